"""Panels of figures: grids in inches, curves over flexion or time, ligaments, matrices, limits."""

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.collections import QuadMesh
from matplotlib.colors import Colormap
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import FuncFormatter, LogLocator, MultipleLocator, NullLocator
from numpy.typing import ArrayLike

from kneejax.geometry import COORDINATES
from kneejax.mechanics import Knee
from kneejax.report.look.colours import BLACK, PARTS, VERMILLION, part_styles
from kneejax.report.look.style import SHOWN, WIDTH, Axes, verbatim, without_frame
from kneejax.report.pose_tables import bundle_forces
from kneejax.statics import Status

#: More measured poses than these are drawn smaller.
DENSE = 40
#: What an axis of flexion says; one of steps has no such ticks.
FLEXION = "Flexion, deg"
#: Ligaments in a drawing; those whose force never reaches this part of the largest are left out.
_MOST, _SMALL = 8, 0.03
#: Outcomes that are marked at the bottom edge: legend entry and marker.
_MARKS = (
    ("not balanced", tuple(s for s in Status if not s.converged), "x"),
    ("dislocated", (Status.DISLOCATED,), "D"), ("unstable", (Status.UNSTABLE,), "+"),
    ("a fibre's way is wrong", (Status.WAY_FLIPPED, Status.PAST_WRAP, Status.WRAP_INSIDE), "v"),
    ("a fibre overstretched", (Status.OVERSTRETCHED,), "^"),
    ("outside fitted surfaces", (Status.OUTSIDE_REGION,), "|"),
)


def grid(
    rows: int, columns: int, height: float, *, width: float = WIDTH, title: str = "",
    left: float = 0.6, right: float = 0.1, top: float = 0.3, bottom: float = 0.5,
    apart: tuple[float, float] = (0.6, 0.45), shown: int | None = None, constrained: bool = False,
    **how: Any,
) -> tuple[Figure, np.ndarray]:  # fmt: skip
    """A figure with its panels, `(rows, columns)`; all sizes are inches.

    `apart` lies between columns and between rows; panels beyond those `shown` have no axes.
    """
    figure = Figure(figsize=(width, height), layout="constrained" if constrained else None)
    if not constrained:
        wide = (width - left - right - (columns - 1) * apart[0]) / columns
        tall = (height - top - bottom - (rows - 1) * apart[1]) / rows
        figure.subplots_adjust(left=left / width, right=1 - right / width, top=1 - top / height,
                               bottom=bottom / height, wspace=apart[0] / wide,
                               hspace=apart[1] / tall)  # fmt: skip
    if title:
        figure.suptitle(verbatim(title), x=left / width, ha="left", fontsize=9.5)
    panels = figure.subplots(rows, columns, squeeze=False, **how)
    for axes in () if shown is None else panels.flat[shown:]:
        axes.set_axis_off()
    return figure, panels


def panel_grid(
    rows: int, columns: int, height: float, title: str, *, shared: bool = False
) -> tuple[Figure, np.ndarray]:
    """Panels in reading order with room for a legend above each, `shared` with one lowest axis."""
    left, wide, tall = (0.63, 0.77, 0.48) if columns == 2 else (0.53, 0.57, 0.45)
    figure, panels = grid(rows, columns, height, title=title, left=left, top=0.68, bottom=0.46,
                          apart=(wide, tall if shared else 0.8), sharex=shared)  # fmt: skip
    return figure, panels.ravel()


def coordinate_panels(
    flexion: np.ndarray, height: float = 6.3, **how: Any
) -> tuple[Figure, dict[str, Axes], Axes]:
    """Panels of the five coordinates by name, and axes for the legend; `how` goes to `grid`."""
    how = {"left": 0.6, "bottom": 0.47, "top": 0.25, "apart": (0.57, 0.42), **how}
    figure, panels = grid(3, 2, height, sharex=True, **how)
    panels[2, 1].set_axis_off()
    shown = dict(zip(SHOWN, (*panels[:, 0], *panels[:2, 1]), strict=True))
    for name, axes in shown.items():
        last = axes in (panels[2, 0], panels[1, 1])
        flexion_axis(axes, flexion, last)
        axes.tick_params(labelbottom=last)
        axes.set_title(COORDINATES[name].axis_label)
    return figure, shown, panels[2, 1]


