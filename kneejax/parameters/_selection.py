"""Named parameters of a knee, and the vector that a search moves.

A parameter belongs to a ligament or to a group of them. A group's value is the mean of its fibres.
Setting it keeps how the fibres differ: strains and points shift together, stiffnesses, lengths and
the law's own strains grow by one factor.
"""

from __future__ import annotations

import dataclasses
import difflib
import functools
from collections.abc import Iterable, Mapping, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.mechanics import (
    Implausible,
    Knee,
    at_reference,
    check_fibres,
    ligament_law,
    range_of_parameter,
)

#: Quantities of a ligament that may be named, with their units.
QUANTITIES = {
    "stiffness": "N",
    "reference_strain": "",
    "slack_length": "mm",
    "transition_strain": "",
    "transition_width": "",
    "failure_strain": "",
} | {
    f"{end}_attachment.{axis}": "mm"
    for end in ("femoral", "tibial")
    for axis in ("anterior", "superior", "lateral")
}
#: Bounds of paper 1, section 2.3, and wide ones for the rest, by quantity.
DEFAULT_BOUNDS = {
    "stiffness": (300.0, 10000.0),
    "reference_strain": (-0.2, 0.2),
    "slack_length": (5.0, 200.0),
    "transition_strain": (0.005, 0.2),
    "transition_width": (1e-4, 0.02),
    "failure_strain": (0.05, 0.5),
}
_AXES = ("anterior", "superior", "lateral")
_MOST_SHOWN = 12  # names in an error


class UnknownParameter(ValueError):
    """A parameter name that the knee does not have."""


class UnsuitableData(ValueError):
    """Data, bounds or options with which no calibration can begin."""


@dataclasses.dataclass(frozen=True)
class Selection:
    """Parameters that are free, in order; hashable, so that it can steer a compiled function.

    Attributes:
        names: `LIGAMENT.quantity` or `GROUP.quantity`, one a free number.
        ligaments: names of the knee's ligaments.
        groups: names that stand for several ligaments, with those.

    Example:
        >>> from kneejax.parameters import Selection
        >>> Selection(("ACL.stiffness",), ("ACL", "PCL")).quantity(0)
        'stiffness'
    """

    names: tuple[str, ...]
    ligaments: tuple[str, ...]
    groups: tuple[tuple[str, tuple[str, ...]], ...] = ()

    def __len__(self) -> int:
        return len(self.names)

    def __str__(self) -> str:
        return f"{len(self)} free number{'s' * (len(self) != 1)}: " + ", ".join(self.names)

    def ligament(self, index: int) -> str:
        """Name of the ligament, or of the group, of a parameter."""
        return self.names[index].split(".", 1)[0]

    def fibres(self, index: int) -> tuple[str, ...]:
        """The ligaments that a parameter drives."""
        name = self.ligament(index)
        return dict(self.groups).get(name, (name,))

    def quantity(self, index: int) -> str:
        """Quantity of a parameter, e.g. `stiffness`."""
        return self.names[index].split(".", 1)[1]

    def read(self, knee: Knee) -> Array:
        """Values of the free parameters in a knee, shape `(p,)`."""
        quantities = list(dict.fromkeys(map(self.quantity, range(len(self)))))
        # Every quantity once, of all fibres.
        numbers = jnp.stack([_numbers(knee, quantity) for quantity in quantities])
        places = [self._place(i) for i in range(len(self))]
        kinds = [quantities.index(quantity) for _, quantity in places]
        if all(len(rows) == 1 for rows, _ in places):
            return numbers[np.array(kinds), np.array([rows[0] for rows, _ in places])]
        pairs = zip(kinds, places, strict=True)
        return jnp.stack([jnp.mean(numbers[kind][np.array(rows)]) for kind, (rows, _) in pairs])

    def apply(self, knee: Knee, values: Array) -> Knee:
        """The knee with new values of the free parameters.

        Reference strains are turned into slack lengths at the reference pose, after attachments
        have been moved.

        Args:
            knee: any knee with these ligaments.
            values: shape `(p,)`.
        """
        order = sorted(range(len(self)), key=lambda i: self.quantity(i) == "reference_strain")
        for i in order:
            knee = _write(knee, *self._place(i), values[i])
        return knee

    def _place(self, index: int) -> tuple[tuple[int, ...], str]:
        rows = tuple(self.ligaments.index(fibre) for fibre in self.fibres(index))
        return rows, self.quantity(index)


