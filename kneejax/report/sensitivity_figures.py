"""Figures of the motion over parameters: sweeps (paper 1, Figures 3 to 10) and derivatives."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from kneejax.geometry import COORDINATES
from kneejax.report.panels import flexion_axis, mark_status, measured_curve, part_legend
from kneejax.report.look.style import GREY, PARTS, SHOWN, VERMILLION, WIDTH, readable, styled
from kneejax.report.look.tables import trimmed
from kneejax.statics import Status, converged

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from kneejax.inference import LocalSensitivity, Sweep, Sweeps


#: Panels of the five coordinates, in the order of `SHOWN`; the sixth holds the legend.
_SPOTS = ((0, 0), (1, 0), (2, 0), (0, 1), (1, 1))
#: Free coordinate -> column of a table without flexion.
FREE_COLUMN = {name: i - 1 for i, name in enumerate(COORDINATES)}
OF_FIBRES = (Status.OVERSTRETCHED, Status.WAY_FLIPPED, Status.PAST_WRAP, Status.WRAP_INSIDE)
#: Poses that are not drawn as if they were fine: legend entry, dashes of the line, marker.
_DOUBTFUL = {
    "outside fitted surfaces": ((0, (3, 1.2)), ""),
    "a fibre torn or its way wrong": ((0, (5, 1.2)), "^"), "unphysiological": ((0, (1, 1)), "v"),
    "unstable": ((0, (1, 1)), "+"),
}
_NOWHERE = "no balance"
#: Scale -> what follows the unit on an axis, and what one step of a parameter is.
_PER = {"prior": "per prior SD", "percent": "per %"}
_STEP = {
    "prior": "one standard deviation of each parameter's prior",
    "percent": "1 % of each value (0.01 of a reference strain)",
}
#: Dashes of the quantities, in the order in which they come.
_DASHES = ("-", (0, (4, 1.5)), (0, (1, 1)), (0, (5, 1.2, 1, 1.2)))
#: Parameters that one panel can show as curves or bars; rows of a heat map.
MOST_PARAMETERS, _MOST_ROWS = 12, 40
_TRANSLATIONS = ("lateral", "anterior", "superior")


def _panels(figure: Figure, flexion: np.ndarray, **shared: Any) -> Iterator[tuple[str, Axes]]:
    """Each coordinate with its panel: translations on the left, rotations on the right."""
    every = figure.subplots(3, 2, sharex=True, **shared)
    every[2, 1].set_axis_off()
    for coordinate, spot in zip(SHOWN, _SPOTS, strict=True):
        yield coordinate, every[spot]
        last = spot in ((2, 0), (1, 1))
        flexion_axis(every[spot], flexion, last)
        every[spot].tick_params(labelbottom=last)


def _curves() -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, 6.3))
    figure.subplots_adjust(left=0.085, right=0.985, top=0.96, bottom=0.075, wspace=0.2, hspace=0.24)
    return figure


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
    sweep, flexion, figure = sweeps[name], sweeps.flexion_deg, _curves()
    shades, faults = uniform_colours(), _faults(sweep)
    low, high = sweep.values[0], sweep.values[-1]
    handles: dict[str, Any] = {}
    for coordinate, axes in _panels(figure, flexion):
        column = FREE_COLUMN[coordinate]
        axes.set_title(COORDINATES[coordinate].axis_label)
        for i, value in enumerate(sweep.values):
            at = {entry: rows[i] for entry, rows in faults.items()}
            colour = shades((value - low) / (high - low))
            _line(axes, flexion, sweep.table[i, :, column], colour, at)
        lost = faults[_NOWHERE].any(axis=0)
        if lost.any():  # crosses at the bottom edge
            axes.plot(
                flexion[lost], np.full(lost.sum(), 0.03), "x", color=GREY, markersize=4.5,
                markeredgewidth=1.2, transform=axes.get_xaxis_transform(), clip_on=False, zorder=5,
            )  # fmt: skip
        own = sweeps.table[:, column]
        seen = [sweep.table[..., column][sweep.sound], own]
        (handles["own"],) = axes.plot(flexion, own, "--", color=VERMILLION, linewidth=1.8)
        if measured is not None:
            style = {**measured_curve(measured[:, 0]), "markersize": 2.2}
            drawn = axes.plot(measured[:, 0], measured[:, column + 1], **style)
            handles["measured"] = drawn[0]
            seen.append(measured[:, column + 1])
        numbers = np.concatenate(seen)
        if np.isfinite(numbers).any():
            # What a working knee does fills the panel; what flies off may leave it.
            least, most = np.nanmin(numbers), np.nanmax(numbers)
            pad = 0.07 * max(most - least, 1.0)
            axes.set_ylim(least - pad, most + pad)
    words = figure.axes[5]
    _legend(words, sweep, handles, faults, moved)
    _colour_bar(figure, words, sweep)
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

    return ListedColormap(matplotlib.colormaps["viridis"](np.linspace(0.0, 0.9, 256)))


def _faults(sweep: Sweep) -> dict[str, np.ndarray]:
    """Legend entry -> poses, the worst that applies to each."""
    nowhere = ~converged(sweep.status)
    unstable = sweep.status == Status.UNSTABLE
    strange = (sweep.unphysiological | (sweep.status == Status.DISLOCATED)) & ~unstable & ~nowhere
    outside = (sweep.status == Status.OUTSIDE_REGION) & ~strange
    of_fibres = np.isin(sweep.status, OF_FIBRES) & ~strange
    return dict(zip((*_DOUBTFUL, _NOWHERE), (outside, of_fibres, strange, unstable, nowhere),
                    strict=True))  # fmt: skip


def _line(axes: Axes, x: np.ndarray, y: np.ndarray, colour, at: dict[str, np.ndarray]) -> None:
    """A motion: solid where it is sound, otherwise in the dashes of what is wrong."""
    fine = ~np.any([rows for rows in at.values()], axis=0)
    axes.plot(x, np.where(fine, y, np.nan), color=colour, linewidth=0.8)
    for entry, (dashes, marker) in _DOUBTFUL.items():
        rows = at[entry]
        if not rows.any():
            continue
        # From a pose at fault to its neighbours, too.
        beside = rows | np.r_[rows[1:], False] | np.r_[False, rows[:-1]]
        axes.plot(x, np.where(beside, y, np.nan), color=colour, linewidth=1.0, linestyle=dashes)
        if marker:
            axes.plot(x[rows], y[rows], marker, color=colour, markersize=3, markeredgewidth=0.8)


def _legend(axes: Axes, sweep: Sweep, handles: dict[str, Any], faults, moved: bool) -> None:
    from matplotlib.lines import Line2D

    entries = []
    if "measured" in handles:
        words = "measured, moved onto the knee itself" if moved else "measured"
        entries.append((handles["measured"], words))
    own = f"{trimmed(sweep.own)} {sweep.unit}".strip()
    entries.append((handles["own"], f"the knee itself ({own})"))
    cross = {_NOWHERE: ("none", "x")}
    for entry, (dashes, marker) in (_DOUBTFUL | cross).items():
        if (rows := faults[entry]).any():
            style = {"color": GREY, "linewidth": 0.8, "linestyle": dashes}
            line = Line2D([], [], marker=marker or "none", markersize=3.5, **style)
            entries.append((line, f"{entry}: {rows.sum()} of {rows.size} poses"))
    lines, words = zip(*entries, strict=True)
    axes.legend(
        lines, words, loc="upper left", bbox_to_anchor=(0.0, 0.86), borderaxespad=0,
        handlelength=2.6, labelspacing=0.35,
    )  # fmt: skip


def _colour_bar(figure: Figure, axes: Axes, sweep: Sweep) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    scale = ScalarMappable(Normalize(sweep.values[0], sweep.values[-1]), uniform_colours())
    place = axes.inset_axes((0.0, 0.06, 0.97, 0.075))
    bar = figure.colorbar(scale, cax=place, orientation="horizontal")
    bar.set_label(readable(sweep.name) + (f", {sweep.unit}" if sweep.unit else ""))
    bar.outline.set_linewidth(0.5)  # pyright: ignore[reportCallIssue, reportAttributeAccessIssue]
    if sweep.values[0] <= sweep.own <= sweep.values[-1]:
        bar.ax.plot(
            [sweep.own], [1.12], "v", color=VERMILLION, markersize=5, clip_on=False,
            transform=bar.ax.get_xaxis_transform(),
        )  # fmt: skip


def looks(names: tuple[str, ...]) -> list[tuple[str, int]]:
    """Colour of each parameter's ligament, and the number of its quantity, both as they come."""
    ligaments = list(dict.fromkeys(name.split(".", 1)[0] for name in names))
    quantities = list(dict.fromkeys(name.split(".", 1)[1] for name in names))
    return [
        (PARTS[ligaments.index(ligament) % len(PARTS)], quantities.index(quantity))
        for ligament, quantity in (name.split(".", 1) for name in names)
    ]


