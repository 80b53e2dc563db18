"""Bounds, scales and plausible ranges of parameters."""

__all__ = [
    "default_bounds", "digitised", "looked_up", "percent_scales", "prior_scales", "start_within",
    "stated", "stated_bounds", "structure_range", "unphysiological",
]

import warnings
from collections.abc import Mapping, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from kneejax.geometry import FREE_COORDINATES
from kneejax.mechanics import Knee
from kneejax.parameters._numbers import Assumption, DoubtfulValue, of_whole, over_fibres
from kneejax.parameters._selection import Selection, UnknownParameter, UnsuitableData
from kneejax.quantities import PUBLISHED_STIFFNESS, nearest_name, quantity_of

T = TypeVar("T")
#: A structure of several fibres is sought from a quarter to four times its own stiffness, wider
#: where what is published of that ligament is.
_TIMES = 4.0


def prior_scales(
    selection: Selection, values: ArrayLike, given: Mapping[str, float] | None = None
) -> np.ndarray:
    """Prior standard deviations of parameters, in their own units.

    Where none is given, those of the quantities (`Quantity.scale_of`): 30 % of a stiffness, 0.02 of
    a reference strain, 2 % of a slack length, 2 mm of an attachment, ...

    Args:
        selection: the parameters.
        values: of them, `(p,)`.
        given: name, `*.quantity` or quantity -> standard deviation; a name counts before a
            wildcard, and that before a quantity.

    Returns:
        Standard deviations, `(p,)`, all positive.

    Raises:
        UnknownParameter: something is given that none of the parameters is.
        UnsuitableData: a width is zero, negative or not finite.

    Example:
        >>> from kneejax.parameters import Selection, prior_scales
        >>> both = Selection(("ACL.stiffness", "ACL.reference_strain"), ("ACL",))
        >>> prior_scales(both, [4500.0, 0.03], {"reference_strain": 0.01}).tolist()
        [1350.0, 0.01]
    """
    values = np.asarray(values, float)
    scales = np.empty(len(selection))
    for i, own in enumerate(stated(selection, given or {}, "prior")):
        usual = quantity_of(selection.quantity(i)).scale_of(values[i])
        scales[i] = usual if own is None else own
        if not (np.isfinite(scales[i]) and scales[i] > 0):
            said = f"{selection.names[i]}: prior of width {scales[i]:g}: expected a standard "
            said += "deviation above zero; leave the parameter out if it is known exactly"
            raise UnsuitableData(said)
    return scales


def percent_scales(selection: Selection, values: ArrayLike) -> np.ndarray:
    """One per cent of each parameter; of a reference strain, which may be zero, 0.01.

    Args:
        selection: the parameters.
        values: of them, `(p,)`.

    Returns:
        Widths in their own units, `(p,)`.

    Raises:
        UnsuitableData: a per cent of the parameter means nothing: a coordinate of an attachment,
            or a value of zero.

    Example:
        >>> import kneejax as kj
        >>> knee = kj.load_knee("four_ligament")
        >>> percent_scales(kj.select(knee, ["ACL.stiffness"]), [5000.0]).tolist()
        [50.0]
    """
    scales = []
    for i, value in enumerate(np.asarray(values, float)):
        quantity, name = selection.quantity(i), selection.names[i]
        if quantity_of(quantity).within is not None:
            raise UnsuitableData(f"{name} has no per cent, its zero is arbitrary: scale by a prior")
        scales.append(0.01 if quantity == "reference_strain" else 0.01 * abs(value))
        if not scales[-1] > 0:
            raise UnsuitableData(f"{name} is {value:g}, it has no per cent: scale by a prior")
    return np.array(scales)