def select(knee: Knee, names: list[str] | tuple[str, ...]) -> Selection:
    """Choose free parameters by name.

    Args:
        knee: the knee that has them.
        names: `LIGAMENT.quantity`, or `GROUP.quantity`; `*` stands for every ligament
            (`*.stiffness`).

    Returns:
        The selection.

    Raises:
        UnknownParameter: naming the nearest known name; also if one number is chosen twice.
    """
    ligaments, chosen = knee.ligaments.names, []
    owners = (*ligaments, *(name for name, _ in knee.groups))
    for name in names:
        owner, _, quantity = name.partition(".")
        if quantity not in QUANTITIES or owner not in ("*", *owners):
            raise UnknownParameter(f"unknown parameter {name!r}{_meant(owner, quantity, owners)}")
        matches = [f"{ligament}.{quantity}" for ligament in ligaments] if owner == "*" else [name]
        chosen += [match for match in matches if match not in chosen]
    selection = Selection(tuple(chosen), ligaments, knee.groups)
    _check_once(selection)
    return _one(selection)


def _meant(owner: str, quantity: str, owners: Sequence[str]) -> str:
    """The end of a sentence on a parameter that there is not: the nearest that there is, or which
    there are of the part that is wrong."""
    near_owner = owner if owner == "*" else nearest_of(owner, owners)
    near_quantity = nearest_of(quantity, QUANTITIES)
    if near_owner and near_quantity:
        return f"; did you mean {f'{near_owner}.{near_quantity}'!r}?"
    if near_owner:
        return f": expected {near_owner}. and one of {', '.join(QUANTITIES)}"
    shown = [*owners[:_MOST_SHOWN], *["..."] * (len(owners) > _MOST_SHOWN)]
    return f": expected a ligament or a group of the knee, of {', '.join(shown) or 'none'}"


def nearest_of(word: str, known: Iterable[str]) -> str | None:
    """The one of some names that a word may be meant to be; None if it is like none of them."""
    by_lower = {name.lower(): name for name in known}
    near = difflib.get_close_matches(word.lower(), by_lower, 1)
    return by_lower[near[0]] if near else None


@functools.cache
def _one(selection: Selection) -> Selection:
    """The same choice is the same object: its bound methods, which steer compiled functions, are
    equal only then."""
    return selection


def _check_once(selection: Selection) -> None:
    """No number of a fibre may be driven by two parameters."""
    driven: dict[tuple[str, str], str] = {}
    for i, name in enumerate(selection.names):
        # Either gives the slack length.
        quantity = selection.quantity(i).replace("reference_strain", "slack_length")
        for fibre in selection.fibres(i):
            other = driven.setdefault((fibre, quantity), name)
            if other != name:
                raise UnknownParameter(
                    f"{other} and {name} are one number (of {fibre}): choose one"
                )


def with_values(knee: Knee, values: dict[str, float]) -> Knee:
    """The knee with some parameters set by name.

    Args:
        knee: any knee.
        values: `LIGAMENT.quantity`, `GROUP.quantity` or `*.quantity` -> value.

    Raises:
        UnknownParameter: the knee has no such parameter.
        Implausible: a value that no knee has (`kneejax.mechanics.RANGES`), or one that leads to
            such a knee, as in a knee file.
    """
    for name, value in values.items():
        selection, allowed = select(knee, [name]), range_of_parameter(name)
        if allowed and not allowed.holds(value):
            owner, quantity = name.split(".", 1)
            raise Implausible(owner, quantity, f"{value:g}", allowed.expected(value))
        knee = selection.apply(knee, jnp.full(len(selection), float(value)))
    if values:
        check_fibres(knee.ligaments, *at_reference(knee.ligaments, knee.reference_pose))
    return knee


