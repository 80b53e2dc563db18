"""A calibration as an answer: page, files, and the screen after it."""

__all__ = ["calibration_answer", "result_document", "write_report"]

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from kneejax.geometry import COORDINATES
from kneejax.inference import Calibration, Fit
from kneejax.parameters import MEANING, sums_in_words
from kneejax.report import calibration_parameters as estimates
from kneejax.report import calibration_verdict as verdicts
from kneejax.report.flexion import ligament_forces_figure, motion_figure
from kneejax.report.look.page import Answer, Drawing, Section, prose, write_page
from kneejax.report.look.style import SHOWN
from kneejax.report.look.tables import NONE, Column, Table, change, json_safe, listed, number
from kneejax.report.pose_tables import row_status
from kneejax.statics import Status

#: Counts of a whole search; other counts are of its stages.
TOTALS = ("residual", "jacobian", "equilibria")
#: Method of a study -> the optimiser, and what ends it when it has converged.
_SEARCHES = {
    "least_squares": ("bounded Levenberg-Marquardt with exact Jacobians",
                      "the search stopped: further steps no longer improve the fit"),
    "lbfgsb": ("L-BFGS-B with exact gradients (jaxopt)",
               "the projected gradient fell below the tolerance"),
}


def result_document(calibration: Calibration) -> dict[str, Any]:
    """Gather what result.json of a calibration holds.

    Args:
        calibration: the answer to write.

    Returns:
        A JSON-safe dictionary; NaN and infinity are null.
    """
    fit = calibration.fit

    def of_procedure(one: Fit) -> dict[str, Any]:
        names, status = [e.name for e in (*one.estimates, *one.offsets)], row_status(one.motion)
        starts = one.starts
        ends = [] if starts is None else zip(starts.objectives, starts.values, strict=True)
        return {
            "procedure": one.procedure, "success": bool(one.success),
            "message": verdicts.message(one), "objective": one.objective,
            "partial_objectives": one.partial_objectives, "rmse": one.rmse,
            "parameters": {
                e.name: estimates.parameter_document(e)
                | {"unit": e.unit, "remark": estimates.reasons(e)}
                for e in one.estimates
            },
            "evaluations": one.evaluations, "iterations": len(one.history),
            "starts": [{"objective": objective, "values": dict(zip(names, values, strict=True))}
                       for objective, values in ends],
            "status": {Status(value).word: int(np.sum(status == value))
                       for value in sorted(set(status.tolist()))},
        }  # fmt: skip

    return json_safe(
        {
            "title": calibration.title, "knee": calibration.knee, "success": bool(fit.success),
            "outcome": verdicts.outcome(calibration).value, "message": verdicts.message(fit),
            "warnings": verdicts.warnings(calibration), "procedure": fit.procedure,
            "parameters": {e.name: estimates.parameter_document(e) for e in fit.estimates},
            "units": {e.name: e.unit for e in fit.estimates},
            "remarks": {e.name: why for e in fit.estimates if (why := estimates.reasons(e))},
            "objective_start": calibration.start_objective, "objective": fit.objective,
            "partial_objectives_start": calibration.start_partial_objectives,
            "partial_objectives": fit.partial_objectives, "rmse_start": calibration.start_rmse,
            "rmse": fit.rmse,
            "tests": estimates.laxity_errors(calibration),
            "evaluations": {key: fit.evaluations.get(key, 0) for key in TOTALS},
            "correlation": {"parameters": [e.name for e in fit.estimates],
                            "matrix": fit.correlation},
            "truth": calibration.truth,
            "frame_offset": {e.name: estimates.parameter_document(e) | {"unit": e.unit}
                             for e in fit.offsets},
            "noise": calibration.noise, "noise_estimated": calibration.noise_estimated,
            "per_procedure": {one.procedure: of_procedure(one) for one in calibration.fits},
            "notes": verdicts.calibration_notes(calibration), "seconds": calibration.seconds,
            "versions": calibration.versions, "settings": calibration.settings, **MEANING,
        }
    )