def largest_shares(size: np.ndarray, most: int) -> list[int]:
    """Columns of `(outputs, p)` with the largest share in any output, in their own order."""
    size = np.nan_to_num(np.abs(size))
    share = (size / np.maximum(size.max(axis=1, keepdims=True), 1e-300)).max(axis=0)
    return sorted(np.argsort(-share, kind="stable")[:most].tolist())


@styled
def local_curves_figure(local: LocalSensitivity) -> Figure:
    """Draw the derivative of every coordinate with respect to every parameter over flexion.

    Args:
        local: what to draw; of more than twelve parameters, those that move the knee most.

    Returns:
        Translations on the left, rotations on the right, a line per parameter: the colour is its
        ligament's, the dashes are its quantity's.
    """
    figure, shown = _curves(), largest_shares(local.largest()[0], MOST_PARAMETERS)
    styles = looks(tuple(local.names[i] for i in shown))
    drawn: list = []
    marks: dict = {}
    for coordinate, axes in _panels(figure, local.flexion_deg):
        slopes = local.scaled[:, FREE_COLUMN[coordinate]]
        axes.set_title(f"{COORDINATES[coordinate].axis_label} {_PER[local.scale]}")
        axes.axhline(0.0, color=GREY, linewidth=0.7)
        lines = []
        for i, (colour, quantity) in zip(shown, styles, strict=True):
            dashes = _DASHES[quantity % len(_DASHES)]
            lines += axes.plot(local.flexion_deg, slopes[:, i], color=colour, linestyle=dashes)
        drawn = [(line, readable(local.names[i])) for line, i in zip(lines, shown, strict=True)]
        marks |= mark_status(axes, local.flexion_deg, local.status, VERMILLION, 0.03)
    words = figure.axes[5]
    drawn += [(handle, entry) for entry, handle in marks.items()]
    part_legend(
        words, drawn, (0.0, 0.84), ncols=2 if len(drawn) > 5 else 1, handlelength=2.6,
        labelspacing=0.5 if len(drawn) <= 10 else 0.22,
    )  # fmt: skip
    note = f"Change of the pose by {_STEP[local.scale]}"
    left_out = len(local.names) - len(shown)
    note += f"; {left_out} that move it less are not shown" if left_out else ""
    words.text(0.0, 0.02, note, fontsize=7.5, wrap=True, transform=words.transAxes)
    return figure


