"""Everything that a cohort found, as rows of one tidy table."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from kneejax.geometry import COORDINATES

if TYPE_CHECKING:
    from kneejax.cohorts import CohortSummary, KneeAnswer

#: Columns of cohort.csv; what is else known of a knee follows.
COHORT_COLUMNS = (
    "knee", "outcome", "kind", "name", "unit", "value", "low", "high", "standard_error",
    "interval", "at_bound", "start", "in_population", "in_population_sd", "own_share",
    "bootstrap_sd", "bootstrap_low", "bootstrap_high",
)  # fmt: skip


def cohort_rows(summary: CohortSummary) -> tuple[list[str], list[list[Any]]]:
    """Header and rows of cohort.csv.

    A row is a number of a knee: a `parameter` with its limits and with what it is in the light of
    the others (`in_population`), a root mean square error of its poses (`rmse`) or curves (`test`),
    or its `objective`. A knee that failed has one row, with its sentence as `name`. Rows of knee
    `population` hold the mean and the spread of each parameter.

    Args:
        summary: of the cohort.
    """
    about = list(dict.fromkeys(name for one in summary.answers for name in one.about))
    rows = []
    place = {one.name: row for row, one in enumerate(summary.fitted)}
    for one in summary.answers:
        known = [one.about.get(name) for name in about]
        own = _failed(one) if one.failed else _rows(summary, one, place[one.name])
        rows += [[one.name, one.outcome or "failed", *row, *known] for row in own]
    rows += [["population", "", *row, *[None] * len(about)] for row in _population(summary)]
    return [*COHORT_COLUMNS, *about], rows


def _failed(one: KneeAnswer) -> list[list[Any]]:
    return [["failed", one.failed, *[None] * 14]]


def _rows(summary: CohortSummary, one: KneeAnswer, row: int) -> list[list[Any]]:
    rows = [_bare("objective", "objective", "", one.objective)]
    rows += [_bare("rmse", name, COORDINATES[name].unit, x) for name, x in one.rmse.items()]
    for name, x in one.tests.items():
        coordinate = name.rpartition(", ")[2]
        unit = COORDINATES[coordinate].unit if coordinate in COORDINATES else ""
        rows.append(_bare("test", name, unit, x))
    for name, own in one.parameters.items():
        found = summary.populations.get(name)
        beside: list[Any] = [None, None, None]
        if found is not None:
            mean, sd = float(found.shrunk[row]), float(found.deviation[row])
            # Of a logarithm, to first order.
            middle = found.in_own_unit(mean)
            beside = [middle, sd * middle if found.log else sd, float(found.own[row])]
        rows.append(
            ["parameter", name, summary.units.get(name, ""), own.value, own.low, own.high,
             own.standard_error, own.interval, own.at_bound, own.start, *beside,
             *summary.redrawn(one.name, name)]
        )  # fmt: skip
    return rows


def _bare(kind: str, name: str, unit: str, value: float) -> list[Any]:
    return [kind, name, unit, value, *[None] * 12]


def _population(summary: CohortSummary) -> list[list[Any]]:
    rows = []
    for name, found in summary.populations.items():
        unit = summary.units.get(name, "")
        middle, low, high = map(found.in_own_unit, (found.mean, *found.mean_limits))
        rows.append(["mean", name, unit, middle, low, high, *[None] * 10])
        if found.log:  # a standard deviation of the logarithm is one in proportion
            unit = "of the logarithm"
        rows.append(["spread", name, unit, found.spread, *found.spread_limits, *[None] * 10])
    return rows
