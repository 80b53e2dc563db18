"""Figures over flexion: the motion and the forces that hold it."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from kneejax.geometry import CONVENTION_WORDS, COORDINATES
from kneejax.report.look import (
    CONTACT_PARTS,
    FITS,
    GREY,
    MEASURED,
    PARTS,
    SHOWN,
    START,
    VERMILLION,
    WIDTH,
    styled,
    verbatim,
)
from kneejax.report.motion._pose_doubts import row_status
from kneejax.statics import Status

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike

    from kneejax.inference import Calibration, Fit

_DENSE = 40
#: What an axis of flexion says; one of steps has no such ticks.
FLEXION = "Flexion, deg"
_COLUMN = {name: i for i, name in enumerate(COORDINATES)}
#: Outcomes that are marked at the bottom edge: legend entry and marker.
_MARKS = (
    ("not balanced", tuple(s for s in Status if not s.converged), "x"),
    ("dislocated", (Status.DISLOCATED,), "D"),
    ("unstable", (Status.UNSTABLE,), "+"),
    ("a fibre's way is wrong", (Status.WAY_FLIPPED, Status.PAST_WRAP, Status.WRAP_INSIDE), "v"),
    ("a fibre overstretched", (Status.OVERSTRETCHED,), "^"),
    ("outside fitted surfaces", (Status.OUTSIDE_REGION,), "|"),
)


def _curve(flexion: np.ndarray, dashes: Any, marker_only: float = 1.8) -> dict[str, Any]:
    """A line where flexion runs one way, small markers where it does not."""
    steps = np.diff(flexion)
    if len(flexion) > 1 and ((steps >= 0).all() or (steps <= 0).all()):
        return {"linestyle": dashes}
    return {"linestyle": "none", "marker": "o", "markersize": marker_only, "markeredgewidth": 0}


def measured_curve(flexion: np.ndarray) -> dict[str, Any]:
    """How measured poses are drawn: black points without a line, smaller where they are many.

    Args:
        flexion: of the poses, `(n,)`, degrees.

    Returns:
        Keywords for `Axes.plot`.
    """
    size = 3.0 if len(flexion) <= _DENSE else 1.6
    return {
        "linestyle": "none", "marker": "o", "markersize": size, "markeredgewidth": 0,
        "color": MEASURED,
    }  # fmt: skip


def flexion_axis(
    axes: Axes, flexion: np.ndarray, labelled: bool = True, *, label: str = FLEXION
) -> None:
    """Make the horizontal axis one of flexion: limits, ticks at clinical angles, label.

    Args:
        axes: of the panel.
        flexion: of what is drawn, `(n,)`, degrees (or steps, where flexion is constant).
        labelled: whether the label is written; panels above others leave it out.
        label: of the axis; only that of flexion has ticks at multiples of 15 or 30.
    """
    from matplotlib.ticker import MultipleLocator

    low, high = np.nanmin(flexion), np.nanmax(flexion)
    pad = 0.02 * (high - low) or 1.0
    axes.set_xlim(low - pad, high + pad)
    if label == FLEXION and 60 <= high - low <= 200:
        axes.xaxis.set_major_locator(MultipleLocator(30 if high - low > 90 else 15))
    if labelled:
        axes.set_xlabel(label)


def mark_status(axes: Axes, x: np.ndarray, status: np.ndarray, color: str, height: float) -> dict:
    """Mark doubtful rows at the bottom edge; returns the handles by legend entry."""
    handles = {}
    for entry, outcomes, marker in _MARKS:
        rows = np.isin(status, outcomes)
        if rows.any():
            (handles[entry],) = axes.plot(
                x[rows],
                np.full(rows.sum(), height),
                marker,
                color=color,
                markersize=4.5,
                markeredgewidth=1.2,
                transform=axes.get_xaxis_transform(),
                clip_on=False,
                zorder=5,
            )
    return handles


def _as_measured(fit: Fit) -> np.ndarray:
    """Fitted poses in the frames of the measurement: with the offsets that were fitted."""
    table = np.array(fit.motion.table, float)
    for offset in fit.offsets:
        table[:, _COLUMN[offset.name]] += offset.value
    return table


@styled
def motion_figure(calibration: Calibration) -> Figure:
    """Draw measured, started and fitted motion: five coordinates over flexion.

    Args:
        calibration: what to draw; every procedure is shown, the answer on top.

    Returns:
        Translations on the left, rotations on the right, the legend in the sixth panel.
    """
    from matplotlib.figure import Figure

    measured = np.asarray(calibration.measured, float)
    flexion = measured[:, 0]
    figure = Figure(figsize=(WIDTH, 6.3))
    panels = figure.subplots(3, 2, sharex=True)
    figure.subplots_adjust(left=0.085, right=0.985, top=0.96, bottom=0.075, wspace=0.2, hspace=0.24)
    # A simulated pose depends on flexion alone, so it is drawn as a line over flexion even where
    # the measurement runs to and fro.
    order = np.argsort(flexion, kind="stable")
    start = np.asarray(calibration.start.table, float)
    motions: list[tuple[str, str, Any, np.ndarray]] = []
    for i, fit in reversed(list(enumerate(calibration.fits))):
        dashes = "--" if i == 0 else (0, (1 + 3 * i, 1.5, 1, 1.5))
        several = len(calibration.fits) > 1
        label = verbatim(f"fitted, procedure {fit.procedure}") if several else "fitted"
        motions.append((label, FITS[i % len(FITS)], dashes, _as_measured(fit)))
    spots = [(0, 0), (1, 0), (2, 0), (0, 1), (1, 1)]
    lines: dict[str, Any] = {}
    marked: dict[str, Any] = {}
    for name, spot in zip(SHOWN, spots, strict=True):
        axes, column = panels[spot], _COLUMN[name]
        axes.set_title(COORDINATES[name].axis_label)
        (lines["measured"],) = axes.plot(flexion, measured[:, column], **measured_curve(flexion))
        for label, color, dashes, table in [("start", START, ":", start), *motions]:
            (lines[label],) = axes.plot(
                flexion[order],
                table[order, column],
                color=color,
                **_curve(flexion[order], dashes),
            )
        marks = mark_status(axes, flexion, row_status(calibration.start), START, 0.10)
        marked |= {f"start: {entry}": handle for entry, handle in marks.items()}
        if calibration.fits:
            status = row_status(calibration.fit.motion)
            marks = mark_status(axes, flexion, status, VERMILLION, 0.03)
            marked |= {f"fitted: {entry}": handle for entry, handle in marks.items()}
        last = spot in ((2, 0), (1, 1))
        flexion_axis(axes, flexion, last)
        axes.tick_params(labelbottom=last)
    # The answer was drawn last, on top, and is named first.
    order = ["measured", "start", *(label for label, *_ in reversed(motions))]
    legend = {label: lines[label] for label in order} | marked
    _legend_panel(panels[2, 1], legend, calibration)
    return figure


def _legend_panel(axes: Axes, handles: dict[str, Any], calibration: Calibration) -> None:
    axes.set_axis_off()
    axes.legend(
        list(handles.values()),
        list(handles),
        loc="upper left",
        bbox_to_anchor=(0.0, 0.84),
        borderaxespad=0,
        ncols=1 if len(handles) <= 8 else 2,
        handlelength=2.8,
        columnspacing=1.2,
        borderpad=0,
        labelspacing=0.5,
        markerscale=1.2 if len(calibration.measured) <= _DENSE else 2.0,
    )
    if calibration.fit.offsets:
        axes.text(
            0.0, 0.0, "Fitted motions are drawn with their frame offsets.", fontsize=7.5,
            transform=axes.transAxes,
        )  # fmt: skip


def _force_panel(
    axes: Axes,
    x: np.ndarray,
    forces: np.ndarray,
    names: Sequence[str],
    colors: Sequence[str],
    dashes: str,
    drawn: list,
) -> None:
    for i, name in enumerate(names):
        color = colors[i % len(colors)]
        (line,) = axes.plot(x, forces[:, i], color=color, **_curve(x, dashes))
        drawn.append((line, verbatim(name)))


def part_legend(axes: Axes, drawn: list, corner: tuple[float, float], **layout: Any) -> None:
    """Lines and their names, the upper left corner in the axes' coordinates."""
    if drawn:
        lines, names = zip(*drawn, strict=True)
        layout = {"fontsize": 7.5, **layout}
        axes.legend(
            lines, names, loc="upper left", bbox_to_anchor=corner, borderaxespad=0, **layout
        )