def digitised(
    selection: Selection, given: Mapping[str, float], sd_mm: float, *, counts: bool
) -> dict[str, float]:
    """A prior of attachments that are free without one: as exact as they were digitised.

    Args:
        selection: the parameters.
        given: name, `*.quantity` or quantity -> standard deviation of a prior that is stated.
        sd_mm: with which attachments were digitised; 0 for no such prior.
        counts: whether a prior can count, which it does against noise that is stated.

    Returns:
        Name -> standard deviation, mm; none where priors do not count.

    Warns:
        Assumption: with the attachments, and what to write instead; `DoubtfulValue` where the prior
            does not count.

    Example:
        >>> import kneejax as kj
        >>> chosen = kj.select(kj.load_knee("four_ligament"), ["ACL.stiffness"])
        >>> digitised(chosen, {}, 2.0, counts=True)
        {}
    """
    free = looked_up(selection, given)
    names = [name for i, name in enumerate(selection.names)
             if free[i] is None and sd_mm and quantity_of(selection.quantity(i)).bone]  # fmt: skip
    if not names:
        return {}
    said = ", ".join(dict.fromkeys(name.rpartition(".")[0] for name in names))
    if not counts:
        said += (": free without a prior, since none counts unless noise_mm and noise_deg are "
                 f"stated; attachments are digitised to some {sd_mm:g} mm")
        warnings.warn(said, DoubtfulValue, 3)
        return {}
    said += (f": free without a prior; a standard deviation of {sd_mm:g} mm around the knee's own "
             "is taken, as exact as they are digitised (prior: states another, "
             "attachment_sd_mm: 0 none)")
    warnings.warn(said, Assumption, 3)
    return dict.fromkeys(names, sd_mm)


def stated(selection: Selection, given: Mapping[str, T], what: str) -> list[T | None]:
    """What is given for each parameter, and nothing for anything else.

    Args:
        selection: the parameters.
        given: name, `*.quantity` or quantity -> anything.
        what: is given, for the error.

    Returns:
        As `looked_up`.

    Raises:
        UnknownParameter: something is given that none of the parameters is.

    Example:
        >>> import kneejax as kj
        >>> chosen = kj.select(kj.load_knee("four_ligament"), ["ACL.stiffness", "PCL.stiffness"])
        >>> stated(chosen, {"ACL.stiffness": 500.0}, "prior")
        [500.0, None]
    """
    known = sorted({key for i in range(len(selection)) for key in _keys(selection, i)})
    for key in given:
        if key not in known:
            # A wildcard is no misspelling of one parameter.
            near = nearest_name(key, [name for name in known if ("*" in name) == ("*" in key)])
            end = f"; did you mean {near!r}?" if near else f": free are {', '.join(known)}"
            raise UnknownParameter(f"{what} of {key!r}, which is not free{end}")
    return looked_up(selection, given)


def looked_up(selection: Selection, given: Mapping[str, T]) -> list[T | None]:
    """What is given for each parameter under its name, `*.quantity` or quantity, of which the first
    counts before the next; None where nothing is.

    Example:
        >>> import kneejax as kj
        >>> chosen = kj.select(kj.load_knee("four_ligament"), ["ACL.stiffness", "PCL.stiffness"])
        >>> looked_up(chosen, {"*.stiffness": 500.0, "ACL.stiffness": 300.0})
        [300.0, 500.0]
    """
    keys = [_keys(selection, i) for i in range(len(selection))]
    return [next((given[key] for key in own if key in given), None) for own in keys]


def _keys(selection: Selection, index: int) -> tuple[str, ...]:
    """What may stand for a parameter, the nearest first: of one number of several
    (`ACL.femoral_attachment.anterior`), all of them too (`ACL.femoral_attachment`)."""
    name, quantity = selection.names[index], selection.quantity(index)
    keys = [name, f"*.{quantity}", quantity]
    if "." in quantity:
        keys = [key for one in keys for key in (one, one.rpartition(".")[0])]
    return tuple(keys)


