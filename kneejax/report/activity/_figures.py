"""Secondary motion, forces and pressure over a record, in the layout of papers on gait."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from kneejax.experiments import Activity, Cycle
from kneejax.geometry import COORDINATES, coordinate
from kneejax.report.in_time import bundles
from kneejax.report.look import BLUE, GREY, LIGHT, PARTS, VERMILLION, WIDTH, styled, verbatim

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLORS, _DASHES = (BLUE, VERMILLION), ("-", (0, (4, 1.5)))
_MOST_LIGAMENTS, _MOST_MUSCLES, _SMALL = 5, 4, 0.05


@styled
def activity_figure(found: Mapping[str, Activity], cycle: Cycle, title: str) -> Figure:
    """Draw a movement of one knee, or of two side by side.

    Args:
        found: what a knee is called -> its activity, one or two; the second is dashed.
        cycle: of their record.
        title: of the whole.

    Returns:
        Twelve panels: six coordinates with the record's, contacts, peak pressure, ligaments, the
        moment that holds flexion, muscles, and the force of the ground. Instants without a balance
        are gaps, marked at the lower edge.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, 8.6))
    panels = figure.subplots(4, 3, sharex=True)
    figure.subplots_adjust(
        left=0.075, right=0.985, top=0.915, bottom=0.055, wspace=0.33, hspace=0.27
    )
    figure.suptitle(verbatim(title), x=0.075, ha="left", fontsize=9.5)
    for k, (name, axes) in enumerate(zip(COORDINATES, panels[:2].ravel(), strict=True)):
        _coordinate(axes, found, cycle, k, name)
    _contacts(panels[2, 0], found, cycle, _forces, "Contact force, N")
    _contacts(panels[2, 1], found, cycle, _pressures, "Peak pressure, MPa")
    _ligaments(panels[2, 2], found, cycle)
    _residual(panels[3, 0], found, cycle)
    _muscles(panels[3, 1], next(iter(found.values())), cycle)
    _ground(panels[3, 2], next(iter(found.values())), cycle)
    for axes in panels.ravel():
        if np.isfinite(cycle.toe_off):
            axes.axvline(cycle.toe_off, color=LIGHT, linewidth=1.0, zorder=0)
        _mark_lost(axes, found, cycle)
        axes.set_xlim(cycle.percent[0], cycle.percent[-1])
        axes.yaxis.labelpad = 1.5
    for axes in panels[-1]:
        axes.set_xlabel(cycle.axis_label)
    _legend(figure, found, cycle)
    return figure


def _styles(found: Mapping[str, Activity]):
    return zip(found.items(), _COLORS, _DASHES, strict=False)


def _coordinate(axes: Axes, found: Mapping[str, Activity], cycle: Cycle, k: int, name: str) -> None:
    record = next(iter(found.values())).record
    if record.same_frames or k == 0:
        axes.plot(cycle.percent, record.pose[:, k], color=GREY, linestyle=":", linewidth=1.4)
    for (_, one), color, dashes in _styles(found):
        table = np.asarray(one.motion.to_table())
        if k or not record.same_frames:
            axes.plot(cycle.percent, table[:, k], color=color, linestyle=dashes)
    axes.set_ylabel(coordinate(name).axis_label)


def _forces(one: Activity) -> np.ndarray:
    return np.linalg.norm(np.asarray(one.mechanics.contact_force), axis=-1)


def _pressures(one: Activity) -> np.ndarray:
    return np.asarray(one.mechanics.max_pressure)


def _contacts(axes: Axes, found: Mapping[str, Activity], cycle: Cycle, of, label: str) -> None:
    for (_, one), dashes in zip(found.items(), _DASHES, strict=False):
        values = of(one)
        for j, name in enumerate(one.motion.knee.contact_names):
            own = None if dashes != "-" else name
            color = PARTS[j % len(PARTS)]
            axes.plot(cycle.percent, values[:, j], color=color, linestyle=dashes, label=own)
    axes.set_ylabel(label)
    axes.set_ylim(bottom=0.0)
    _above(axes)