@styled
def ligament_forces_figure(calibration: Calibration) -> Figure:
    """Draw ligament and contact forces over flexion, at the start and fitted.

    Args:
        calibration: what to draw; the forces are those of the answer.

    Returns:
        Two panels: ligaments above, contacts below.
    """
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    flexion = np.asarray(calibration.measured, float)[:, 0]
    order = np.argsort(flexion, kind="stable")
    groups = [
        ("Ligament force, N", calibration.ligaments, "ligament_forces", PARTS),
        ("Contact force, N", calibration.contacts, "contact_forces", CONTACT_PARTS),
    ]
    groups = [group for group in groups if group[1]] or groups[:1]
    figure = Figure(figsize=(WIDTH, 2.75 * len(groups) + 0.35))
    panels = figure.subplots(len(groups), 1, sharex=True, squeeze=False)[:, 0]
    many = max(len(names) for _, names, _, _ in groups) > 12
    height = figure.get_size_inches()[1]
    figure.subplots_adjust(
        left=0.085, right=0.66 if many else 0.8, top=1 - 0.28 / height,
        bottom=0.45 / height, hspace=0.16,
    )  # fmt: skip
    for axes, (title, names, field, colors) in zip(panels, groups, strict=True):
        axes.set_title(title)
        drawn: list = []
        before = np.asarray(getattr(calibration.start, field), float)
        after = np.asarray(getattr(calibration.fit.motion, field), float)
        _force_panel(axes, flexion[order], before[order], names, colors, ":", [])
        _force_panel(axes, flexion[order], after[order], names, colors, "-", drawn)
        last = axes is panels[-1]
        flexion_axis(axes, flexion, last)
        axes.tick_params(labelbottom=last)
        if "marker" not in _curve(flexion[order], "-"):
            kinds = [("fitted", "-"), ("start", ":")] if axes is panels[0] else []
            drawn += [(Line2D([], [], color=GREY, linestyle=d), word) for word, d in kinds]
        mark_status(axes, flexion, row_status(calibration.fit.motion), VERMILLION, 0.03)
        columns = 1 if len(drawn) <= 12 else 2
        part_legend(axes, drawn, (1.01, 1.0), ncols=columns, handlelength=1.4)
    return figure


