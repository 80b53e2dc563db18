"""Figures over flexion: the motion and the forces that hold it."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from kneejax.geometry import CONVENTION_WORDS, COORDINATES
from kneejax.report.doubts import row_status
from kneejax.report.look.colours import BLUE, CONTACT_PARTS, FITS, GREY, VERMILLION, part_styles
from kneejax.report.look.style import SHOWN, Axes, Figure, styled, verbatim
from kneejax.report.panels import (
    DENSE,
    FLEXION,
    coordinate_panels,
    curve_style,
    flexion_axis,
    grid,
    legend_above,
    mark_status,
    measured_curve,
    panel_grid,
    part_legend,
)

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from kneejax.inference import Calibration

_COLUMN = {name: i for i, name in enumerate(COORDINATES)}


@styled
def motion_figure(calibration: Calibration) -> Figure:
    """Draw measured, started and fitted motion: five coordinates over flexion.

    Args:
        calibration: what to draw; every procedure is shown, the answer on top.

    Returns:
        Translations on the left, rotations on the right, the legend in the sixth panel.
    """
    measured, several = np.asarray(calibration.measured, float), len(calibration.fits) > 1
    flexion = measured[:, 0]
    # A simulated pose depends on flexion alone, so it is drawn as a line over flexion even where
    # the measurement runs to and fro.
    order = np.argsort(flexion, kind="stable")
    motions = {"start": (BLUE, ":", np.asarray(calibration.start.table, float))}
    for i, fit in reversed(list(enumerate(calibration.fits))):
        table = np.array(fit.motion.table, float)
        for offset in fit.offsets:
            table[:, _COLUMN[offset.name]] += offset.value
        label = verbatim(f"fitted, procedure {fit.procedure}") if several else "fitted"
        dashes = "--" if i == 0 else (0, (1 + 3 * i, 1.5, 1, 1.5))
        motions[label] = FITS[i % len(FITS)], dashes, table
    figure, panels, words = coordinate_panels(flexion)
    lines: dict[str, Any] = {}
    marked: dict[str, Any] = {}
    for name, axes in panels.items():
        column = _COLUMN[name]
        axes.set_title(COORDINATES[name].axis_label)
        (lines["measured"],) = axes.plot(flexion, measured[:, column], **measured_curve(flexion))
        for label, (color, dashes, table) in motions.items():
            style = {"color": color, **curve_style(flexion[order], dashes)}
            (lines[label],) = axes.plot(flexion[order], table[order, column], **style)
        own = [("start", calibration.start, BLUE, 0.10)]
        own += [("fitted", fit.motion, VERMILLION, 0.03) for fit in calibration.fits[:1]]
        for kind, motion, color, height in own:
            marks = mark_status(axes, flexion, row_status(motion), color, height)
            marked |= {f"{kind}: {entry}": handle for entry, handle in marks.items()}
    # The answer was drawn last, on top, and is named first.
    legend = ["measured", "start", *reversed([label for label in motions if label != "start"])]
    handles = {label: lines[label] for label in legend} | marked
    part_legend(
        words, handles, (0.0, 0.84), fontsize=8, ncols=1 if len(handles) <= 8 else 2,
        handlelength=2.8, columnspacing=1.2, borderpad=0, labelspacing=0.5,
        markerscale=1.2 if len(measured) <= DENSE else 2.0,
    )  # fmt: skip
    if calibration.fit.offsets:
        note = "Fitted motions are drawn with their frame offsets."
        words.text(0.0, 0.0, note, fontsize=7.5, transform=words.transAxes)
    return figure


def _force_lines(
    axes: Axes, x: np.ndarray, forces: Any, names: Sequence[str], contact: bool, dashes: str = "-"
) -> dict[str, Any]:
    """Forces over flexion, ligaments in the colours of their structures; lines by their names."""
    colours = [{"color": CONTACT_PARTS[i % len(CONTACT_PARTS)]} for i in range(len(names))]
    styles = dict(zip(names, colours, strict=True)) if contact else part_styles(names)
    drawn = {}
    for name, force in zip(names, np.asarray(forces, float).T, strict=True):
        own = styles[name].get("linestyle", "-") if dashes == "-" else dashes
        style = {**styles[name], **curve_style(x, own)}
        label = verbatim(name) if dashes == "-" else None
        (drawn[verbatim(name)],) = axes.plot(x, force, label=label, **style)
    return drawn


@styled
def ligament_forces_figure(calibration: Calibration) -> Figure:
    """Draw ligament and contact forces over flexion, at the start and fitted."""
    from matplotlib.lines import Line2D

    flexion = np.asarray(calibration.measured, float)[:, 0]
    order = np.argsort(flexion, kind="stable")
    groups = [("Ligament force, N", calibration.ligaments, "ligament_forces"),
              ("Contact force, N", calibration.contacts, "contact_forces")]  # fmt: skip
    groups = [group for group in groups if group[1]] or groups[:1]
    right = 2.38 if max(len(names) for _, names, _ in groups) > 12 else 1.4
    figure, panels = grid(len(groups), 1, 2.75 * len(groups) + 0.35, right=right, top=0.28,
                          bottom=0.45, apart=(0, 0.4), sharex=True)  # fmt: skip
    fitted = calibration.fit.motion
    for axes, (title, names, field) in zip(panels[:, 0], groups, strict=True):
        contact, last = field == "contact_forces", axes is panels[-1, 0]
        axes.set_title(title)
        before, after = (np.asarray(getattr(x, field), float)[order]
                         for x in (calibration.start, fitted))  # fmt: skip
        _force_lines(axes, flexion[order], before, names, contact, ":")
        drawn = _force_lines(axes, flexion[order], after, names, contact)
        flexion_axis(axes, flexion, last)
        axes.tick_params(labelbottom=last)
        if "marker" not in curve_style(flexion[order], "-") and axes is panels[0, 0]:
            drawn |= {word: Line2D([], [], color=GREY, linestyle=d)
                      for word, d in (("fitted", "-"), ("start", ":"))}  # fmt: skip
        mark_status(axes, flexion, row_status(fitted))
        columns = 1 if len(drawn) <= 12 else 2
        part_legend(axes, drawn, (1.01, 1.0), ncols=columns, handlelength=1.4)
    return figure


@styled
def simulation_figure(
    flexion_deg: ArrayLike, table: ArrayLike, status: ArrayLike, ligament_names: Sequence[str],
    ligament_forces: ArrayLike, contact_names: Sequence[str], contact_forces: ArrayLike,
    convention: str = "femoral",
) -> Figure:  # fmt: skip
    """Draw a simulated motion and its forces."""
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
        marks |= mark_status(axes, x, status)
    panels[5].set_axis_off()
    part_legend(panels[5], marks, (0.0, 0.9))
    for axes, names, values, kind in (
        (panels[6], ligament_names, ligament_forces, "Ligament force, N"),
        (panels[7], contact_names, contact_forces, "Contact force, N"),
    ):
        _force_lines(axes, x, values, names, axes is panels[7])
        axes.set_ylabel(kind)
        legend_above(axes, 5)
        mark_status(axes, x, status)
    for place, axes in enumerate(panels):
        if place != 5:
            flexion_axis(axes, x, place in (3, 4, 6, 7), label=label)
    return figure
