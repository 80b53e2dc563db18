"""Figures over flexion: the motion and the forces that hold it."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from kneejax.geometry import CONVENTION_WORDS, COORDINATES
from kneejax.report.doubts import row_status
from kneejax.report.panels import (
    DENSE,
    FLEXION,
    curve_style,
    flexion_axis,
    legend_above,
    mark_status,
    measured_curve,
    panel_grid,
    part_legend,
    part_styles,
)
from kneejax.report.look.style import (
    CONTACT_PARTS,
    FITS,
    GREY,
    PARTS,
    SHOWN,
    START,
    VERMILLION,
    WIDTH,
    styled,
    verbatim,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike

    from kneejax.inference import Calibration, Fit


_COLUMN = {name: i for i, name in enumerate(COORDINATES)}


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
                flexion[order], table[order, column], color=color,
                **curve_style(flexion[order], dashes),
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
        list(handles.values()), list(handles), loc="upper left", bbox_to_anchor=(0.0, 0.84),
        borderaxespad=0, ncols=1 if len(handles) <= 8 else 2, handlelength=2.8, columnspacing=1.2,
        borderpad=0, labelspacing=0.5,
        markerscale=1.2 if len(calibration.measured) <= DENSE else 2.0,
    )
    if calibration.fit.offsets:
        axes.text(
            0.0, 0.0, "Fitted motions are drawn with their frame offsets.", fontsize=7.5,
            transform=axes.transAxes,
        )  # fmt: skip


def _force_lines(
    axes: Axes, x: np.ndarray, forces: Any, names: Sequence[str], colors: Sequence[str], dashes: str
) -> list:
    """Forces over flexion, ligaments in the colours of their structures; lines with their names."""
    styles, drawn = part_styles(names) if colors is PARTS else {}, []
    for i, (name, force) in enumerate(zip(names, np.asarray(forces, float).T, strict=True)):
        style = {"color": colors[i % len(colors)], **styles.get(name, {}), **curve_style(x, dashes)}
        if dashes == "-" and "marker" not in style:
            style["linestyle"] = styles.get(name, {}).get("linestyle", "-")
        label = verbatim(name) if dashes == "-" else None
        drawn += [(line, verbatim(name)) for line in axes.plot(x, force, label=label, **style)]
    return drawn


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
        before = np.asarray(getattr(calibration.start, field), float)
        after = np.asarray(getattr(calibration.fit.motion, field), float)
        _force_lines(axes, flexion[order], before[order], names, colors, ":")
        drawn = _force_lines(axes, flexion[order], after[order], names, colors, "-")
        last = axes is panels[-1]
        flexion_axis(axes, flexion, last)
        axes.tick_params(labelbottom=last)
        if "marker" not in curve_style(flexion[order], "-"):
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
        convention: of the table; it stands above the panels.

    Returns:
        Five coordinates, then ligament and contact forces with their legends above them.
    """

    x, label = np.asarray(flexion_deg, float), FLEXION
    if np.ptp(x) == 0:
        x, label = np.arange(1.0, len(x) + 1), "Step"
    table, status = np.asarray(table, float), np.asarray(status, int)
    meaning = f"Convention {convention}: {CONVENTION_WORDS.get(convention, '')}".strip(": ")
    figure, panels = panel_grid(4, 2, 8.8, "\n".join(textwrap.wrap(meaning, 100)))
    marks: dict[str, Any] = {}
    for name, place in zip(SHOWN, (0, 2, 4, 1, 3), strict=True):
        axes = panels[place]
        axes.plot(x, table[:, _COLUMN[name]], color=GREY, **curve_style(x, "-"))
        axes.set_title(COORDINATES[name].axis_label)
        marks |= mark_status(axes, x, status, VERMILLION, 0.03)
    panels[5].set_axis_off()
    part_legend(panels[5], [(handle, entry) for entry, handle in marks.items()], (0.0, 0.9))
    for axes, names, values, kind, colors in (
        (panels[6], ligament_names, ligament_forces, "Ligament force, N", PARTS),
        (panels[7], contact_names, contact_forces, "Contact force, N", CONTACT_PARTS),
    ):
        _force_lines(axes, x, values, names, colors, "-")
        axes.set_ylabel(kind)
        legend_above(axes, 5)
        mark_status(axes, x, status, VERMILLION, 0.03)
    for place, axes in enumerate(panels):
        if place != 5:
            flexion_axis(axes, x, place in (3, 4, 6, 7), label=label)
    return figure