def _ligaments(axes: Axes, found: Mapping[str, Activity], cycle: Cycle) -> None:
    drawn: dict[str, list[np.ndarray]] = {}
    for one in found.values():
        names, tension = one.motion.knee.ligaments.names, np.asarray(one.mechanics.tension)
        for name, fibres in bundles(one.motion.knee).items():
            whole = tension[:, [names.index(fibre) for fibre in fibres]].sum(axis=1)
            drawn.setdefault(name, []).append(whole)
    size = {name: max(np.nanmax(x, initial=0.0) for x in rows) for name, rows in drawn.items()}
    shown = sorted(size, key=lambda name: -size[name])[:_MOST_LIGAMENTS]
    for name, color in zip(shown, PARTS, strict=False):
        if size[name] > _SMALL * size[shown[0]]:
            for values, dashes in zip(drawn[name], _DASHES, strict=False):
                own = verbatim(name) if dashes == "-" else None
                axes.plot(cycle.percent, values, color=color, linestyle=dashes, label=own)
    axes.set_ylabel("Ligament force, N")
    axes.set_ylim(bottom=0.0)
    _above(axes)


def _residual(axes: Axes, found: Mapping[str, Activity], cycle: Cycle) -> None:
    axes.axhline(0.0, color=GREY, linewidth=0.5)
    for (_, one), color, dashes in _styles(found):
        axes.plot(cycle.percent, one.residual_Nm, color=color, linestyle=dashes)
    axes.set_ylabel("Moment holding flexion, N m")


def _muscles(axes: Axes, one: Activity, cycle: Cycle) -> None:
    tension = np.asarray(one.record.muscles.tension)
    curves = dict(zip(one.record.muscles.names, tension, strict=True))
    if not curves:
        axes.set_visible(False)
        return
    if one.record.quadriceps_N.any():
        curves["quadriceps"] = one.record.quadriceps_N
    shown = sorted(curves, key=lambda name: -float(curves[name].max()))[:_MOST_MUSCLES]
    for name, color in zip(shown, PARTS, strict=False):
        own = verbatim(re.sub(r"_[rl]$", "", name))
        axes.plot(cycle.percent, curves[name], color=color, label=own)
    axes.set_ylabel("Muscle force, N")
    _above(axes)


def _ground(axes: Axes, one: Activity, cycle: Cycle) -> None:
    """Force of the ground, or of the joint reaction that was given."""
    if "joint reaction" in one.record.acting:
        force, label = one.record.acting["joint reaction"][:, :3], "Joint reaction, N"
        names = "anterior", "superior", "lateral"
    else:
        force, label = one.record.ground_N, "Ground force, N"
        names = "X", "Y", "Z"
    for values, name, color in zip(force.T, names, PARTS, strict=False):
        axes.plot(cycle.percent, values, color=color, label=name)
    axes.set_ylabel(label)
    _above(axes)


def _above(axes: Axes) -> None:
    if axes.get_legend_handles_labels()[0]:
        axes.legend(
            fontsize=6, ncol=5, loc="lower left", bbox_to_anchor=(-0.04, 0.985), borderaxespad=0.1,
            columnspacing=0.6, handlelength=0.9, handletextpad=0.3,
        )  # fmt: skip


def _mark_lost(axes: Axes, found: Mapping[str, Activity], cycle: Cycle) -> None:
    for (_, one), color, _ in _styles(found):
        lost = cycle.percent[~one.holds]
        place = axes.get_xaxis_transform()
        axes.plot(lost, np.full(len(lost), 0.02), "x", color=color, markersize=3, transform=place)


def _legend(figure: Figure, found: Mapping[str, Activity], cycle: Cycle) -> None:
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], color=color, linestyle=dashes, label=verbatim(name))
        for (name, _), color, dashes in _styles(found)
    ]
    if next(iter(found.values())).record.same_frames:
        handles.append(Line2D([], [], color=GREY, linestyle=":", linewidth=1.4, label="record"))
    if np.isfinite(cycle.toe_off):
        handles.append(Line2D([], [], color=LIGHT, label="toe off"))
    if any(not one.holds.all() for one in found.values()):
        handles.append(Line2D([], [], color=GREY, marker="x", linestyle="", markersize=4,
                              label="no balance"))  # fmt: skip
    figure.legend(
        handles=handles, loc="upper left", bbox_to_anchor=(0.068, 0.965), ncol=len(handles),
        fontsize=8, frameon=False,
    )  # fmt: skip
