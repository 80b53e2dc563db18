"""Picture of the average knee beside published knees: internal rotation, anterior laxity.

    python docs/figures/make_average_knee.py
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
from kneejax.parameters import cut  # noqa: E402
from kneejax.report.look import BLUE, GREY, ORANGE, VERMILLION, styled  # noqa: E402

HERE = Path(__file__).resolve().parent
FLEXION = np.arange(0.0, 121.0, 10.0)


@styled
def drawn() -> Figure:
    """Two panels: what turns with flexion, and how far 90 N draw."""
    average, start = kj.load_knee("average_knee"), kj.load_knee("lenhart2015")
    figure = Figure(figsize=(7.4, 3.5))
    turning, drawing = figure.subplots(1, 2)
    for knee, color, label in ((average, BLUE, "average_knee"), (start, ORANGE, "lenhart2015")):
        table = np.asarray(kj.passive_flexion(knee, FLEXION).to_table("grood-suntay"))
        turning.plot(FLEXION, table[:, 2] - table[0, 2], color=color, label=label)
    with open(bundled_measurements()["walker1988"].path) as file:
        rows = list(csv.DictReader(file))
    turning.plot(
        [float(row["flexion_deg"]) for row in rows],
        [float(row["internal_rotation_deg"]) for row in rows],
        "s", color=GREY, markersize=3, label="Walker 1988",
    )  # fmt: skip
    turning.set_ylabel("Internal rotation from extension, deg")
    bands = bundled_bands(name="robot_anterior_90N")
    for band in sorted(bands, key=lambda band: len(band.cut)):
        without = bool(band.cut)
        color, said = (VERMILLION, "ACL cut") if without else (BLUE, "intact")
        drawing.errorbar(
            band.flexion_deg, band.mean, np.nan_to_num(2 * band.sd), fmt="s", color=color,
            markersize=3, elinewidth=0.8, capsize=2, alpha=0.5, label=f"12 knees (2 sd), {said}",
        )  # fmt: skip
        (test,) = kj.lab_tests("drawer", band.flexion_deg, force_N=90.0, steps=1)
        (curves,) = kj.load_curves(cut(average, band.cut), test, average)
        drawing.plot(
            band.flexion_deg, [row.positive for row in kj.laxity(curves)], color=color,
            label=f"average_knee, {said}",
        )  # fmt: skip
    drawing.set_ylabel("Anterior of the intact path under 90 N, mm")
    for axes in (turning, drawing):
        axes.set_xlabel("Flexion, deg")
        axes.legend(
            fontsize=7, ncol=2, columnspacing=1.0, handlelength=1.5, loc="upper center",
            bbox_to_anchor=(0.5, -0.17),
        )  # fmt: skip
    figure.subplots_adjust(left=0.08, right=0.99, top=0.97, bottom=0.28, wspace=0.22)
    return figure


if __name__ == "__main__":
    (HERE / "average_knee.png").write_bytes(report.picture_png(drawn()))
