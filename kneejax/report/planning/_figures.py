"""Strain curves beside the intact knee's, what the tension does, criteria against each other."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kneejax.planning import criteria_of
from kneejax.report.look import BLACK, BLUE, GREY, VERMILLION, WIDTH, styled, verbatim

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from kneejax.planning import PlanResult

#: Most ligaments with a panel each; of more, those whose curves are farthest off.
_MOST = 12
_ROW = 1.55  # inches


@styled
def strain_figure(result: PlanResult) -> Figure:
    """Draw the strain of every ligament over extension, as paper 2's Figure 6 does.

    Args:
        result: of a plan.

    Returns:
        A panel for each ligament: intact, the eight corners of the octagon, the plan and the
        optimum.
    """
    from matplotlib.figure import Figure

    surgery = result.plan.surgery
    names = list(surgery.ligaments)
    worst = np.nan_to_num(np.nanmax(result.octagon.distance, axis=0), nan=-1.0)
    shown = sorted(np.argsort(-worst)[:_MOST])
    columns = 2 if len(shown) <= 4 else 3
    rows = -(-len(shown) // columns)
    figure = Figure(figsize=(WIDTH, _ROW * rows + 0.75))
    panels = figure.subplots(rows, columns, sharex=True, squeeze=False)
    height = figure.get_figheight()
    figure.subplots_adjust(
        left=0.085, right=0.99, top=1 - 0.28 / height, bottom=0.85 / height, hspace=0.32,
        wspace=0.26,
    )  # fmt: skip
    for axes in panels.flat[len(shown) :]:
        axes.set_axis_off()
    for axes, k in zip(panels.flat, shown, strict=False):
        _strain_panel(axes, result, k)
        axes.set_title(verbatim(names[k]))
    for axes in panels[:, 0]:
        axes.set_ylabel("Strain, %")
    for axes in panels.flat[max(len(shown) - columns, 0) : len(shown)]:
        axes.set_xlabel("Flexion, deg")
        axes.tick_params(labelbottom=True)
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="lower center", ncols=6, fontsize=7.5, handlelength=1.6,
                  columnspacing=1.2)  # fmt: skip
    return figure


def _strain_panel(axes: Axes, result: PlanResult, k: int) -> None:
    from matplotlib import colormaps

    surgery, angles = result.plan.surgery, result.plan.surgery.protocol.extension_deg
    row = surgery.plan.rows([surgery.ligaments[k]])[0]
    motion = surgery.protocol.motion
    colours = colormaps["viridis"](np.linspace(0.0, 0.95, 8))
    for corner, strain in enumerate(result.octagon.followed.strain[:, motion, row]):
        axes.plot(angles, 100 * strain, color=colours[corner], linewidth=0.7,
                  label=f"octagon {corner + 1}")  # fmt: skip
    planned = result.planned.followed.strain[0, motion, row]
    axes.plot(angles, 100 * planned, color=BLUE, label="planned")
    if result.optimum is not None:
        best = result.optimum.outcome.followed.strain[0, motion, row]
        axes.plot(angles, 100 * best, color=VERMILLION, label="optimum")
    axes.plot(angles, 100 * surgery.intact_strain[:, k], color=BLACK, linewidth=1.6,
              linestyle=(0, (4, 1.5)), label="intact")  # fmt: skip
    axes.set_xlim(angles.max(), angles.min())


@styled
def tension_figure(result: PlanResult) -> Figure:
    """Draw laxity, the graft's largest force and the strain distance over the pretension.

    Args:
        result: of a plan.

    Returns:
        Three panels; what the intact knee has, and the limits, are dashed.
    """
    from matplotlib.figure import Figure

    surgery, found = result.plan.surgery, result.tension
    tension, limits = found.choices[:, 4], surgery.limits
    figure = Figure(figsize=(WIDTH, 2.45))
    panels = figure.subplots(1, 3)
    figure.subplots_adjust(left=0.075, right=0.99, top=0.89, bottom=0.19, wspace=0.3)
    intact = surgery.laxity(surgery.before)[0]
    for k, (angle, colour) in enumerate(
        zip(surgery.protocol.lachman_deg, (BLUE, VERMILLION, GREY, BLACK), strict=False)
    ):
        panels[0].plot(tension, found.laxity_mm[:, k], color=colour, label=f"{angle:g} deg")
        panels[0].axhline(intact[k], color=colour, linewidth=0.8, linestyle="--")
    panels[0].set_title(f"Laxity under {surgery.protocol.force_N:g} N, mm")
    panels[0].set_ylim(0.0, 1.45 * max(panels[0].get_ylim()))
    panels[0].legend(loc="upper right", title="dashed: intact", title_fontsize=7.5, ncols=2)
    panels[1].plot(tension, found.peak_N, color=BLUE)
    panels[1].axhline(limits.graft_N, color=GREY, linewidth=0.8, linestyle="--")
    panels[1].set_title("Largest force of the graft, N")
    panels[1].set_ylim(bottom=0.0)
    panels[2].plot(tension, found.total, color=BLUE)
    panels[2].set_title("Distance of all strain curves")
    panels[2].set_ylim(bottom=0.0)
    for axes in panels:
        axes.set_xlabel(f"Pretension at {surgery.fixation_deg:g} degrees, N")
    return figure


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
