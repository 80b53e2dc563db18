"""The report of a cohort: one page, with links to each knee's own."""

from __future__ import annotations

import math
import os
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote

import numpy as np

from kneejax.geometry import COORDINATES
from kneejax.report.calibration import Outcome, correlation_matrix_figure
from kneejax.report.cohort._figures import forest_figure
from kneejax.report.cohort._text import outcomes, population_rows
from kneejax.report.look import (
    NONE,
    boxes,
    number,
    page,
    picture,
    plain,
    save_and_inline,
    section,
    table,
    warnings_box,
    write_whole,
)

if TYPE_CHECKING:
    from kneejax.cohorts import CohortSummary, KneeAnswer

_POPULATION = (
    "Mean over knees and standard deviation between them, each with 95 % limits: a normal "
    "distribution of values about the mean (of logarithms for stiffness, whose spread is in per "
    "cent), every knee with the standard error of its own data. A knee in the light of the others "
    "is drawn to the mean as far as its data leave room. Knees whose fit is poor or did not "
    "converge tell nothing of the others."
)


def write_cohort_report(
    summary: CohortSummary, folder: str | os.PathLike[str], knees: str, *, svg: bool = False
) -> list[Path]:
    """Write the report of a cohort with its figures.

    Args:
        summary: what to report.
        folder: where; made if needed. Files of the same names are replaced.
        knees: folder in it, of the folders of the knees.
        svg: whether figures are saved as SVG as well.

    Returns:
        `report.html`, then `figures/NAME.png`.
    """
    folder = Path(folder)
    paths, pictures = [], {}
    drawn = {}
    if summary.fitted and summary.units:
        drawn["parameters"] = forest_figure(summary)
    if np.isfinite(summary.correlation).any():
        drawn["correlation"] = correlation_matrix_figure(
            list(summary.units), summary.correlation
        )
    for name, figure in drawn.items():
        written, pictures[name] = save_and_inline(figure, folder / "figures", name, svg=svg)
        paths += written
    page = cohort_page(summary, pictures, knees)
    return [write_whole(folder / "report.html", page.encode()), *paths]


def cohort_page(summary: CohortSummary, pictures: dict[str, str], knees: str) -> str:
    """Compose the page of a cohort.

    Args:
        summary: what to report.
        pictures: name -> `<svg>` element.
        knees: folder of the folders of the knees, beside the page.

    Returns:
        A complete HTML document; it links to nothing but the knees' own reports.
    """
    sections = [
        _head(summary),
        section("Parameters over the knees", _parameters(summary, pictures)),
        _outliers(summary),
        section("Knees", _knees(summary, knees)),
    ]
    if "correlation" in pictures:
        caption = "Correlation of the estimates over the knees; of logarithms for stiffness."
        sections.insert(2, section("What goes together", picture(pictures["correlation"], caption)))
    return page(summary.title, sections)


def _head(summary: CohortSummary) -> str:
    seconds = [one.seconds for one in summary.answers if math.isfinite(one.seconds)]
    facts = [("Knees", str(len(summary.answers)))]
    facts += [(word, str(count)) for word, count in outcomes(summary).items()]
    facts += [("Time of a knee, s", number(float(np.median(seconds)), 3))] if seconds else []
    failed = (f"{one.name}: {one.failed}" for one in summary.answers if one.failed)
    return (
        f"<header>\n<h1>{escape(summary.title)}</h1>\n"
        f'<p class="under">Calibration of a cohort</p>\n{boxes(facts)}\n</header>\n'
        + warnings_box("No answer", failed)
    )


def _parameters(summary: CohortSummary, pictures: dict[str, str]) -> str:
    text = ""
    if summary.populations:
        header = ["Parameter", "Knees", "Mean", "95 % limits", "Spread", "95 % limits", "Unit"]
        rows = [[plain(row[0]), *row[1:]] for row in population_rows(summary)]
        text = f"<p>{escape(_POPULATION)}</p>\n" + table(header, rows)
    if "parameters" in pictures:
        caption = (
            "Estimates with 95 % limits, one row a knee; an arrow is an end that the data leave "
            "open, a knee whose data say nothing has no point. Red: in the light of the others."
        )
        text += picture(pictures["parameters"], caption)
    return text or "<p>No knee has an answer.</p>\n"


def _outliers(summary: CohortSummary) -> str:
    if not summary.outliers:
        return ""
    rows = [
        [one.knee, plain(one.parameter), number(one.value), summary.units[one.parameter] or NONE,
         f"{one.deviations:+.1f}"]
        for one in summary.outliers
    ]  # fmt: skip
    words = "<p>Farther from the population than 3 standard deviations of a knee measured so.</p>\n"
    header = ["Knee", "Parameter", "Value", "Unit", "Deviations"]
    return section("Outliers", words + table(header, rows, (0, 1)))


def _knees(summary: CohortSummary, knees: str) -> str:
    header = ["Knee", "Outcome", "RMSE, mm", "RMSE, deg", "Objective", "Time, s"]
    body = []
    for one in summary.answers:
        name = escape(one.name)
        if not one.failed:
            name = f'<a href="{quote(knees)}/{quote(one.name)}/report.html">{name}</a>'
        numbers = [_worst(one, "mm"), _worst(one, "deg"), number(one.objective),
                   number(one.seconds, 3)]  # fmt: skip
        cells = "".join(f"<td class=n>{x}</td>" for x in numbers)
        body.append(f"<tr><td>{name}</td><td>{_badge(one)}</td>{cells}</tr>\n")
    head = "".join(f"<th{' class=n' if i > 1 else ''}>{x}</th>" for i, x in enumerate(header))
    return (
        "<p>Root mean square errors of the poses, the largest of the displacements and of the "
        "rotations.</p>\n"
        f'<div class="wide"><table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{"".join(body)}'
        "</tbody>\n</table></div>\n"
    )


def _worst(one: KneeAnswer, unit: str) -> str:
    """The largest error of a unit."""
    own = [x for name, x in one.rmse.items() if COORDINATES[name].unit == unit]
    known = [x for x in own if math.isfinite(x)]
    return number(max(known), 3) if known else NONE


def _badge(one: KneeAnswer) -> str:
    kinds = {Outcome.GOOD.value: "good", Outcome.DOUBTFUL.value: "doubtful"}
    word = one.outcome or "No answer"
    return f'<strong class="badge {kinds.get(word, "failed")}">{escape(word)}</strong>'
