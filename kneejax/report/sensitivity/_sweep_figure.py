"""Figure of one parameter's sweep: the motion at each of its values (paper 1, Figures 3 to 10)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from kneejax.geometry import COORDINATES
from kneejax.report.look import GREY, SHOWN, VERMILLION, WIDTH, readable, styled, trimmed
from kneejax.report.motion import flexion_axis, measured_curve
from kneejax.statics import Status, converged

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from kneejax.inference import Sweep, Sweeps

#: Panels of the five coordinates, in the order of `SHOWN`; the sixth holds the legend.
SPOTS = ((0, 0), (1, 0), (2, 0), (0, 1), (1, 1))
#: Free coordinate -> column of a table without flexion.
FREE_COLUMN = {name: i - 1 for i, name in enumerate(COORDINATES)}
#: The uniform scale without its lightest end, which white paper swallows.
_LOWEST, _HIGHEST = 0.0, 0.9
#: Poses that are not drawn as if they were fine: legend entry, dashes of the line, marker.
_DOUBTFUL = {
    "outside fitted surfaces": ((0, (3, 1.2)), ""),
    "a fibre torn or its way wrong": ((0, (5, 1.2)), "^"),
    "unphysiological": ((0, (1, 1)), "v"),
    "unstable": ((0, (1, 1)), "+"),
}
_NOWHERE = "no balance"
_OF_FIBRES = (
    Status.OVERSTRETCHED, Status.WAY_FLIPPED, Status.PAST_WRAP, Status.WRAP_INSIDE,
)  # fmt: skip


@styled
def sweep_figure(
    sweeps: Sweeps, name: str, measured: np.ndarray | None = None, moved: bool = False
) -> Figure:
    """Draw the motion over one parameter.

    Args:
        sweeps: with that parameter among them.
        name: the parameter.
        measured: poses `(n, 6)`, degrees and mm, drawn in black.
        moved: whether constants were added to it because its frames are not known; said so.

    Returns:
        Translations on the left, rotations on the right, a line per value, coloured low to high.
        Poses that are not balanced, not stable or not those of a knee are dashed, dotted or left
        out, marked, and counted in the legend.
    """
    from matplotlib.figure import Figure

    sweep = sweeps[name]
    figure = Figure(figsize=(WIDTH, 6.3))
    panels = figure.subplots(3, 2, sharex=True)
    figure.subplots_adjust(left=0.085, right=0.985, top=0.96, bottom=0.075, wspace=0.2, hspace=0.24)
    colours = _colours(sweep)
    faults = _faults(sweep)
    handles: dict[str, Any] = {}
    for coordinate, spot in zip(SHOWN, SPOTS, strict=True):
        axes, column = panels[spot], FREE_COLUMN[coordinate]
        axes.set_title(COORDINATES[coordinate].axis_label)
        for i, value in enumerate(sweep.values):
            at = {entry: rows[i] for entry, rows in faults.items()}
            _line(axes, sweeps.flexion_deg, sweep.table[i, :, column], colours(value), at)
        _nowhere(axes, sweeps.flexion_deg, faults[_NOWHERE])
        handles |= _own_and_measured(axes, sweeps, column, measured)
        _limits(axes, sweeps, sweep, column, measured)
        last = spot in ((2, 0), (1, 1))
        flexion_axis(axes, sweeps.flexion_deg, last)
        axes.tick_params(labelbottom=last)
    _legend(panels[2, 1], sweep, handles, faults, moved)
    _colour_bar(figure, panels[2, 1], sweep)
    return figure


def uniform_colours():
    """A scale of colours from dark (low) to bright (high) whose steps look equally large.

    It stays ordered for colour-blind readers and in grey, and ends before the yellow that is lost
    on white paper.

    Returns:
        A Matplotlib `ListedColormap`, part of viridis.
    """
    import matplotlib
    from matplotlib.colors import ListedColormap

    uniform = matplotlib.colormaps["viridis"]
    return ListedColormap(uniform(np.linspace(_LOWEST, _HIGHEST, 256)))


def _colours(sweep: Sweep):
    """Value -> colour."""
    shades, low, high = uniform_colours(), sweep.values[0], sweep.values[-1]
    return lambda value: shades((value - low) / (high - low))


def _faults(sweep: Sweep) -> dict[str, np.ndarray]:
    """Legend entry -> poses, the worst that applies to each."""
    nowhere = ~converged(sweep.status)
    unstable = sweep.status == Status.UNSTABLE
    strange = (sweep.unphysiological | (sweep.status == Status.DISLOCATED)) & ~unstable & ~nowhere
    outside = (sweep.status == Status.OUTSIDE_REGION) & ~strange
    of_fibres = np.isin(sweep.status, _OF_FIBRES) & ~strange
    return {
        "outside fitted surfaces": outside,
        "a fibre torn or its way wrong": of_fibres,
        "unphysiological": strange,
        "unstable": unstable,
        _NOWHERE: nowhere,
    }


def _line(axes: Axes, x: np.ndarray, y: np.ndarray, colour, at: dict[str, np.ndarray]) -> None:
    """A motion: solid where it is sound, otherwise in the dashes of what is wrong."""
    fine = ~np.any([rows for rows in at.values()], axis=0)
    axes.plot(x, np.where(fine, y, np.nan), color=colour, linewidth=0.8)
    for entry, (dashes, marker) in _DOUBTFUL.items():
        rows = at[entry]
        if not rows.any():
            continue
        # Stretches between a pose at fault and its neighbours, too.
        beside = rows | np.r_[rows[1:], False] | np.r_[False, rows[:-1]]
        axes.plot(x, np.where(beside, y, np.nan), color=colour, linewidth=1.0, linestyle=dashes)
        if marker:
            axes.plot(x[rows], y[rows], marker, color=colour, markersize=3, markeredgewidth=0.8)


def _nowhere(axes: Axes, x: np.ndarray, rows: np.ndarray) -> None:
    """Crosses at the bottom edge, where any value has no balance."""
    lost = rows.any(axis=0)
    if lost.any():
        axes.plot(
            x[lost],
            np.full(lost.sum(), 0.03),
            "x",
            color=GREY,
            markersize=4.5,
            markeredgewidth=1.2,
            transform=axes.get_xaxis_transform(),
            clip_on=False,
            zorder=5,
        )


def _own_and_measured(axes: Axes, sweeps: Sweeps, column: int, measured) -> dict[str, Any]:
    (own,) = axes.plot(
        sweeps.flexion_deg, sweeps.table[:, column], color=VERMILLION, linewidth=1.8, linestyle="--"
    )
    if measured is None:
        return {"own": own}
    style = {**measured_curve(measured[:, 0]), "markersize": 2.2}
    (points,) = axes.plot(measured[:, 0], measured[:, column + 1], **style)
    return {"own": own, "measured": points}


def _limits(axes: Axes, sweeps: Sweeps, sweep: Sweep, column: int, measured) -> None:
    """What a working knee does fills the panel; what flies off may leave it."""
    seen = [sweep.table[..., column][sweep.sound], sweeps.table[:, column]]
    if measured is not None:
        seen.append(measured[:, column + 1])
    numbers = np.concatenate(seen)
    if not np.isfinite(numbers).any():
        return
    low, high = np.nanmin(numbers), np.nanmax(numbers)
    pad = 0.07 * max(high - low, 1.0)
    axes.set_ylim(low - pad, high + pad)


def _legend(axes: Axes, sweep: Sweep, handles: dict[str, Any], faults, moved: bool) -> None:
    from matplotlib.lines import Line2D

    axes.set_axis_off()
    entries = []
    if "measured" in handles:
        words = "measured, moved onto the knee itself" if moved else "measured"
        entries.append((handles["measured"], words))
    own = f"{trimmed(sweep.own)} {sweep.unit}".strip()
    entries.append((handles["own"], f"the knee itself ({own})"))
    for entry, (dashes, marker) in _DOUBTFUL.items():
        if faults[entry].any():
            style = {"color": GREY, "linewidth": 0.8, "linestyle": dashes}
            line = Line2D([], [], marker=marker or "none", markersize=3.5, **style)
            entries.append((line, _counted(entry, faults[entry])))
    if faults[_NOWHERE].any():
        cross = Line2D([], [], color=GREY, marker="x", markersize=4.5, linestyle="none")
        entries.append((cross, _counted(_NOWHERE, faults[_NOWHERE])))
    lines, words = zip(*entries, strict=True)
    axes.legend(
        lines, words, loc="upper left", bbox_to_anchor=(0.0, 0.86), borderaxespad=0,
        handlelength=2.6, labelspacing=0.35,
    )  # fmt: skip


def _counted(entry: str, rows: np.ndarray) -> str:
    return f"{entry}: {rows.sum()} of {rows.size} poses"


def _colour_bar(figure: Figure, axes: Axes, sweep: Sweep) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    scale = Normalize(sweep.values[0], sweep.values[-1])
    bar = figure.colorbar(
        ScalarMappable(scale, uniform_colours()),
        cax=axes.inset_axes((0.0, 0.06, 0.97, 0.075)),
        orientation="horizontal",
    )
    unit = f", {sweep.unit}" if sweep.unit else ""
    bar.set_label(readable(sweep.name) + unit)
    bar.outline.set_linewidth(0.5)  # pyright: ignore[reportCallIssue, reportAttributeAccessIssue]
    if sweep.values[0] <= sweep.own <= sweep.values[-1]:
        bar.ax.plot(
            [sweep.own], [1.12], "v", color=VERMILLION, markersize=5, clip_on=False,
            transform=bar.ax.get_xaxis_transform(),
        )  # fmt: skip
