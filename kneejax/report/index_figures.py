"""Figures of global sensitivity: Sobol and Morris indices as bars with confidence intervals."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kneejax.geometry import COORDINATES
from kneejax.report.look.style import BLACK, BLUE, GREY, SHOWN, WIDTH, readable, styled
from kneejax.report.sensitivity_figures import MOST_PARAMETERS, largest_shares, looks

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from kneejax.inference import MotionIndices


#: Method -> its two measures and how an axis calls them; what its bars measure.
_MEASURES = {
    "sobol": {"total_order": "total order", "first_order": "first order"},
    "morris": {"mu_star": "mean size of the effect", "sigma": "its standard deviation"},
}
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

    indices, shown, sobol = found.indices, _largest(found), found.indices.method == "sobol"
    height = 3 * (0.62 + 0.21 * len(shown)) + 0.7
    figure = Figure(figsize=(WIDTH, height))
    panels = figure.subplots(3, 2, sharey=True, sharex=sobol)
    # Morris' effects have units: each panel has its own axis then, which takes room.
    figure.subplots_adjust(
        left=0.2, right=0.985, top=1 - 0.3 / height, bottom=1.05 / height, wspace=0.08,
        hspace=(0.42 if sobol else 0.58) / (height / 3 - 0.5),
    )  # fmt: skip
    handles: dict = {}
    places = np.arange(len(shown))
    for k, (axes, name) in enumerate(zip(panels.flat, ("", *SHOWN), strict=True)):
        row, title = found.row(name), "Objective"
        if name:
            title = f"{COORDINATES[name].label}, RMSE"
            title += "" if sobol else f", {COORDINATES[name].unit}"
        axes.set_title(title)
        pair = _MEASURES[indices.method].items()
        looks_of_pair = ((BLUE, -0.22), ("#9CC6E0", 0.22))
        for (measure, label), (colour, shift) in zip(pair, looks_of_pair, strict=True):
            values = indices.measures[measure][row, shown]
            handles[label] = axes.barh(places + shift, values, 0.44, color=colour)
            if measure in indices.half_widths:
                half = indices.half_widths[measure][row, shown]
                handles[f"{100 * indices.confidence:g} % interval"] = _interval(
                    axes, values, places + shift, 0.8, 1.8, xerr=half
                )
        axes.set_yticks(places, [readable(indices.names[i]) for i in shown])
        axes.set_ylim(len(shown) - 0.4, -0.6)
        axes.axvline(0.0, color=GREY, linewidth=0.7)
        axes.grid(axis="y", visible=False)
        axes.tick_params(axis="y", length=0)
        _say_if_empty(axes, indices.measures[_main(found)][row])
        if sobol:
            axes.tick_params(labelbottom=k > 3)
        if k > 3:
            axes.set_xlabel(_AXIS[indices.method])
    figure.legend(
        handles.values(), handles, loc="lower center", bbox_to_anchor=(0.59, 0.36 / height),
        ncols=3, borderaxespad=0,
    )  # fmt: skip
    _say_what_is_left_out(figure, found)
    return figure


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
    measure, sobol = _main(found), indices.method == "sobol"
    figure = Figure(figsize=(WIDTH, 7.9))
    panels = figure.subplots(5, 1, sharex=True, sharey=sobol)
    figure.subplots_adjust(left=0.085, right=0.985, top=0.965, bottom=0.178, hspace=0.32)
    width = 0.92 / len(shown)
    styles = looks(tuple(indices.names[i] for i in shown))
    handles = {}
    for axes, name in zip(panels, SHOWN, strict=True):
        rows = [found.row(name, angle) for angle in angles]
        for k, (i, (colour, quantity)) in enumerate(zip(shown, styles, strict=True)):
            places = np.arange(len(angles)) + (k - (len(shown) - 1) / 2) * width
            values = indices.measures[measure][rows, i]
            handles[readable(indices.names[i])] = axes.bar(
                places, values, 0.96 * width, facecolor=colour, edgecolor="white",
                hatch=_HATCHES[quantity % len(_HATCHES)], linewidth=0,
            )  # fmt: skip
            half = indices.half_widths[measure][rows, i]
            _interval(axes, places, values, 0.7, 1.4, yerr=half)
        unit = "" if sobol else f", {COORDINATES[name].unit}"
        words = _MEASURES[indices.method][measure]
        axes.set_title(f"{COORDINATES[name].label}: {words}{unit}")
        axes.set_ylabel("Share" if sobol else "Change")
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


def _main(found: MotionIndices) -> str:
    return next(iter(_MEASURES[found.indices.method]))


def _largest(found: MotionIndices) -> list[int]:
    return largest_shares(found.indices.measures[_main(found)], MOST_PARAMETERS)


def _interval(axes: Axes, x, y, width: float, cap: float, **half: np.ndarray):
    return axes.errorbar(
        x, y, **half, fmt="none", ecolor=BLACK, elinewidth=width, capsize=cap, capthick=width
    )


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
