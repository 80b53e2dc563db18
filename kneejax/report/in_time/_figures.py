"""Poses, forces and energies over time, and a leg that a motor raises over its flexion."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kneejax.experiments import RaisedLeg, Transient
from kneejax.geometry import COORDINATES, coordinate, table_units
from kneejax.inference.transients import Recorded
from kneejax.mechanics import NAMED_LOADS
from kneejax.report.look import BLACK, BLUE, GREEN, GREY, PURPLE, VERMILLION, styled
from kneejax.report.motion import (
    contact_forces,
    draw_ligaments,
    draw_named,
    flexion_axis,
    panel_grid,
)
from kneejax.statics import Status

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLORS = (BLUE, VERMILLION, GREEN)
_ENERGIES = {
    "work": BLACK, "kinetic": BLUE, "potential": GREEN, "dissipated": PURPLE, "missing": GREY
}  # fmt: skip


@styled
def transient_figure(found: Transient, title: str, recorded: Recorded | None = None) -> Figure:
    """Draw a motion through time.

    Args:
        found: the motion.
        title: of the whole.
        recorded: drawn as dots, where there is a record.

    Returns:
        Six panels: translations, and rotations but flexion, as changes from the start, with the
        balance under the last loads dashed; loads or flexion; ligaments; contacts; energies.
    """
    figure, panels = panel_grid(3, 2, 7.0, title, shared=True)
    motion, time, names = found.trajectory, found.time_s, list(COORDINATES)
    table, knee = motion.to_table(), motion.moving.knee
    rest = None if found.rest is None else np.asarray(found.rest.to_table())[0]
    for axes, shown, label in (
        (panels[0], names[3:], "Change of translation, mm"),
        (panels[1], names[1:3], "Change of rotation, deg"),
    ):
        columns = [names.index(name) for name in shown]
        changes = {name.replace("_rotation", ""): table[:, k] - table[0, k]
                   for name, k in zip(shown, columns, strict=True)}  # fmt: skip
        draw_named(axes, time, changes, label, colors=_COLORS)
        for name, k, color in zip(shown, columns, _COLORS, strict=False):
            if recorded is not None and name in recorded.changes:
                dots = recorded.time_s, recorded.changes[name]
                axes.plot(*dots, ".", color=color, markersize=2.5, alpha=0.6)
            if rest is not None:
                axes.axhline(rest[k] - table[0, k], color=color, linestyle="--", linewidth=0.8)
    acting = {NAMED_LOADS[name]: x for name, x in found.sizes.items() if np.any(x)}
    if acting:
        units = sorted({load.unit for load in acting})
        loads = {x.positive + f", {x.unit}" * (len(units) > 1): y for x, y in acting.items()}
        draw_named(panels[2], time, loads, f"Load, {' and '.join(units)}")
    else:
        panels[2].plot(time, table[:, 0], color=BLACK)
        panels[2].set_ylabel("Flexion, deg")
    draw_ligaments(panels[3], time, knee, np.asarray(found.mechanics.tension) + found.damping_N)
    contact = dict(zip(knee.contact_names, contact_forces(found.mechanics).T, strict=True))
    draw_named(panels[4], time, contact, "Contact force, N")
    energies = {kind: getattr(found.account, kind) for kind in _ENERGIES}
    steps = np.concatenate([[0.0], motion.grid.time_s]) + time[0]
    draw_named(panels[5], steps, energies, "Energy, N mm", colors=[*_ENERGIES.values()], columns=5,
               size=6.5)  # fmt: skip
    for axes in panels[4:]:
        axes.set_xlabel("Time, s")
    for axes in panels:
        if motion.ended is not Status.BALANCED:
            axes.axvline(motion.ended_s, color=VERMILLION, linewidth=0.8, linestyle=":")
    return figure


@styled
def motor_raise_figure(found: RaisedLeg, title: str) -> Figure:
    """Draw a leg that is raised over its flexion, and by points one that is held there.

    Args:
        found: the leg.
        title: of the whole.

    Returns:
        Six panels: flexion over time, the quadriceps' pull, both bones, ligaments, and how far the
        motion is from a leg that is held.
    """
    figure, panels = panel_grid(3, 2, 7.8, title)
    one, motion, at = found.transient, found.transient.trajectory, found.held.flexion_deg
    table, names = motion.to_table(), motion.names
    flexion = table[:, 0]
    panels[0].plot(one.time_s, flexion, color=BLUE)
    panels[0].set(xlabel="Time, s", ylabel="Flexion, deg")
    dots = {"linestyle": "none", "marker": ".", "markersize": 3.5}
    draw_named(panels[1], at, {"held": found.held.quadriceps_N}, "", colors=[BLACK], **dots)
    pull = {"raised": one.quadriceps["quadriceps_N"]}
    draw_named(panels[1], flexion, pull, "Quadriceps force, N")
    state = found.held.motion.equilibrium.state.at(names)
    held = np.asarray(state).T * table_units(names)
    for axes, shown, label in (
        (panels[2], ("patella_flexion", "patella_tilt", "patella_rotation"), "Patella, deg"),
        (panels[3], ("internal_rotation", "adduction", "anterior"), "Tibia, change, deg or mm"),
    ):
        curves = {}
        for name, color in zip(shown, _COLORS, strict=True):
            k = names.index(name)
            zero = table[0, k] if axes is panels[3] else 0.0
            curves[name.replace("patella_", "").replace("_", " ")] = table[:, k] - zero
            axes.plot(at, held[:, k] - zero, color=color, **dots)
        draw_named(axes, flexion, curves, label, colors=_COLORS, columns=3)
    tension = np.asarray(one.mechanics.tension) + one.damping_N
    draw_ligaments(panels[4], flexion, motion.moving.knee, tension)
    away = {}
    for bone in ("tibia", "patella"):
        for unit in ("deg", "mm"):
            columns = [
                k for k, name in enumerate(names)
                if coordinate(name).unit == unit
                and name.startswith("patella") == (bone == "patella")
            ]  # fmt: skip
            away[f"{bone}, {unit}"] = np.abs(found.from_held[:, columns]).max(axis=1)
    colors = (BLUE, GREEN, VERMILLION, PURPLE)
    draw_named(panels[5], at, away, "From the leg that is held", colors=colors)
    panels[5].set_ylim(bottom=0.0)
    for axes in panels[1:]:
        flexion_axis(axes, flexion)
    return figure