def default_bounds(knee: Knee, selection: Selection) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper bounds of a selection, those of its quantities (`Quantity.bounds_around`).

    The stiffness of a structure drawn as several fibres may be a quarter of and four times what it
    is at least, and those of its fibres and bundles in proportion (`structure_range`); its damping
    has the bounds of all its fibres together.

    Example:
        >>> import kneejax as kj
        >>> knee = kj.load_knee("four_ligament")
        >>> lower, upper = default_bounds(knee, kj.select(knee, ["ACL.reference_strain"]))
        >>> lower.tolist(), upper.tolist()
        ([-0.2], [0.2])
    """
    pairs = []
    for i, value in enumerate(np.asarray(selection.read(knee))):
        quantity, fibres = quantity_of(selection.quantity(i)), selection.fibres(i)
        low, high = quantity.bounds_around(float(value))
        if quantity.name == "stiffness" and fibres:
            low, high = structure_range(knee, fibres, (low, high))
        elif quantity.summed and quantity.bounds is not None and fibres:
            high *= len(fibres)
        pairs.append((low, high))
    lower, upper = np.reshape(pairs, (-1, 2)).T
    return lower, upper


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
    total, own = (over_fibres(knee, rows, "stiffness") for rows in (whole, fibres))
    if not (total > 0.0 and own > 0.0):
        return usual
    share, (low, high) = own / total, PUBLISHED_STIFFNESS.get(name, (total, total))
    if len(whole) == 1:
        low, high = usual
        if low <= total <= high:
            return usual
    return share * min(low, total / _TIMES), share * max(high, total * _TIMES)


def stated_bounds(
    knee: Knee, selection: Selection, given: Mapping[str, tuple[float, float]]
) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of a selection: those that are stated, default ones for the rest.

    Args:
        knee: gives the middle of default bounds of attachments.
        selection: the parameters.
        given: name, `*.quantity` or quantity -> lower and upper bound; a name counts before a
            wildcard, that before a quantity.

    Returns:
        Lower and upper bounds, `(p,)` each.

    Raises:
        UnsuitableData: bounds that are reversed, equal or not finite.

    Example:
        >>> import kneejax as kj
        >>> knee = kj.load_knee("four_ligament")
        >>> chosen = kj.select(knee, ["ACL.stiffness", "ACL.reference_strain"])
        >>> stated_bounds(knee, chosen, {"stiffness": (500.0, 9000.0)})[1].tolist()
        [9000.0, 0.2]
    """
    lower, upper = (np.array(b) for b in default_bounds(knee, selection))
    for i, (name, own) in enumerate(zip(selection.names, looked_up(selection, given), strict=True)):
        if own is not None:
            lower[i], upper[i] = own
        if not (np.isfinite([lower[i], upper[i]]).all() and lower[i] < upper[i]):
            said = f"{name}: bounds {lower[i]:g} to {upper[i]:g}: expected lower below upper"
            raise UnsuitableData(said)
    return lower, upper


def start_within(
    knee: Knee, selection: Selection, lower: np.ndarray, upper: np.ndarray
) -> np.ndarray:
    """The knee's own values, `(p,)`; raises `UnsuitableData` where bounds exclude one.

    Example:
        >>> import kneejax as kj
        >>> knee = kj.load_knee("four_ligament")
        >>> chosen = kj.select(knee, ["ACL.reference_strain"])
        >>> start_within(knee, chosen, np.array([-0.2]), np.array([0.2])).shape
        (1,)
    """
    start = np.asarray(selection.read(knee))
    for name, value, low, high in zip(selection.names, start, lower, upper, strict=True):
        if not low <= value <= high:
            said = f"{name}: bounds {low:g} to {high:g} exclude the start {value:g}"
            count, total, _ = of_whole(knee, name)
            if count > 1 and low <= total / count <= high:
                owner = name.partition(".")[0]
                said += f"; it is the sum over the {count} fibres of {owner}, "
                said += f"whose mean is {total / count:g}"
            raise UnsuitableData(said)
    return start


#: How far a pose may be from that of the knee itself, degrees and mm. Clinical tests move no knee
#: as far: 13 mm by 90 N without an ACL, 12 degrees by an axial torque, 7 degrees from varus to
#: valgus (robot tests, n = 12; Komzak 2013; Markolf 1978).
PHYSIOLOGICAL_LIMITS = {"adduction": 10.0, "internal_rotation": 20.0, "anterior": 15.0,
                        "superior": 15.0, "lateral": 15.0}


def unphysiological(table: ArrayLike, own: ArrayLike) -> np.ndarray:
    """Mark poses that have left what a knee does.

    A balance can be stable and yet that of a knee that has come apart: paper 1 calls such motion
    unphysiological, of reference strains far from the usual.

    Args:
        table: free coordinates, degrees and mm, `(..., 5)`.
        own: those of the knee itself, of a shape that broadcasts.

    Returns:
        Truth values of shape `(...)`; a pose that is NaN is not marked, it failed already.

    Source: paper 1, section 3.2; the limits are ours.

    Example:
        >>> unphysiological([[0.0, 5.0, 2.0, 0.0, 1.0], [0.0, 60.0, 2.0, 0.0, 1.0]], 0.0).tolist()
        [False, True]
    """
    limits = [PHYSIOLOGICAL_LIMITS[name] for name in FREE_COORDINATES]
    return np.any(np.abs(np.asarray(table, float) - np.asarray(own, float)) > limits, axis=-1)
