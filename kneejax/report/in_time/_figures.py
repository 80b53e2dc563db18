"""Poses, forces and energies over time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from kneejax.experiments import Transient
from kneejax.geometry import COORDINATES
from kneejax.inference.transients import Recorded
from kneejax.mechanics import NAMED_LOADS, Knee
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
from kneejax.statics import Status

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Ligaments whose force never reaches this part of the largest are left out of the drawing.
_SMALL = 0.03
_MOST_LINES = 8
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
    draw_ligaments(panels[3], found.time_s, found)
    contact = np.linalg.norm(np.asarray(found.mechanics.contact_force), axis=-1)
    for k, name in enumerate(found.trajectory.moving.knee.contact_names):
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


def legend_above(axes: Axes, columns: int = 4) -> None:
    """Put the legend above a panel, if it has one."""
    if axes.get_legend_handles_labels()[0]:
        axes.legend(
            fontsize=7.5, ncol=columns, loc="lower left", bbox_to_anchor=(0.0, 1.0),
            borderaxespad=0.1, columnspacing=1.0, handlelength=1.4,
        )  # fmt: skip


def _changes(
    axes: Axes, found: Transient, names: list[str], label: str, recorded: Recorded | None
) -> None:
    table = found.trajectory.to_table()
    rest = None if found.rest is None else np.asarray(found.rest.to_table())[0]
    for name, color in zip(names, _COLORS, strict=False):
        k = list(COORDINATES).index(name)
        axes.plot(found.time_s, table[:, k] - table[0, k], color=color, label=_short(name))
        if recorded is not None and name in recorded.changes:
            dots = recorded.time_s, recorded.changes[name]
            axes.plot(*dots, ".", color=color, markersize=2.5, alpha=0.6)
        if rest is not None:
            axes.axhline(rest[k] - table[0, k], color=color, linestyle="--", linewidth=0.8)
    axes.set_ylabel(label)
    legend_above(axes)


def _short(name: str) -> str:
    return name.replace("internal_rotation", "internal")


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


def draw_ligaments(axes: Axes, x: np.ndarray, found: Transient) -> None:
    """Draw the ligaments that carry most, the fibres of a group together."""
    knee = found.trajectory.moving.knee
    whole = np.asarray(found.mechanics.tension) + found.damping_N
    row = {name: k for k, name in enumerate(knee.ligaments.names)}
    drawn = {
        name: whole[:, [row[fibre] for fibre in fibres]].sum(axis=1)
        for name, fibres in bundles(knee).items()
    }
    size = {name: np.nanmax(np.abs(x)) for name, x in drawn.items()}
    largest = max(size.values(), default=0.0)
    shown = [name for name in drawn if size[name] > _SMALL * largest]
    for name, color in zip(
        sorted(shown, key=lambda x: -size[x])[:_MOST_LINES], PARTS, strict=False
    ):
        axes.plot(x, drawn[name], color=color, label=verbatim(name))
    axes.set_ylabel("Ligament force, N")
    legend_above(axes)


def bundles(knee: Knee) -> Mapping[str, list[str]]:
    """Ligaments, the fibres of the largest groups together: name -> fibres.

    Args:
        knee: any knee.
    """
    answer: dict[str, list[str]] = {}
    left = list(knee.ligaments.names)
    for group, members in sorted(knee.groups, key=lambda group: -len(group[1])):
        if all(name in left for name in members):
            answer[group] = list(members)
            left = [name for name in left if name not in members]
    return answer | {name: [name] for name in left}


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
    axes.legend(
        fontsize=7, ncol=5, loc="lower left", bbox_to_anchor=(-0.02, 1.0), borderaxespad=0.1,
        columnspacing=0.7, handlelength=1.0, handletextpad=0.4,
    )  # fmt: skip
