"""The leg that is raised, in the layout of paper 3's Figures 12 to 19."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kneejax.report.look import BLUE, GREEN, GREY, VERMILLION, WIDTH, styled, verbatim
from kneejax.report.motion import flexion_axis
from kneejax.reproduction import RaisedLeg

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Parts of the shear that are drawn by themselves.
_PARTS = 6


@styled
def raised_leg_figure(found: RaisedLeg) -> Figure:
    """Draw pull, ratios of forces, moment arm, patella, cruciates and the shear on the tibia.

    Args:
        found: where the quadriceps would have to push nothing is drawn but the patella.

    Returns:
        Six panels.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, 7.6))
    panels = figure.subplots(3, 2).ravel()
    figure.subplots_adjust(left=0.085, right=0.985, top=0.95, bottom=0.065, wspace=0.24, hspace=0.5)
    leg, held = found.leg, found.held

    def of_held(values: np.ndarray) -> np.ndarray:
        return np.where(held, values, np.nan)

    _lines(panels[0], leg.flexion_deg, {"": of_held(leg.quadriceps_N)}, "Quadriceps force, N")
    ratios = {
        "patellar tendon": of_held(leg.tendon_N / leg.quadriceps_N),
        "patellofemoral contact": of_held(leg.patellofemoral_N / leg.quadriceps_N),
    }
    _lines(panels[1], leg.flexion_deg, ratios, "Force by quadriceps force")
    _lines(panels[2], leg.flexion_deg, {"": of_held(leg.arm_mm)}, "Moment arm, mm")
    turned = dict(zip(("flexion", "rotation", "tilt"), leg.patella.T, strict=False))
    _lines(panels[3], leg.flexion_deg, turned, "Patella, deg")
    cruciates = {name: of_held(found.tension[name]) for name in ("ACL", "PCL")}
    _lines(panels[4], leg.flexion_deg, cruciates, "Ligament force, N")
    _shear_panel(panels[5], found, of_held)
    for axes in panels[[0, 1, 2, 4]]:
        axes.set_ylim(bottom=0.0)
    return figure


def _lines(axes: Axes, x: np.ndarray, curves: dict[str, np.ndarray], label: str) -> None:
    for (name, values), color in zip(curves.items(), (BLUE, VERMILLION, GREEN), strict=False):
        axes.plot(x, values, color=color, label=name or None)
    axes.set_ylabel(label)
    flexion_axis(axes, x)
    if len(curves) > 1:
        _legend(axes)


def _shear_panel(axes: Axes, found: RaisedLeg, of_held) -> None:
    from matplotlib import colormaps

    parts = {name: of_held(force) for name, force in found.shear.items()}
    largest = sorted(parts, key=lambda name: -np.nanmax(np.abs(parts[name])))[:_PARTS]
    for name, color in zip(largest, colormaps["tab10"](np.arange(_PARTS)), strict=False):
        axes.plot(found.leg.flexion_deg, parts[name], color=color, label=verbatim(name))
    rest = [force for name, force in parts.items() if name not in largest]
    if rest:
        axes.plot(found.leg.flexion_deg, sum(rest), color=GREY, label="all others")
    total = sum(parts.values())
    axes.plot(found.leg.flexion_deg, total, color="black", linestyle=":", label="sum")
    axes.set_ylabel("Force on the tibia, forwards, N")
    flexion_axis(axes, found.leg.flexion_deg)
    _legend(axes, columns=4)


def _legend(axes: Axes, columns: int = 3) -> None:
    axes.legend(
        fontsize=7.0, frameon=False, ncol=columns, loc="lower left", bbox_to_anchor=(0.0, 1.0),
        borderaxespad=0.1, columnspacing=0.9, handlelength=1.2,
    )  # fmt: skip
