"""The screen after a calibration, in plain ASCII that works in a pipe."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from kneejax.geometry import COORDINATES
from kneejax.parameters import sums_in_words
from kneejax.report.calibration._estimates import limits, line_remark
from kneejax.report.calibration._starts import starts_words
from kneejax.report.calibration._tests import axis_label_of, errors_to_show
from kneejax.report.calibration._verdict import (
    Outcome,
    data_words,
    known_words,
    noise_of,
    outcome,
    search,
    warnings,
)
from kneejax.report.look import (
    LINE_WIDTH,
    NONE,
    SHOWN,
    aligned,
    change,
    number,
    trimmed,
    with_error,
    wrapped,
)

if TYPE_CHECKING:
    from kneejax.inference import Calibration


def calibration_summary(calibration: Calibration) -> str:
    """Say on a terminal what a calibration found.

    Args:
        calibration: what to show.

    Returns:
        Lines of fewer than 100 columns, without a final line break.
    """
    fit = calibration.fit
    lines = wrapped(f"{calibration.title} (knee {calibration.knee})")
    became = outcome(calibration)
    loud = became in (Outcome.FAILED, Outcome.POOR)
    word = became.value.upper() if loud else became.value.lower()
    fell = change(calibration.start_objective, fit.objective)
    lines += wrapped(
        f"Procedure {fit.procedure} {word}: objective "
        f"{number(calibration.start_objective)} -> {number(fit.objective)}"
        + (f" ({fell})" if fell else "")
        + f", {data_words(calibration)}, "
        + f"{number(calibration.seconds.get('total', math.nan), 3)} s"
    )
    lines += wrapped(f"Search: {search(calibration, fit)}")
    lines += ["", *_parameter_table(calibration)]
    lines += wrapped(sums_in_words(fit.motion.knee, [e.name for e in fit.estimates]))
    noise = _noise_words(calibration)
    lines += ["", *wrapped(" ".join(filter(None, [noise, known_words(calibration)])))]
    lines += wrapped(starts_words(fit))
    if len(calibration.measured):
        lines += ["", *aligned(_rmse_rows(calibration))]
    if calibration.fit.tests:
        lines += ["", *aligned(_test_rows(calibration), (0, 1, 2))]
    lines += ["", *aligned(_procedure_rows(calibration), (0, 1))]
    doubts = warnings(calibration)
    lines += [""] * bool(doubts)
    for sentence in doubts:
        lines += wrapped(sentence, "warning: ")
    if len(calibration.fits) > 1:
        lines += ["", *wrapped(_judged(calibration))]
    return "\n".join(lines)


def _judged(calibration: Calibration) -> str:
    """Which procedure decides the exit status of `kneejax calibrate`."""
    others = [fit.procedure for fit in calibration.fits[1:]]
    status = outcome(calibration).exit_status
    words = "1, in doubt" if status else "0, nothing to doubt"
    return (
        f"Procedure {calibration.fit.procedure}, the first of the study, is the answer and alone "
        f"decides the exit status ({words}); {' and '.join(others)} "
        f"{'are' if len(others) > 1 else 'is'} there to compare."
    )


def _noise_words(calibration: Calibration) -> str:
    """By which noise the limits are what they are."""
    mm, deg = (noise_of(calibration, unit) for unit in ("mm", "deg"))
    if not (math.isfinite(mm) and math.isfinite(deg)):
        return ""
    kind = "estimated from the misfit" if calibration.noise_estimated else "as stated"
    noise = f"Noise {number(mm, 3)} mm and {number(deg, 3)} deg, {kind}"
    return f"{noise}; limits are at 95 % confidence."


def _parameter_table(calibration: Calibration) -> list[str]:
    """One line per parameter or offset; what was set is left out where it does not fit."""
    head = ["parameter", "value", "", "std. error", "unit", "95 % limits", "", "truth", "start"]
    table = [[*head, "lower", "upper"]]
    fit = calibration.fit
    for e in (*fit.estimates, *fit.offsets):
        sure = e.interval is not None and math.isfinite(e.standard_error)
        value, error = with_error(e.value, e.standard_error if sure else math.nan)
        known = "" if e.interval is None else limits(e) or NONE
        table.append(
            [e.name if e not in fit.offsets else f"offset {e.name}", value]
            + (["+-", error] if sure else ["", ""])
            + [e.unit, known, line_remark(e), trimmed(calibration.truth.get(e.name, math.nan))]
            + [trimmed(e.start), trimmed(e.lower), trimmed(e.upper)]
        )
    empty = {i for i in (3, 4, 5, 6) if not any(row[i] for row in table[1:])}
    empty |= set() if calibration.truth else {7}
    empty |= {2} if 3 in empty else set()
    lines: list[str] = []
    for kept in (11, 9, 8, 7):
        columns = [i for i in range(kept) if i not in empty]
        words = [j for j, i in enumerate(columns) if i in (0, 2, 4, 5, 6)]
        lines = aligned([[row[i] for i in columns] for row in table], words)
        if max(map(len, lines)) <= LINE_WIDTH:
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


def _test_rows(calibration: Calibration) -> list[list[str]]:
    rows = [["test under load", "coordinate", "flexion, deg", "readings", "start RMSE", "fitted"]]
    for one in errors_to_show(calibration):
        whole = one.flexion_deg is None
        label = axis_label_of(one.coordinate)
        rows.append(
            [one.test if whole else "", label if whole else "", "all" if whole else ""]
            + [str(one.readings), number(one.start, 3), number(one.fitted, 3)]
        )
        if not whole:
            rows[-1][2] = f"{one.flexion_deg:g}"
    return rows


def _procedure_rows(calibration: Calibration) -> list[list[str]]:
    rows = [["procedure", "converged", "objective", "simulated motions", "gradients", "poses"]]
    for fit in calibration.fits:
        row = [fit.procedure, "yes" if fit.success else "no", number(fit.objective)]
        counted = ("residual", "jacobian", "equilibria")
        rows.append([*row, *(str(fit.evaluations.get(key, "-")) for key in counted)])
    return rows
