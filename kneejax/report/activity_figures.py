"""A movement in the layout of papers on gait, and grafts in several places (paper 2, Figure 7)."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from kneejax.experiments import Activity, Cycle
from kneejax.geometry import COORDINATES, coordinate
from kneejax.report.look.colours import BLACK, BLUE, GREY, LIGHT, VERMILLION, part_styles
from kneejax.report.look.style import Axes, Figure, styled, verbatim
from kneejax.report.panels import draw_named, panel_grid
from kneejax.report.pose_tables import bundle_forces, contact_forces

_COLORS, _DASHES = (BLUE, VERMILLION), ("-", (0, (4, 1.5)))
_MOST_LIGAMENTS, _MOST_MUSCLES, _SMALL = 5, 4, 0.05
#: Columns of a table of poses.
_TURN, _FORWARD = 2, 3
_PLACES = {0: (BLACK, (0, (4, 1.5)), 1.6), 1: (VERMILLION, "-", 1.0), 2: (BLUE, "-", 1.2)}


@styled
def activity_figure(found: Mapping[str, Activity], cycle: Cycle, title: str) -> Figure:
    """Draw a movement of one knee, or of two side by side."""
    figure, panels = panel_grid(4, 3, 8.6, title, shared=True)
    x, first = cycle.percent, next(iter(found.values()))
    record, legend = first.record, {"columns": 5, "size": 6.0}
    for k, (name, axes) in enumerate(zip(COORDINATES, panels[:6], strict=True)):
        if record.same_frames or k == 0:
            axes.plot(x, record.pose[:, k], color=GREY, linestyle=":", linewidth=1.4)
        for (_, one), color, dashes in _styles(found):
            if k or not record.same_frames:
                table = np.asarray(one.motion.to_table())
                axes.plot(x, table[:, k], color=color, linestyle=dashes)
        axes.set_ylabel(coordinate(name).axis_label)
    bundled = [bundle_forces(one.motion.knee, one.mechanics.tension) for one in found.values()]
    size = {name: max(np.nanmax(f[name], initial=0.0) for f in bundled) for name in bundled[0]}
    shown = sorted(size, key=lambda name: -size[name])[:_MOST_LIGAMENTS]
    shown = [name for name in shown if size[name] > _SMALL * size[shown[0]]]
    styles = part_styles(bundled[0])
    panels[9].axhline(0.0, color=GREY, linewidth=0.5)
    for k, ((_, one), color, dashes) in enumerate(_styles(found)):
        mark = "_" * k  # of the second knee nothing stands in the legends
        names = [mark + name for name in one.motion.knee.contact_names]
        for axes, values, label in (
            (panels[6], contact_forces(one.mechanics), "Contact force, N"),
            (panels[7], np.asarray(one.mechanics.max_pressure), "Peak pressure, MPa"),
        ):
            curves = dict(zip(names, values.T, strict=True))
            draw_named(axes, x, curves, label, linestyle=dashes, **legend)
        forces = {mark + name: bundled[k][name] for name in shown}
        colors = [styles[name]["color"] for name in shown] or [GREY]
        draw_named(panels[8], x, forces, "Ligament force, N", colors=colors, linestyle=dashes,
                   **legend)  # fmt: skip
        panels[9].plot(x, one.residual_Nm, color=color, linestyle=dashes)
    panels[9].set_ylabel("Moment holding flexion, N m")
    for axes in panels[6:9]:
        axes.set_ylim(bottom=0.0)
    muscles = dict(zip(record.muscles.names, np.asarray(record.muscles.tension), strict=True))
    panels[10].set_visible(bool(muscles))
    if muscles and record.quadriceps_N.any():
        muscles["quadriceps"] = record.quadriceps_N
    most = sorted(muscles, key=lambda name: -float(muscles[name].max()))[:_MOST_MUSCLES]
    pulls = {re.sub(r"_[rl]$", "", name): muscles[name] for name in most}
    draw_named(panels[10], x, pulls, "Muscle force, N", **legend)
    given = record.acting.get("joint reaction")
    force, ways, label = record.ground_N, ("X", "Y", "Z"), "Ground force, N"
    if given is not None:
        force, ways = given[:, :3], ("anterior", "superior", "lateral")
        label = "Joint reaction, N"
    draw_named(panels[11], x, dict(zip(ways, force.T, strict=True)), label, **legend)
    for axes in panels:
        if np.isfinite(cycle.toe_off):
            axes.axvline(cycle.toe_off, color=LIGHT, linewidth=1.0, zorder=0)
        _mark_lost(axes, found, cycle)
        axes.set_xlim(x[0], x[-1])
        axes.yaxis.labelpad = 1.5
    for axes in panels[9:]:
        axes.set_xlabel(cycle.axis_label)
    _legend(figure, found, cycle)
    return figure


def _styles(found: Mapping[str, Activity]):
    return zip(found.items(), _COLORS, _DASHES, strict=False)


def _mark_lost(axes: Axes, found: Mapping[str, Activity], cycle: Cycle) -> None:
    for (_, one), color, _ in _styles(found):
        lost = cycle.percent[~one.holds]
        place = axes.get_xaxis_transform()
        axes.plot(lost, np.full(len(lost), 0.02), "x", color=color, markersize=3, transform=place)


def _legend(figure: Figure, found: Mapping[str, Activity], cycle: Cycle) -> None:
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], color=color, linestyle=dashes, label=verbatim(name))
               for (name, _), color, dashes in _styles(found)]  # fmt: skip
    if next(iter(found.values())).record.same_frames:
        handles.append(Line2D([], [], color=GREY, linestyle=":", linewidth=1.4, label="record"))
    if np.isfinite(cycle.toe_off):
        handles.append(Line2D([], [], color=LIGHT, label="toe off"))
    if any(not one.holds.all() for one in found.values()):
        handles.append(Line2D([], [], color=GREY, marker="x", linestyle="", markersize=4,
                              label="no balance"))  # fmt: skip
    figure.legend(handles=handles, loc="upper left", bbox_to_anchor=(0.068, 0.965),
                  ncol=len(handles), fontsize=8, frameon=False)  # fmt: skip


def graft_pulls(found: Mapping[str, Activity]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Force, N, and largest strain of the ligament where it acts, and of the graft elsewhere."""
    acts = np.stack([np.asarray(one.motion.knee.ligaments.stiffness) for one in found.values()])
    changing, answer = np.ptp(acts, axis=0) > 0, {}
    for (name, one), stiffness in zip(found.items(), acts, strict=True):
        rows = np.flatnonzero(changing & (stiffness > 0))
        force, strain = (np.asarray(x)[:, rows]
                         for x in (one.mechanics.tension, one.mechanics.strain))  # fmt: skip
        nothing = np.full(len(force), np.nan)
        both = (force.sum(axis=1), strain.max(axis=1)) if len(rows) else (nothing, nothing)
        answer[name] = both
    return answer


