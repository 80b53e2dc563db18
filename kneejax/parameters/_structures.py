"""Stiffness of structures drawn as several fibres: usual ranges, doubts, and older files.

A structure's stiffness is the sum over its fibres (`_fibres.py`). It once was their mean: files of
that time lack `MEANING`, and a number of that time that a person gives is doubted.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence

import numpy as np

from kneejax.mechanics import Knee
from kneejax.parameters._fibres import SUMMED, numbers_of

#: What a file with values by parameter says of itself, field and value.
MEANING = {"stiffness_of": "structure"}
#: A structure of several fibres is sought between its usual limits and at least from a quarter to
#: four times its own stiffness: sums over fibres exceed the single lines of paper 1.
_TIMES = 4.0
#: A prior that is narrower than this part of a structure's stiffness may be that of one fibre.
_NARROW = 0.05


class DoubtfulValue(UserWarning):
    """A value that is probably not what was meant."""


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
    return len(dict(knee.groups).get(owner, (owner,))) if quantity in SUMMED else 1


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
    """
    count, total = fibres_summed(knee, name), _sum(knee, name)
    if count > 1 and _NARROW * total / count <= deviation < _NARROW * total:
        words = _of_whole(name, count, total)
        warnings.warn(f"{name}: a prior of {deviation:g} {words}", DoubtfulValue, 2)


def _of_whole(name: str, count: int, total: float) -> str:
    owner, _, quantity = name.partition(".")
    unit = {"stiffness": "N", "damping": "N s"}[quantity]
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
    return _over(knee, fibres, quantity) if fibres and quantity in SUMMED else 0.0


def _over(knee: Knee, fibres: Sequence[str], quantity: str) -> float:
    rows = [knee.ligaments.names.index(fibre) for fibre in fibres]
    return float(np.asarray(numbers_of(knee, quantity))[rows].sum())


def structure_range(
    knee: Knee, fibres: Sequence[str], usual: tuple[float, float]
) -> tuple[float, float]:
    """Limits of the stiffness of some fibres, from the usual ones of a whole structure.

    Args:
        knee: gives the stiffnesses.
        fibres: one, or those of a bundle or structure.
        usual: of a structure, N per unit strain.

    Returns:
        The usual limits where the fibres are a ligament drawn as one line. Otherwise those of the
        largest group that holds all the fibres, at least from a quarter to four times its own
        stiffness; a part of it has its share.
    """
    holding = [group for _, group in knee.groups if set(fibres) <= set(group)]
    whole = max(holding, key=len, default=fibres)
    total = _over(knee, whole, "stiffness")
    if len(whole) == 1 or not total > 0.0:
        return usual
    share = _over(knee, fibres, "stiffness") / total
    if not share > 0.0:
        return usual
    return share * min(usual[0], total / _TIMES), share * max(usual[1], total * _TIMES)
