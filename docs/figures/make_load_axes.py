"""The picture of docs/units_and_conventions.md: along which axes loads by name act.

    python docs/figures/make_load_axes.py

The axes are those that the package computes, at 0 and 90 degrees; the bones are outlines.
"""

from __future__ import annotations

from pathlib import Path

import jax
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Circle, FancyArrowPatch, Polygon

jax.config.update("jax_enable_x64", True)

from kneejax.geometry import Pose, grood_suntay_axes  # noqa: E402

HERE = Path(__file__).resolve().parent
BLUE, VERMILLION, GREEN, GREY, BONE = "#0072B2", "#D55E00", "#009E73", "#666666", "#EFE9DC"
#: Outlines seen from the lateral side, mm: anterior to the right, superior up.
FEMUR = [[-13, 95], [-13, 30], [-26, 16], [-29, -4], [-19, -21], [0, -25], [19, -20], [27, -3],
         [21, 18], [12, 32], [12, 95]]  # fmt: skip
TIBIA = [[-25, 0], [25, 0], [24, -9], [15, -26], [11, -42], [10, -110], [-10, -110], [-12, -42],
         [-20, -20]]  # fmt: skip
#: From the femur's origin to the tibia's, along the tibia's long axis, mm.
APART = 28.0


def draw_knee(axes, flexion_deg: float) -> None:
    """A knee from its lateral side, with the axes of its loads."""
    tibia = Pose.from_table([flexion_deg, 0, 0, 0, 0, 0]).placement
    floating, long, _ = (np.array([float(x) for x in axis])[:2]
                         for axis in grood_suntay_axes(tibia))  # fmt: skip
    forwards, origin = np.array([float(x) for x in tibia.turn((1, 0, 0))])[:2], -APART * long
    outline = [origin + x * forwards + y * long for x, y in TIBIA]
    for points in (FEMUR, outline):
        axes.add_patch(Polygon(points, closed=True, fc=BONE, ec="#8A8577", lw=1.0))

    draw_arrow(axes, origin, 62 * floating, VERMILLION)
    label(axes, origin + 62 * floating, floating, "anterior_N\nfloating axis", VERMILLION)
    turn(axes, origin + 42 * floating, floating, VERMILLION)
    label(axes, origin + 42 * floating - 25 * long, -long, "varus_Nm", VERMILLION)
    below = origin - 70 * long
    draw_arrow(axes, below - 52 * long, 40 * long, BLUE)
    label(axes, below - 52 * long, -long, "compression_N\ntibia's long axis", BLUE)
    turn(axes, below + 6 * long, long, BLUE)
    label(axes, below + 6 * long - 25 * floating, -floating, "internal_Nm", BLUE)
    axes.add_patch(Circle(origin, 4.5, fc="white", ec=GREEN, lw=1.8, zorder=5))
    axes.add_patch(Circle(origin, 1.4, fc=GREEN, ec=GREEN, zorder=6))
    label(axes, origin - 36 * floating - 14 * long, -floating, "lateral_N\ntowards you", GREEN)

    # What a column of the femoral convention reads, for comparison.
    axes.annotate("", (58, 60), (22, 60), arrowprops=dict(arrowstyle="->", color=GREY, ls="--"))
    words = "the femur's\nanterior axis"
    axes.text(40, 64, words, color=GREY, ha="center", va="bottom", fontsize=7)
    axes.set(xlim=(-165, 110), ylim=(-180, 100), aspect="equal")
    axes.set_axis_off()
    axes.set_title(f"{flexion_deg:g} degrees of flexion", fontsize=9)


def draw_arrow(axes, start, along, colour: str) -> None:
    """A force."""
    style = dict(arrowstyle="-|>", mutation_scale=13, lw=2.2, color=colour, zorder=4)
    axes.add_patch(FancyArrowPatch(start, start + along, shrinkA=0, shrinkB=0, **style))


def turn(axes, center, axis, colour: str) -> None:
    """The near half of a turn about an axis in the plane of the picture."""
    # The side towards the eye moves along axis x (out of the picture).
    onwards = np.array([axis[1], -axis[0]])
    angle = np.linspace(-1.25, 1.25, 40)[:, None]
    arc = center + 17 * np.sin(angle) * onwards + 6 * np.cos(angle) * axis
    axes.plot(*arc[:-3].T, color=colour, lw=1.6, zorder=4)
    style = dict(arrowstyle="-|>", mutation_scale=9, lw=1.6, color=colour, zorder=4)
    axes.add_patch(FancyArrowPatch(arc[-4], arc[-1], shrinkA=0, shrinkB=0, **style))


def label(axes, at, away, words: str, colour: str) -> None:
    """Words beside a point, on the side that `away` shows."""
    x, y = at + 4 * away
    across = "center" if abs(away[0]) < 0.5 else ("left" if away[0] > 0 else "right")
    up = "center" if abs(away[1]) < 0.5 else ("bottom" if away[1] > 0 else "top")
    axes.text(x, y, words, color=colour, ha=across, va=up, fontsize=7.5, linespacing=1.15)


def main() -> None:
    """Draw and save."""
    figure, panels = plt.subplots(1, 2, figsize=(7.0, 3.7))
    figure.subplots_adjust(left=0.0, right=1.0, top=0.93, bottom=0.0, wspace=0.0)
    for axes, flexion_deg in zip(panels, (0.0, 90.0), strict=True):
        draw_knee(axes, flexion_deg)
    figure.savefig(HERE / "load_axes.png", dpi=150, metadata={"Software": None})


if __name__ == "__main__":
    main()
