"""Named parameters of a knee, and the vector that a search moves.

A parameter belongs to a fibre, to a structure drawn as several fibres (a group), or to another
part; `_numbers.py` says what its value means.
"""

__all__ = ["Selection", "UnknownParameter", "UnsuitableData", "fibre_rows", "select"]

import dataclasses
import functools
import re
from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.mechanics import Knee
from kneejax.numerics import numpy_for, traced
from kneejax.parameters import _numbers as numbers
from kneejax.parameters._numbers import BONES, OF_STRAIN, Leaf, parts_of
from kneejax.quantities import AXES, BAND_QUANTITIES, FIBRE_QUANTITIES, nearest_name, quantity_of

_MOST_SHOWN = 12  # names in an error
#: Quantity -> the one whose numbers it sets, where that has another name.
_WRITES = dict.fromkeys(OF_STRAIN, "slack_length") | {"youngs_modulus": "stiffness"}
_LONG_NAME = re.compile(r"(?<=')([^']{60})[^']{3,}(?=')")


class _Refused(ValueError):
    """A sentence for the person who gave a name or data: names in quotes end after 60 letters."""

    def __init__(self, sentence: object = ""):
        super().__init__(_LONG_NAME.sub(r"\1...", str(sentence)))


class UnknownParameter(_Refused):
    """A parameter name that the knee does not have.

    Example:
        >>> import kneejax as kj
        >>> try:
        ...     kj.select(kj.load_knee("four_ligament"), ["ACL.stifness"])
        ... except UnknownParameter as error:
        ...     print("stiffness" in str(error))
        True
    """


class UnsuitableData(_Refused):
    """Data, bounds or options with which no calibration can begin."""


@dataclasses.dataclass(frozen=True)
class Selection:
    """Parameters that are free, in order; hashable, so that it can steer a compiled function.

    Attributes:
        names: `LIGAMENT.quantity`, `GROUP.quantity` or `PART.quantity`, one per free number.
        ligaments: names of the knee's ligaments.
        groups: names that stand for several ligaments, with those.
        leaves: names of parameters of other parts, with the numbers that they mean.

    Example:
        >>> from kneejax.parameters import Selection
        >>> Selection(("ACL.stiffness",), ("ACL", "PCL")).quantity(0)
        'stiffness'
    """

    names: tuple[str, ...]
    ligaments: tuple[str, ...]
    groups: tuple[tuple[str, tuple[str, ...]], ...] = ()
    leaves: tuple[tuple[str, Leaf], ...] = ()

    def __len__(self) -> int:
        return len(self.names)

    def __str__(self) -> str:
        return f"{len(self)} free number{'s' * (len(self) != 1)}: " + ", ".join(self.names)

    def ligament(self, index: int) -> str:
        """Name of the ligament, of the group or of another part, of a parameter."""
        return self.names[index].split(".", 1)[0]

    def fibres(self, index: int) -> tuple[str, ...]:
        """The ligaments that a parameter drives; none where it is another part's."""
        name = self.ligament(index)
        return () if self.leaf(index) else dict(self.groups).get(name, (name,))

    def leaf(self, index: int) -> Leaf | None:
        """The number that a parameter means, where it is no ligament's."""
        return dict(self.leaves).get(self.names[index])

    def quantity(self, index: int) -> str:
        """Quantity of a parameter, e.g. `stiffness`."""
        return self.names[index].split(".", 1)[1]

    def unit(self, index: int) -> str:
        """Unit of a parameter, empty for a plain number."""
        return quantity_of(self.quantity(index)).unit

    def numbers(self, index: int) -> Mapping[Any, str]:
        """The numbers that a parameter drives -> what each is, in words."""
        quantity = _WRITES.get(self.quantity(index), self.quantity(index))
        words = quantity.replace("_", " ").replace(".", " ")
        own = {(fibre, quantity): f"{words} of {fibre}" for fibre in self.fibres(index)}
        return own or {self.leaf(index): self.names[index]}

    def read(self, knee: Knee) -> Array:
        """Values of the free parameters in a knee, shape `(p,)`."""
        # Every quantity once, of all fibres.
        every, each = functools.cache(lambda quantity: numbers.numbers_of(knee, quantity)), []
        for i in range(len(self)):
            leaf, (rows, own) = self.leaf(i), self._place(i)
            each.append(leaf.read(knee) if leaf else numbers.value_of(every(own), rows, own))
        return jnp.asarray(numpy_for(each).stack(each), float)

    def apply(self, knee: Knee, values: Array) -> Knee:
        """The knee with new values of the free parameters.

        Reference strains and prestretches are turned into slack lengths at the reference pose,
        after attachments have been moved.

        Args:
            knee: any knee with these ligaments.
            values: shape `(p,)`.
        """
        strains, values = [], numpy_for(values).asarray(values)
        for i in range(len(self)):
            leaf = self.leaf(i)
            if leaf is not None:
                knee = leaf.write(knee, values[i])
            elif self.quantity(i) in OF_STRAIN:
                strains.append((self._place(i)[0], values[i] - OF_STRAIN[self.quantity(i)]))
            else:
                knee = numbers.write_value(knee, *self._place(i), values[i])
        return numbers.strained(knee, strains) if strains else knee

    def _place(self, index: int) -> tuple[tuple[int, ...], str]:
        rows = tuple(self.ligaments.index(fibre) for fibre in self.fibres(index))
        return rows, self.quantity(index)


