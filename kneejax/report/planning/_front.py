"""Several criteria against each other."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kneejax.planning import criteria_of
from kneejax.report.look import BLACK, BLUE, VERMILLION, WIDTH, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from kneejax.planning import PlanResult


@styled
def front_figure(result: PlanResult) -> Figure:
    """Draw the front of several criteria.

    Args:
        result: of a plan with a front.

    Returns:
        A panel for each laxity over the graft's largest force, coloured by strain distance, and
        one of strain distance over the force, coloured by the first laxity.
    """
    from matplotlib.figure import Figure

    front = result.front
    assert front is not None
    tests = [f"Laxity at {x:g} deg, mm" for x in result.plan.surgery.protocol.lachman_deg]
    names = [*tests, "Largest graft force, N", "Strain distance"]
    force, strains = len(tests), len(tests) + 1
    panels = [(k, strains) for k in range(len(tests))] + [(strains, 0)]
    shown = [("planned", result.planned, "P", BLUE, 8)]
    if result.optimum is not None:
        shown.append(("optimum", result.optimum.outcome, "*", VERMILLION, 11))
    figure = Figure(figsize=(WIDTH, 2.75), layout="constrained")
    every = np.atleast_1d(figure.subplots(1, len(panels)))
    for axes, (up, colour) in zip(every, panels, strict=True):
        points = axes.scatter(
            front.criteria[:, force], front.criteria[:, up], c=front.criteria[:, colour], s=14,
            cmap="viridis", linewidths=0,
        )  # fmt: skip
        middle = front.criteria[front.compromise]
        axes.plot(middle[force], middle[up], "D", color="none", markeredgecolor=BLACK,
                  markersize=6.5, linestyle="none", label="compromise")  # fmt: skip
        for label, outcome, marker, edge, size in shown:
            one = criteria_of(outcome)[0]
            axes.plot(one[force], one[up], marker, color=edge, markersize=size, label=label,
                      markeredgecolor="white", markeredgewidth=0.8, linestyle="none")  # fmt: skip
        axes.set_xlabel(names[force])
        axes.set_title(names[up])
        bar = figure.colorbar(points, ax=axes, location="bottom", fraction=0.06, pad=0.02)
        bar.set_label(f"colour: {names[colour].lower()}", fontsize=7.5)
        bar.ax.tick_params(labelsize=7)
    handles, labels = every[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), fontsize=7.5)
    return figure