def curve_style(flexion: np.ndarray, dashes: Any) -> dict[str, Any]:
    """A line where flexion runs one way, small markers where it does not."""
    steps = np.diff(flexion)
    if len(flexion) > 1 and ((steps >= 0).all() or (steps <= 0).all()):
        return {"linestyle": dashes}
    return {"linestyle": "none", "marker": "o", "markersize": 1.8, "markeredgewidth": 0}


def measured_curve(flexion: np.ndarray) -> dict[str, Any]:
    """How measured poses are drawn: black points without a line, smaller where they are many."""
    size = 3.0 if len(flexion) <= DENSE else 1.6
    return {"linestyle": "none", "marker": "o", "markersize": size, "markeredgewidth": 0,
            "color": BLACK}  # fmt: skip


def flexion_axis(
    axes: Axes, flexion: np.ndarray, labelled: bool = True, *, label: str = FLEXION
) -> None:
    """Limits and ticks at clinical angles; where flexion is constant `label` says what it is."""
    low, high = np.nanmin(flexion), np.nanmax(flexion)
    pad = 0.02 * (high - low) or 1.0
    axes.set_xlim(low - pad, high + pad)
    if label == FLEXION and 60 <= high - low <= 200:
        axes.xaxis.set_major_locator(MultipleLocator(30 if high - low > 90 else 15))
    if labelled:
        axes.set_xlabel(label)


def mark_edge(axes: Axes, x: np.ndarray, marker: str, color: str, height: float = 0.03):
    """Markers at the bottom edge of a panel."""
    return axes.plot(x, np.full(len(x), height), marker, color=color, markersize=4.5,
                     markeredgewidth=1.2, transform=axes.get_xaxis_transform(), clip_on=False,
                     zorder=5)[0]  # fmt: skip


def mark_status(
    axes: Axes, x: np.ndarray, status: np.ndarray, color: str = VERMILLION, height: float = 0.03
) -> dict[str, Any]:
    """Mark doubtful rows at the bottom edge; legend entry -> handle."""
    where = {entry: (np.isin(status, outcomes), marker) for entry, outcomes, marker in _MARKS}
    return {entry: mark_edge(axes, x[rows], marker, color, height)
            for entry, (rows, marker) in where.items() if rows.any()}  # fmt: skip


def draw_ligaments(
    axes: Axes, x: np.ndarray, knee: Knee, tension: ArrayLike, *,
    among: Sequence[str] | None = None, rows: Sequence[Any] = (slice(None),),
) -> None:  # fmt: skip
    """Draw the ligaments that carry most, the fibres of a group together."""
    forces = bundle_forces(knee, tension, among)
    size = {name: float(np.nanmax(np.abs(f), initial=0.0)) for name, f in forces.items()}
    largest, styles = max(size.values(), default=0.0), part_styles(forces)
    shown = sorted((x for x in forces if size[x] > _SMALL * largest), key=lambda x: -size[x])
    for name in shown[:_MOST]:
        for k, of_line in enumerate(rows):
            label = verbatim(name) if k == 0 else None
            axes.plot(x[of_line], forces[name][of_line], label=label, **styles[name])
    axes.set_ylabel("Ligament force, N")
    legend_above(axes)


def draw_named(
    axes: Axes, x: ArrayLike, curves: Mapping[str, Any], label: str, *,
    colors: Iterable[str] = PARTS, columns: int = 4, size: float = 7.5, **style: Any,
) -> None:  # fmt: skip
    """Draw a line for each name, in turn in `colors`, with a legend above the panel."""
    for (name, values), color in zip(curves.items(), itertools.cycle(colors), strict=False):
        own = {"color": color, "label": verbatim(name), **style}
        axes.plot(np.asarray(x), np.asarray(values), **own)
    axes.set_ylabel(label)
    legend_above(axes, columns, size)


