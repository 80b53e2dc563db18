"""The report of a calibration: one page that opens anywhere."""

from __future__ import annotations

import contextlib
import gc
import json
import math
import os
from collections.abc import Iterator
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kneejax.geometry import COORDINATES
from kneejax.report.calibration._estimates import limits, reasons
from kneejax.report.calibration._figures import (
    convergence_figure,
    correlation_figure,
    parameters_figure,
)
from kneejax.report.calibration._notes import calibration_notes
from kneejax.report.calibration._starts import starts_words
from kneejax.report.calibration._tests import axis_label_of, errors_to_show, tests_figure
from kneejax.report.calibration._verdict import (
    Outcome,
    data_words,
    ending,
    noise_of,
    optimiser,
    outcome,
    search,
    stage_counts,
    verdict,
    warnings,
)
from kneejax.report.look import (
    NONE,
    SHOWN,
    boxes,
    change,
    json_safe,
    number,
    page,
    picture,
    picture_svg,
    save_and_inline,
    section,
    table,
    trimmed,
    warnings_box,
    with_error,
    write_whole,
)
from kneejax.report.motion import ligament_forces_figure, motion_figure

if TYPE_CHECKING:
    from kneejax.inference import Calibration, Estimate

#: Colour of the badge.
_BADGES = {
    Outcome.GOOD: "good",
    Outcome.DOUBTFUL: "doubtful",
    Outcome.POOR: "failed",
    Outcome.FAILED: "failed",
}


def _drawn(calibration: Calibration) -> dict[str, Any]:
    """Figures of what there is: a motion, tests, or both."""
    drawn = {
        "motion": motion_figure,
        "tests": tests_figure,
        "parameters": parameters_figure,
        "correlation": correlation_figure,
        "convergence": convergence_figure,
        "ligament_forces": ligament_forces_figure,
    }
    absent = ("motion", "ligament_forces") if not len(calibration.measured) else ()
    absent += ("tests",) if not calibration.fit.tests else ()
    return {name: draw for name, draw in drawn.items() if name not in absent}


