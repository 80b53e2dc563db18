"""A cohort as an answer."""

import math
import textwrap
from collections import Counter
from typing import Any
from urllib.parse import quote

import numpy as np

from kneejax.cohorts import CohortSummary
from kneejax.geometry import COORDINATES
from kneejax.report.calibration_parameters import correlation_matrix_figure
from kneejax.report.calibration_verdict import Outcome, worst_errors
from kneejax.report.look.colours import BLUE, GREY, LIGHT, VERMILLION
from kneejax.report.look.page import Answer, Drawing, Section, Verdict, prose
from kneejax.report.look.style import Figure, readable, styled
from kneejax.report.look.tables import NONE, Column, Table, number
from kneejax.report.panels import figure_legend, grid

#: Panels beside each other, and knees whose names are all written.
_ACROSS, _NAMED = 4, 40
#: Above all panels, and between two rows of them, inches: room for titles of two lines.
_ABOVE, _BETWEEN = 0.48, 0.76


@styled
def forest_figure(summary: CohortSummary) -> Figure:
    """Draw every parameter over the knees: 95 % limits, and what the others make of them."""
    names, knees = list(summary.units), summary.fitted
    across = min(_ACROSS, max(len(names), 1))
    down, tall = -(-len(names) // across), min(max(0.085 * len(knees), 0.8), 7.0)
    figure, panels = grid(down, across, _ABOVE + down * (tall + _BETWEEN), left=0.55, right=0.12,
                          top=_ABOVE + 0.1, bottom=_BETWEEN - 0.1, apart=(0.21, _BETWEEN),
                          shown=len(names), sharey=True)  # fmt: skip
    step = 1 if len(knees) <= _NAMED else 10
    ticks = np.arange(0, len(knees), step)
    for place, (name, axes) in enumerate(zip(names, panels.flat, strict=False)):
        _panel(axes, summary, name)
        axes.set_ylim(len(knees) - 0.5, -0.5)
        axes.set_yticks(ticks, [knees[row].name for row in ticks], fontsize=5.5 if step == 1 else 7)
        axes.tick_params(axis="y", length=0, labelleft=place % across == 0)
        axes.set_yticks(ticks)
    figure_legend(figure, loc="upper center", ncols=5, borderaxespad=0.1)
    return figure


def _panel(axes, summary: CohortSummary, name: str) -> None:
    rows = np.arange(len(summary.fitted))
    estimates = [one.parameters.get(name) for one in summary.fitted]
    value, low, high = (np.array([np.nan if e is None else e[field] for e in estimates], float)
                        for field in ("value", "low", "high"))  # fmt: skip
    unit, found = summary.units[name], summary.populations.get(name)
    told = np.isfinite(low) | np.isfinite(high)
    seen = np.r_[value[told], low[np.isfinite(low)], high[np.isfinite(high)]]
    left, right = (seen.min(), seen.max()) if len(seen) else (0.0, 1.0)
    room = 0.05 * (right - left) or 1.0
    left, right = left - room, right + room
    if found is not None:
        ends = [found.in_own_unit(found.mean + sign * 1.96 * found.spread) for sign in (-1, 1)]
        left, right = min(left, ends[0]), max(right, ends[1])
        axes.axvspan(*ends, color=LIGHT, lw=0, label="95 % of the population")
        axes.axvline(found.in_own_unit(found.mean), color=GREY, lw=1.0, label="its mean")
    from_, to = np.where(np.isfinite(low), low, left), np.where(np.isfinite(high), high, right)
    good = np.array([one.good for one in summary.fitted], bool)
    for some, colour, label in ((told & ~good, GREY, "a poor fit"),
                                (told & good, BLUE, "a knee, 95 % limits")):  # fmt: skip
        axes.hlines(rows[some], from_[some], to[some], color=colour, lw=0.8)
        shown = label if some.any() else None
        axes.plot(value[some], rows[some], "o", ms=2.4, color=colour, label=shown)
    for open_, edge, mark in ((~np.isfinite(low), left, "<"), (~np.isfinite(high), right, ">")):
        some = open_ & told
        axes.plot(np.full(some.sum(), edge), rows[some], mark, ms=2.6, color=BLUE, clip_on=False)
    if found is not None:
        axes.plot([found.in_own_unit(x) for x in found.shrunk], rows, "|", ms=4.0, mew=1.0,
                  color=VERMILLION, label="shrunken towards the mean")  # fmt: skip
    axes.set_title(textwrap.fill(readable(name), 22), fontsize=8)
    axes.set(xlim=(left, right), xlabel=unit or ("strain" if name.endswith("strain") else "-"))
    axes.tick_params(axis="x", labelsize=7)
    axes.locator_params(axis="x", nbins=4)
    axes.grid(axis="y", visible=False)


#: Columns of cohort.csv; what is else known of a knee follows.
COHORT_COLUMNS = ("knee", "outcome", "kind", "name", "unit", "value", "low", "high",
                  "standard_error", "interval", "at_bound", "start", "in_population",
                  "in_population_sd", "own_share", "bootstrap_sd", "bootstrap_low",
                  "bootstrap_high")  # fmt: skip
_FAILED = "No answer"

def cohort_answer(summary: CohortSummary, knees: str) -> Answer:
    """What a cohort found."""
    counts = Counter(one.outcome or _FAILED for one in summary.answers)
    order = [*(one.value for one in Outcome), _FAILED]
    found = {word: counts[word] for word in order if counts[word]}
    words = ", ".join(f"{count} {word.lower()}" for word, count in found.items())
    population = population_table(summary)
    drawings = {}
    if summary.fitted and summary.units:
        drawings["parameters"] = Drawing(forest_figure, summary)
    if np.isfinite(summary.correlation).any():
        drawings["correlation"] = Drawing(correlation_matrix_figure, list(summary.units),
                                          summary.correlation,
                                          more="Over the knees; of logarithms for stiffness.")
    seconds = [one.seconds for one in summary.answers if math.isfinite(one.seconds)]
    outliers = Table(
        ["knee", "parameter", "value", Column("deviations", show="+.1f"),
         Column("unit", words=False)],
        [[*one, summary.units[one.parameter] or NONE] for one in summary.outliers],
        note=prose("outliers"),
    )  # fmt: skip
    return Answer(
        title=summary.title,
        asked=prose("cohort", count=len(summary.answers)),
        verdict=None if summary.fitted else Verdict.FAILED,
        sentence=f"{len(summary.fitted)} of {len(summary.answers)} knees have an answer: {words}.",
        tables={"cohort": _every_number(summary)}, main=[population] if population.rows else [],
        drawings=drawings,
        doubts=[
            *(f"{word}: {count} of {len(summary.answers)} knees, whose pages say why"
              for word, count in found.items() if word not in (Outcome.GOOD.value, _FAILED)),
            *(f"No answer: {one.name}: {one.failed}" for one in summary.answers if one.failed),
        ],
        facts=[("Time of a knee, s", number(float(np.median(seconds)), 3))] if seconds else [],
        sections=[Section("Knees", tables=[_knees_table(summary, knees)], opened=True),
                  Section("Outliers", tables=[outliers] * bool(outliers.rows), printed=True),
                  Section("Correlation over the knees",
                          drawings=[name for name in drawings if name == "correlation"])],
    )  # fmt: skip


def _knees_table(summary: CohortSummary, knees: str) -> Table:
    """Outcome and errors of every knee, with a link to its page."""
    from markupsafe import Markup

    link = Markup('<a href="{}/{}/report.html">{}</a>')
    answered = {one.name for one in summary.fitted}

    def linked(name: str) -> str:
        return link.format(quote(knees), quote(name), name) if name in answered else name

    rows = [[one.name, one.outcome or _FAILED, *worst_errors(one.rmse).values(), one.objective,
             one.seconds] for one in summary.answers]  # fmt: skip
    columns = [Column("knee", show=linked), "outcome", Column("rmse_mm", "RMSE, mm", "3"),
               Column("rmse_deg", "RMSE, deg", "3"), "objective", Column("time_s", show="3")]
    return Table(columns, rows, note=prose("knees"))


def population_table(summary: CohortSummary) -> Table:
    """Mean and spread of each parameter over knees; the spread of logarithms in per cent."""
    rows = []
    for name, found in summary.populations.items():
        mean, low, high = map(found.in_own_unit, (found.mean, *found.mean_limits))
        factor, sign = (100.0, " %") if found.log else (1.0, "")
        spread, *ends = (number(factor * x, 3) for x in (found.spread, *found.spread_limits))
        rows.append([name, found.knees, mean, f"{number(low)} to {number(high)}", f"{spread}{sign}",
                     f"{' to '.join(ends)}{sign}", summary.units[name] or NONE])  # fmt: skip
    columns = ["parameter", "knees", "mean", Column("mean_limits", "95 % limits", words=False),
               Column("spread", words=False),
               Column("spread_limits", "95 % limits", words=False), Column("unit", words=False)]
    return Table(columns, rows, "Parameters over the knees", prose("population"))


def _every_number(summary: CohortSummary) -> Table:
    """Every number of each knee, of which one that failed has one row, then of the population."""
    about = list(dict.fromkeys(name for one in summary.answers for name in one.about))
    place = {one.name: row for row, one in enumerate(summary.fitted)}
    rows: list[list[Any]] = []

    def add(knee: str, outcome: str, known: list[Any], *cells: Any) -> None:
        missing = [None] * (len(COHORT_COLUMNS) - 2 - len(cells))
        rows.append([knee, outcome, *cells, *missing, *known])

    for one in summary.answers:
        head = one.name, one.outcome or "failed", [one.about.get(name) for name in about]
        if one.failed:
            add(*head, "failed", one.failed)
            continue
        add(*head, "objective", "objective", "", one.objective)
        for name, x in one.rmse.items():
            add(*head, "rmse", name, COORDINATES[name].unit, x)
        for name, x in one.tests.items():
            coordinate = name.rpartition(", ")[2]
            unit = COORDINATES[coordinate].unit if coordinate in COORDINATES else ""
            add(*head, "test", name, unit, x)
        for name, own in one.parameters.items():
            shrunk: list[Any] = [None, None, None]
            if (found := summary.populations.get(name)) is not None:
                row = place[one.name]
                mean, sd = float(found.shrunk[row]), float(found.deviation[row])
                # Of a logarithm, to first order.
                middle = found.in_own_unit(mean)
                shrunk = [middle, sd * middle if found.log else sd, float(found.own[row])]
            fields = ("value", "low", "high", "standard_error", "interval", "at_bound", "start")
            add(*head, "parameter", name, summary.units.get(name, ""),
                *(own[field] for field in fields), *shrunk, *summary.redrawn(one.name, name))
    for name, found in summary.populations.items():
        head, unit = ("population", "", [None] * len(about)), summary.units.get(name, "")
        mean, low, high = map(found.in_own_unit, (found.mean, *found.mean_limits))
        add(*head, "mean", name, unit, mean, low, high)
        # A standard deviation of the logarithm is one in proportion.
        unit = "of the logarithm" if found.log else unit
        add(*head, "spread", name, unit, found.spread, *found.spread_limits)
    return Table((*COHORT_COLUMNS, *about), rows)
