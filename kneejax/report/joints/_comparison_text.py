"""Joint models against measured motion as tables: on a screen, in files, as JSON."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from kneejax.joints import MEASURED, MEASURES
from kneejax.report.joints._comparison_notes import comparison_doubts, comparison_notes
from kneejax.report.look import NONE, aligned, json_safe, wrapped

if TYPE_CHECKING:
    from kneejax.joints import Comparison, Difference, Summary

_COLUMNS = tuple(one.column for one in MEASURES)
#: Columns of summary.csv (paper 5, Tables 1 to 3), differences.csv (4), predictions.csv (5) and
#: tests.csv (the supplementary table).
SUMMARY_COLUMNS = (
    "motion", "condition", *(f"{c}_{x}" for c in _COLUMNS for x in ("mean", "sd"))
)  # fmt: skip
DIFFERENCE_COLUMNS = (
    "first", "second", "condition", *(f"{c}_{x}" for c in _COLUMNS for x in ("mean", "se"))
)  # fmt: skip
PREDICTION_COLUMNS = ("model", "measure", "unit", "points", "r2", "adjusted_r2", "rmse")
TEST_COLUMNS = (
    "measure", "unit", "flexion_deg", "smallest_shapiro_p", "f", "df_between", "df_error",
    "epsilon", "p", "first", "second", "difference", "standard_error", "p_bonferroni", "lower",
    "upper", "significant",
)  # fmt: skip
#: More flexions than these are not listed on a screen.
_MOST_ROWS = 12


def summary_rows(found: Comparison) -> Iterator[list[Any]]:
    """Rows of summary.csv: one per motion and condition."""
    for one in found.summaries:
        for i, condition in enumerate(one.conditions):
            yield [one.motion, condition, *_beside(one.mean[i], one.sd[i])]


def difference_rows(found: Comparison) -> Iterator[list[Any]]:
    """Rows of differences.csv: one per pair of motions and condition."""
    for one in found.differences:
        for i, condition in enumerate(one.conditions):
            yield [one.first, one.second, condition, *_beside(one.mean[i], one.standard_error[i])]


def prediction_rows(found: Comparison) -> Iterator[list[Any]]:
    """Rows of predictions.csv: one per model and measure."""
    for one in found.predictions:
        numbers = zip(one.r2, one.adjusted_r2, one.rmse, strict=True)
        for measure, row in zip(MEASURES, numbers, strict=True):
            yield [one.model, measure.name, measure.unit, one.points, *row]


def test_rows(found: Comparison) -> Iterator[list[Any]]:
    """Rows of tests.csv: one per measure, flexion and pair of motions."""
    flexion = found.flexion_deg[found.compared]
    for i, test in enumerate(found.tests):
        measure, angle = MEASURES[i // len(flexion)], flexion[i % len(flexion)]
        if test is None:
            continue
        shared = [min(test.normality.values()), test.f, *test.df, test.epsilon, test.p]
        for pair in test.pairs:
            own = [pair.difference, pair.standard_error, pair.p, pair.lower, pair.upper]
            yield [
                measure.name, measure.unit, angle, *shared, pair.first, pair.second, *own,
                pair.p <= found.alpha,
            ]  # fmt: skip


def joint_comparison_document(
    found: Comparison, settings: dict[str, Any], versions: dict[str, str]
) -> dict[str, Any]:
    """What result.json of a comparison holds.

    Args:
        found: the comparison.
        settings: everything needed to run it again.
        versions: package -> version.

    Returns:
        A JSON-safe dictionary; NaN is null.
    """
    names = [one.name for one in MEASURES]
    return json_safe(
        {
            "subjects": len(found.measured),
            "flexion_deg": found.flexion_deg,
            "compared": found.compared,
            "models": list(found.models),
            "predictions": {
                one.model: {
                    "points": one.points,
                    "r2": dict(zip(names, one.r2, strict=True)),
                    "adjusted_r2": dict(zip(names, one.adjusted_r2, strict=True)),
                    "rmse": dict(zip(names, one.rmse, strict=True)),
                }
                for one in found.predictions
            },
            "average_differences": {
                f"{one.first} - {one.second}": {
                    name: {"mean": mean, "standard_error": error}
                    for name, mean, error in zip(
                        names, one.mean[-1], one.standard_error[-1], strict=True
                    )
                }
                for one in found.differences
            },
            "tested": bool(found.tests),
            "alpha": found.alpha,
            "measures": {one.name: f"{one.meaning}, {one.unit}" for one in MEASURES},
            "notes": tuple(comparison_notes(found)),
            "doubts": tuple(comparison_doubts(found)),
            "settings": settings,
            "versions": versions,
        }
    )


def joint_comparison_summary(found: Comparison) -> str:
    """Say on a terminal how far models are from what was measured.

    Args:
        found: the comparison.

    Returns:
        Lines of fewer than 100 columns, without a final line break.
    """
    count = len(found.measured)
    lines = wrapped(
        f"{count} subject{'s' * (count != 1)}, {len(found.flexion_deg)} flexions, "
        f"{int(found.compared.sum())} of them compared; "
        + ", ".join(f"{one.name}: {one.meaning}" for one in MEASURES)
    )
    for one in found.summaries:
        lines += ["", one.motion + (": mean (standard deviation)" if count > 1 else "")]
        lines += aligned([_head(), *_summary_lines(one)])
    for one in found.differences:
        if one.first == MEASURED or found.tests:
            spread = ": mean +- standard error" if count > 1 else ""
            lines += ["", f"{one.first} - {one.second}{spread}"]
            lines += aligned([_head(), *_difference_lines(found, one)])
    lines += ["", "R2 (adjusted), and root mean square error (RMSE)"]
    rows = [_head()]
    for one in found.predictions:
        both = [f"{_text(a)} ({_text(b)})" for a, b in zip(one.r2, one.adjusted_r2, strict=True)]
        rows += [["R2", *both], ["RMSE", *(_text(x) for x in one.rmse)]]
    table = aligned(rows)
    lines += [f"  {table[0]}"]
    for i, one in enumerate(found.predictions):
        lines += [one.model, *(f"  {line}" for line in table[1 + 2 * i : 3 + 2 * i])]
    for note in comparison_notes(found):
        lines += ["", *wrapped(note)]
    for doubt in comparison_doubts(found):
        lines += ["", *wrapped(doubt, "! ")]
    return "\n".join(lines)


def _head() -> list[str]:
    return ["", *(f"{one.name}, {one.unit}" for one in MEASURES)]


def _summary_lines(one: Summary) -> list[list[str]]:
    # The last rows are averages and ranges.
    first = next(i for i, name in enumerate(one.conditions) if name == "average")
    rows = range(first if first > _MOST_ROWS else 0, len(one.conditions))
    return [
        [_condition(one.conditions[i]), *_with_spread(one.mean[i], one.sd[i], "{} ({})")]
        for i in rows
    ]


def _difference_lines(found: Comparison, one: Difference) -> list[list[str]]:
    last = len(one.conditions) - 1
    lines = []
    for i in range(last if last > _MOST_ROWS else 0, last + 1):
        marks = _marks(found, one, i) if i < last else [""] * len(MEASURES)
        cells = _with_spread(one.mean[i], one.standard_error[i], "{} +- {}")
        starred = [f"{cell}{mark or ' '}" for cell, mark in zip(cells, marks, strict=True)]
        lines.append([_condition(one.conditions[i]), *starred])
    return lines


def _marks(found: Comparison, one: Difference, flexion: int) -> list[str]:
    """An asterisk for each measure in which two motions differ significantly."""
    answer = []
    for measure in MEASURES:
        test = found.test(measure.name, flexion)
        pairs = () if test is None else test.pairs
        p = next((x.p for x in pairs if (x.first, x.second) == (one.first, one.second)), 1.0)
        answer.append("*" if p <= found.alpha else "")
    return answer


def _condition(name: str) -> str:
    return f"{name} deg" if name[0].isdigit() or name[0] == "-" else name


def _with_spread(mean: np.ndarray, spread: np.ndarray, words: str) -> list[str]:
    return [
        _text(a) if np.isnan(b) else words.format(_text(a), _text(b))
        for a, b in zip(mean, spread, strict=True)
    ]


def _text(value: float) -> str:
    return NONE if np.isnan(value) else f"{value:.2f}"


def _beside(first: np.ndarray, second: np.ndarray) -> list[float]:
    return [x for pair in zip(first, second, strict=True) for x in pair]
