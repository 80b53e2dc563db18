"""A cohort on a terminal."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from kneejax.report.calibration import Outcome
from kneejax.report.look import aligned, number, plain, wrapped

if TYPE_CHECKING:
    from kneejax.cohorts import CohortSummary

_FAILED = "No answer"


def outcomes(summary: CohortSummary) -> dict[str, int]:
    """What became of the knees -> how many, the best first."""
    counts = Counter(one.outcome or _FAILED for one in summary.answers)
    order = [*(one.value for one in Outcome), _FAILED]
    return {word: counts[word] for word in order if counts[word]}


def cohort_exit_status(summary: CohortSummary) -> int:
    """Of `kneejax calibrate`: 0 if there is nothing to doubt in any knee."""
    return int(any(word != Outcome.GOOD.value for word in outcomes(summary)))


def cohort_text(summary: CohortSummary) -> str:
    """Say on a terminal what a cohort found.

    Args:
        summary: of the cohort.

    Returns:
        Lines of fewer than 100 columns, without a final line break.
    """
    counts = ", ".join(f"{count} {word.lower()}" for word, count in outcomes(summary).items())
    lines = wrapped(f"{summary.title}: {len(summary.answers)} knees: {counts}")
    for one in summary.answers:
        if one.failed:
            lines += wrapped(one.failed, f"{one.name}: ")
    if summary.populations:
        lines += ["", *aligned(_population_rows(summary))]
    if summary.outliers:
        first = ", ".join(
            f"{one.knee} {plain(one.parameter)} ({one.deviations:+.1f} SD)"
            for one in summary.outliers[:5]
        )
        more = len(summary.outliers) - 5
        lines += ["", *wrapped(first + (f" and {more} more" if more > 0 else ""), "outliers: ")]
    return "\n".join(lines)


def _population_rows(summary: CohortSummary) -> list[list[str]]:
    rows = [["parameter", "knees", "mean", "95 % limits", "spread", "95 % limits", "unit"]]
    rows += population_rows(summary)
    return rows


def population_rows(summary: CohortSummary) -> list[list[str]]:
    """Parameter, knees, mean and its limits, spread between knees and its limits, unit; the spread
    of what differs by factors in per cent."""
    rows = []
    for name, found in summary.populations.items():
        mean, low, high = map(found.in_own_unit, (found.mean, *found.mean_limits))
        spreads = [100.0 * x if found.log else x for x in (found.spread, *found.spread_limits)]
        sign = " %" if found.log else ""
        spread, least, most = (f"{number(x, 3)}" for x in spreads)
        rows.append(
            [name, str(found.knees), number(mean), f"{number(low)} to {number(high)}",
             spread + sign, f"{least} to {most}{sign}", summary.units[name] or "-"]
        )  # fmt: skip
    return rows
