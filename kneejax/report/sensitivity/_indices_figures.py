"""Figures of global sensitivity: Sobol and Morris indices as bars with confidence intervals."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kneejax.geometry import COORDINATES
from kneejax.report.look import BLACK, GREY, SHOWN, WIDTH, readable, styled
from kneejax.report.sensitivity._figures import MOST_PARAMETERS, looks

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from kneejax.inference import MotionIndices

#: Measure -> how it is called on an axis.
_WORDS = {
    "total_order": "total order",
    "first_order": "first order",
    "mu_star": "mean size of the effect",
    "sigma": "its standard deviation",
}
_MAIN = {"sobol": "total_order", "morris": "mu_star"}
_OTHER = {"sobol": "first_order", "morris": "sigma"}
#: Method -> what its bars measure.
_AXIS = {"sobol": "Share of the variance", "morris": "Change over a parameter's range"}
_HATCHES = ("", "/////", ".....", "xxxxx")


@styled
def fit_indices_figure(found: MotionIndices) -> Figure:
    """Draw what decides how far the motion is from the measured one.

    Args:
        found: Sobol or Morris indices of a motion.

    Returns:
        The objective and the root mean square error of each coordinate, two bars a parameter with
        their confidence intervals.
    """
    from matplotlib.figure import Figure

    shown = _largest(found)
    height = 3 * (0.62 + 0.21 * len(shown)) + 0.7
    figure = Figure(figsize=(WIDTH, height))
    panels = figure.subplots(3, 2, sharey=True, sharex=found.indices.method == "sobol")
    # Morris' effects have units: each panel has its own axis then, which takes room.
    gap = 0.42 if found.indices.method == "sobol" else 0.58
    figure.subplots_adjust(
        left=0.2, right=0.985, top=1 - 0.3 / height, bottom=1.05 / height, wspace=0.08,
        hspace=gap / (height / 3 - 0.5),
    )  # fmt: skip
    handles: dict = {}
    for k, name in enumerate(("", *SHOWN)):
        axes = panels[k // 2, k % 2]
        title, unit = "Objective", ""
        if name:
            title, unit = f"{COORDINATES[name].label}, RMSE", COORDINATES[name].unit
        handles |= _paired_bars(axes, found, found.row(name), shown)
        if found.indices.method == "morris" and unit:
            title += f", {unit}"
        axes.set_title(title)
        if found.indices.method == "sobol":
            axes.tick_params(labelbottom=k > 3)
        if k > 3:
            axes.set_xlabel(_AXIS[found.indices.method])
    figure.legend(
        handles.values(), handles, loc="lower center", bbox_to_anchor=(0.59, 0.36 / height),
        ncols=3, borderaxespad=0,
    )  # fmt: skip
    _say_what_is_left_out(figure, found)
    return figure


def _paired_bars(axes: Axes, found: MotionIndices, row: int, shown: list[int]) -> dict:
    indices = found.indices
    places = np.arange(len(shown))
    handles = {}
    pair = ((_MAIN[indices.method], "#0072B2", -0.22), (_OTHER[indices.method], "#9CC6E0", 0.22))
    for measure, colour, shift in pair:
        values = indices.measures[measure][row, shown]
        half = indices.half_widths.get(measure)
        handles[_WORDS[measure]] = axes.barh(places + shift, values, 0.44, color=colour)
        if half is not None:
            handles[f"{100 * indices.confidence:g} % interval"] = axes.errorbar(
                values, places + shift, xerr=half[row, shown], fmt="none", ecolor=BLACK,
                elinewidth=0.8, capsize=1.8, capthick=0.8,
            )  # fmt: skip
    axes.set_yticks(places, [readable(indices.names[i]) for i in shown])
    axes.set_ylim(len(shown) - 0.4, -0.6)
    axes.axvline(0.0, color=GREY, linewidth=0.7)
    axes.grid(axis="y", visible=False)
    axes.tick_params(axis="y", length=0)
    _say_if_empty(axes, indices.measures[pair[0][0]][row])
    return handles


@styled
def pose_indices_figure(found: MotionIndices) -> Figure:
    """Draw what decides each coordinate at several angles.

    Args:
        found: Sobol or Morris indices of a motion.

    Returns:
        A panel per coordinate; groups of bars over flexion, one bar per parameter with its
        confidence interval: the colour is its ligament's, the hatch its quantity's.
    """
    from matplotlib.figure import Figure

    indices, angles, shown = found.indices, found.flexion_deg, _largest(found)
    measure = _MAIN[indices.method]
    half = indices.half_widths[measure]
    figure = Figure(figsize=(WIDTH, 7.9))
    panels = figure.subplots(5, 1, sharex=True, sharey=indices.method == "sobol")
    figure.subplots_adjust(left=0.085, right=0.985, top=0.965, bottom=0.178, hspace=0.32)
    width = 0.92 / len(shown)
    styles = looks(tuple(indices.names[i] for i in shown))
    handles = {}
    for axes, name in zip(panels, SHOWN, strict=True):
        rows = [found.row(name, angle) for angle in angles]
        for k, i in enumerate(shown):
            places = np.arange(len(angles)) + (k - (len(shown) - 1) / 2) * width
            colour, quantity = styles[k]
            handles[readable(indices.names[i])] = axes.bar(
                places, indices.measures[measure][rows, i], 0.96 * width, facecolor=colour,
                edgecolor="white", hatch=_HATCHES[quantity % len(_HATCHES)], linewidth=0,
            )  # fmt: skip
            axes.errorbar(
                places, indices.measures[measure][rows, i], yerr=half[rows, i], fmt="none",
                ecolor=BLACK, elinewidth=0.7, capsize=1.4, capthick=0.7,
            )  # fmt: skip
        unit = f", {COORDINATES[name].unit}" if indices.method == "morris" else ""
        axes.set_title(f"{COORDINATES[name].label}: {_WORDS[measure]}{unit}")
        axes.set_ylabel("Share" if indices.method == "sobol" else "Change")
        axes.set_ylim(bottom=0)
        axes.grid(axis="x", visible=False)
        _say_if_empty(axes, indices.measures[measure][rows])
    panels[-1].set_xticks(range(len(angles)), [f"{angle:g}" for angle in angles])
    panels[-1].set_xlabel("Flexion, deg")
    panels[-1].legend(
        handles.values(), handles, loc="upper center", bbox_to_anchor=(0.5, -0.42), ncols=4,
        borderaxespad=0,
    )  # fmt: skip
    _say_what_is_left_out(figure, found)
    return figure


def _largest(found: MotionIndices) -> list[int]:
    """Parameters to draw, in their own order: those with the largest index of any output."""
    indices = found.indices
    size = np.nan_to_num(np.abs(indices.measures[_MAIN[indices.method]]))
    share = (size / np.maximum(size.max(axis=1, keepdims=True), 1e-300)).max(axis=0)
    return sorted(np.argsort(-share, kind="stable")[:MOST_PARAMETERS].tolist())


def _say_what_is_left_out(figure: Figure, found: MotionIndices) -> None:
    indices, hidden = found.indices, len(found.indices.names) - MOST_PARAMETERS
    notes = []
    if indices.left_out:
        kind = "Saltelli blocks" if indices.method == "sobol" else "trajectories"
        notes.append(
            f"{indices.left_out} of {indices.blocks} {kind} left out: they hold a run in which the "
            "knee is not balanced and stable"
        )
    if hidden > 0:
        notes.append(f"{hidden} parameters with smaller indices not shown")
    below = 0.07 / figure.get_size_inches()[1]
    figure.text(0.085, below, "\n".join(notes), fontsize=7.5, color=GREY)


def _say_if_empty(axes: Axes, values: np.ndarray) -> None:
    if not np.isfinite(values).any():
        axes.text(
            0.5, 0.5, "not computed", color=GREY, ha="center", va="center", transform=axes.transAxes
        )
