"""Parameters of a cohort, knee by knee."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

import numpy as np

from kneejax.report.look import BLUE, GREY, LIGHT, VERMILLION, WIDTH, readable, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from kneejax.cohorts import CohortSummary

#: Panels beside each other, and knees whose names are all written.
_ACROSS, _NAMED = 4, 40
#: Above all panels, and between two rows of them, inches: room for titles of two lines.
_ABOVE, _BETWEEN = 0.48, 0.76


@styled
def forest_figure(summary: CohortSummary) -> Figure:
    """Draw every parameter over the knees: 95 % limits, and what the others make of them.

    Args:
        summary: of a cohort.

    Returns:
        A panel for each parameter, a row for each knee; an open end is an arrow.
    """
    from matplotlib.figure import Figure

    names, knees = list(summary.units), summary.fitted
    across = min(_ACROSS, max(len(names), 1))
    down = -(-len(names) // across)
    tall = min(max(0.085 * len(knees), 0.8), 7.0)
    high = _ABOVE + down * (tall + _BETWEEN)
    figure = Figure(figsize=(WIDTH, high))
    panels = figure.subplots(down, across, sharey=True, squeeze=False)
    figure.subplots_adjust(
        left=0.55 / WIDTH, right=1.0 - 0.12 / WIDTH, wspace=0.14, hspace=_BETWEEN / tall,
        top=1.0 - (_ABOVE + 0.1) / high, bottom=(_BETWEEN - 0.1) / high,
    )  # fmt: skip
    for place, axes in enumerate(panels.flat):
        if place >= len(names):
            axes.set_axis_off()
            continue
        _panel(axes, summary, names[place])
        _name_knees(axes, [one.name for one in knees], place % across == 0)
    handles, labels = panels.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper center", ncols=5, borderaxespad=0.1)
    return figure


def _panel(axes, summary: CohortSummary, name: str) -> None:
    rows = np.arange(len(summary.fitted))
    estimates = [one.parameters.get(name) for one in summary.fitted]
    value, low, high = (
        np.array([np.nan if e is None else e[field] for e in estimates], float)
        for field in ("value", "low", "high")
    )
    unit = summary.units[name]
    found = summary.populations.get(name)
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
    for some, colour, label in (
        (told & ~good, GREY, "a poor fit"), (told & good, BLUE, "a knee, 95 % limits"),
    ):  # fmt: skip
        axes.hlines(rows[some], from_[some], to[some], color=colour, lw=0.8)
        shown = label if some.any() else None
        axes.plot(value[some], rows[some], "o", ms=2.4, color=colour, label=shown)
    for open_, edge, mark in ((~np.isfinite(low), left, "<"), (~np.isfinite(high), right, ">")):
        some = open_ & told
        axes.plot(np.full(some.sum(), edge), rows[some], mark, ms=2.6, color=BLUE, clip_on=False)
    if found is not None:
        shrunk = [found.in_own_unit(x) for x in found.shrunk]
        light = "shrunken towards the mean"
        axes.plot(shrunk, rows, "|", ms=4.0, mew=1.0, color=VERMILLION, label=light)
    axes.set_xlim(left, right)
    axes.set_title(textwrap.fill(readable(name), 22), fontsize=8)
    axes.set_xlabel(unit or "strain" if name.endswith("strain") else unit or "-")
    axes.tick_params(axis="x", labelsize=7)
    axes.locator_params(axis="x", nbins=4)
    axes.grid(axis="y", visible=False)


def _name_knees(axes, names: list[str], first: bool) -> None:
    axes.set_ylim(len(names) - 0.5, -0.5)
    every = 1 if len(names) <= _NAMED else 10
    shown = np.arange(0, len(names), every)
    axes.set_yticks(shown, [names[row] for row in shown], fontsize=5.5 if every == 1 else 7)
    axes.tick_params(axis="y", length=0, labelleft=first)
    axes.set_yticks(shown)