@styled
def local_heatmap_figure(local: LocalSensitivity) -> Figure:
    """Draw the same derivatives as colours: parameters down, flexion across, a panel a coordinate.

    Args:
        local: what to draw; of more than forty parameters, those that move the knee most.

    Returns:
        Translations on the left and rotations on the right, each kind on one scale of colours
        centred on zero; poses without a balance are hatched.
    """
    from matplotlib.figure import Figure

    shown, flexion = largest_shares(local.largest()[0], _MOST_ROWS), local.flexion_deg
    rows, pitch = len(shown), 0.145 if len(local.names) <= 16 else 0.1
    height = 3 * (0.55 + pitch * max(rows, 6)) + 0.3
    figure = Figure(figsize=(WIDTH, height))
    figure.subplots_adjust(
        left=0.235, right=0.985, top=1 - 0.25 / height, bottom=0.45 / height, wspace=0.06,
        hspace=0.3 / (height / 3 - 0.4),
    )  # fmt: skip
    middle = (flexion[1:] + flexion[:-1]) / 2
    edges = flexion[0] + np.array([-0.5, 0.5])
    if len(flexion) > 1:
        edges = np.r_[2 * flexion[0] - middle[0], middle, 2 * flexion[-1] - middle[-1]]
    colours: dict[bool, Any] = {}
    for coordinate, axes in _panels(figure, flexion, sharey=True):
        shift = coordinate in _TRANSLATIONS
        alike = [FREE_COLUMN[c] for c in SHOWN if (c in _TRANSLATIONS) == shift]
        limit = float(np.nan_to_num(np.abs(local.scaled[:, alike])).max()) or 1.0
        slopes = local.scaled[:, FREE_COLUMN[coordinate], shown].T
        colours[shift] = axes.pcolormesh(
            edges, np.arange(rows + 1), slopes, cmap="RdBu_r", vmin=-limit, vmax=limit
        )
        for i in np.flatnonzero(np.isnan(slopes).all(axis=0)):
            axes.fill_between(edges[i : i + 2], 0, rows, facecolor="none", edgecolor=GREY,
                              hatch="////", linewidth=0)  # fmt: skip
        axes.set_title(COORDINATES[coordinate].label)
        axes.set_yticks(np.arange(rows) + 0.5, [readable(local.names[i]) for i in shown])
        axes.tick_params(axis="y", labelsize=min(8.0, 60 * pitch), length=0)
        axes.set_ylim(rows, 0)
        axes.grid(False)
    for axes in figure.axes[:5]:
        axes.set_xlim(edges[0], edges[-1])
    words = figure.axes[5]
    inch = 1 / (height * words.get_position().height)
    for place, shift, kind in ((0.7, True, "translations, mm"), (1.35, False, "rotations, deg")):
        at = words.inset_axes((0.05, 1 - place * inch, 0.9, 0.13 * inch))
        bar = figure.colorbar(colours[shift], cax=at, orientation="horizontal")
        bar.set_label(f"{kind} {_PER[local.scale]}")
        bar.outline.set_linewidth(0.5)  # pyright: ignore[reportCallIssue, reportAttributeAccessIssue]
    if len(local.names) > rows:
        note = f"{len(local.names) - rows} parameters that move\nthe knee less are not shown"
        words.text(0.05, 1 - 2.2 * inch, note, fontsize=7.5, transform=words.transAxes)
    return figure
