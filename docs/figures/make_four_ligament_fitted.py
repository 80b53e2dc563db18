"""Picture of the four lines before and after, beside published knees: rotation and laxity.

    python docs/figures/make_four_ligament_fitted.py
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

import kneejax as kj

kj.configure()

from matplotlib.figure import Figure  # noqa: E402

from kneejax import report  # noqa: E402
from kneejax.files import bundled_bands, bundled_measurements  # noqa: E402
from kneejax.report.look import BLUE, GREY, ORANGE, styled  # noqa: E402

HERE = Path(__file__).resolve().parent
FLEXION = np.arange(0.0, 121.0, 10.0)
KNEES = (("four_ligament_fitted", BLUE), ("four_ligament", ORANGE))


@styled
def drawn() -> Figure:
    """Three panels: what turns with flexion, how far 90 N draw, and how far 5 N m turn."""
    figure = Figure(figsize=(9.6, 3.4))
    turning, drawing, torque = figure.subplots(1, 3)
    (band,) = bundled_bands(cut=(), name="robot_anterior_90N")
    for name, color in KNEES:
        knee = kj.load_knee(name)
        table = np.asarray(kj.passive_flexion(knee, FLEXION).to_table("grood-suntay"))
        turning.plot(FLEXION, table[:, 2] - table[0, 2], color=color, label=name)
        (test,) = kj.lab_tests("drawer", band.flexion_deg, force_N=90.0, steps=1)
        (curves,) = kj.load_curves(knee, test)
        drawing.plot(band.flexion_deg, [row.positive for row in kj.laxity(curves)], color=color)
        (test,) = kj.lab_tests("torsion", band.flexion_deg, moment_Nm=5.0, both=True, steps=4)
        (curves,) = kj.load_curves(knee, test)
        for end in ("positive", "negative"):
            found = [getattr(row, end) for row in kj.laxity(curves)]
            torque.plot(band.flexion_deg, found, color=color)
    with open(bundled_measurements()["walker1988"].path) as file:
        rows = list(csv.DictReader(file))
    turning.plot(
        [float(row["flexion_deg"]) for row in rows],
        [float(row["internal_rotation_deg"]) for row in rows],
        "s", color=GREY, markersize=3, label="measured",
    )  # fmt: skip
    drawing.errorbar(
        band.flexion_deg, band.mean, np.nan_to_num(2 * band.sd), fmt="s", color=GREY,
        markersize=3, elinewidth=0.8, capsize=2,
    )  # fmt: skip
    torque.plot([30.0, 30.0], [12.1, -10.1], "s", color=GREY, markersize=3)
    turning.set_ylabel("Internal rotation from extension, deg")
    drawing.set_ylabel("Anterior laxity under 90 N, mm")
    torque.set_ylabel("Rotation under 5 N m, in and out, deg")
    for axes in (turning, drawing, torque):
        axes.set_xlabel("Flexion, deg")
        axes.axhline(0.0, color=GREY, linewidth=0.5)
        axes.set_xticks(np.arange(0.0, axes.get_xlim()[1], 30.0))
    drawing.set_ylim(bottom=0.0)
    handles, labels = turning.get_legend_handles_labels()
    figure.legend(handles, labels, fontsize=8, ncol=3, loc="lower center")
    figure.subplots_adjust(left=0.06, right=0.99, top=0.97, bottom=0.24, wspace=0.25)
    return figure


if __name__ == "__main__":
    (HERE / "four_ligament_fitted.png").write_bytes(report.picture_png(drawn()))
