"""Figures over flexion: the motion and the forces that hold it."""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.lines import Line2D

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
    axes: Axes, x: np.ndarray, forces: Mapping[str, ArrayLike], contact: bool, dashes: str = "-"
) -> dict[str, Any]:
    """Forces over flexion, ligaments in the colours of their structures; lines by their names."""
    colours = itertools.cycle({"color": one} for one in CONTACT_PARTS)
    styles = dict(zip(forces, colours, strict=False)) if contact else part_styles(forces)
    drawn = {}
    for name, force in forces.items():
        own = styles[name].get("linestyle", "-") if dashes == "-" else dashes
        style = {**styles[name], **curve_style(x, own)}
        label = verbatim(name) if dashes == "-" else None
        (drawn[verbatim(name)],) = axes.plot(x, np.asarray(force, float), label=label, **style)
    return drawn


@styled
def ligament_forces_figure(calibration: Calibration) -> Figure:
    """Draw ligament and contact forces over flexion, at the start and fitted."""
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
        before, after = (
            dict(zip(names, np.asarray(getattr(x, field), float)[order].T, strict=True))
            for x in (calibration.start, fitted)
        )
        _force_lines(axes, flexion[order], before, contact, ":")
        drawn = _force_lines(axes, flexion[order], after, contact)
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
    flexion_deg: ArrayLike, table: ArrayLike, status: ArrayLike, ligaments: Mapping[str, ArrayLike],
    contacts: Mapping[str, ArrayLike], convention: str = "femoral",
) -> Figure:  # fmt: skip
    """Draw a simulated motion and its forces, by the names of ligaments and of contacts."""
    x, label = np.asarray(flexion_deg, float), FLEXION
    if np.ptp(x) == 0:
        x, label = np.arange(1.0, len(x) + 1), "Step"
    table, status = np.asarray(table, float), np.asarray(status, int)
    meaning = f"Convention {convention}: {CONVENTION_WORDS.get(convention, '')}".strip(": ")
    figure, panels = panel_grid(4, 2, 8.8, "\n".join(textwrap.wrap(meaning, 100)))
    for name, place in zip(SHOWN, (0, 2, 4, 1, 3), strict=True):
        panels[place].plot(x, table[:, _COLUMN[name]], color=GREY, **curve_style(x, "-"))
        panels[place].set_title(COORDINATES[name].axis_label)
    for place, forces, kind in ((6, ligaments, "Ligament"), (7, contacts, "Contact")):
        _force_lines(panels[place], x, forces, place == 7)
        panels[place].set_ylabel(f"{kind} force, N")
        legend_above(panels[place], 5)
    marks: dict[str, Any] = {}
    for place, axes in enumerate(panels):
        if place != 5:
            marks |= mark_status(axes, x, status)
            flexion_axis(axes, x, place in (3, 4, 6, 7), label=label)
    panels[5].set_axis_off()
    part_legend(panels[5], marks, (0.0, 0.9))
    return figure