def cut(knee: Knee, names: Sequence[str]) -> Knee:
    """The same knee with some ligaments cut: they neither pull nor tear.

    Args:
        knee: any knee.
        names: of ligaments, or of groups of them.

    Raises:
        UnknownParameter: naming the nearest ligament or group.

    Example:
        >>> import kneejax as kj
        >>> cut(kj.load_knee("four_ligament"), ["ACL"]).ligaments.stiffness.tolist()[0]
        0.0
    """
    fibres = knee.ligaments.names
    groups = {**{name: (name,) for name in fibres}, **dict(knee.groups)}
    for name in names:
        if name not in groups:
            near = nearest_of(name, groups)
            end = f"; did you mean {near!r}?" if near else f": expected one of {', '.join(groups)}"
            raise UnknownParameter(f"unknown ligament {name!r}{end}")
    gone = {fibre for name in names for fibre in groups[name]}
    torn = np.array([fibre in gone for fibre in fibres])
    law = knee.ligaments.stiffness, knee.ligaments.failure_strain
    ends = jnp.where(torn, 0.0, law[0]), jnp.where(torn, jnp.inf, law[1])
    return eqx.tree_at(
        lambda k: (k.ligaments.stiffness, k.ligaments.failure_strain), knee, ends
    )


def default_bounds(knee: Knee, selection: Selection) -> tuple[Array, Array]:
    """Lower and upper bounds of a selection; attachments may move by 10 mm."""
    values = selection.read(knee)
    pairs = [
        DEFAULT_BOUNDS.get(selection.quantity(i), (float(values[i]) - 10, float(values[i]) + 10))
        for i in range(len(selection))
    ]
    return jnp.array([p[0] for p in pairs]), jnp.array([p[1] for p in pairs])


def stated_bounds(
    knee: Knee, selection: Selection, given: Mapping[str, tuple[float, float]]
) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of a selection: those that are stated, default ones for the rest.

    Args:
        knee: gives the middle of default bounds of attachments.
        selection: the parameters.
        given: quantity, `*.quantity` or name -> lower and upper bound; the last of these counts.

    Returns:
        Lower and upper bounds, `(p,)` each.

    Raises:
        UnsuitableData: bounds that are reversed, equal or not finite.
    """
    lower, upper = (np.array(b) for b in default_bounds(knee, selection))
    for i, name in enumerate(selection.names):
        quantity = selection.quantity(i)
        for key in (quantity, f"*.{quantity}", name):
            if key in given:
                lower[i], upper[i] = given[key]
        if not (np.isfinite([lower[i], upper[i]]).all() and lower[i] < upper[i]):
            raise UnsuitableData(
                f"{name}: bounds {lower[i]:g} to {upper[i]:g}: expected lower below upper"
            )
    return lower, upper


def start_within(
    knee: Knee, selection: Selection, lower: np.ndarray, upper: np.ndarray
) -> np.ndarray:
    """The knee's own values, `(p,)`; raises `UnsuitableData` where bounds exclude one."""
    start = np.asarray(selection.read(knee))
    for name, value, low, high in zip(selection.names, start, lower, upper, strict=True):
        if not low <= value <= high:
            raise UnsuitableData(f"{name}: bounds {low:g} to {high:g} exclude the start {value:g}")
    return start


def _read(knee: Knee, rows: tuple[int, ...], quantity: str) -> Array:
    return jnp.mean(jnp.stack([_numbers(knee, quantity)[row] for row in rows]))


def _numbers(knee: Knee, quantity: str) -> Array:
    """A quantity of every fibre."""
    if quantity == "reference_strain":
        return knee.reference_strain()
    if "." in quantity:
        end, axis = quantity.split(".")
        return getattr(knee.ligaments, end)[:, _AXES.index(axis)]
    return getattr(knee.ligaments, quantity)


def _write(knee: Knee, rows: tuple[int, ...], quantity: str, value: Array) -> Knee:
    if len(rows) == 1:
        values = [value]
    else:
        old = [_numbers(knee, quantity)[row] for row in rows]
        mean = _read(knee, rows, quantity)
        shifts = quantity == "reference_strain" or "." in quantity
        values = [x + (value - mean) if shifts else x * (value / mean) for x in old]
    for row, x in zip(rows, values, strict=True):
        knee = _write_one(knee, row, quantity, x)
    return knee


def _write_one(knee: Knee, row: int, quantity: str, value: Array) -> Knee:
    field, index = quantity, row
    if quantity == "reference_strain":
        field = "slack_length"
        value = ligament_law.slack_length_from_strain(knee.reference_length()[row], value)
    elif "." in quantity:
        field, axis = quantity.split(".")
        index = (row, _AXES.index(axis))
    changed = getattr(knee.ligaments, field).at[index].set(value)
    return eqx.tree_at(lambda k: getattr(k.ligaments, field), knee, changed)