def calibration_answer(calibration: Calibration) -> Answer:
    """What a calibration found: parameters with their limits, the fit, and what to doubt.

    Args:
        calibration: what to report.

    Returns:
        The answer; its tables are parameters and, of a study with tests under load, tests.
    """
    fit, became = calibration.fit, verdicts.outcome(calibration)
    several, measured = len(calibration.fits) > 1, len(calibration.measured)
    errors, objectives, side_by_side = _of_procedures(calibration)
    doubts, compared = verdicts.split_warnings(calibration)
    quantities = dict.fromkeys(
        e.name.partition(".")[2].partition(".")[0].replace("_", " ") or e.name
        for e in fit.estimates
    )
    data = [f"{measured} pose{'s' * (measured != 1)}"] if measured else []
    if fit.tests:
        read = sum(int(np.isfinite(x).sum()) for own in fit.tests for x, _ in own.compared.values())
        data.append(f"{read} readings of {len(fit.tests)} test{'s' * (len(fit.tests) > 1)}")
    names = [e.name for e in fit.estimates]
    notes = verdicts.noise_words(calibration), sums_in_words(fit.motion.knee, names)
    main = estimates.estimates_table(calibration, " ".join(filter(None, notes)))
    fell = change(calibration.start_objective, fit.objective)
    sections = [
        Section("Parameters in detail", [prose("limits"), *[prose("offsets")] * bool(fit.offsets)],
                ["parameters", *[side_by_side] * several], ["parameters"]),
        *[Section("Motion", [prose("motion_errors")], [errors], printed=True)] * bool(measured),
        *[Section("Tests under load", [prose("test_errors")],
                  [estimates.errors_table(calibration)], ["tests"] * bool(measured),
                  printed=True)] * bool(fit.tests),
        _search(calibration, compared, became),
        *[Section("Sums of squares", [prose("objectives")], [objectives])] * bool(measured),
        Section("Correlation", drawings=["correlation"]),
        Section("Forces", drawings=["ligament_forces"] * bool(measured)),
        Section("Notes", verdicts.calibration_notes(calibration)),
    ]  # fmt: skip
    tables = {"parameters": estimates.parameters_table(calibration)}
    # The figure that shows the fit is the first.
    drawings: dict[str, Drawing] = {}
    if measured:
        offset = "Fitted motions are drawn with the offsets between frames added."
        drawings["motion"] = Drawing(motion_figure, calibration, more=offset * bool(fit.offsets))
    if fit.tests:
        tables["tests"] = estimates.reading_table(calibration)
        drawings["tests"] = Drawing(estimates.tests_figure, calibration)
    drawings |= {"parameters": Drawing(estimates.parameters_figure, calibration),
                 "correlation": Drawing(estimates.correlation_matrix_figure, names,
                                        fit.correlation),
                 "convergence": Drawing(estimates.convergence_figure, calibration)}  # fmt: skip
    if measured:
        drawings["ligament_forces"] = Drawing(ligament_forces_figure, calibration)
    made = " (synthetic)" if calibration.truth else ""
    return Answer(
        title=calibration.title,
        asked=f"Which {len(fit.estimates)} values ({listed(list(quantities), 4)}) make knee "
        f"{calibration.knee} follow {' and '.join(data)}{made}?",
        verdict=became.verdict, badge=became.value, sentence=verdicts.verdict(calibration),
        tables=tables, main=[main], drawings=drawings, doubts=doubts,
        facts=[("Objective at the start", number(calibration.start_objective)),
               ("Objective fitted", f"{number(fit.objective)} ({fell})".removesuffix(" ()")),
               ("Simulated motions", str(fit.evaluations.get("residual", NONE))),
               ("Time, s", number(calibration.seconds.get("total", math.nan), 3))],
        sections=sections, document=result_document(calibration),
    )


def write_report(
    calibration: Calibration, folder: str | os.PathLike[str], *, svg: bool = False,
    figures: bool = True,
) -> list[Path]:
    """Write the report of a calibration with its figures.

    Args:
        calibration: what to report.
        folder: where; made if needed. Files of the same names are replaced.
        svg: whether figures are saved as SVG as well; the page holds them in any case.
        figures: whether figures are files at all. To draw them twice is half of a report's time.

    Returns:
        `report.html`, which needs no other file, then `figures/NAME.png`.

    Example:
        After `fit = kj.calibrate(study)`, call `kj.write_report(fit, "folder")`. What it takes:

        >>> import inspect
        >>> from kneejax import write_report
        >>> [*inspect.signature(write_report).parameters]
        ['calibration', 'folder', 'svg', 'figures']
    """
    return write_page(calibration_answer(calibration), folder, svg=svg, figures=figures,
                      settings=calibration.settings, versions=calibration.versions,
                      seconds=calibration.seconds)  # fmt: skip


