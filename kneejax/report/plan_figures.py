"""Figures of a plan."""

__all__ = ["front_figure", "strain_figure", "tunnel_map_figure"]

from collections.abc import Callable

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from kneejax.geometry import FEMUR, TIBIA
from kneejax.planning import Footprint, Outcome, PlanResult, TunnelMap, criteria_of
from kneejax.report.look.colours import BLACK, BLUE, GREY, LIGHT, VERMILLION, shades
from kneejax.report.look.style import Axes, Figure, styled, verbatim
from kneejax.report.panels import figure_legend, grid, labelled
from kneejax.report.scene.surfaces import surface_grid

#: Of the first panel, from the middle of the footprint, mm.
_FARTHEST_MM = 32.0


@styled
def tunnel_map_figure(result: PlanResult, found: TunnelMap) -> Figure:
    """Draw what a tunnel's place does, and where on the bone that is.

    Args:
        result: of the plan.
        found: one of its maps.

    Returns:
        The bone with the region, then a panel for each quantity. The tibia is seen from above,
        the notch's lateral wall from its medial side, of a right knee.
    """
    tests = [f"Laxity at {angle:g} deg, mm" for angle in found.lachman_deg]
    shown = [("Strain distance", found.total), *zip(tests, found.laxity_mm, strict=True),
             ("Graft force, N", found.peak_N), ("Length change, mm", found.isometry_mm)]
    rows = -(-(len(shown) + 1) // 3)
    figure, panels = grid(rows, 3, 2.15 * rows + 0.35, shown=len(shown) + 1, constrained=True)
    _bone_panel(panels.flat[0], result, found)
    right, up = _across(found.bone)
    x, y = (found.first, found.second)[right], (found.first, found.second)[up]
    over = np.nan_to_num(found.excess if right == 0 else found.excess.T, posinf=1.0)
    for axes, (title, values) in zip(panels.flat[1:], shown, strict=False):
        axes.set_title(title)
        axes.set_facecolor("#D8DADC")
        drawn = values if right == 0 else values.T
        known = drawn[np.isfinite(drawn)]
        if known.size and np.ptp(known) > 0:
            # A few steep corners would leave the rest without colours.
            low, high = float(known.min()), float(np.quantile(known, 0.95))
            levels = MaxNLocator(10).tick_values(low, high if high > low else float(known.max()))
            filled = axes.contourf(x, y, drawn, levels, cmap="viridis", extend="both")
            bar = figure.colorbar(filled, ax=axes, fraction=0.05, pad=0.03)
            bar.ax.tick_params(labelsize=7)
            bar.set_ticks(list(levels[::2]))
        if (over > 0).any():
            missed = axes.contourf(x, y, over, [0.0, np.inf], colors="none", hatches=["////"])
            missed.set_edgecolor("#FFFFFF90")
            missed.set_linewidth(0.0)
            axes.contour(x, y, over, [0.0], colors="white", linewidths=0.7)
        _axes(axes, found, (x.min(), x.max()), (y.min(), y.max()))
        _marks(axes, result, found)
    hatched = Patch(facecolor="none", hatch="////", edgecolor=BLACK, linewidth=0)
    drawn = labelled(*figure.axes) | {"a limit is missed": hatched}
    figure_legend(figure, drawn, ncols=6, fontsize=7.5, loc="outside lower center",
                  handlelength=1.4)  # fmt: skip
    return figure


def _across(bone: str) -> tuple[int, int]:
    """Which coordinate goes to the right, which upwards."""
    return (1, 0) if bone == TIBIA else (0, 1)


def _marks(axes: Axes, result: PlanResult, found: TunnelMap, small: bool = False) -> None:
    footprint = result.plan.surgery.footprint(found.bone)
    right, up = _across(found.bone)
    angle = np.linspace(0.0, 2.0 * np.pi, 100)
    ring = np.stack([np.cos(angle), np.sin(angle)]) * np.array(footprint.semi_axes_mm)[:, None]
    axes.plot(ring[right], ring[up], color="white", linewidth=2.2)
    axes.plot(ring[right], ring[up], color=BLACK, linewidth=1.0, label="footprint")
    if found.bone == TIBIA and not small:
        for number, corner in enumerate(result.octagon.choices[:, :2], 1):
            if np.abs(corner).max() <= found.first.max():
                axes.text(corner[right], corner[up], str(number), ha="center", va="center",
                          fontsize=6.5, bbox={"boxstyle": "circle,pad=0.15", "fc": "white",
                                              "ec": GREY, "lw": 0.5})  # fmt: skip
    first = 0 if found.bone == TIBIA else 2
    _mark_outcomes(axes, result, lambda one: one.choices[0, [first + right, first + up]],
                   (5, 7) if small else (7, 10), "optimum (all choices free)")  # fmt: skip


def _mark_outcomes(
    axes: Axes, result: PlanResult, place: Callable[[Outcome], np.ndarray],
    sizes: tuple[int, int], optimum: str = "optimum",
) -> None:  # fmt: skip
    """Marks of the plan and, where there is one, of the optimum at their places."""
    shown = [("planned", result.planned, "P", BLUE)]
    shown += [(optimum, result.best, "*", VERMILLION)] * (result.optimum is not None)
    for (label, outcome, marker, colour), size in zip(shown, sizes, strict=False):
        axes.plot(*place(outcome), marker, color=colour, markersize=size, label=label,
                  markeredgecolor="white", markeredgewidth=0.8, linestyle="none")  # fmt: skip


def _axes(axes: Axes, found: TunnelMap, x: tuple, y: tuple) -> None:
    right, up = _across(found.bone)
    axes.grid(False)
    # Medial, and in the notch anterior, is on the left.
    axes.set(aspect="equal", xlim=(x[1], x[0]), ylim=y)
    axes.set_xlabel(f"mm {found.names[right]}", labelpad=1)
    axes.set_ylabel(f"mm {found.names[up]}", labelpad=0)


def _bone_panel(axes: Axes, result: PlanResult, found: TunnelMap) -> None:
    """The surfaces of the bone in the plane of the footprint, and the region of the map."""
    footprint = result.plan.surgery.footprint(found.bone)
    right, up = _across(found.bone)
    reach = 0.0
    for contact in result.plan.own.contacts:
        surface = contact.tibial if found.bone == TIBIA else contact.femoral
        middle = surface_grid(surface, (5, 5)).mean(axis=(0, 1))
        # A condyle that is not the one in whose notch the footprint is.
        beside = (middle[2] - footprint.middle[2]) * max(footprint.middle[2], 1.0) < 0
        if found.bone == FEMUR and beside:
            continue
        flat = _flat(surface, footprint)
        corners = [flat[:-1, :-1], flat[1:, :-1], flat[1:, 1:], flat[:-1, 1:]]
        cells = np.stack(corners, axis=2)[..., (right, up)].reshape(-1, 4, 2)
        cells = cells[np.isfinite(cells).all(axis=(1, 2))]
        looks = {"facecolors": LIGHT, "edgecolors": LIGHT, "linewidths": 0.3}
        axes.add_collection(PolyCollection(cells, **looks))
        reach = max(reach, float(np.nanmax(np.abs(flat))))
    half = found.first.max(), found.second.max()
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * half
    axes.plot(corners[:, right], corners[:, up], color=BLACK, linewidth=0.8)
    _marks(axes, result, found, small=True)
    for x, y in footprint.fibres[:, (right, up)]:
        axes.plot(x, y, ".", color=BLACK, markersize=3.5)
    far = min(max(reach, 15.0) + 2.0, _FARTHEST_MM)
    _axes(axes, found, (-far, far), (-far, far))
    axes.set_title("Tibia from above" if found.bone == TIBIA else "Lateral wall of the notch")


def _flat(surface, footprint: Footprint) -> np.ndarray:
    """Points of a surface in the plane of a footprint, `(m, n, 2)`; NaN beyond its border."""
    grid = surface_grid(surface, (60, 60))
    (a0, a1), (b0, b1) = surface.bounds()
    a, b = np.meshgrid(np.linspace(a0, a1, 60), np.linspace(b0, b1, 60), indexing="ij")
    spacing = np.array((a1 - a0) / 59), np.array((b1 - b0) / 59)
    known = np.broadcast_to(np.asarray(surface.covered(a, b, spacing)), a.shape) > 0.5
    flat = (grid - footprint.middle) @ footprint.axes.T
    return np.where(known[..., None], flat, np.nan)


#: Most ligaments with a panel each; of more, those whose curves are farthest off.
_MOST = 12


@styled
def strain_figure(result: PlanResult) -> Figure:
    """Draw the strain of every ligament over extension, as paper 2's Figure 6 does.

    Args:
        result: of a plan.

    Returns:
        A panel for each ligament: intact, the eight corners of the octagon, the plan and the
        optimum.
    """
    surgery, colours = result.plan.surgery, shades(8, 0.95)
    motion, angles = surgery.protocol.motion, surgery.protocol.extension_deg
    worst = np.nan_to_num(np.nanmax(result.octagon.distance, axis=0), nan=-1.0)
    shown = sorted(np.argsort(-worst)[:_MOST])
    columns = 2 if len(shown) <= 4 else 3
    rows = -(-len(shown) // columns)
    figure, panels = grid(rows, columns, 1.55 * rows + 0.75, top=0.28, bottom=0.85,
                          apart=(0.5, 0.37), shown=len(shown), sharex=True)  # fmt: skip
    for axes, k in zip(panels.flat, shown, strict=False):
        row = surgery.plan.rows([surgery.ligaments[k]])[0]
        for corner, strain in enumerate(result.octagon.followed.strain[:, motion, row]):
            axes.plot(angles, 100 * strain, color=colours[corner], linewidth=0.7,
                      label=f"octagon {corner + 1}")  # fmt: skip
        known = [("planned", result.planned, BLUE)]
        known += [("optimum", result.best, VERMILLION)] * (result.optimum is not None)
        for label, one, colour in known:
            strain = one.followed.strain[0, motion, row]
            axes.plot(angles, 100 * strain, color=colour, label=label)
        axes.plot(angles, 100 * surgery.intact_strain[:, k], color=BLACK, linewidth=1.6,
                  linestyle=(0, (4, 1.5)), label="intact")  # fmt: skip
        axes.set(xlim=(angles.max(), angles.min()), title=verbatim(surgery.ligaments[k]))
    for axes in panels[:, 0]:
        axes.set_ylabel("Strain, %")
    for axes in panels.flat[max(len(shown) - columns, 0) : len(shown)]:
        axes.set_xlabel("Flexion, deg")
        axes.tick_params(labelbottom=True)
    figure_legend(figure, ncols=6, fontsize=7.5, handlelength=1.6, columnspacing=1.2)
    return figure


@styled
def tension_figure(result: PlanResult) -> Figure:
    """Draw laxity, the graft's largest force and the strain distance over the pretension."""
    surgery, found = result.plan.surgery, result.tension
    tension, limits = found.choices[:, 4], surgery.limits
    figure, ((*panels,),) = grid(1, 3, 2.45, left=0.53, bottom=0.47)
    intact = surgery.laxity(surgery.before)[0]
    for angle, colour, laxity, whole in zip(surgery.protocol.lachman_deg,
                                            (BLUE, VERMILLION, GREY, BLACK), found.laxity_mm.T,
                                            intact, strict=False):  # fmt: skip
        panels[0].plot(tension, laxity, color=colour, label=f"{angle:g} deg")
        panels[0].axhline(whole, color=colour, linewidth=0.8, linestyle="--")
    panels[0].set_ylim(0.0, 1.45 * max(panels[0].get_ylim()))
    panels[0].legend(loc="upper right", title="dashed: intact", title_fontsize=7.5, ncols=2)
    panels[1].plot(tension, found.peak_N, color=BLUE)
    panels[1].axhline(limits.graft_N, color=GREY, linewidth=0.8, linestyle="--")
    panels[2].plot(tension, found.total, color=BLUE)
    titles = (f"Laxity under {surgery.protocol.force_N:g} N, mm", "Largest force of the graft, N",
              "Distance of all strain curves")  # fmt: skip
    for axes, title in zip(panels, titles, strict=True):
        axes.set_ylim(bottom=0.0)
        axes.set(title=title, xlabel=f"Pretension at {surgery.fixation_deg:g} degrees, N")
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
    front = result.front
    assert front is not None
    tests = [f"Laxity at {x:g} deg, mm" for x in result.plan.surgery.protocol.lachman_deg]
    names = [*tests, "Largest graft force, N", "Strain distance"]
    force, strains = len(tests), len(tests) + 1
    panels = [(k, strains) for k in range(len(tests))] + [(strains, 0)]
    figure, (every,) = grid(1, len(panels), 2.75, constrained=True)
    for axes, (up, colour) in zip(every, panels, strict=True):
        points = axes.scatter(front.criteria[:, force], front.criteria[:, up],
                              c=front.criteria[:, colour], s=14, cmap="viridis", linewidths=0)
        middle = front.criteria[front.compromise]
        axes.plot(middle[force], middle[up], "D", color="none", markeredgecolor=BLACK,
                  markersize=6.5, linestyle="none", label="compromise")  # fmt: skip
        _mark_outcomes(axes, result, lambda one, up=up: criteria_of(one)[0, [force, up]], (8, 11))
        axes.set(xlabel=names[force], title=names[up])
        bar = figure.colorbar(points, ax=axes, location="bottom", fraction=0.06, pad=0.02)
        bar.set_label(f"colour: {names[colour].lower()}", fontsize=7.5)
        bar.ax.tick_params(labelsize=7)
    figure_legend(figure, loc="outside lower center", fontsize=7.5)
    return figure