@styled
def simulation_figure(
    flexion_deg: ArrayLike,
    table: ArrayLike,
    status: ArrayLike,
    ligament_names: Sequence[str],
    ligament_forces: ArrayLike,
    contact_names: Sequence[str],
    contact_forces: ArrayLike,
    convention: str = "femoral",
) -> Figure:
    """Draw a simulated motion and its forces.

    Args:
        flexion_deg: shape `(n,)`; if it is constant, rows are counted instead.
        table: shape `(n, 6)`, degrees and mm, in the order of every pose table.
        status: one `Status` value per row.
        ligament_names: one per column of `ligament_forces`.
        ligament_forces: shape `(n, ligaments)`, N.
        contact_names: one per column of `contact_forces`.
        contact_forces: shape `(n, contacts)`, N.
        convention: of the table; said beside the legend.

    Returns:
        Five coordinates, then ligament and contact forces with their legends below them.
    """
    from matplotlib.figure import Figure

    x, label = np.asarray(flexion_deg, float), FLEXION
    if np.ptp(x) == 0:
        x, label = np.arange(1.0, len(x) + 1), "Step"
    table, status = np.asarray(table, float), np.asarray(status, int)
    forces = [
        ("Ligament force, N", ligament_names, np.asarray(ligament_forces, float), PARTS),
        ("Contact force, N", contact_names, np.asarray(contact_forces, float), CONTACT_PARTS),
    ]
    most = max(len(ligament_names), len(contact_names), 1)
    columns, line = (4, 0.16) if most <= 12 else (5, 0.115)
    legends = line * -(-most // columns) + 0.05
    height = 8.6 + legends
    figure = Figure(figsize=(WIDTH, height))
    grid = figure.add_gridspec(
        4, 2, left=0.085, right=0.98, top=1 - 0.26 / height, bottom=(0.45 + legends) / height,
        wspace=0.2, hspace=0.48,
    )  # fmt: skip
    marks: dict[str, Any] = {}
    spots = [(0, 0), (1, 0), (2, 0), (0, 1), (1, 1)]
    for name, spot in zip(SHOWN, spots, strict=True):
        axes = figure.add_subplot(grid[spot])
        axes.plot(x, table[:, _COLUMN[name]], color=GREY, **_curve(x, "-"))
        axes.set_title(COORDINATES[name].axis_label)
        marks |= mark_status(axes, x, status, VERMILLION, 0.03)
        flexion_axis(axes, x, spot in ((2, 0), (1, 1)), label=label)
    words = figure.add_subplot(grid[2, 1])
    words.set_axis_off()
    meaning = f"Convention {convention}: {CONVENTION_WORDS.get(convention, '')}".strip(": ")
    words.text(0.0, 0.98, textwrap.fill(meaning, 46), va="top", fontsize=7.5)
    for column, (title, names, values, colors) in enumerate(forces):
        axes = figure.add_subplot(grid[3, column])
        axes.set_title(title)
        drawn: list = []
        if len(names):
            _force_panel(axes, x, values, names, colors, "-", drawn)
        mark_status(axes, x, status, VERMILLION, 0.03)
        flexion_axis(axes, x, label=label)
        below = -0.45 / (axes.get_position().height * height)
        part_legend(
            axes, drawn, (0.0, below), ncols=columns, fontsize=7.5 if columns == 4 else 6.0,
            handlelength=1.4, columnspacing=0.9, labelspacing=0.3, borderpad=0,
        )  # fmt: skip
    part_legend(words, [(handle, entry) for entry, handle in marks.items()], (0.0, 0.46))
    return figure
