"""Means of paper 5, printed and made again."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kneejax.joints import MEASURES
from kneejax.report.look import BLACK, BLUE, VERMILLION, WIDTH, styled
from kneejax.reproduction.paper5 import printed_paper5 as printed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from kneejax.reproduction import Paper5Study


@styled
def paper5_figure(found: Paper5Study) -> Figure:
    """Draw the printed means of measurement, moving axis and hinge, and the joints made again.

    Args:
        found: the study.

    Returns:
        Five panels over flexion, the legend in the sixth. The band holds the middle 95 % of the
        axis points that were drawn.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, 6.3))
    panels = figure.subplots(3, 2, sharex=True)
    figure.subplots_adjust(left=0.085, right=0.985, top=0.96, bottom=0.075, wspace=0.2, hspace=0.24)
    x = printed.REACHED_DEG
    low, high = np.quantile(found.spread, [0.025, 0.975], axis=0)
    spots = [(0, 0), (1, 0), (2, 0), (0, 1), (1, 1)]
    for j, (measure, spot) in enumerate(zip(MEASURES, spots, strict=True)):
        axes = panels[spot]
        axes.set_title(f"{measure.name}: {measure.meaning}, {measure.unit}")
        axes.fill_between(
            x, low[:, j], high[:, j], color=VERMILLION, alpha=0.15, linewidth=0,
            label="the same, drawn axis points (95 %)",
        )  # fmt: skip
        axes.plot(
            x, found.moving_axis["contact"][:, j], color=VERMILLION,
            label="moving axis, ours, stand-in axis points",
        )  # fmt: skip
        axes.plot(
            x, found.hinge[:, j], color=BLUE, linestyle="--", label="hinge, ours, one number fitted"
        )
        axes.errorbar(
            x, printed.MEAN[printed.EOS][:, j], printed.SD[printed.EOS][:, j], fmt="o",
            markersize=4, markerfacecolor="none", color=BLACK, capsize=2, linewidth=0.8,
            label="EOS, printed, mean +- SD of ten",
        )  # fmt: skip
        axes.plot(
            x, printed.MEAN[printed.MOVING_AXIS][:, j], "D", markersize=4, color=VERMILLION,
            markeredgecolor="white", markeredgewidth=0.5, label="moving axis, printed",
        )  # fmt: skip
        axes.plot(
            x, printed.MEAN[printed.HINGE][:, j], "s", markersize=4, color=BLUE,
            markeredgecolor="white", markeredgewidth=0.5, label="hinge, printed",
        )  # fmt: skip
        last = spot in ((2, 0), (1, 1))
        axes.tick_params(labelbottom=last)
        if last:
            axes.set_xlabel("Flexion, deg")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    panels[2, 1].set_axis_off()
    order = [1, 0, 2, 5, 3, 4]
    panels[2, 1].legend(
        [handles[i] for i in order],
        [labels[i] for i in order],
        loc="upper left",
        bbox_to_anchor=(0.0, 0.82),
        borderaxespad=0,
    )
    return figure
