"""Poses, forces and energies over time, and a leg that a motor raises over its flexion."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kneejax.experiments import RaisedLeg, Transient
from kneejax.geometry import COORDINATES, coordinate, table_units
from kneejax.inference.transients import Recorded
from kneejax.mechanics import NAMED_LOADS
from kneejax.report.look import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    PARTS,
    PURPLE,
    VERMILLION,
    WIDTH,
    styled,
    verbatim,
)
from kneejax.report.motion import contact_forces, draw_ligaments, flexion_axis, legend_above
from kneejax.statics import Status

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Coordinates that are drawn, and what they are called there.
_PATELLA = {f"patella_{way}": way for way in ("flexion", "tilt", "rotation")}
_TIBIA = {"internal_rotation": "internal", "adduction": "varus", "anterior": "anterior"}
_COLORS = (BLUE, VERMILLION, GREEN)


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
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, 7.0))
    panels = figure.subplots(3, 2, sharex=True).ravel()
    figure.subplots_adjust(left=0.09, right=0.985, top=0.90, bottom=0.065, wspace=0.26, hspace=0.3)
    figure.suptitle(verbatim(title), x=0.09, ha="left", fontsize=9.5)
    coordinates = list(COORDINATES)
    _changes(panels[0], found, coordinates[3:], "Change of translation, mm", recorded)
    turned = coordinates[1:3]
    _changes(panels[1], found, turned, "Change of rotation, deg", recorded)
    _loads(panels[2], found)
    knee = found.trajectory.moving.knee
    tension = np.asarray(found.mechanics.tension) + found.damping_N
    draw_ligaments(panels[3], found.time_s, knee, tension)
    contact = contact_forces(found.mechanics)
    for k, name in enumerate(knee.contact_names):
        panels[4].plot(found.time_s, contact[:, k], color=PARTS[k % len(PARTS)], label=name)
    panels[4].set_ylabel("Contact force, N")
    legend_above(panels[4])
    _energies(panels[5], found)
    for axes in panels[-2:]:
        axes.set_xlabel("Time, s")
    if found.trajectory.ended is not Status.BALANCED:
        for axes in panels:
            axes.axvline(found.trajectory.ended_s, color=VERMILLION, linewidth=0.8, linestyle=":")
    return figure


def _changes(
    axes: Axes, found: Transient, names: list[str], label: str, recorded: Recorded | None
) -> None:
    table = found.trajectory.to_table()
    rest = None if found.rest is None else np.asarray(found.rest.to_table())[0]
    for name, color in zip(names, _COLORS, strict=False):
        k = list(COORDINATES).index(name)
        change = table[:, k] - table[0, k]
        axes.plot(found.time_s, change, color=color, label=name.replace("_rotation", ""))
        if recorded is not None and name in recorded.changes:
            dots = recorded.time_s, recorded.changes[name]
            axes.plot(*dots, ".", color=color, markersize=2.5, alpha=0.6)
        if rest is not None:
            axes.axhline(rest[k] - table[0, k], color=color, linestyle="--", linewidth=0.8)
    axes.set_ylabel(label)
    legend_above(axes)


def _loads(axes: Axes, found: Transient) -> None:
    acting = {name: x for name, x in found.sizes.items() if np.any(x)}
    if not acting:
        axes.plot(found.time_s, found.trajectory.to_table()[:, 0], color=BLACK)
        axes.set_ylabel("Flexion, deg")
        return
    units = {NAMED_LOADS[name].unit for name in acting}
    for (name, sizes), color in zip(acting.items(), PARTS, strict=False):
        load = NAMED_LOADS[name]
        label = f"{load.positive}" + (f", {load.unit}" if len(units) > 1 else "")
        axes.plot(found.time_s, sizes, color=color, label=label)
    axes.set_ylabel(f"Load, {' and '.join(sorted(units))}")
    legend_above(axes)


def _energies(axes: Axes, found: Transient) -> None:
    account = found.account
    times = np.concatenate([[0.0], found.trajectory.grid.time_s]) + found.time_s[0]
    for values, label, color, dashes in (
        (account.work, "work", BLACK, "-"),
        (account.kinetic, "kinetic", BLUE, "-"),
        (account.potential, "potential", GREEN, "-"),
        (account.dissipated, "dissipated", PURPLE, "-"),
        (account.missing, "missing", GREY, ":"),
    ):
        axes.plot(times, values, color=color, label=label, linestyle=dashes)
    axes.set_ylabel("Energy, N mm")
    legend_above(axes, 5, 7.0)


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
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, 7.8))
    panels = figure.subplots(3, 2).ravel()
    figure.subplots_adjust(left=0.09, right=0.985, top=0.905, bottom=0.06, wspace=0.27, hspace=0.52)
    figure.suptitle(verbatim(title), x=0.09, ha="left", fontsize=9.5)
    motion = found.transient.trajectory
    flexion = motion.to_table()[:, 0]
    panels[0].plot(found.transient.time_s, flexion, color=BLUE)
    panels[0].set_xlabel("Time, s")
    panels[0].set_ylabel("Flexion, deg")
    panels[1].plot(flexion, found.transient.quadriceps["quadriceps_N"], color=BLUE, label="raised")
    at, pulls = found.held.flexion_deg, found.held.quadriceps_N
    panels[1].plot(at, pulls, ".", color=BLACK, markersize=3.5, label="held")
    panels[1].set_ylabel("Quadriceps force, N")
    legend_above(panels[1])
    _beside(panels[2], found, _PATELLA, "Patella, deg")
    _beside(panels[3], found, _TIBIA, "Tibia, change, deg or mm")
    tension = np.asarray(found.transient.mechanics.tension) + found.transient.damping_N
    draw_ligaments(panels[4], flexion, motion.moving.knee, tension)
    _away(panels[5], found)
    for axes in panels[1:]:
        flexion_axis(axes, flexion)
    return figure


def _beside(axes: Axes, found: RaisedLeg, names: dict[str, str], label: str) -> None:
    motion, at = found.transient.trajectory, found.held.flexion_deg
    table, moved = motion.to_table(), "change" in label
    there = found.held.motion.equilibrium.state.at(motion.names)
    held = np.asarray(there).T * table_units(motion.names)
    for (name, word), color in zip(names.items(), (BLUE, VERMILLION, GREEN), strict=True):
        k = motion.names.index(name)
        zero = table[0, k] if moved else 0.0
        axes.plot(table[:, 0], table[:, k] - zero, color=color, label=word)
        axes.plot(at, held[:, k] - zero, ".", color=color, markersize=3.5)
    axes.set_ylabel(label)
    legend_above(axes)


def _away(axes: Axes, found: RaisedLeg) -> None:
    motion = found.transient.trajectory
    colors = {"tibia": (BLUE, GREEN), "patella": (VERMILLION, PURPLE)}
    for name, pair in colors.items():
        for unit, color in zip(("deg", "mm"), pair, strict=True):
            columns = [
                k for k, one in enumerate(motion.names)
                if coordinate(one).unit == unit and one.startswith("patella") == (name == "patella")
            ]  # fmt: skip
            size = np.abs(found.from_held[:, columns]).max(axis=1)
            axes.plot(found.held.flexion_deg, size, color=color, label=f"{name}, {unit}")
    axes.set_ylabel("From the leg that is held")
    axes.set_ylim(bottom=0.0)
    legend_above(axes, 2)
