"""Pictures of the bundled knees for the reference: lateral and anterior view at the reference pose.

Usage: `python docs/figures/make_knees.py`.
"""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

import kneejax as kj
from kneejax.files import bundled_knee_descriptions, load_knee_file
from kneejax.geometry import TIBIA, Vector

kj.configure()
FOLDER = Path(__file__).resolve().parent
COLOURS = {"ACL": "#d55e00", "PCL": "#0072b2", "MCL": "#009e73", "LCL": "#cc79a7"}


def grid(surface, points=24):
    """Points of a surface in its bone's frame, `(3, n, n)`, mm."""
    (a0, a1), (b0, b1) = surface.bounds()
    a, b = np.meshgrid(np.linspace(a0, a1, points), np.linspace(b0, b1, points), indexing="ij")
    placed = surface.frame.placement.apply(surface.point(a, b))
    return np.stack([np.broadcast_to(np.asarray(x), a.shape) for x in placed])


for name in bundled_knee_descriptions():
    knee = load_knee_file(name).knee
    motion = knee.reference_pose.placement  # from the tibia's frame to the femur's
    figure, axes = plt.subplots(1, 2, figsize=(5.2, 3.4), sharey=True, layout="constrained")
    for axis, (across, label) in zip(axes, ((0, "anterior, mm"), (2, "lateral, mm")), strict=True):
        for contact in knee.contacts:
            for surface, bone, colour in (
                (contact.femoral, "femur", "0.6"),
                (contact.tibial, TIBIA, "#c9a66b"),
            ):
                at = grid(surface)
                if bone == TIBIA:
                    moved = motion.apply(Vector.of(at.reshape(3, -1)))
                    at = np.stack([np.asarray(x) for x in moved]).reshape(at.shape)
                axis.plot(at[across], at[1], color=colour, lw=0.3)
        fibres = knee.ligaments
        femoral = np.asarray(fibres.femoral_attachment).T
        tibial = np.stack([*motion.apply(Vector.of(np.asarray(fibres.tibial_attachment).T))])
        for number, fibre in enumerate(fibres.names):
            colour = next((c for key, c in COLOURS.items() if fibre.startswith(key)), "0.35")
            ends = [(x[across][number], x[1][number]) for x in (femoral, tibial)]
            axis.plot(*zip(*ends, strict=True), color=colour, lw=0.9)
        axis.set_aspect("equal")
        axis.set_xlabel(label)
    axes[0].set_ylabel("superior, mm")
    for key, colour in COLOURS.items():
        axes[1].plot([], [], color=colour, label=key)
    axes[1].plot([], [], color="0.35", label="others")
    figure.legend(loc="outside upper center", ncols=5, frameon=False, fontsize=8)
    figure.savefig(FOLDER / f"knee_{name}.png", dpi=110)
    plt.close(figure)
