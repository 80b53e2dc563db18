"""What became of a cohort: each knee's answer, parameters over knees, outliers, the next prior."""

__all__ = ["CohortSummary", "KneeAnswer", "summed_up"]

import dataclasses
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np

from kneejax.cohorts._reading import Member
from kneejax.files.reading import read_text
from kneejax.geometry import BY_COORDINATE, FREE_COORDINATES
from kneejax.inference.population import Population, in_log, population
from kneejax.numerics import Named
from kneejax.parameters import MEANING

#: What the result of a knee says of a fit that leaves more than noise.
POOR = "Poor fit"
#: Half the width of a 95 % interval in standard errors.
_HALF = 1.959964
#: Deviations from the population beyond which a knee is said to be an outlier.
OUTLIER = 3.0
#: Draws of a bootstrap that tell limits; knees that tell a correlation.
_FEWEST, _FEWEST_KNEES = 20, 5
_NUMBERS = ("value", "low", "high", "standard_error", "start")
#: Fields of result.json that are fields of a `KneeAnswer`.
_OF_RESULT = ("outcome", "rmse", "objective", "parameters", "units")


@dataclasses.dataclass(frozen=True, eq=False)
class KneeAnswer:
    """What became of a knee.

    Attributes:
        name: of the knee.
        about: what else is known of it.
        failed: why there is no answer; empty where there is one.
        outcome: in words, as its own report says; empty where it failed.
        seconds: that it took.
        rmse: coordinate -> root mean square error of the poses, mm or degrees.
        tests: test and coordinate -> root mean square error of its curves.
        objective: weighted sum of squares.
        parameters: name -> its estimate as in result.json, NaN for null: `value`, `low`, `high`
            (95 % limits), `standard_error`, `start`, `interval` (which limits mean something, in
            words), `at_bound`.
        units: parameter -> unit.
        correlation: of the estimates, `(p, p)`.
        good: whether its search converged to a fit that is not poor: only such a knee counts in the
            population.
    """

    name: str
    about: Mapping[str, float | str]
    failed: str = ""
    outcome: str = ""
    seconds: float = math.nan
    rmse: Mapping[str, float] = dataclasses.field(default_factory=dict)
    tests: Mapping[str, float] = dataclasses.field(default_factory=dict)
    objective: float = math.nan
    parameters: Mapping[str, Mapping[str, Any]] = dataclasses.field(default_factory=dict)
    units: Mapping[str, str] = dataclasses.field(default_factory=dict)
    correlation: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((0, 0)))
    good: bool = False

    @classmethod
    def read(cls, member: Member, mark: Mapping[str, Any], folder: Path) -> Self:
        """What became of a member of a cohort, whose mark says why it `failed`, if it did, and the
        `seconds` that it took; its result stands in a folder."""
        if mark["failed"]:
            return cls(member.name, member.about, mark["failed"], seconds=mark["seconds"])
        text = read_text(folder / "result.json", "the result of a knee")
        result = json.loads(text, object_hook=_without_null)
        tests = {f"{one['test']}, {one['coordinate']}": one["fitted"]
                 for one in result["tests"] if math.isnan(one["flexion_deg"])}  # fmt: skip
        return cls(member.name, member.about, seconds=mark["seconds"], tests=tests,
                   correlation=np.array(result["correlation"]["matrix"], float),
                   good=bool(result["success"]) and result["outcome"] != POOR,
                   **{name: result[name] for name in _OF_RESULT})  # fmt: skip


class Outlier(NamedTuple):
    """A parameter of a knee that is far from the population's mean: its estimate, and the distance
    in standard deviations of a knee that is measured as well as this one."""

    knee: str
    parameter: str
    value: float
    deviations: float


