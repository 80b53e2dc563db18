"""Quadriceps, tendon, patella and ligaments, over flexion or over the pull."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kneejax.experiments import TENDON, Extensor
from kneejax.geometry import FEMUR_AND_TIBIA
from kneejax.report.look import BLUE, GREEN, GREY, VERMILLION, WIDTH, styled, verbatim
from kneejax.report.motion import flexion_axis, mark_status

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_PULL = "Quadriceps force, N"
#: Ligaments whose force never reaches this part of the largest are left out of the drawing.
_SMALL = 0.03
_MOST_LINES = 8
#: Moment up to which a leg counts as held by the quadriceps, N m.
_LEFT_NM = 1e-3


@styled
def extensor_figure(found: Extensor, status: np.ndarray, title: str) -> Figure:
    """Draw the pull, the ratios of forces, the moment arm, the patella, and the ligaments.

    Args:
        found: of any of the experiments. Where several pulls were tried at a flexion, they run to
            the right and each flexion is a line.
        status: `Status` values, one a pose.
        title: of the whole.

    Returns:
        Six panels; what is no plain balance is marked at their lower edge.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, 7.6))
    panels = figure.subplots(3, 2).ravel()
    figure.subplots_adjust(
        left=0.085, right=0.985, top=0.93, bottom=0.065, wspace=0.24, hspace=0.36
    )
    figure.suptitle(verbatim(title), x=0.085, ha="left", fontsize=9.5)
    curves = _curves(found)
    pull, patella = found.quadriceps_N, found.patella
    # A quadriceps that nothing asks for is left at rest: its ratios tell of the bands alone.
    asked = (found.weight_Nm == 0.0) | (np.abs(found.extension_Nm) < _LEFT_NM)
    ratios = (np.where(asked, force / pull, np.nan) for force in (found.tendon_N, found.contact_N))
    if curves.over_pull:
        _draw(panels[0], curves, found.extension_Nm, "Extension moment, N m")
    else:
        panels[0].plot(curves.x, pull, color=BLUE)
        panels[0].set_ylabel(_PULL)
    for values, name, color in zip(
        ratios, ("patellar tendon", "patellofemoral contact"), (BLUE, VERMILLION), strict=True
    ):
        for k, rows in enumerate(curves.rows):
            panels[1].plot(
                curves.x[rows], values[rows], color=color, label=name if k == 0 else None
            )
    panels[1].set_ylabel("Force by quadriceps force")
    panels[1].set_ylim(bottom=0.0)
    _legend_above(panels[1])
    _draw(panels[2], curves, found.arm_mm, "Moment arm of the quadriceps, mm")
    _patella_panel(panels[3], curves, patella)
    _ligament_panel(panels[4], curves, found)
    _draw(panels[5], curves, np.asarray(found.motion.to_table())[:, 3], "Tibia, anterior, mm")
    for axes in panels:
        if curves.over_pull:
            axes.set_xlabel(_PULL)
        else:
            flexion_axis(axes, curves.x)
        mark_status(axes, curves.x, status, VERMILLION, 0.02)
    if curves.over_pull and len(curves.rows) > 1:
        panels[2].legend(title="Flexion, deg", title_fontsize=7.5, fontsize=7.5, frameon=False)
    return figure


@styled
def shear_figure(found: Extensor) -> Figure:
    """Draw what each part does to the tibia along its anterior axis: the parts sum to zero.

    Args:
        found: one pull a flexion.

    Returns:
        One panel, forces forwards upwards; parts that matter little are one line together.
    """
    from matplotlib import colormaps
    from matplotlib.figure import Figure

    forces = {name: force[:, 0] for name, force in _grouped(found).items()}
    size = {name: float(np.nanmax(np.abs(force))) for name, force in forces.items()}
    shown = sorted(size, key=lambda name: -size[name])[:_MOST_LINES]
    figure = Figure(figsize=(WIDTH, 3.6))
    axes = figure.subplots()
    figure.subplots_adjust(left=0.1, right=0.74, top=0.93, bottom=0.14)
    x = found.flexion_deg
    colors = colormaps["tab10"](np.arange(_MOST_LINES))
    for name, color in zip(shown, colors, strict=False):
        axes.plot(x, forces[name], color=color, label=verbatim(name))
    rest = [name for name in forces if name not in shown]
    if rest:
        axes.plot(x, sum(forces[name] for name in rest), color=GREY, label="all others")
    axes.plot(x, sum(forces.values()), color="black", linestyle=":", label="sum")
    axes.axhline(0.0, color=GREY, linewidth=0.5)
    axes.set_title("Force on the tibia, forwards along its own axis")
    axes.set_ylabel("N")
    flexion_axis(axes, x)
    axes.legend(loc="upper left", bbox_to_anchor=(1.02, 1.02), borderaxespad=0, fontsize=7.5)
    return figure