def _of_procedures(calibration: Calibration) -> tuple[Table, Table, Table]:
    """A column a procedure: root mean square errors of the coordinates, sums of their squares with
    the weighted sum that is minimised, and the value of each parameter."""
    fits = calibration.fits
    heads = [f"procedure {one.procedure}" for one in fits] if len(fits) > 1 else ["fitted"]
    parts = [calibration.start_partial_objectives, *(fit.partial_objectives for fit in fits)]
    errors, sums = [], []
    for name in SHOWN:
        own, rmse = COORDINATES[name], (calibration.start_rmse, *(fit.rmse for fit in fits))
        sizes, squares = ([one.get(name, math.nan) for one in every] for every in (rmse, parts))
        errors.append([own.axis_label, *sizes, change(*sizes[:2])])
        sums.append([own.label, f"{own.unit}\u00b2", *squares])
    totals = [calibration.start_objective, *(fit.objective for fit in fits)]
    sums.append(["Objective (weighted sum)", "", *totals])
    found = [{e.name: number(e.value) + "*" * e.at_bound for e in fit.estimates} for fit in fits]
    values = [[e.name, e.unit or NONE, *(one.get(e.name, NONE) for one in found)]
              for e in calibration.fit.estimates]  # fmt: skip
    rmse = [Column(head, head, "3") for head in ("start", *heads)]
    of_fits = [Column(head, head, words=False) for head in heads]
    return (
        Table(["root mean square error", *rmse, "change"], errors),
        Table(["sum of squares", "unit", "start", *of_fits], sums),
        Table(["parameter", "unit", *of_fits], values, "The procedures side by side",
              "* ended on a bound"),
    )  # fmt: skip


def _search(calibration: Calibration, compared: Sequence[str], became: verdicts.Outcome) -> Section:
    """What each procedure, and each of its stages, took, and why it ended."""
    several, text, where = len(calibration.fits) > 1, [], []
    optimiser, ended = _SEARCHES.get(str(calibration.settings.get("method", "")), ("", "converged"))
    rows: list[list[str]] = []
    for fit in calibration.fits:
        why = "; ".join(filter(None, [optimiser, verdicts.message(fit, ended)]))
        text.append(f"Procedure {fit.procedure}: " * several + f"{why}.")
        if (starts := fit.starts) is not None:
            count, objectives = len(starts.objectives), np.array(starts.objectives)
            at_answer = count - int((starts.elsewhere | starts.rivals).sum())
            words = [f"{at_answer} of {count} at the answer"]
            if starts.rivals.any():
                words.append(f"{int(starts.rivals.sum())} apart from it with as good a fit")
            lost = np.isinf(objectives)
            worse = objectives[starts.elsewhere & ~lost]
            if len(worse):
                among = " to ".join(dict.fromkeys(number(f(worse)) for f in (min, max)))
                among += f", the answer's is {number(fit.objective)}"
                words.append(f"{len(worse)} at worse fits (objective {among})")
            words += [f"{int(lost.sum())} found no balance"] * bool(lost.any())
            where.append(f"Several starts ended: {'; '.join(words)}.")
        counts = [str(fit.evaluations.get(key, NONE)) for key in TOTALS]
        rows.append([fit.procedure, "yes" if fit.success else "no", number(fit.objective),
                     str(len(fit.history)), *counts])  # fmt: skip
        stages = {key: count for key, count in fit.evaluations.items() if key not in TOTALS}
        if not stages:
            last = {step.stage: step.evaluations for step in fit.history}
            stages = dict(zip(last, np.diff([0, *last.values()]).tolist(), strict=True))
        for stage, evaluations in stages.items() if len(stages) > 1 else ():
            steps = [step for step in fit.history if step.stage == stage]
            known = [number(steps[-1].objective), str(len(steps))] if steps else [NONE] * 2
            rows.append([f"stage {stage}", "", *known, str(evaluations), "", ""])
    text += [*where, *compared]
    if several:
        first, *others = (one.procedure for one in calibration.fits)
        status = "0, nothing to doubt" if became is verdicts.Outcome.GOOD else "1, in doubt"
        beside = f"{' and '.join(others)} {'are' if len(others) > 1 else 'is'}"
        text.append(prose("procedures", first=first, status=status, compared=beside))
    names = ["procedure", "converged", "objective", "accepted steps", "simulated motions",
             "gradients", "poses"]  # fmt: skip
    table = Table([Column(n, words=n in ("procedure", "converged")) for n in names], rows)
    return Section("Procedures" if several else "Search", text, [table], ["convergence"],
                   printed=several)  # fmt: skip
