"""A calibration as an answer: page, files, and the screen after it."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from kneejax.geometry import COORDINATES
from kneejax.parameters import MEANING, sums_in_words
from kneejax.report import calibration_parameters as estimates
from kneejax.report import calibration_tests as load_tests
from kneejax.report import calibration_verdict as verdicts
from kneejax.report.doubts import row_status
from kneejax.report.look.page import Answer, Drawing, Section, prose, write_page
from kneejax.report.look.style import SHOWN
from kneejax.report.look.tables import (
    NONE,
    Column,
    Table,
    change,
    json_safe,
    listed,
    number,
)
from kneejax.report.motion_figures import ligament_forces_figure, motion_figure
from kneejax.statics import Status

if TYPE_CHECKING:
    from kneejax.inference import Calibration, Fit

#: Counts of a whole search; other counts are of its stages.
TOTALS = ("residual", "jacobian", "equilibria")


def result_document(calibration: Calibration) -> dict[str, Any]:
    """Gather what result.json of a calibration holds.

    Args:
        calibration: the answer to write.

    Returns:
        A JSON-safe dictionary; NaN and infinity are null.
    """
    fit = calibration.fit
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
            "tests": [one._asdict() for one in load_tests.laxity_errors(calibration)],
            "evaluations": {key: fit.evaluations.get(key, 0) for key in TOTALS},
            "correlation": {"parameters": [e.name for e in fit.estimates],
                            "matrix": fit.correlation},
            "truth": calibration.truth,
            "frame_offset": {e.name: estimates.parameter_document(e) | {"unit": e.unit}
                             for e in fit.offsets},
            "noise": calibration.noise, "noise_estimated": calibration.noise_estimated,
            "per_procedure": {one.procedure: _of_procedure(one) for one in calibration.fits},
            "notes": verdicts.calibration_notes(calibration), "seconds": calibration.seconds,
            "versions": calibration.versions, "settings": calibration.settings, **MEANING,
        }
    )


def _of_procedure(fit: Fit) -> dict[str, Any]:
    names = [e.name for e in (*fit.estimates, *fit.offsets)]
    ends = [] if fit.starts is None else zip(fit.starts.objectives, fit.starts.values, strict=True)
    status = row_status(fit.motion)
    return {
        "procedure": fit.procedure, "success": bool(fit.success), "message": verdicts.message(fit),
        "objective": fit.objective, "partial_objectives": fit.partial_objectives, "rmse": fit.rmse,
        "parameters": {
            e.name: estimates.parameter_document(e)
            | {"unit": e.unit, "remark": estimates.reasons(e)}
            for e in fit.estimates
        },
        "evaluations": fit.evaluations, "iterations": len(fit.history),
        "starts": [{"objective": objective, "values": dict(zip(names, values, strict=True))}
                   for objective, values in ends],
        "status": {Status(value).word: int(np.sum(status == value))
                   for value in sorted(set(status.tolist()))},
    }


def calibration_answer(calibration: Calibration) -> Answer:
    """What a calibration found: parameters with their limits, the fit, and what to doubt.

    Args:
        calibration: what to report.

    Returns:
        The answer; its tables are parameters and, of a study with tests under load, tests.
    """
    fit, became = calibration.fit, verdicts.outcome(calibration)
    several = len(calibration.fits) > 1
    doubts, compared = verdicts.split_warnings(calibration)
    quantities = dict.fromkeys(
        e.name.partition(".")[2].partition(".")[0].replace("_", " ") or e.name
        for e in fit.estimates
    )
    searched = [f"Procedure {one.procedure}: " * several + f"{verdicts.search(calibration, one)}."
                for one in calibration.fits]  # fmt: skip
    searched += [*filter(None, map(verdicts.starts_words, calibration.fits)), *compared]
    if several:
        others = [one.procedure for one in calibration.fits[1:]]
        words = "1, in doubt" if became.exit_status else "0, nothing to doubt"
        searched.append(
            f"Procedure {fit.procedure}, the first of the study, is the answer and alone decides "
            f"the exit status ({words}); {' and '.join(others)} "
            f"{'are' if len(others) > 1 else 'is'} there to compare."
        )
    noise = verdicts.noise_words(calibration)
    summed = sums_in_words(fit.motion.knee, [e.name for e in fit.estimates])
    main = estimates.estimates_table(calibration, " ".join(filter(None, [noise, summed])))
    fell = change(calibration.start_objective, fit.objective)
    sections = [
        Section("Parameters in detail", [prose("limits"), *[prose("offsets")] * bool(fit.offsets)],
                ["parameters", *[_side_by_side(calibration)] * several], ["parameters"]),
        Section("Motion", [prose("motion_errors")], [errors_by_coordinate(calibration)],
                printed=True),
        Section("Tests under load", [prose("test_errors")], [load_tests.errors_table(calibration)],
                ["tests"] * bool(len(calibration.measured)), printed=True),
        Section("Procedures" if several else "Search", searched, [procedures_table(calibration)],
                ["convergence"], printed=several),
        Section("Sums of squares", [prose("objectives")], [_objectives(calibration)]),
        Section("Correlation", drawings=["correlation"]),
        Section("Forces", drawings=["ligament_forces"]),
        Section("Notes", verdicts.calibration_notes(calibration)),
    ]  # fmt: skip
    absent = [] if len(calibration.measured) else ["Motion", "Sums of squares", "Forces"]
    absent += [] if fit.tests else ["Tests under load"]
    tests = {"tests": load_tests.reading_table(calibration)} if fit.tests else {}
    made = " (synthetic)" if calibration.truth else ""
    return Answer(
        title=calibration.title,
        asked=f"Which {len(fit.estimates)} values ({listed(list(quantities), 4)}) make knee "
        f"{calibration.knee} follow {verdicts.data_words(calibration)}{made}?",
        verdict=became.verdict, badge=became.value, sentence=verdicts.verdict(calibration),
        tables={"parameters": estimates.parameters_table(calibration), **tests},
        main=[main], drawings=_drawings(calibration), doubts=doubts,
        facts=[("Objective at the start", number(calibration.start_objective)),
               ("Objective fitted", f"{number(fit.objective)} ({fell})".removesuffix(" ()")),
               ("Simulated motions", str(fit.evaluations.get("residual", NONE))),
               ("Time, s", number(calibration.seconds.get("total", math.nan), 3))],
        sections=[one for one in sections
                  if one.title not in absent and (one.text or one.tables or one.drawings)],
        document=result_document(calibration),
    )


def _drawings(calibration: Calibration) -> dict[str, Drawing]:
    """Figures of what there is, the one that shows the fit first."""
    fit, every = calibration.fit, {}
    offset = "Fitted motions are drawn with the offsets between frames added." * bool(fit.offsets)
    if len(calibration.measured):
        every["motion"] = Drawing(motion_figure, calibration, more=offset)
    if fit.tests:
        every["tests"] = Drawing(load_tests.tests_figure, calibration)
    names = [e.name for e in fit.estimates]
    every |= {"parameters": Drawing(estimates.parameters_figure, calibration),
              "correlation": Drawing(estimates.correlation_matrix_figure, names, fit.correlation),
              "convergence": Drawing(estimates.convergence_figure, calibration)}  # fmt: skip
    if len(calibration.measured):
        every["ligament_forces"] = Drawing(ligament_forces_figure, calibration)
    return every


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


def _each_fit(calibration: Calibration) -> list[str]:
    """Headings of columns that hold a number for each procedure."""
    if len(calibration.fits) == 1:
        return ["fitted"]
    return [f"procedure {fit.procedure}" for fit in calibration.fits]


def errors_by_coordinate(calibration: Calibration) -> Table:
    """Root mean square differences between simulated and measured motion, by coordinate."""
    heads = ["start", *_each_fit(calibration)]
    rows = []
    for name in SHOWN:
        before = calibration.start_rmse.get(name, math.nan)
        after = [fit.rmse.get(name, math.nan) for fit in calibration.fits]
        rows.append([COORDINATES[name].axis_label, before, *after, change(before, after[0])])
    columns = [Column("root mean square error", words=True)]
    columns += [Column(head, head, "3") for head in heads]
    return Table([*columns, Column("change", words=True)], rows)


def _objectives(calibration: Calibration) -> Table:
    """Unweighted sums of squared differences, and the weighted sum that is minimised."""
    parts = [calibration.start_partial_objectives]
    parts += [fit.partial_objectives for fit in calibration.fits]
    rows: list[list[Any]] = [
        [COORDINATES[name].label, f"{COORDINATES[name].unit}\u00b2"]
        + [part.get(name, math.nan) for part in parts]
        for name in SHOWN
    ]
    totals = [calibration.start_objective, *(fit.objective for fit in calibration.fits)]
    rows.append(["Objective (weighted sum)", "", *totals])
    columns = [Column("sum of squares", words=True), Column("unit", words=True)]
    heads = ["start", *_each_fit(calibration)]
    return Table([*columns, *(Column(head, head) for head in heads)], rows)


def _side_by_side(calibration: Calibration) -> Table:
    """What each procedure found for each parameter."""
    found = [{e.name: number(e.value) + "*" * e.at_bound for e in fit.estimates}
             for fit in calibration.fits]  # fmt: skip
    columns = [Column("parameter", words=True), Column("unit", words=True)]
    columns += [Column(head, head) for head in _each_fit(calibration)]
    rows = [[e.name, e.unit or NONE, *(one.get(e.name, NONE) for one in found)]
            for e in calibration.fit.estimates]  # fmt: skip
    return Table(columns, rows, "The procedures side by side", "* ended on a bound")


def procedures_table(calibration: Calibration) -> Table:
    """What each procedure, and each of its stages, took."""
    names = ["procedure", "converged", "objective", "accepted steps", "simulated motions",
             "gradients", "poses"]  # fmt: skip
    rows: list[list[Any]] = []
    for fit in calibration.fits:
        row = [fit.procedure, "yes" if fit.success else "no", number(fit.objective)]
        counts = [str(fit.evaluations.get(key, NONE)) for key in TOTALS]
        rows.append([*row, str(len(fit.history)), *counts])
        for stage, evaluations in _stages(fit):
            steps = [step for step in fit.history if step.stage == stage]
            objective = number(steps[-1].objective) if steps else NONE
            taken = str(len(steps)) if steps else NONE
            rows.append([f"stage {stage}", "", objective, taken, str(evaluations), "", ""])
    return Table([Column(n, words=n in ("procedure", "converged")) for n in names], rows)


def _stages(fit: Fit) -> list[tuple[str, int]]:
    """Simulated motions of each stage, in order; none if there is only one stage."""
    stages = {key: count for key, count in fit.evaluations.items() if key not in TOTALS}
    if not stages:
        last = {step.stage: step.evaluations for step in fit.history}
        ends = [0, *last.values()]
        stages = {stage: ends[i + 1] - ends[i] for i, stage in enumerate(last)}
    return list(stages.items()) if len(stages) > 1 else []
