"""The screen after a calibration, in plain ASCII that works in a pipe."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING

from kneejax.report._numbers import change, number, trimmed, with_error
from kneejax.report._style import COORDINATES, SHOWN
from kneejax.report._verdict import (
    PAPER_COUNTS,
    answer_warnings,
    search,
    undetermined,
    warnings,
)

if TYPE_CHECKING:
    from kneejax.inference._result import Calibration

_COLUMNS = 98


def _aligned(rows: Sequence[Sequence[str]], words: Sequence[int] = (0,)) -> list[str]:
    """Columns two blanks apart; columns in `words` to the left, the others to the right."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return [
        "  ".join(
            text.ljust(width) if i in words else text.rjust(width)
            for i, (text, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


def _wrapped(text: str, first: str = "") -> list[str]:
    return textwrap.wrap(text, _COLUMNS, initial_indent=first, subsequent_indent=" " * len(first))


def calibration_summary(calibration: Calibration) -> str:
    """Say on a terminal what a calibration found.

    Args:
        calibration: what to show.

    Returns:
        Lines of fewer than 100 columns, without a final line break.
    """
    fit = calibration.fit
    lines = _wrapped(f"{calibration.title} (knee {calibration.knee})")
    outcome = "converged" if fit.success else "NOT CONVERGED"
    fell = change(calibration.start_objective, fit.objective)
    lines += _wrapped(
        f"Procedure {fit.procedure} {outcome}: objective "
        f"{number(calibration.start_objective)} -> {number(fit.objective)}"
        + (f" ({fell})" if fell else "")
        + f", {len(calibration.measured)} poses, "
        + f"{number(calibration.seconds.get('total', math.nan), 3)} s"
    )
    lines += _wrapped(f"Search: {search(calibration, fit)}")
    lines += ["", *_parameter_table(calibration)]
    lines += ["", *_aligned(_rmse_rows(calibration))]
    lines += ["", *_aligned(_procedure_rows(calibration), (0, 1))]
    doubts = warnings(calibration)
    lines += [""] * bool(doubts)
    for sentence in doubts:
        lines += _wrapped(sentence, "warning: ")
    if len(calibration.fits) > 1:
        lines += ["", *_wrapped(_judged(calibration))]
    return "\n".join(lines)


def _judged(calibration: Calibration) -> str:
    """Which procedure decides the exit status of `kneejax calibrate`."""
    others = [fit.procedure for fit in calibration.fits[1:]]
    outcome = "1, in doubt" if answer_warnings(calibration) else "0, nothing to doubt"
    return (
        f"Procedure {calibration.fit.procedure}, the first of the study, is the answer and alone "
        f"decides the exit status ({outcome}); {' and '.join(others)} "
        f"{'are' if len(others) > 1 else 'is'} there to compare."
    )


def _parameter_table(calibration: Calibration) -> list[str]:
    """One line a parameter; what was set is left out where it does not fit."""
    table = [["parameter", "value", "", "", "unit", "remark", "truth", "start", "lower", "upper"]]
    for e in calibration.fit.estimates:
        value, error = with_error(e.value, e.standard_error)
        remark = ["at bound"] * e.at_bound + ["undetermined"] * undetermined(e)
        table.append(
            [e.name, value, *(("", "") if undetermined(e) else ("+-", error)), e.unit]
            + [", ".join(remark), trimmed(calibration.truth.get(e.name, math.nan))]
            + [trimmed(e.start), trimmed(e.lower), trimmed(e.upper)]
        )
    empty = {i for i in (4, 5) if not any(row[i] for row in table[1:])}
    empty |= set() if calibration.truth else {6}
    lines: list[str] = []
    for kept in (10, 8, 7, 6):
        columns = [i for i in range(kept) if i not in empty]
        words = [j for j, i in enumerate(columns) if i in (0, 2, 4, 5)]
        lines = _aligned([[row[i] for i in columns] for row in table], words)
        if max(map(len, lines)) <= _COLUMNS:
            break
    return lines


def _rmse_rows(calibration: Calibration) -> list[list[str]]:
    rows = [["root mean square error", "start"]]
    rows[0] += [f"procedure {fit.procedure}" for fit in calibration.fits]
    for name in SHOWN:
        row = [COORDINATES[name].axis_label, number(calibration.start_rmse.get(name, math.nan), 3)]
        row += [number(fit.rmse.get(name, math.nan), 3) for fit in calibration.fits]
        rows.append(row)
    return rows


def _procedure_rows(calibration: Calibration) -> list[list[str]]:
    published = bool(calibration.truth)
    rows = [["procedure", "converged", "objective", "residuals", "Jacobians", "balanced poses"]]
    rows[0] += ["published calls"] * published
    for fit in calibration.fits:
        row = [fit.procedure, "yes" if fit.success else "no", number(fit.objective)]
        counted = ("residual", "jacobian", "equilibria")
        row += [str(fit.evaluations.get(key, "-")) for key in counted]
        calls = PAPER_COUNTS.get(fit.procedure, ("-", "-"))[1]
        rows.append([*row, *[str(calls)] * published])
    return rows
