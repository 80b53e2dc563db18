"""Numbers of compartments, lines, muscles, loads and wraps by name: any leaf of a knee.

A name leads from a part through its fields to one number: `medial.youngs_modulus`,
`medial.tibial_surface.superior`, `quadriceps.tension`, `PatTen.radius`. Fields are those of the
part's own class, or as `kneejax.quantities` calls them.
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
from kneejax.quantities import AXES, QUANTITIES

#: Kind of part -> what it is called in a knee.
_PARTS = {
    "contacts": "contact",
    "lines": "line",
    "muscles": "muscle",
    "loads": "load",
    "courses": "obstacle",
}


@dataclasses.dataclass(frozen=True)
class Leaf:
    """One number of a knee, or all numbers of one array of it; hashable."""

    part: str  # `contacts`, `lines`, `muscles`, `loads` or `courses`
    row: int  # which of them
    fields: tuple[str, ...]  # from the part to the array
    place: tuple[int, ...] = ()  # of the number in the array; empty for a number by itself

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
    """The numbers that a name means: quantity -> number, one, or each component where the name
    stands for a whole array; none where the part has no such number."""
    for part, row in parts_of(knee).get(owner, []):
        words = quantity.split(".")
        declared = QUANTITIES.get(words[0])
        fields = tuple((declared.paths if declared else {}).get(_PARTS[part], words[0]).split("."))
        found = _descended(Leaf(part, row, ()), (*fields, *words[1:]), knee)
        if found is not None:
            return {quantity + end: leaf for end, leaf in _components(found, knee).items()}
    return {}


def quantities_of(knee: Knee, owner: str) -> tuple[str, ...]:
    """What may be named of a part besides what every ligament has, for advice."""
    kinds = [_PARTS[part] for part, _ in parts_of(knee).get(owner, [])]
    names = [one.name for kind in kinds for one in QUANTITIES.values() if kind in one.owners]
    return tuple(name for name in names if leaves_called(knee, owner, name))


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
