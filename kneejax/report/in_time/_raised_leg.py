"""A leg that a motor raises, beside the leg that is held at each flexion."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from kneejax.experiments import RaisedLeg
from kneejax.geometry import coordinate, table_units
from kneejax.report.in_time._figures import draw_ligaments, legend_above
from kneejax.report.in_time._text import how_exact
from kneejax.report.look import BLACK, BLUE, GREEN, PURPLE, VERMILLION, WIDTH, styled, verbatim
from kneejax.report.motion import flexion_axis

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Coordinates that are drawn, and what they are called there.
_PATELLA = {f"patella_{way}": way for way in ("flexion", "tilt", "rotation")}
_TIBIA = {"internal_rotation": "internal", "adduction": "varus", "anterior": "anterior"}
#: Rows of the table on a terminal.
_ROWS = 9


def motor_raise_lines(found: RaisedLeg) -> Iterator[str]:
    """The leg at some times, how far it is from one that is held, and how exact it is.

    Args:
        found: the leg.
    """
    motion, pull, held = found.transient.trajectory, _pull(found), found.held
    table, patella = motion.to_table(), motion.names.index("patella_flexion")
    yield "  time  flexion  quadriceps    held   patella"
    yield "     s      deg           N       N       deg"
    for k in np.unique(np.linspace(0, len(found.rows) - 1, _ROWS).round().astype(int)):
        row = found.rows[k]
        cells = f"{found.transient.time_s[row]:6.2f}{table[row, 0]:9.2f}{pull[row]:12.1f}"
        yield f"{cells}{held.quadriceps_N[k]:8.1f}{table[row, patella]:10.2f}"
    if np.isfinite(found.from_held).any():
        k, column = np.unravel_index(np.nanargmax(np.abs(found.from_held)), found.from_held.shape)
        one = coordinate(motion.names[column])
        yield (
            f"farthest from a leg that is held: {found.farthest:.2g} {one.unit}, {one.phrase}, "
            f"at {table[found.rows[k], 0]:.1f} degrees"
        )
    yield from how_exact(found.transient)


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
    panels[1].plot(flexion, _pull(found), color=BLUE, label="raised")
    at, pulls = found.held.flexion_deg, found.held.quadriceps_N
    panels[1].plot(at, pulls, ".", color=BLACK, markersize=3.5, label="held")
    panels[1].set_ylabel("Quadriceps force, N")
    legend_above(panels[1])
    _beside(panels[2], found, _PATELLA, "Patella, deg")
    _beside(panels[3], found, _TIBIA, "Tibia, change, deg or mm")
    draw_ligaments(panels[4], flexion, found.transient)
    _away(panels[5], found)
    for axes in panels[1:]:
        flexion_axis(axes, flexion)
    return figure


def _pull(found: RaisedLeg) -> np.ndarray:
    return found.transient.quadriceps["quadriceps_N"]


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
