"""Numbers of compartments, lines, muscles, loads and wraps by name: any leaf of a knee.

A name leads from a part through its fields to one number: `medial.youngs_modulus`,
`medial.tibial_surface.superior`, `quadriceps.tension`, `PatTen.radius`. Fields are those of the
part's own class; what they are called in a laboratory stands in `_ALSO_CALLED`.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.mechanics import Knee
from kneejax.numerics import numpy_for, traced

#: Components of points and directions.
AXES = ("anterior", "superior", "lateral")
#: Field of a part -> its fields in the class.
_ALSO_CALLED = {
    "femoral_surface": "femoral.frame.origin",
    "tibial_surface": "tibial.frame.origin",
    "wrap": "obstacle.frame.origin",
    "radius": "obstacle.radius",
    "semi_axes": "obstacle.semi_axes",
}
_OF_MUSCLES = {"origin": "femoral_attachment", "insertion": "tibial_attachment"}
#: Units by the last field that has one.
_UNITS = {
    "youngs_modulus": "MPa",
    "layer_thickness": "mm",
    "onset_width": "mm",
    "tension": "N",
    "insertion": "mm",
    "radius": "mm",
    "length": "mm",
    "semi_axes": "mm",
    "origin": "mm",
    "via": "mm",
    "femoral_surface": "mm",
    "tibial_surface": "mm",
    "wrap": "mm",
    "rotation": "rad",
    "force": "N",
    "moment": "N mm",
    "point": "mm",
}
#: Quantities that have no other sign.
_SIZES = ("youngs_modulus", "layer_thickness", "onset_width", "tension", "radius", "semi_axes",
          "length")  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Leaf:
    """One number of a knee, or all numbers of one array of it; hashable.

    Attributes:
        part: `contacts`, `lines`, `muscles`, `loads` or `courses`.
        row: which of them.
        fields: from the part to the array.
        place: of the number in the array; empty for a number by itself.
    """

    part: str
    row: int
    fields: tuple[str, ...]
    place: tuple[int, ...] = ()

    def array(self, knee: Knee) -> Array:
        """The array in which the number stands."""
        if self.part == "muscles":  # one object; the row stands first in the place
            found: Any = knee.muscles
        else:
            courses = self.part == "courses"
            found = (knee.ligaments.courses if courses else getattr(knee, self.part))[self.row]
        for field in self.fields:
            found = getattr(found, field)
        return found

    def read(self, knee: Knee) -> Array:
        """The number."""
        array = self.array(knee)
        return numpy_for(array).asarray(array)[self.place]

    def write(self, knee: Knee, value: Array) -> Knee:
        """The knee with another number there."""
        array = self.array(knee)
        if traced(array, value):
            changed = jnp.asarray(array, float).at[self.place].set(value)
        else:
            changed = np.array(array, float)
            changed[self.place] = value
        return eqx.tree_at(self.array, knee, jnp.asarray(changed))


def parts_of(knee: Knee) -> dict[str, list[tuple[str, int]]]:
    """Name of a part -> its places in the knee; a fibre's is the course that it runs in."""
    found: dict[str, list[tuple[str, int]]] = {}
    for part, names in (
        ("contacts", knee.contact_names),
        ("lines", [line.name for line in knee.lines]),
        ("muscles", knee.muscles.names if knee.muscles is not None else ()),
        ("loads", [getattr(load, "name", "") for load in knee.loads]),
    ):
        for row, name in enumerate(names):
            found.setdefault(name, []).append((part, row))
    for row, course in enumerate(knee.ligaments.courses):
        for fibre in course.rows:
            found.setdefault(knee.ligaments.names[fibre], []).append(("courses", row))
    return found


def leaves_called(knee: Knee, owner: str, quantity: str) -> dict[str, Leaf]:
    """The numbers that a name means.

    Args:
        knee: that has them.
        owner: name of a part.
        quantity: fields and components, with dots between them.

    Returns:
        Quantity -> number: one, or each component where the name stands for a whole array; empty
        where the part has no such number.
    """
    for part, row in parts_of(knee).get(owner, []):
        words = quantity.split(".")
        fields = tuple(_ALSO_CALLED.get(words[0], words[0]).split("."))
        if part == "muscles":
            fields = (_OF_MUSCLES.get(words[0], words[0]),)
        if part != "courses" and words[0] in ("wrap", "radius", "semi_axes"):
            fields = (words[0],)
        found = _descended(Leaf(part, row, ()), (*fields, *words[1:]), knee)
        if found is not None:
            return {quantity + end: leaf for end, leaf in _components(found, knee).items()}
    return {}


def quantities_of(knee: Knee, owner: str) -> tuple[str, ...]:
    """What may be named of a part besides what every ligament has, for advice."""
    common = {
        "contacts": ("youngs_modulus", "poisson_ratio", "layer_thickness", "onset_width",
                     "femoral_surface", "tibial_surface"),
        "lines": ("tension", "insertion", "origin"),
        "muscles": ("tension", "insertion", "origin"),
        "loads": ("force", "moment", "point"),
        "courses": ("radius", "semi_axes", "wrap"),
    }  # fmt: skip
    kinds = [part for part, _ in parts_of(knee).get(owner, [])]
    names = (name for kind in kinds for name in common[kind])
    return tuple(name for name in names if leaves_called(knee, owner, name))


def unit_of(quantity: str) -> str:
    """The unit of a quantity, empty for a plain number."""
    known = [word for word in quantity.split(".") if word in _UNITS]
    return _UNITS[known[-1]] if known else ""


def is_size(quantity: str) -> bool:
    """Whether a quantity is a size, which may not fall below zero, and no place."""
    return quantity.split(".")[-1] in _SIZES or quantity.split(".")[0] in _SIZES


def _descended(leaf: Leaf, words: tuple[str, ...], knee: Knee) -> Leaf | None:
    """The number or array that words lead to from a part."""
    found = leaf.array(knee)
    for count, word in enumerate(words):
        if isinstance(found, jax.Array | np.ndarray):
            return _at(leaf, words[count:], found)
        known = dataclasses.fields(found) if isinstance(found, eqx.Module) else ()
        if word not in [field.name for field in known]:
            return None
        found = getattr(found, word)
        leaf = dataclasses.replace(leaf, fields=(*leaf.fields, word))
        if leaf.part == "muscles":
            if not isinstance(found, jax.Array | np.ndarray):
                return None
            leaf, found = dataclasses.replace(leaf, place=(leaf.row,)), found[leaf.row]
    return leaf if isinstance(found, jax.Array | np.ndarray) else None


def _at(leaf: Leaf, words: tuple[str, ...], array: Array) -> Leaf | None:
    """A component of an array, by its number or the name of its axis."""
    place = []
    for size, word in zip(array.shape, words, strict=False):
        if word in AXES and size == len(AXES):
            place.append(AXES.index(word))
        elif word.isdigit() and int(word) < size:
            place.append(int(word))
        else:
            return None
    too_many = len(words) > array.ndim
    return None if too_many else dataclasses.replace(leaf, place=(*leaf.place, *place))


def _components(leaf: Leaf, knee: Knee) -> dict[str, Leaf]:
    """The number itself, or all of an array by the ends of their names."""
    rest = leaf.array(knee).shape[len(leaf.place) :]
    found = {}
    for place in np.ndindex(*rest):
        last = len(rest) - 1
        words = [
            AXES[k] if axis == last and rest[axis] == len(AXES) else str(k)
            for axis, k in enumerate(place)
        ]
        end = "".join(f".{word}" for word in words)
        found[end] = dataclasses.replace(leaf, place=(*leaf.place, *place))
    return found
