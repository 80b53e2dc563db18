"""Figures of knees side by side: a parameter's ramps, and the scores of paper 4."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kneejax.report.look import (
    BLACK,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    WIDTH,
    styled,
    verbatim,
    without_frame,
)
from kneejax.report.sensitivity import uniform_colours
from kneejax.reproduction import LIMITS
from kneejax.reproduction.paper4 import ATTACHMENT, CHANGED, HALVES, MODULUS, PRESTRETCH

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from kneejax.reproduction import KneeComparison, KneeStudy

_QUANTITIES = {
    PRESTRETCH: "prestretch",
    MODULUS: "Young's modulus",
    ATTACHMENT: "attachment",
}
_OUTCOMES = dict(
    zip(LIMITS, ("Convergence", "Rotation", "Peak pressure", "Place of the peak"), strict=True)
)
_MARKERS = {"varus": "^", "valgus": "v"}
#: Compartments, by dashes and fill: colours are for values.
_CONTACT_STYLES = (("-", GREY), ((0, (4, 1.5)), "white"))
_MOST_COLUMNS = 5
#: A score that is not known.
_UNKNOWN = {"hatch": "////", "facecolor": "#F7F7F7", "edgecolor": "#A0A0A0", "linewidth": 0}


def parameter_words(parameter: str) -> str:
    """A parameter as figures name it.

    Example:
        >>> parameter_words("MCL.youngs_modulus")
        "MCL Young's modulus"
    """
    ligament, quantity = parameter.split(".")
    return f"{verbatim(ligament)} {_QUANTITIES[quantity]}"


@styled
def ramp_figure(found: KneeComparison, parameter: str) -> Figure:
    """Draw what one parameter does in every knee that has it (Figures 4 and 5 of paper 4).

    Args:
        found: knees side by side.
        parameter: e.g. `MCL.prestretch`.

    Returns:
        A column per knee: rotation over the moment, a line per value; the moment that each value
        holds; and the peak contact pressures at the moment at which all are compared. Colour means
        the value alone; compartments differ by dashes and by filled or hollow markers.
    """
    from matplotlib.figure import Figure

    knees = [knee for knee in found.knees if parameter in knee.parameters]
    blocks = -(-len(knees) // _MOST_COLUMNS)
    columns = min(len(knees), _MOST_COLUMNS)
    height = 6.6 * blocks + 0.75
    figure = Figure(figsize=(WIDTH, height))
    panels = figure.subplots(3 * blocks, columns, sharey="row", squeeze=False)
    figure.subplots_adjust(
        left=0.085,
        right=0.985,
        top=1 - 0.48 / height,
        bottom=1.0 / height,
        wspace=0.08,
        hspace=0.44,
    )
    colours, scale = _colours(knees[0], parameter)
    for number, knee in enumerate(knees):
        block, column = divmod(number, _MOST_COLUMNS)
        rows = panels[3 * block : 3 * block + 3, column]
        rows[0].set_title(verbatim(knee.name), fontsize=8)
        _rotation(rows[0], knee, parameter, colours)
        _held(rows[1], knee, parameter, colours, found.settings.full_Nm)
        _pressure(rows[2], knee, parameter)
        if column == 0:
            for axes, label in zip(
                rows, ("Varus rotation, deg", "Moment held, N m", "Peak pressure, MPa"), strict=True
            ):
                axes.set_ylabel(label)
    for axes in panels[2::3].flat:
        axes.set_ylim(bottom=0.0)
    _empty(panels, len(knees), columns)
    figure.suptitle(
        parameter_words(parameter), x=0.012, y=1 - 0.08 / height, ha="left", va="top", fontsize=9
    )
    _legend(figure, knees[0], height, colours, scale, parameter)
    return figure


def _empty(panels: np.ndarray, count: int, columns: int) -> None:
    """Panels beyond the last knee."""
    for place in range(count, panels.shape[0] // 3 * columns):
        block, column = divmod(place, columns)
        for axes in panels[3 * block : 3 * block + 3, column]:
            axes.set_axis_off()


def _colours(knee: KneeStudy, parameter: str):
    from matplotlib.colors import Normalize

    values = [change.value for change in knee.changes if change.parameter == parameter]
    if parameter.endswith(ATTACHMENT):
        shades = dict(zip(HALVES, (GREEN, ORANGE, PURPLE), strict=True))
        return shades.__getitem__, None
    largest = max(abs(value) for value in values)
    scale, shades = Normalize(-largest, largest), uniform_colours()
    return lambda value: shades(float(scale(value))), scale


def _rotation(axes: Axes, knee: KneeStudy, parameter: str, colours) -> None:
    for run in knee.runs.values():
        shown = run.ramp.loaded
        x = run.ramp.moment_Nm[shown]
        for row, change in enumerate(knee.changes, 1):
            if change.parameter == parameter:
                y = run.adduction_deg[row, shown]
                axes.plot(x, y, color=colours(change.value), linewidth=0.9)
        y = run.adduction_deg[0, shown]
        axes.plot(x, y, color=BLACK, linewidth=1.4, linestyle="--")
    axes.set_xlabel("Moment, N m")
    full = max(run.ramp.full_Nm for run in knee.runs.values())
    axes.set_xlim(-1.2 * full, 1.2 * full)
    axes.set_xticks([-full, 0.0, full])
    axes.axhline(0, color=GREY, linewidth=0.5, zorder=0)


def _held(axes: Axes, knee: KneeStudy, parameter: str, colours, full_Nm: float) -> None:
    for direction, run in knee.runs.items():
        own = float(run.moment_reached_Nm[0])
        axes.axhline(own, color=BLACK, linewidth=1.0, linestyle="--", zorder=1)
        for one in knee.outcomes:
            if (one.change.parameter, one.direction) == (parameter, direction):
                axes.plot(
                    one.change.value, one.moment_reached_Nm, _MARKERS[direction],
                    color=colours(one.change.value), markersize=4.5, clip_on=False, zorder=3,
                )  # fmt: skip
    axes.set_ylim(-1.1 * full_Nm, 1.1 * full_Nm)
    _value_axis(axes, knee, parameter, labelled=False)


def _pressure(axes: Axes, knee: KneeStudy, parameter: str) -> None:
    for direction in knee.runs:
        own = [
            one
            for one in knee.outcomes
            if (one.change.parameter, one.direction) == (parameter, direction)
        ]
        values = np.array([one.change.value for one in own])
        peaks = np.array([one.peak_MPa for one in own])
        order, unchanged = np.argsort(values), own[0].unchanged_peak_MPa
        for i, (dashes, fill) in zip(range(len(knee.contacts)), _CONTACT_STYLES, strict=False):
            style = {"color": GREY, "markersize": 4, "linewidth": 0.9, "markerfacecolor": fill}
            line = "none" if parameter.endswith(ATTACHMENT) else dashes
            x, y = np.append(values, 0.0), np.append(peaks[:, i], unchanged[i])
            order = np.argsort(x)
            axes.plot(x[order], y[order], linestyle=line, marker=_MARKERS[direction], **style)
            axes.plot(
                0.0, unchanged[i], _MARKERS[direction], color=BLACK, markersize=4, zorder=4,
                markerfacecolor=BLACK if fill == GREY else fill,
            )  # fmt: skip
    _value_axis(axes, knee, parameter, labelled=True)
    moments = {
        one.direction: one.compared_at_Nm
        for one in knee.outcomes
        if one.change.parameter == parameter and np.isfinite(one.compared_at_Nm)
    }
    words = " and ".join(f"{m:+g}".replace("-", "\u2212") for m in moments.values())
    axes.set_title(f"at {words} N m" if words else "not compared", fontsize=7, color=GREY)


def _value_axis(axes: Axes, knee: KneeStudy, parameter: str, labelled: bool) -> None:
    quantity = parameter.split(".")[1]
    values = [change.value for change in knee.changes if change.parameter == parameter]
    if quantity == ATTACHMENT:
        axes.set_xticks([0.0, *HALVES], ["as is", "femur", "tibia", "both"])
        axes.tick_params(axis="x", labelsize=6.3)
        axes.set_xlim(-0.5, 3.5)
    else:
        largest = max(abs(value) for value in values)
        axes.set_xlim(-1.25 * largest, 1.25 * largest)
        axes.set_xticks([-largest, 0.0, largest])
    axes.set_xlabel(_value_words(quantity) if labelled else "")


def _value_words(quantity: str) -> str:
    if quantity == ATTACHMENT:
        return "Halved on"
    unit = CHANGED[quantity]
    return "Change" + (f", {unit}" if unit else "")


def _legend(figure: Figure, knee: KneeStudy, height: float, colours, scale, parameter: str) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, Normalize
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], color=BLACK, linestyle="--", label="unchanged")]
    handles += [
        Line2D([], [], color=GREY, marker=marker, linestyle="none", markersize=4.5, label=name)
        for name, marker in _MARKERS.items()
    ]
    handles += [
        Line2D(
            [], [], color=GREY, linestyle=dashes, marker="o", markersize=4, markerfacecolor=fill,
            linewidth=0.9, label=verbatim(name),
        )
        for name, (dashes, fill) in zip(knee.contacts, _CONTACT_STYLES, strict=False)
    ]
    figure.legend(
        handles=handles, loc="lower left", bbox_to_anchor=(0.075, 0.1 / height), ncols=5,
        handlelength=1.8, columnspacing=1.2, fontsize=7.5, borderaxespad=0,
    )  # fmt: skip
    if scale is None:
        return
    shades = ListedColormap([colours(x) for x in np.linspace(scale.vmin, scale.vmax, 128)])
    place = figure.add_axes((0.7, 0.38 / height, 0.27, 0.11 / height))
    bar = figure.colorbar(
        ScalarMappable(Normalize(scale.vmin, scale.vmax), shades),
        cax=place,
        orientation="horizontal",
        ticks=[scale.vmin, 0.0, scale.vmax],
    )
    bar.outline.set_visible(False)
    bar.ax.tick_params(labelsize=7, length=2, pad=1)
    bar.ax.set_title(_value_words(parameter.split(".")[1]), fontsize=7, loc="left", pad=2)


@styled
def score_figure(found: KneeComparison) -> Figure:
    """Draw the scores of every parameter and outcome, knees side by side (paper 4, Figs 6 to 8).

    Args:
        found: knees side by side.

    Returns:
        A row per parameter, a block of columns per outcome, in it a column per knee. Numbers are
        means of the scores in varus and valgus; hatched: the knee does not have the parameter, or
        nothing could be compared.
    """
    import matplotlib
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    parameters, knees = found.parameters, found.knees
    gap = 0.35
    height = 0.235 * len(parameters) + 0.75 + 0.055 * max(len(knee.name) for knee in knees)
    figure = Figure(figsize=(WIDTH, height))
    below = (0.38 + 0.055 * max(len(knee.name) for knee in knees)) / height
    axes = figure.add_axes((0.2, below, 0.67, 1 - below - 0.3 / height))
    shades, scale = matplotlib.colormaps["YlGnBu"], Normalize(0, 3.4)
    ticks, hatched, size = [], False, 6.4 - 0.3 * len(knees)
    for block, outcome in enumerate(_OUTCOMES):
        left = block * (len(knees) + gap)
        axes.text(
            left + len(knees) / 2, -0.25, _OUTCOMES[outcome], ha="center", va="bottom", fontsize=8
        )
        for column, knee in enumerate(knees):
            ticks.append((left + column + 0.5, verbatim(knee.name)))
            for row, parameter in enumerate(parameters):
                one = knee.influence(parameter, outcome)
                number = np.nan if one is None else one.score
                hatched |= _cell(axes, (left + column, row), number, shades, scale, size)
    width = 4 * len(knees) + 3 * gap
    axes.set_xlim(0, width)
    axes.set_ylim(len(parameters), 0)
    axes.set_xticks(*zip(*ticks, strict=True), rotation=90, fontsize=7)
    axes.set_yticks(
        np.arange(len(parameters)) + 0.5,
        [parameter_words(name) for name in parameters],
        fontsize=7.5,
    )
    without_frame(axes)
    place = figure.add_axes((0.885, below, 0.015, 1 - below - 0.3 / height))
    bar = figure.colorbar(ScalarMappable(scale, shades), cax=place, ticks=[0, 1, 2, 3])
    bar.ax.set_ylim(0, 3)
    bar.ax.set_yticklabels(["0 none", "1 small", "2 medium", "3 large"], fontsize=7)
    bar.ax.tick_params(length=2)
    bar.outline.set_visible(False)
    if hatched:
        figure.legend(
            [Rectangle((0, 0), 1, 1, **_UNKNOWN)], ["not in this knee, or not compared"],
            loc="lower left", bbox_to_anchor=(0.01, 0.02), fontsize=7, borderaxespad=0,
            handlelength=1.4,
        )  # fmt: skip
    return figure


def _cell(
    axes: Axes, corner: tuple[float, float], number: float, shades, scale, size: float
) -> bool:
    """One score; whether it is unknown comes back."""
    from matplotlib.patches import Rectangle

    if np.isnan(number):
        axes.add_patch(Rectangle(corner, 1, 1, **_UNKNOWN))
        return True
    axes.add_patch(
        Rectangle(corner, 1, 1, facecolor=shades(scale(number)), edgecolor="white", linewidth=1)
    )
    axes.text(
        corner[0] + 0.5, corner[1] + 0.5, f"{number:g}", ha="center", va="center", fontsize=size,
        color="white" if number > 1.8 else BLACK,
    )  # fmt: skip
    return False
