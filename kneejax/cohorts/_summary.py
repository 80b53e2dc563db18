"""What a cohort says together: parameters over knees, outliers, and a prior for the next knee."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from kneejax.cohorts._answers import KneeAnswer, KneeEstimate
from kneejax.inference.population import Population, in_log, population
from kneejax.parameters import MEANING

#: Half the width of a 95 % interval in standard errors.
_HALF = 1.959964
#: Deviations from the population beyond which a knee is said to be an outlier.
OUTLIER = 3.0
#: Draws of a bootstrap that tell limits.
_FEWEST = 20


@dataclasses.dataclass(frozen=True, eq=False)
class Outlier:
    """A parameter of a knee that is far from those of the others.

    Attributes:
        knee: its name.
        parameter: which.
        value: its estimate.
        deviations: from the population's mean, in standard deviations of a knee that is measured as
            well as this one.
    """

    knee: str
    parameter: str
    value: float
    deviations: float


@dataclasses.dataclass(frozen=True, eq=False)
class CohortSummary:
    """What a cohort says together.

    Attributes:
        title: of the cohort.
        answers: of each knee.
        units: parameter -> unit, in the order of the first knee.
        populations: parameter -> what is known of it over knees; those of fewer than three are not
            there.
        correlation: of the estimates over knees, `(p, p)` in the order of `units`; NaN where fewer
            than five knees have both.
        outliers: the farthest first.
        draws: knee -> values of its bootstrap, `(draws, p)`, NaN where a draw did not converge.
    """

    title: str
    answers: tuple[KneeAnswer, ...]
    units: Mapping[str, str]
    populations: Mapping[str, Population]
    correlation: np.ndarray
    outliers: tuple[Outlier, ...]
    draws: Mapping[str, np.ndarray] = dataclasses.field(default_factory=dict)

    def redrawn(self, knee: str, parameter: str) -> tuple[float, float, float]:
        """Standard deviation and 95 % limits of a parameter over a knee's bootstrap; NaN without
        one, or with fewer than twenty draws that converged."""
        every, answer = self.draws.get(knee), {one.name: one for one in self.answers}.get(knee)
        if every is None or answer is None or parameter not in answer.parameters:
            return np.nan, np.nan, np.nan
        own = every[:, list(answer.parameters).index(parameter)]
        own = own[np.isfinite(own)]
        if len(own) < _FEWEST:
            return np.nan, np.nan, np.nan
        low, high = np.percentile(own, [2.5, 97.5])
        return float(own.std(ddof=1)), float(low), float(high)

    @property
    def fitted(self) -> tuple[KneeAnswer, ...]:
        """Knees that have an answer."""
        return tuple(one for one in self.answers if not one.failed)


def summed_up(
    title: str,
    answers: Sequence[KneeAnswer],
    units: Mapping[str, str],
    draws: Mapping[str, np.ndarray] | None = None,
) -> CohortSummary:
    """Bring the answers of a cohort together.

    Args:
        title: of the cohort.
        answers: of each knee.
        units: parameter -> unit.
        draws: knee -> values of its bootstrap.
    """
    fitted = [one for one in answers if not one.failed]
    populations, outliers = {}, []
    for name in units:
        values, errors = _told(fitted, name)
        found = population(values, errors, in_log(name))
        if found is not None:
            populations[name] = found
            outliers += _outliers(fitted, name, values, errors, found)
    outliers.sort(key=lambda one: -abs(one.deviations))
    return CohortSummary(
        title, tuple(answers), dict(units), populations, _correlation(fitted, units),
        tuple(outliers), dict(draws or {}),
    )  # fmt: skip


def _told(answers: Sequence[KneeAnswer], name: str) -> tuple[np.ndarray, np.ndarray]:
    """What each knee says of a parameter, or of its logarithm: value and standard error."""
    pairs = [
        _one(answer.parameters.get(name) if answer.good else None, in_log(name))
        for answer in answers
    ]
    values, errors = np.reshape(pairs, (-1, 2)).T
    return values, errors


def _one(estimate: KneeEstimate | None, log: bool) -> tuple[float, float]:
    """Value and standard error; nothing where the data give no two limits."""
    if estimate is None or not np.isfinite([estimate.low, estimate.high]).all():
        return np.nan, np.inf
    ends = np.array([estimate.low, estimate.high])
    if log and not (ends > 0).all():
        return np.nan, np.inf
    ends = np.log(ends) if log else ends
    # Limits of a profile lie around where the likelihood is largest, to first order in the middle.
    return float(ends.mean()), float(np.ptp(ends) / (2.0 * _HALF))


def _outliers(answers, name: str, values, errors, found: Population) -> list[Outlier]:
    expected = np.sqrt(found.next_deviation**2 + errors**2)
    with np.errstate(invalid="ignore"):
        away = (values - found.mean) / expected
    return [
        Outlier(answers[row].name, name, answers[row].parameters[name].value, float(away[row]))
        for row in np.flatnonzero(np.abs(np.nan_to_num(away)) > OUTLIER)
    ]


def _correlation(answers: Sequence[KneeAnswer], units: Mapping[str, str]) -> np.ndarray:
    good, size = [one for one in answers if one.good], len(units)
    table = np.array(
        [[_one(one.parameters.get(name), in_log(name))[0] for one in good] for name in units]
    ).reshape(size, len(good))
    found = np.full((size, size), np.nan)
    for i in range(size):
        for j in range(size):
            both = np.isfinite(table[i]) & np.isfinite(table[j])
            spread = both.sum() >= 5 and np.ptp(table[i, both]) > 0 and np.ptp(table[j, both]) > 0
            if spread:
                found[i, j] = np.corrcoef(table[i, both], table[j, both])[0, 1]
    return found


def next_prior(summary: CohortSummary) -> dict[str, Any]:
    """What the cohort says of a knee of which nothing is measured, as a study takes it.

    Args:
        summary: of the cohort.

    Returns:
        `start` and `prior`: parameter -> mean and standard deviation, in its own unit; and what a
        structure's stiffness means in it (`kneejax.parameters.MEANING`).
    """
    pairs = {name: found.prior for name, found in summary.populations.items()}
    return {
        "start": {name: float(f"{mean:.6g}") for name, (mean, _) in pairs.items()},
        "prior": {name: float(f"{sd:.6g}") for name, (_, sd) in pairs.items()},
        **MEANING,
    }
