"""Parameters of structures: fibres and groups of fibres under one name.

A structure drawn as several fibres is a group of them. Its stiffness and its damping are the sums
over its fibres, which act side by side; of any other quantity its value is the mean. Setting a
value keeps how the fibres differ: strains and points shift together, anything else is scaled by one
factor.

A structure's stiffness once was the mean over its fibres: files of that time lack `MEANING`, and a
number of that time that a person gives is doubted.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.mechanics import Knee, ligament_law
from kneejax.numerics import numpy_for
from kneejax.quantities import AXES, PUBLISHED_STIFFNESS, QUANTITIES, quantity_of

#: Ends of a ligament, by the bones that they are on.
BONES = {one.name: one.bone for one in QUANTITIES.values() if one.bone}
#: Quantities that say how a fibre is strained at the reference pose -> their value without strain.
OF_STRAIN = {"reference_strain": 0.0, "prestretch": 1.0}


def value_of(numbers: Array, rows: tuple[int, ...], quantity: str) -> Array:
    """The value of a structure of some fibres, by their rows: sum or mean of `numbers_of`."""
    xp = numpy_for(numbers)
    own = xp.asarray(numbers)[np.array(rows)]
    return (xp.sum if quantity_of(quantity).summed else xp.mean)(own, axis=0)


def numbers_of(knee: Knee, quantity: str) -> Array:
    """A quantity of every fibre."""
    fibres = knee.ligaments
    if quantity in OF_STRAIN:
        both = knee.reference_length(), fibres.slack_length
        length, slack = map(numpy_for(both).asarray, both)
        return length / slack - (1.0 - OF_STRAIN[quantity])
    if quantity == "youngs_modulus":
        both = fibres.stiffness, fibres.area
        stiffness, area = map(numpy_for(both).asarray, both)
        return stiffness / numpy_for(both).where(area > 0.0, area, np.inf)
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
    """The knee in which a structure has a value, as `value_of` reads it, of any quantity but those
    that tell its strain (`strained`)."""
    end, _, axis = quantity.partition(".")
    if quantity_of(quantity).summed:
        value = value / len(rows)
    old, own = numbers_of(knee, quantity), _rows_of(knee, rows)
    changed = _shared(old, own, value, shifts=bool(axis))
    xp = numpy_for(knee, changed)
    if quantity == "youngs_modulus":
        quantity, old = "stiffness", knee.ligaments.stiffness
        changed = changed * knee.ligaments.area
    elif quantity == "area":  # of the same material
        stiffness = numbers_of(knee, "youngs_modulus") * changed
        knee = _with(knee, "stiffness", xp.where(own, stiffness, knee.ligaments.stiffness))
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
    return eqx.tree_at(lambda k: getattr(k.ligaments, field), knee, jnp.asarray(values, float))


def strained(knee: Knee, strains: Sequence[tuple[tuple[int, ...], Array]]) -> Knee:
    """The knee with reference strains of some fibres, by their rows.

    Lengths are asked for once: each way around an obstacle is a search, and no compiler sees that
    two searches are one.
    """
    both = knee.reference_length(), knee.ligaments.slack_length
    length, slack = map(numpy_for(both).asarray, both)
    for rows, value in strains:
        own = _rows_of(knee, rows)
        strain = _shared(length / slack - 1.0, own, value, shifts=True)
        changed = ligament_law.slack_length_from_strain(length, strain)
        slack = numpy_for(changed, slack).where(own, changed, slack)
    return _with(knee, "slack_length", slack)


def _shared(old: Array, own: np.ndarray, value: Array, shifts: bool) -> Array:
    """Numbers of all fibres, changed so that the mean of some becomes a value.

    Each number is computed from its own and picked by a mask: what was gathered, changed and
    scattered in lanes aborted XLA 0.10 (a check of its fused kernels).
    """
    xp = numpy_for(old, value)
    if own.sum() == 1:
        return xp.broadcast_to(value, old.shape)
    old = xp.asarray(old)
    mean = xp.sum(xp.where(own, old, 0.0)) / own.sum()
    if shifts:
        return old + (value - mean)
    # Fibres that have nothing yet (no damping, cut) share alike.
    nothing = mean == 0.0
    return xp.where(nothing, value, old * (value / xp.where(nothing, 1.0, mean)))


def _rows_of(knee: Knee, rows: tuple[int, ...]) -> np.ndarray:
    """Which fibres these are, `(fibres,)`."""
    return np.isin(np.arange(len(knee.ligaments.names)), rows)


#: What a file with values by parameter says of itself, field and value.
MEANING = {"stiffness_of": "structure"}
#: A structure of several fibres is sought from a quarter to four times its own stiffness, wider
#: where what is published of that ligament is.
_TIMES = 4.0
#: A prior that is narrower than this part of a structure's stiffness may be that of one fibre.
_NARROW = 0.05


class DoubtfulValue(UserWarning):
    """A value that is probably not what was meant."""


class Assumption(UserWarning):
    """What was taken to be so of what a file or a study does not say, in a sentence."""


def fibres_summed(knee: Knee, name: str) -> int:
    """Number of fibres over which a parameter's value is a sum.

    Args:
        knee: any knee.
        name: `LIGAMENT.quantity`, `GROUP.quantity`, ...

    Returns:
        1 for a fibre, for a mean, and for parameters of other parts.

    Example:
        >>> import kneejax as kj
        >>> knee = kj.load_knee("lenhart2015_reduced")
        >>> [fibres_summed(knee, f"MCL.{x}") for x in ("stiffness", "slack_length")]
        [3, 1]
    """
    owner, _, quantity = name.partition(".")
    return len(dict(knee.groups).get(owner, (owner,))) if quantity_of(quantity).summed else 1


def sums_in_words(knee: Knee | None, names: Sequence[str]) -> str:
    """Which parameters are sums over fibres, as a sentence; empty where none is.

    Args:
        knee: that has the parameters; None where there is none.
        names: of the parameters.

    Example:
        >>> import kneejax as kj
        >>> knee = kj.load_knee("lenhart2015_reduced")
        >>> sums_in_words(knee, ["MCL.stiffness", "LCL.stiffness", "MCL.slack_length"])
        'Sums over the fibres of a structure: MCL.stiffness (3 fibres).'
    """
    counts = {} if knee is None else {name: fibres_summed(knee, name) for name in names}
    summed = [f"{name} ({count} fibres)" for name, count in counts.items() if count > 1]
    return f"Sums over the fibres of a structure: {', '.join(summed)}." if summed else ""


def doubt_value(knee: Knee, name: str, value: float) -> None:
    """Warn of a structure's value that is nearer, as a ratio, to that of one of its fibres.

    Args:
        knee: whose structure it is, with the value that it has so far.
        name: of the parameter.
        value: that it is to have.

    Warns:
        DoubtfulValue: naming both.

    Example:
        >>> import kneejax as kj
        >>> doubt_value(kj.load_knee("four_ligament"), "ACL.stiffness", 5000.0)
    """
    count, total = fibres_summed(knee, name), _sum(knee, name)
    if count > 1 and 0.0 < value < total / math.sqrt(count):
        warnings.warn(f"{name}: {value:g} {_of_whole(name, count, total)}", DoubtfulValue, 2)


def doubt_prior(knee: Knee, name: str, deviation: float) -> None:
    """Warn of a prior of a structure's stiffness that is narrow, but not for one of its fibres.

    Args:
        knee: whose structure it is.
        name: of the parameter.
        deviation: its standard deviation.

    Warns:
        DoubtfulValue: naming both.

    Example:
        >>> import kneejax as kj
        >>> doubt_prior(kj.load_knee("four_ligament"), "ACL.stiffness", 500.0)
    """
    count, total = fibres_summed(knee, name), _sum(knee, name)
    if count > 1 and _NARROW * total / count <= deviation < _NARROW * total:
        words = _of_whole(name, count, total)
        warnings.warn(f"{name}: a prior of {deviation:g} {words}", DoubtfulValue, 2)


def _of_whole(name: str, count: int, total: float) -> str:
    owner, _, quantity = name.partition(".")
    unit = quantity_of(quantity).unit
    return (
        f"{unit} is of the whole {owner}, drawn as {count} fibres with {total:,.0f} {unit} in this "
        f"knee; one fibre has {total / count:,.0f} {unit} in the mean"
    )


def of_one_fibre(knee: Knee, name: str, low: float, high: float) -> str:
    """The end of a sentence on bounds that exclude a structure's value, where they hold the mean
    of its fibres; empty otherwise."""
    count, total = fibres_summed(knee, name), _sum(knee, name)
    if count == 1 or not low <= total / count <= high:
        return ""
    owner = name.partition(".")[0]
    return f"; it is the sum over the {count} fibres of {owner}, whose mean is {total / count:g}"


def _sum(knee: Knee, name: str) -> float:
    """The sum over a structure's fibres; 0 of what is no sum."""
    owner, _, quantity = name.partition(".")
    fibres = dict(knee.groups).get(owner)
    return _over(knee, fibres, quantity) if fibres and quantity_of(quantity).summed else 0.0


