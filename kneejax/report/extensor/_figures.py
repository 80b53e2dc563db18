"""Quadriceps, tendon, patella and ligaments, over flexion or over the pull."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kneejax.experiments import TENDON, Extensor
from kneejax.geometry import FEMUR_AND_TIBIA
from kneejax.report.look import BLUE, GREEN, GREY, VERMILLION, WIDTH, styled, verbatim
from kneejax.report.motion import (
    bundles,
    draw_ligaments,
    draw_named,
    flexion_axis,
    mark_status,
    panel_grid,
    part_styles,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_PULL = "Quadriceps force, N"
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
    from matplotlib import colormaps

    figure, panels = panel_grid(3, 2, 7.8, title)
    flexion, pull, patella = (np.asarray(x) for x in
                              (found.flexion_deg, found.quadriceps_N, found.patella))  # fmt: skip
    angles = np.unique(flexion)
    over_pull = len(angles) < len(flexion)
    x, rows = (pull if over_pull else flexion), [np.arange(len(flexion))]
    if over_pull:
        rows = [np.flatnonzero(flexion == angle) for angle in angles]

    def by_flexion(axes: Axes, values, label: str) -> None:
        """A line for each flexion where several pulls were tried, else one."""
        shades = colormaps["viridis"](np.linspace(0.0, 0.92, len(rows)))
        for angle, own, shade in zip(angles, rows, shades, strict=False):
            color = shade if len(rows) > 1 else BLUE
            axes.plot(x[own], np.asarray(values)[own], color=color, label=f"{angle:g}")
        axes.set_ylabel(label)

    def by_kind(axes: Axes, curves: dict[str, np.ndarray], label: str) -> None:
        """A colour for each of several quantities."""
        for k, own in enumerate(rows):
            named = {name if k == 0 else f"_{name}": y[own] for name, y in curves.items()}
            draw_named(axes, x[own], named, label, colors=(BLUE, VERMILLION, GREEN), columns=3)

    # A quadriceps that nothing asks for is left at rest: its ratios tell of the bands alone.
    extension = np.asarray(found.extension_Nm)
    asked = (np.asarray(found.weight_Nm) == 0.0) | (np.abs(extension) < _LEFT_NM)
    tendon, contact = (np.where(asked, np.asarray(force) / pull, np.nan)
                       for force in (found.tendon_N, found.contact_N))  # fmt: skip
    if over_pull:
        by_flexion(panels[0], extension, "Extension moment, N m")
    else:
        by_flexion(panels[0], pull, _PULL)
    ratios = {"patellar tendon": tendon, "patellofemoral contact": contact}
    by_kind(panels[1], ratios, "Force by quadriceps force")
    panels[1].set_ylim(bottom=0.0)
    by_flexion(panels[2], found.arm_mm, "Moment arm of the quadriceps, mm")
    turns = {"flexion": patella[:, 0], "tilt": patella[:, 2], "rotation": patella[:, 1]}
    by_kind(panels[3], turns, "Patella, deg")
    knee = found.motion.knee
    draw_ligaments(
        panels[4], x, knee, found.mechanics.tension, among=_tibiofemoral(found), rows=rows
    )
    by_flexion(panels[5], np.asarray(found.motion.to_table())[:, 3], "Tibia, anterior, mm")
    for axes in panels:
        if over_pull:
            axes.set_xlabel(_PULL)
        else:
            flexion_axis(axes, x)
        mark_status(axes, x, status, VERMILLION, 0.02)
    if len(rows) > 1:
        panels[2].legend(title="Flexion, deg", title_fontsize=7.5, fontsize=7.5)
    return figure


@styled
def shear_figure(found: Extensor) -> Figure:
    """Draw what each part does to the tibia along its anterior axis: the parts sum to zero.

    Args:
        found: one pull a flexion.

    Returns:
        One panel, forces forwards upwards; parts that matter little are one line together.
    """
    from matplotlib.figure import Figure

    forces = {name: force[:, 0] for name, force in _grouped(found).items()}
    size = {name: float(np.nanmax(np.abs(force))) for name, force in forces.items()}
    shown = sorted(size, key=lambda name: -size[name])[:_MOST_LINES]
    figure = Figure(figsize=(WIDTH, 3.6))
    axes = figure.subplots()
    figure.subplots_adjust(left=0.1, right=0.74, top=0.93, bottom=0.14)
    x = np.asarray(found.flexion_deg)
    for name, style in part_styles(shown).items():
        axes.plot(x, forces[name], label=verbatim(name), **style)
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


def _tibiofemoral(found: Extensor) -> list[str]:
    """Fibres between femur and tibia."""
    fibres = found.motion.knee.ligaments
    pairs = zip(fibres.names, fibres.bodies, strict=True)
    return [name for name, pair in pairs if pair == FEMUR_AND_TIBIA]


def _grouped(found: Extensor) -> dict[str, np.ndarray]:
    """Forces on the tibia: tendon, contact, muscles and weight, ligaments by their bundles."""
    forces = dict(found.forces_on_tibia)
    knee = found.motion.knee
    tendon = {TENDON: forces.pop(TENDON)}
    pressed = [forces.pop(name) for name in knee.contact_names if name in forces]
    contact = {"contact": sum(pressed)} if pressed else {}
    fibres = _tibiofemoral(found)
    members = bundles(knee, fibres)
    pulled = {name: sum(forces.pop(x) for x in own) for name, own in members.items()}
    return {**tendon, **contact, **forces, **pulled}
