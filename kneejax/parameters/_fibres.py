"""A quantity of the fibres of a knee, read and written.

A structure drawn as several fibres is a group of them. Its stiffness and its damping are the sums
over its fibres, which act side by side; of any other quantity its value is the mean. Setting a
value keeps how the fibres differ: strains and points shift together, anything else is scaled by one
factor.
"""

from __future__ import annotations

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.geometry import FEMUR, PATELLA, TIBIA
from kneejax.mechanics import Knee, ligament_law
from kneejax.numerics import numpy_for
from kneejax.parameters._leaves import AXES

#: Ends of a ligament, by the bones that they are on.
BONES = {
    "femoral_attachment": FEMUR,
    "tibial_attachment": TIBIA,
    "patellar_attachment": PATELLA,
}
#: Quantities of a ligament that may be named, with their units.
QUANTITIES = {
    "stiffness": "N",
    "reference_strain": "",
    "slack_length": "mm",
    "transition_strain": "",
    "transition_width": "",
    "failure_strain": "",
    "damping": "N s",
} | {f"{end}.{axis}": "mm" for end in BONES for axis in AXES}
#: Of these a structure's value is the sum over its fibres, of all others the mean.
SUMMED = ("stiffness", "damping")


def value_of(numbers: Array, rows: tuple[int, ...], quantity: str) -> Array:
    """The value of a structure.

    Args:
        numbers: the quantity of every fibre, from `numbers_of`.
        rows: of the structure's fibres.
        quantity: decides between sum and mean.
    """
    xp = numpy_for(numbers)
    return (xp.sum if quantity in SUMMED else xp.mean)(xp.asarray(numbers)[np.array(rows)])


def numbers_of(knee: Knee, quantity: str) -> Array:
    """A quantity of every fibre."""
    fibres = knee.ligaments
    if quantity == "reference_strain":
        both = knee.reference_length(), fibres.slack_length
        length, slack = map(numpy_for(both).asarray, both)
        return length / slack - 1.0
    end, _, axis = quantity.partition(".")
    if not axis:
        return getattr(fibres, quantity)
    column, first = AXES.index(axis), _is_first(knee, end)
    both = fibres.femoral_attachment, fibres.tibial_attachment
    xp = numpy_for(both)
    ends = [xp.asarray(points)[:, column] for points in both]
    if first.all() or not first.any():
        return ends[not first.any()]
    return xp.where(first.reshape(-1, *(1,) * (ends[0].ndim - 1)), *ends)


def _is_first(knee: Knee, end: str) -> np.ndarray:
    """Whether the bone of an end is the first of the two that each fibre joins, `(fibres,)`."""
    return np.array([pair[0] == BONES[end] for pair in knee.ligaments.bodies])


def write_value(knee: Knee, rows: tuple[int, ...], quantity: str, value: Array) -> Knee:
    """The knee in which a structure has a value.

    Args:
        knee: any knee.
        rows: of the structure's fibres.
        quantity: any of `QUANTITIES` but `reference_strain` (see `strained`).
        value: sum or mean, as `value_of` reads it.
    """
    end, _, axis = quantity.partition(".")
    if quantity in SUMMED:
        value = value / len(rows)
    old, own = numbers_of(knee, quantity), _rows_of(knee, rows)
    changed = _shared(old, rows, value, shifts=bool(axis))
    xp = numpy_for(knee, changed)
    if not axis:
        return _with(knee, quantity, xp.where(own, changed, old))
    column, first = np.arange(len(AXES)) == AXES.index(axis), _is_first(knee, end)
    for field, at in (("femoral_attachment", first), ("tibial_attachment", ~first)):
        place = (own & at)[:, None] & column
        if place.any():
            array = getattr(knee.ligaments, field)
            knee = _with(knee, field, xp.where(place, changed[:, None], array))
    return knee


def _with(knee: Knee, field: str, values: Array) -> Knee:
    return eqx.tree_at(lambda k: getattr(k.ligaments, field), knee, jnp.asarray(values))


def strained(knee: Knee, strains: Sequence[tuple[tuple[int, ...], Array]]) -> Knee:
    """The knee with reference strains of some fibres, by their rows.

    Lengths are asked for once: each way around an obstacle is a search, and no compiler sees that
    two searches are one.
    """
    both = knee.reference_length(), knee.ligaments.slack_length
    length, slack = map(numpy_for(both).asarray, both)
    for rows, value in strains:
        strain = _shared(length / slack - 1.0, rows, value, shifts=True)
        changed = ligament_law.slack_length_from_strain(length, strain)
        slack = numpy_for(changed, slack).where(_rows_of(knee, rows), changed, slack)
    return _with(knee, "slack_length", slack)


def _shared(old: Array, rows: tuple[int, ...], value: Array, shifts: bool) -> Array:
    """Numbers of all fibres, changed so that the mean of some becomes a value.

    Each number is computed from its own and picked by a mask: what was gathered, changed and
    scattered in lanes aborted XLA 0.10 (a check of its fused kernels).
    """
    xp = numpy_for(old, value)
    if len(rows) == 1:
        return xp.broadcast_to(value, old.shape)
    own = np.isin(np.arange(len(old)), rows)
    old = xp.asarray(old)
    mean = xp.sum(xp.where(own, old, 0.0)) / len(rows)
    if shifts:
        return old + (value - mean)
    # Fibres that have nothing yet (no damping, cut) share alike.
    nothing = mean == 0.0
    return xp.where(nothing, value, old * (value / xp.where(nothing, 1.0, mean)))


def _rows_of(knee: Knee, rows: tuple[int, ...]) -> np.ndarray:
    """Which fibres these are, `(fibres,)`."""
    return np.isin(np.arange(len(knee.ligaments.names)), rows)