def select(knee: Knee, names: list[str] | tuple[str, ...]) -> Selection:
    """Choose free parameters by name.

    Args:
        knee: the knee that has them.
        names: `LIGAMENT.quantity`, `GROUP.quantity`, or the same of any other part: of a
            compartment (`medial.youngs_modulus`, `medial.tibial_surface.superior`), of a line
            (`quadriceps.tension`), of what a fibre wraps around (`PatTen.radius`, one number for
            all fibres around the same), or whatever else its fields lead to. `*` stands for every
            part that has the quantity (`*.stiffness`); a name that leads to several numbers
            (`ACL.femoral_attachment`) for all of them. A group is a structure drawn as several
            fibres: its stiffness and damping are the sums over its fibres, any other value is
            their mean; setting it keeps how they differ.

    Returns:
        The selection.

    Raises:
        UnknownParameter: naming the nearest known name; also if one number is chosen twice.

    Example:
        >>> import kneejax as kj
        >>> knee = kj.load_knee("four_ligament")
        >>> kj.select(knee, ["PCL.stiffness", "ACL.stiffness"]).names
        ('PCL.stiffness', 'ACL.stiffness')
    """
    ligaments, chosen = knee.ligaments.names, {}
    fibres = (*ligaments, *(name for name, _ in knee.groups))
    for name in names:
        owner, _, quantity = name.partition(".")
        found: dict[str, Leaf | None] = {}
        for part in (*ligaments, *parts_of(knee)) if owner == "*" else [owner]:
            found |= _numbers_called(knee, part, quantity, part in fibres)
        if not found:
            raise UnknownParameter(f"unknown parameter {name!r}{_meant(knee, owner, quantity)}")
        chosen |= {key: leaf for key, leaf in found.items() if key not in chosen}
    leaves = tuple((name, leaf) for name, leaf in chosen.items() if leaf is not None)
    selection = Selection(tuple(chosen), ligaments, knee.groups, leaves)
    _check_once(selection)
    return _one(selection)


def _numbers_called(
    knee: Knee, owner: str, quantity: str, is_fibre: bool
) -> dict[str, Leaf | None]:
    """Names of single numbers that a name stands for; with the number where it is no ligament's."""
    known = _quantities_of_fibres(knee, owner) if is_fibre else ()
    if quantity in known:
        return {f"{owner}.{quantity}": None}
    if f"{quantity}.{AXES[0]}" in known:
        return {f"{owner}.{quantity}.{axis}": None for axis in AXES}
    leaves = numbers.leaves_called(knee, owner, quantity)
    return {f"{owner}.{end}": leaf for end, leaf in leaves.items()}