def _over(knee: Knee, fibres: Sequence[str], quantity: str) -> float:
    rows = [knee.ligaments.names.index(fibre) for fibre in fibres]
    return float(np.asarray(numbers_of(knee, quantity))[rows].sum())


def structure_range(
    knee: Knee, fibres: Sequence[str], usual: tuple[float, float]
) -> tuple[float, float]:
    """Limits of the stiffness of some fibres, from what the whole structure has.

    Args:
        knee: gives the stiffnesses.
        fibres: one, or those of a bundle or structure.
        usual: of a structure drawn as one line, N per unit strain.

    Returns:
        From a quarter to four times the stiffness of the largest group that holds all the fibres,
        wider where its published range is (`kneejax.quantities.PUBLISHED_STIFFNESS`); a part of it
        has its share. The usual limits where the fibres are a ligament drawn as one line, widened
        in the same way where its own stiffness is beyond them.

    Example:
        >>> import kneejax as kj
        >>> knee = kj.load_knee("four_ligament")
        >>> structure_range(knee, ["ACL"], (300.0, 10000.0))
        (300.0, 10000.0)
    """
    holding = {name: group for name, group in knee.groups if set(fibres) <= set(group)}
    name = max(holding, key=lambda one: len(holding[one]), default="")
    whole = holding.get(name, fibres)
    total, own = (_over(knee, rows, "stiffness") for rows in (whole, fibres))
    if not (total > 0.0 and own > 0.0):
        return usual
    share, (low, high) = own / total, PUBLISHED_STIFFNESS.get(name, (total, total))
    if len(whole) == 1:
        low, high = usual
        if low <= total <= high:
            return usual
    return share * min(low, total / _TIMES), share * max(high, total * _TIMES)