class _Lines:
    """Which poses are drawn as one line, and over what."""

    def __init__(self, found: Extensor):
        flexion = found.flexion_deg
        angles = np.unique(flexion)
        self.over_pull = len(angles) < len(flexion)
        self.x = found.quadriceps_N if self.over_pull else flexion
        every = [np.flatnonzero(flexion == angle) for angle in angles]
        self.rows = every if self.over_pull else [np.arange(len(flexion))]
        self.names = [f"{angle:g}" for angle in angles] if self.over_pull else [None]


def _curves(found: Extensor) -> _Lines:
    return _Lines(found)


def _draw(axes: Axes, curves: _Lines, values: np.ndarray, label: str) -> None:
    from matplotlib import colormaps

    many = len(curves.rows) > 1
    colors = colormaps["viridis"](np.linspace(0.0, 0.92, len(curves.rows))) if many else [BLUE]
    for rows, name, color in zip(curves.rows, curves.names, colors, strict=True):
        axes.plot(curves.x[rows], values[rows], color=color, label=name)
    axes.set_ylabel(label)


def _patella_panel(axes: Axes, curves: _Lines, patella: np.ndarray) -> None:
    for column, name, color in (
        (0, "flexion", BLUE),
        (2, "tilt", VERMILLION),
        (1, "rotation", GREEN),
    ):
        for k, rows in enumerate(curves.rows):
            label = name if k == 0 else None
            axes.plot(curves.x[rows], patella[rows, column], color=color, label=label)
    axes.set_ylabel("Patella, deg")
    _legend_above(axes)


def _legend_above(axes: Axes) -> None:
    axes.legend(
        fontsize=7.5, frameon=False, ncol=3, loc="lower left", bbox_to_anchor=(0.0, 1.0),
        borderaxespad=0.1,
    )  # fmt: skip


def _ligament_panel(axes: Axes, curves: _Lines, found: Extensor) -> None:
    from matplotlib import colormaps

    tension = _tensions(found)
    largest = max((float(np.nanmax(x)) for x in tension.values()), default=0.0)
    shown = [name for name, x in tension.items() if np.nanmax(x) > _SMALL * largest]
    colors = colormaps["tab10"](np.arange(10))
    for name, color in zip(shown[:10], colors, strict=False):
        for k, rows in enumerate(curves.rows):
            label = verbatim(name) if k == 0 else None
            axes.plot(curves.x[rows], tension[name][rows], color=color, label=label)
    axes.set_ylabel("Ligament force, N")
    axes.legend(fontsize=7, frameon=False, ncol=2)


def _members(found: Extensor) -> dict[str, list[str]]:
    """Ligaments between femur and tibia, those of a group together."""
    knee = found.motion.knee
    names = [
        name
        for name, pair in zip(knee.ligaments.names, knee.ligaments.bodies, strict=True)
        if pair == FEMUR_AND_TIBIA
    ]
    # The largest groups first: a bundle that is part of a ligament is drawn with it.
    groups = sorted(knee.groups, key=lambda group: -len(group[1]))
    answer: dict[str, list[str]] = {}
    taken: set[str] = set()
    for group, members in groups:
        own = [name for name in members if name in names and name not in taken]
        if len(own) == len(members):
            answer[group] = own
            taken.update(own)
    return answer | {name: [name] for name in names if name not in taken}


def _tensions(found: Extensor) -> dict[str, np.ndarray]:
    every = np.asarray(found.mechanics.tension)
    row = {name: k for k, name in enumerate(found.motion.knee.ligaments.names)}
    return {
        name: every[:, [row[fibre] for fibre in own]].sum(axis=1)
        for name, own in _members(found).items()
    }


def _grouped(found: Extensor) -> dict[str, np.ndarray]:
    forces = found.forces_on_tibia
    members = _members(found)
    answer = {name: sum(forces[fibre] for fibre in own) for name, own in members.items()}
    others = {fibre for own in members.values() for fibre in own}
    contacts = [name for name in found.motion.knee.contact_names if name in forces]
    rest = {k: v for k, v in forces.items() if k not in others and k not in contacts}
    contact = {"contact": sum(forces[name] for name in contacts)} if contacts else {}
    return {TENDON: rest.pop(TENDON), **contact, **rest, **answer}