def legend_above(axes: Axes, columns: int = 4, size: float = 7.5) -> None:
    """Put the legend above a panel, if it has one."""
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=size, ncol=columns, loc="lower left", bbox_to_anchor=(-0.03, 0.99),
                    borderaxespad=0.1, columnspacing=0.8, handlelength=1.2, handletextpad=0.4)


def part_legend(
    axes: Axes, drawn: Mapping[str, Any], corner: tuple[float, float], **layout: Any
) -> Any:
    """Names and what they stand for, a corner, the upper left one, in the axes' coordinates."""
    layout = {"fontsize": 7.5, "borderaxespad": 0, "loc": "upper left", **layout}
    if drawn:
        return axes.legend([*drawn.values()], [*drawn], bbox_to_anchor=corner, **layout)


def draw_matrix(
    axes: Axes, values: ArrayLike, shades: Colormap, span: tuple[float, float],
    word: Callable[[float], str], dark: Callable[[float], bool], rows: Sequence[str],
    columns: Sequence[str], *, numbers: bool = True, size: float = 7.5,
) -> QuadMesh:  # fmt: skip
    """Draw the cells of a matrix, with numbers in them where they are readable."""
    matrix = np.asarray(values, float)
    cells = axes.pcolormesh(np.ma.masked_invalid(matrix), cmap=shades, vmin=span[0], vmax=span[1],
                            edgecolors="white", linewidth=1)  # fmt: skip
    letters = 6.8 if max(matrix.shape) < 12 else 5.2
    for (i, j), value in np.ndenumerate(matrix):
        if numbers and np.isfinite(value):
            axes.text(j + 0.5, i + 0.5, word(value).replace("-", "\u2212"), ha="center",
                      va="center", fontsize=letters, color="white" if dark(value) else "black")
    high, wide = matrix.shape
    axes.set(xlim=(0, wide), ylim=(high, 0))
    axes.set_xticks(np.arange(wide) + 0.5, list(columns), fontsize=size)
    axes.set_yticks(np.arange(high) + 0.5, list(rows), fontsize=size)
    without_frame(axes)
    return cells


def colour_bar(figure: Figure, place: Axes, scale: Any, label: str):
    """A flat bar of colours that fills `place`."""
    bar = figure.colorbar(scale, cax=place, orientation="horizontal")
    bar.set_label(label)
    bar.outline.set_linewidth(0.5)  # pyright: ignore[reportCallIssue, reportAttributeAccessIssue]
    return bar


def labelled(*every: Axes) -> dict[str, Any]:
    """What has a label in panels, once for each."""
    pairs = (zip(*axes.get_legend_handles_labels()[::-1], strict=True) for axes in every)
    return dict(itertools.chain(*pairs))


def figure_legend(figure: Figure, drawn: Mapping[str, Any] | None = None, **layout: Any) -> None:
    """One legend for all panels: what is `drawn` by its name, by default what has a label."""
    drawn = labelled(*figure.axes) if drawn is None else drawn
    layout = {"loc": "lower center", "ncols": len(drawn), **layout}
    figure.legend([*drawn.values()], [*drawn], **layout)


def name_rows(axes: Axes, places: ArrayLike, names: Sequence[str]) -> None:
    """Names of rows along the vertical axis, without ticks or lines of a grid."""
    axes.set_yticks(places, names)
    axes.tick_params(axis="y", length=0)
    axes.grid(visible=False, axis="y")


def decades(axis: Any, numticks: int, subs: Sequence[float] = (1.0,)) -> None:
    """Along a logarithmic axis numbers as they are, at `subs` of each decade: no powers of ten."""
    axis.set_major_locator(LogLocator(base=10, subs=subs, numticks=numticks))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def hatched(axes: Axes, corner: tuple[float, float], wide: float, high: float, hatch: str) -> Any:
    """A hatched rectangle where there is nothing to draw."""
    style = {"hatch": hatch, "fc": "#F4F4F4", "ec": "#A0A0A0", "lw": 0}
    return axes.add_patch(Rectangle(corner, wide, high, **style))