def _quantities_of_fibres(knee: Knee, name: str) -> tuple[str, ...]:
    """Quantities of a ligament or of a group: of attachments, those to the bones that it joins."""
    rows, area = fibre_rows(knee, name), knee.ligaments.area
    is_band = traced(area) or bool(np.all(np.asarray(area)[rows] > 0.0))
    known = [x for x in FIBRE_QUANTITIES if is_band or x not in BAND_QUANTITIES]
    pairs = [knee.ligaments.bodies[row] for row in rows]
    absent = {end for end, bone in BONES.items() if any(bone not in pair for pair in pairs)}
    return tuple(x for x in known if x.split(".")[0] not in absent)


def _meant(knee: Knee, owner: str, quantity: str) -> str:
    """The end of a sentence on a parameter that there is not: the nearest that there is, or which
    there are of the part that is wrong."""
    fibres = (*knee.ligaments.names, *(name for name, _ in knee.groups))
    owners = tuple(dict.fromkeys((*fibres, *parts_of(knee))))
    near_owner = owner if owner == "*" else nearest_name(owner, owners)
    if owner in fibres and quantity.split(".")[0] in BONES:
        joined = {bone for row in fibre_rows(knee, owner) for bone in knee.ligaments.bodies[row]}
        if BONES[quantity.split(".")[0]] not in joined:
            ends = " and ".join(end for end, bone in BONES.items() if bone in joined)
            return f": {owner} joins {' and '.join(sorted(joined))}; its ends are {ends}"
    known: tuple[str, ...] = FIBRE_QUANTITIES if near_owner == "*" else ()
    if near_owner in fibres:
        known = _quantities_of_fibres(knee, near_owner)
    quantities = (*known, *numbers.quantities_of(knee, near_owner or ""))
    near_quantity = nearest_name(quantity, quantities)
    if near_owner and near_quantity:
        return f"; did you mean {f'{near_owner}.{near_quantity}'!r}?"
    if near_owner:
        return f": expected {near_owner}. and one of {', '.join(quantities)}"
    shown = [*owners[:_MOST_SHOWN], *["..."] * (len(owners) > _MOST_SHOWN)]
    return f": expected a ligament, a group or a part of the knee, of {', '.join(shown) or 'none'}"


@functools.cache
def _one(selection: Selection) -> Selection:
    """The same choice is the same object: its bound methods, which steer compiled functions, are
    equal only then."""
    return selection


def _check_once(selection: Selection) -> None:
    """No number may be driven by two parameters."""
    driven: dict[Any, str] = {}
    for i, name in enumerate(selection.names):
        for number in selection.numbers(i):
            if (other := driven.setdefault(number, name)) != name:
                of = f" (of {number[0]})" if selection.fibres(i) else ""
                raise UnknownParameter(f"{other} and {name} are one number{of}: choose one")


def fibre_rows(knee: Knee, name: str) -> list[int]:
    """Rows of the fibres of a ligament or of a group.

    Args:
        knee: any knee.
        name: of a fibre or of a group.

    Raises:
        UnknownParameter: naming the nearest ligament or group.

    Example:
        >>> from kneejax.files import load_knee
        >>> fibre_rows(load_knee("four_ligament"), "ACL")
        [0]
    """
    fibres = knee.ligaments.names
    groups = {**{own: (own,) for own in fibres}, **dict(knee.groups)}
    if name not in groups:
        near = nearest_name(name, groups)
        end = f"; did you mean {near!r}?" if near else f": expected one of {', '.join(groups)}"
        raise UnknownParameter(f"knee {knee.name!r} has no ligament {name!r}{end}")
    return [fibres.index(fibre) for fibre in groups[name]]