@dataclasses.dataclass(frozen=True, eq=False)
class CohortSummary(Named):
    """What the knees of a cohort say together.

    Attributes:
        title: of the cohort.
        answers: of each knee.
        units: parameter -> unit, in the order of the first knee.
        populations: parameter -> its distribution over knees; those of fewer than three are not
            there.
        correlation: of the estimates over knees, `(p, p)` in the order of `units`; NaN where fewer
            than five knees have both.
        outliers: the farthest first.
        draws: knee -> values of its bootstrap, `(draws, p)`, NaN where a draw did not converge.

    `to_dataset` gives of each knee estimates with limits, their values shrunken towards the
    population (`in_population`), correlation, errors, outcome; of each parameter mean and spread
    over knees, of the logarithm where `logarithm` says so. Knees without an answer are NaN.
    """

    title: str
    answers: tuple[KneeAnswer, ...]
    units: Mapping[str, str]
    populations: Mapping[str, Population]
    correlation: np.ndarray
    outliers: tuple[Outlier, ...]
    draws: Mapping[str, np.ndarray]

    def _named(self) -> dict[str, tuple]:
        answers, names = self.answers, list(self.units)
        over = [self.populations.get(name) for name in names]
        size, count = len(answers), len(names)
        longest = max(map(len, self.draws.values()), default=0)

        def table(kind: str, absent: Any) -> np.ndarray:
            rows = [[one.parameters.get(name, {}).get(kind, absent) for name in names]
                    for one in answers]  # fmt: skip
            return np.reshape(np.array(rows, type(absent)), (size, count))

        numbers = {name: table(name, np.nan) for name in _NUMBERS}
        fitted = [row for row, one in enumerate(answers) if not one.failed]
        for name, part in (("in_population", "shrunk"), ("in_population_sd", "deviation")):
            numbers[name] = np.full((size, count), np.nan)
            for column, found in enumerate(over):
                if found is not None:
                    numbers[name][fitted, column] = getattr(found, part)
        correlation = np.full((size, count, count), np.nan)
        redrawn = np.full((size, longest, count), np.nan)
        for row, one in enumerate(answers):
            own = [names.index(name) for name in one.parameters]
            if own:
                correlation[np.ix_([row], own, own)] = one.correlation
            if one.name in self.draws:
                values = self.draws[one.name][:, : len(own)]
                redrawn[np.ix_([row], range(len(values)), own)] = values
        rmse = [[one.rmse.get(name, np.nan) for name in FREE_COORDINATES] for one in answers]
        each = "knee", "parameter"
        data: dict[str, Any] = {name: (each, values) for name, values in numbers.items()} | {
            "interval": (each, table("interval", "")),
            "rmse": (("knee", "coordinate"), np.reshape(rmse, (size, len(FREE_COORDINATES)))),
            "correlation": ((*each, "other_parameter"), correlation),
            "objective": ("knee", [one.objective for one in answers]),
            "outcome": ("knee", [one.outcome or "failed" for one in answers]),
            "failed": ("knee", [one.failed for one in answers]),
            "mean": ("parameter", [np.nan if x is None else x.mean for x in over]),
            "spread": ("parameter", [np.nan if x is None else x.spread for x in over]),
            "logarithm": ("parameter", [x is not None and x.log for x in over]),
            "correlation_over_knees": (("parameter", "other_parameter"), self.correlation)}
        if self.draws:
            data["bootstrap"] = (("knee", "draw", "parameter"), redrawn)
        places = {"knee": ("knee", [one.name for one in answers]),
                  "parameter": ("parameter", names), "other_parameter": ("other_parameter", names),
                  "parameter_unit": ("parameter", list(self.units.values())), **BY_COORDINATE}
        return data | places

    def _about(self) -> dict[str, Any]:
        return {"title": self.title}

    def redrawn(self, knee: str, parameter: str) -> tuple[float, float, float]:
        """Standard deviation and 95 % limits of a parameter over a knee's bootstrap; NaN without
        one, or with fewer than twenty draws that converged."""
        answer = {one.name: one for one in self.answers}.get(knee)
        if knee in self.draws and answer is not None and parameter in answer.parameters:
            own = self.draws[knee][:, list(answer.parameters).index(parameter)]
            own = own[np.isfinite(own)]
            if len(own) >= _FEWEST:
                low, high = np.percentile(own, [2.5, 97.5])
                return float(own.std(ddof=1)), float(low), float(high)
        return np.nan, np.nan, np.nan

    def next_prior(self) -> dict[str, Any]:
        """What the cohort says of a knee of which nothing is measured, as a study takes it: `start`
        and `prior`, parameter -> mean and standard deviation, in its own unit; and what a
        structure's stiffness means in it (`kneejax.parameters.MEANING`)."""
        pairs = {name: found.prior for name, found in self.populations.items()}
        return {"start": {name: float(f"{mean:.6g}") for name, (mean, _) in pairs.items()},
                "prior": {name: float(f"{sd:.6g}") for name, (_, sd) in pairs.items()}, **MEANING}

    @property
    def fitted(self) -> tuple[KneeAnswer, ...]:
        """Knees that have an answer."""
        return tuple(one for one in self.answers if not one.failed)


def _without_null(read: dict[str, Any]) -> dict[str, Any]:
    """Null is not a number; of words it is none."""
    return {k: ("" if k == "interval" else math.nan) if v is None else v for k, v in read.items()}


def summed_up(
    title: str, answers: Sequence[KneeAnswer], draws: Mapping[str, np.ndarray] | None = None
) -> CohortSummary:
    """Bring the answers of a cohort together.

    Args:
        title: of the cohort.
        answers: of each knee.
        draws: knee -> values of its bootstrap.
    """
    fitted = [one for one in answers if not one.failed]
    units: dict[str, str] = {}
    for one in fitted:
        units |= {name: unit for name, unit in one.units.items() if name not in units}
    populations, outliers, middles = {}, [], []
    for name in units:
        pairs = [_told(one.parameters.get(name), in_log(name), one.good) for one in fitted]
        values, errors = np.reshape(pairs, (-1, 2)).T
        middles.append(values)
        if (found := population(values, errors, in_log(name))) is None:
            continue
        populations[name] = found
        with np.errstate(invalid="ignore"):
            away = (values - found.mean) / np.sqrt(found.next_deviation**2 + errors**2)
        for row in np.flatnonzero(np.abs(np.nan_to_num(away)) > OUTLIER):
            value = fitted[row].parameters[name]["value"]
            outliers.append(Outlier(fitted[row].name, name, value, float(away[row])))
    outliers.sort(key=lambda one: -abs(one.deviations))
    correlation = np.full((len(units), len(units)), np.nan)
    for i, j in np.ndindex(correlation.shape):
        both = np.isfinite(middles[i]) & np.isfinite(middles[j])
        one, other = middles[i][both], middles[j][both]
        if both.sum() >= _FEWEST_KNEES and np.ptp(one) > 0 and np.ptp(other) > 0:
            correlation[i, j] = np.corrcoef(one, other)[0, 1]
    return CohortSummary(title, tuple(answers), units, populations, correlation, tuple(outliers),
                         dict(draws or {}))


def _told(estimate: Mapping[str, Any] | None, log: bool, good: bool) -> tuple[float, float]:
    """Value and standard error of a parameter or its logarithm; NaN and infinite without limits."""
    if estimate is None or not good:
        return np.nan, np.inf
    ends = np.array([estimate["low"], estimate["high"]], float)
    if not np.isfinite(ends).all() or (log and not (ends > 0).all()):
        return np.nan, np.inf
    ends = np.log(ends) if log else ends
    # Limits of a profile lie around where the likelihood is largest, to first order in the middle.
    return float(ends.mean()), float(np.ptp(ends) / (2.0 * _HALF))