@styled
def places_figure(found: Mapping[str, Activity], cycle: Cycle, title: str) -> Figure:
    """Draw what places of a graft do over a record."""
    figure, panels = panel_grid(2, 2, 5.4, title, shared=True)
    figure.subplots_adjust(bottom=0.2, hspace=0.12)
    pulls = graft_pulls(found)
    tables = {name: np.asarray(one.motion.to_table()) for name, one in found.items()}
    intact = next(iter(tables.values()))
    _curves(panels[0], cycle, {name: 100 * strain for name, (_, strain) in pulls.items()})
    _curves(panels[1], cycle, {name: force for name, (force, _) in pulls.items()})
    for axes, column in ((panels[2], _FORWARD), (panels[3], _TURN)):
        axes.axhline(0.0, color=GREY, linewidth=0.5)
        away = {name: table[:, column] - intact[:, column] for name, table in tables.items()}
        _curves(axes, cycle, dict(list(away.items())[1:]), first=1)
    words = ("Strain of ligament or graft, %", "Force of ligament or graft, N",
             "Forwards of the intact tibia, mm", "Turned inwards of it, deg")  # fmt: skip
    for axes, label in zip(panels, words, strict=True):
        axes.set_ylabel(label)
        axes.set_xlim(cycle.percent[0], cycle.percent[-1])
        if np.isfinite(cycle.toe_off):
            axes.axvline(cycle.toe_off, color=LIGHT, linewidth=1.0, zorder=0)
    for axes in panels[2:]:
        axes.set_xlabel(cycle.axis_label)
    own = {label: line for axes in panels
           for line, label in zip(*axes.get_legend_handles_labels(), strict=True)}  # fmt: skip
    lines = [own[verbatim(name)] for name in found]
    names = [_label(name, one.holds) for name, one in found.items()]
    # Names with counts are longer: four of them are as wide as the figure.
    columns = 6 if all(one.holds.all() for one in found.values()) else 4
    figure.legend(lines, names, loc="lower center", ncols=columns, fontsize=7.5, handlelength=1.6,
                  columnspacing=1.2)  # fmt: skip
    return figure


def _label(name: str, holds: np.ndarray) -> str:
    """What a knee is called, and at how many instants it balances where that is not all."""
    lost = "" if holds.all() else f" ({int(holds.sum())} of {len(holds)})"
    return verbatim(name) + lost


def _curves(axes: Axes, cycle: Cycle, values: Mapping[str, np.ndarray], first: int = 0) -> None:
    from matplotlib import colormaps

    colours = colormaps["viridis"](np.linspace(0.0, 0.95, 8))
    for k, (name, one) in enumerate(values.items(), first):
        color, dashes, width = _PLACES.get(k, (colours[(k - 3) % 8], "-", 0.7))
        axes.plot(cycle.percent, one, color=color, linestyle=dashes, linewidth=width,
                  label=verbatim(name))  # fmt: skip