def write_report(
    calibration: Calibration,
    folder: str | os.PathLike[str],
    *,
    svg: bool = False,
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
    """
    folder = Path(folder)
    paths, pictures = [], {}
    with _collection_paused():
        for name, draw in _drawn(calibration).items():
            figure = draw(calibration)
            if figures:
                written, pictures[name] = save_and_inline(figure, folder / "figures", name, svg=svg)
                paths += written
            else:
                pictures[name] = picture_svg(figure, name)
    written = write_whole(folder / "report.html", report_page(calibration, pictures).encode())
    return [written, *paths]


@contextlib.contextmanager
def _collection_paused() -> Iterator[None]:
    """Hold back garbage collection: with many objects alive it costs as much as the drawing."""
    running = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if running:
            gc.enable()


def report_page(calibration: Calibration, pictures: dict[str, str]) -> str:
    """Compose the page from the calibration's words and tables and from drawn pictures.

    Args:
        calibration: what to report.
        pictures: name -> `<svg>` element.

    Returns:
        A complete HTML document without links to anything outside it.
    """
    sections = [
        _head(calibration),
        _optional("Motion", "motion", calibration, pictures, _motion_section),
        _optional("Tests under load", "tests", calibration, pictures, _tests_section),
        section("Parameters", _parameter_section(calibration, pictures["parameters"])),
        section("Procedures", _procedure_section(calibration, pictures["convergence"])),
        section("Objective by coordinate", _partial_section(calibration)),
        section("What the data can tell apart", _correlation_section(pictures)),
        _optional("Forces", "ligament_forces", calibration, pictures, _force_section),
        _notes_section(calibration),
        section("How to run it again", _again_section(calibration)),
    ]
    return page(calibration.title, sections)


def _optional(title: str, name: str, calibration: Calibration, pictures, compose) -> str:
    """A section whose picture there is; nothing otherwise."""
    return section(title, compose(calibration, pictures[name])) if name in pictures else ""


def _head(calibration: Calibration) -> str:
    fit = calibration.fit
    became = outcome(calibration)
    made = ", synthetic" if calibration.truth else ""
    facts = [
        ("Objective at the start", number(calibration.start_objective)),
        ("Objective fitted", number(fit.objective)),
        ("Change", change(calibration.start_objective, fit.objective) or NONE),
        ("Simulated motions", str(fit.evaluations.get("residual", NONE))),
        ("Time, s", number(calibration.seconds.get("total", math.nan), 3)),
    ]
    return (
        f"<header>\n<h1>{escape(calibration.title)}</h1>\n"
        f'<p class="under">Calibration of knee {escape(calibration.knee)}, '
        f"{data_words(calibration)}{made}</p>\n"
        f'<p><strong class="badge {_BADGES[became]}">{became.value}</strong> '
        f"{escape(verdict(calibration))}</p>\n"
        f"<p>Search: {escape(search(calibration, fit))}.</p>\n"
        f"{boxes(facts)}\n</header>\n" + warnings_box("Warnings", warnings(calibration))
    )


def _motion_section(calibration: Calibration, svg: str) -> str:
    header = ["Coordinate", "Start"]
    header += [f"Procedure {fit.procedure}" for fit in calibration.fits] + ["Change"]
    rows = []
    for name in SHOWN:
        before = calibration.start_rmse.get(name, math.nan)
        after = [fit.rmse.get(name, math.nan) for fit in calibration.fits]
        label = COORDINATES[name].axis_label
        rows.append(
            [label, number(before, 3), *(number(v, 3) for v in after), change(before, after[0])]
        )
    offset = ""
    if calibration.fit.offsets:
        offset = " Fitted motions are drawn with the offsets between frames added."
    return (
        "<p>Root mean square difference between simulated and measured motion; the change is "
        f"that of procedure {escape(calibration.fit.procedure)}, the reported answer.</p>\n"
        + table(header, rows)
        + picture(svg, "Measured, started and fitted motion over flexion. Failed poses are gaps, "
                   "marked at the bottom edge like poses that balance but are doubtful." + offset)
    )  # fmt: skip


def _tests_section(calibration: Calibration, svg: str) -> str:
    rows = [
        [
            one.test if one.flexion_deg is None else "",
            axis_label_of(one.coordinate) if one.flexion_deg is None else "",
            "all" if one.flexion_deg is None else f"{one.flexion_deg:g}",
            str(one.readings),
            number(one.start, 3),
            number(one.fitted, 3),
            change(one.start, one.fitted),
        ]
        for one in errors_to_show(calibration)
    ]
    header = ["Test", "Coordinate", "Flexion, deg", "Readings", "Start", "Fitted", "Change"]
    return (
        "<p>Root mean square difference between knee and measurement in each test, along the axes "
        "of Grood and Suntay.</p>\n"
        + table(header, rows, (0, 1))
        + picture(svg, "Measured (points), fitted (solid) and started (dotted), a colour for each "
                   "flexion. A curve ends where the knee no longer holds the load.")
    )  # fmt: skip


def _parameter_section(calibration: Calibration, svg: str) -> str:
    truth = calibration.truth
    fit = calibration.fit
    header = ["Parameter", "Unit", "Value", "Standard error", "95 % limits", "Known by"]
    header += ["Start", "Lower", "Upper"]
    header += ["Truth", "Error"] * bool(truth) + ["At bound", "Remark"]
    words = (0, 1, 4, 5, len(header) - 2, len(header) - 1)
    rows = []
    for e in (*fit.estimates, *fit.offsets):
        value, error = with_error(e.value, e.standard_error)
        kind = NONE if e.interval is None else e.interval.value
        name = e.name if e in fit.estimates else f"offset {e.name}"
        row = [name, e.unit or NONE, value, error, limits(e) or NONE, kind]
        row += [trimmed(e.start), trimmed(e.lower), trimmed(e.upper)]
        if truth:
            true = truth.get(e.name, math.nan)
            row += [trimmed(true), number(e.value - true, 2)]
        rows.append([*row, "yes" if e.at_bound else "no", reasons(e)])
    text = (
        f"<p>Answer of procedure {escape(fit.procedure)}. Limits follow the likelihood, with "
        f"noise {escape(_noise(calibration))}. A standard error is given where it tells the same "
        "limits. Both hold for independent errors of measurement; they say nothing about errors "
        "of the model.</p>\n"
    )
    text += table(header, rows, words)
    text += picture(svg, "Each parameter between its bounds (grey). Bars span the 95 % limits; "
                     "an arrow is a side without a limit.")  # fmt: skip
    if fit.offsets:
        text += (
            "<p>Offsets are constants added to the model to compare it with the measurement.</p>\n"
        )
    if len(calibration.fits) > 1:
        names = [e.name for e in calibration.fit.estimates]
        units = {e.name: e.unit for e in calibration.fit.estimates}
        found = [{e.name: _starred(e) for e in fit.estimates} for fit in calibration.fits]
        text += "<p>The procedures side by side (* ended on a bound):</p>\n" + table(
            ["Parameter", "Unit", *(f"Procedure {fit.procedure}" for fit in calibration.fits)],
            [[n, units[n] or NONE, *(one.get(n, NONE) for one in found)] for n in names],
            (0, 1),
        )
    return text


def _noise(calibration: Calibration) -> str:
    mm, deg = (noise_of(calibration, unit) for unit in ("mm", "deg"))
    kind = "estimated from the misfit" if calibration.noise_estimated else "as stated"
    return f"{number(mm, 3)} mm and {number(deg, 3)} deg ({kind})"


def _starred(e: Estimate) -> str:
    return number(e.value) + ("*" if e.at_bound else "")


def _procedure_section(calibration: Calibration, svg: str) -> str:
    header = ["Procedure", "Converged", "Objective", "Accepted steps", "Simulated motions"]
    header += ["Gradients", "Poses"]
    rows = []
    for fit in calibration.fits:
        count = fit.evaluations
        row = [fit.procedure, "yes" if fit.success else "no", number(fit.objective)]
        row += [str(len(fit.history))]
        row += [str(count.get(key, NONE)) for key in ("residual", "jacobian", "equilibria")]
        rows.append(row)
        for stage, evaluations in stage_counts(fit):
            steps = [step for step in fit.history if step.stage == stage]
            objective = number(steps[-1].objective) if steps else NONE
            row = [f"\u2003{stage}", "", objective, str(len(steps)) if steps else NONE]
            rows.append([*row, str(evaluations), "", ""])
    text = table(header, rows, (0, 1))
    if optimiser(calibration):
        text += f"<p class=small>Optimiser: {escape(optimiser(calibration))}.</p>\n"
    for fit in calibration.fits:
        why = escape(ending(calibration, fit))
        text += f"<p class=small>Procedure {escape(fit.procedure)}: {why}.</p>\n"
        if fit.starts is not None:
            text += f"<p class=small>{escape(starts_words(fit))}</p>\n"
    return text + picture(svg, "Objective against simulated motions; markers are accepted "
                           "steps, their shape is the stage.")  # fmt: skip


def _partial_section(calibration: Calibration) -> str:
    header = ["Coordinate", "Unit", "Start"]
    header += [f"Procedure {fit.procedure}" for fit in calibration.fits]
    parts = [calibration.start_partial_objectives]
    parts += [fit.partial_objectives for fit in calibration.fits]
    rows = [
        [COORDINATES[name].label, f"{COORDINATES[name].unit}²"]
        + [number(part.get(name, math.nan)) for part in parts]
        for name in SHOWN
    ]
    totals = [calibration.start_objective, *(fit.objective for fit in calibration.fits)]
    rows.append(["Objective (weighted sum)", "", *(number(total) for total in totals)])
    return (
        "<p>Unweighted sums of squared differences, and the minimised weighted sum.</p>\n"
        + table(header, rows, (0, 1))
    )


def _correlation_section(pictures: dict[str, str]) -> str:
    return picture(
        pictures["correlation"],
        "Correlation of the estimates: near +1 or \u22121, the data fix a combination of the two "
        "parameters better than either.",
    )


def _force_section(_: Calibration, svg: str) -> str:
    return picture(
        svg,
        "Forces that hold the motion, fitted (solid) and at the start (dotted); failed and "
        "doubtful poses are marked as in the motion figure.",
    )


def _notes_section(calibration: Calibration) -> str:
    notes = calibration_notes(calibration)
    if not notes:
        return ""
    items = "".join(f"<li>{escape(note)}</li>\n" for note in notes)
    return section("Notes", f"<ul>\n{items}</ul>\n")


def _again_section(calibration: Calibration) -> str:
    settings = json_safe(calibration.settings)
    rows = [[str(key), _setting(value)] for key, value in settings.items()]
    versions = [[name, str(version)] for name, version in calibration.versions.items()]
    seconds = [[name, number(value, 3)] for name, value in calibration.seconds.items()]
    text = "<h3>Settings</h3>\n" + table(["Setting", "Value"], rows, (0, 1))
    text += "<h3>Versions</h3>\n" + table(["Package", "Version"], versions, (0, 1))
    return text + "<h3>Time</h3>\n" + table(["Part", "Seconds"], seconds)


def _setting(value: object) -> str:
    if isinstance(value, str):
        return value
    return "none" if value in (None, [], {}) else json.dumps(value, ensure_ascii=False)
