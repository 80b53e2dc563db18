"""Panels of figures: grids, curves over flexion or time, ligaments, matrices."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from kneejax.mechanics import Knee
from kneejax.report.look.style import (
    BLUE,
    GREEN,
    MEASURED,
    ORANGE,
    PARTS,
    PURPLE,
    VERMILLION,
    WIDTH,
    verbatim,
    without_frame,
)
from kneejax.report.pose_tables import bundle_forces
from kneejax.statics import Status

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import QuadMesh
    from matplotlib.colors import Colormap
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike


def both_signs() -> Colormap:
    """Blue for what is negative, white at zero, red for what is positive."""
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("both signs", [BLUE, "#FFFFFF", VERMILLION])


def draw_matrix(
    axes: Axes,
    values: ArrayLike,
    shades: Colormap,
    span: tuple[float, float],
    word: Callable[[float], str],
    dark: Callable[[float], bool],
    rows: Sequence[str],
    columns: Sequence[str],
    *,
    numbers: bool = True,
    size: float = 7.5,
) -> QuadMesh:
    """Draw the cells of a matrix, with numbers in them where they are readable.

    Args:
        axes: of the panel.
        values: `(rows, columns)`; nothing is drawn where a value is NaN.
        shades: colour of a value.
        span: values of the first and the last colour.
        word: of a number; empty for none.
        dark: whether its cell is so dark that it is written in white.
        rows: label of each row.
        columns: label of each column.
        numbers: whether there is room for them.
        size: of the labels, points.

    Returns:
        The cells, for a colour bar.
    """
    matrix = np.asarray(values, float)
    cells = axes.pcolormesh(
        np.ma.masked_invalid(matrix), cmap=shades, vmin=span[0], vmax=span[1], edgecolors="white",
        linewidth=1,
    )  # fmt: skip
    letters = 6.8 if max(matrix.shape) < 12 else 5.2
    for (i, j), value in np.ndenumerate(matrix):
        if numbers and np.isfinite(value):
            axes.text(
                j + 0.5, i + 0.5, word(value).replace("-", "\u2212"), ha="center", va="center",
                fontsize=letters, color="white" if dark(value) else "black",
            )  # fmt: skip
    axes.set_xlim(0, matrix.shape[1])
    axes.set_ylim(matrix.shape[0], 0)
    axes.set_xticks(np.arange(matrix.shape[1]) + 0.5, list(columns), fontsize=size)
    axes.set_yticks(np.arange(matrix.shape[0]) + 0.5, list(rows), fontsize=size)
    without_frame(axes)
    return cells


DENSE = 40
#: What an axis of flexion says; one of steps has no such ticks.
FLEXION = "Flexion, deg"
#: The same colour for a structure in every figure, whichever bundles of it a knee has.
_STRUCTURES = {"ACL": VERMILLION, "PCL": BLUE, "MCL": GREEN, "LCL": ORANGE, "graft": PURPLE}
_OTHERS = [color for color in PARTS if color not in _STRUCTURES.values()]
_DASHES = ("-", "--", ":", "-.")
#: Ligaments whose force never reaches this part of the largest are left out of a drawing.
_SMALL = 0.03
#: Outcomes that are marked at the bottom edge: legend entry and marker.
_MARKS = (
    ("not balanced", tuple(s for s in Status if not s.converged), "x"),
    ("dislocated", (Status.DISLOCATED,), "D"), ("unstable", (Status.UNSTABLE,), "+"),
    ("a fibre's way is wrong", (Status.WAY_FLIPPED, Status.PAST_WRAP, Status.WRAP_INSIDE), "v"),
    ("a fibre overstretched", (Status.OVERSTRETCHED,), "^"),
    ("outside fitted surfaces", (Status.OUTSIDE_REGION,), "|"),
)


def curve_style(flexion: np.ndarray, dashes: Any, marker_only: float = 1.8) -> dict[str, Any]:
    """A line where flexion runs one way, small markers where it does not."""
    steps = np.diff(flexion)
    if len(flexion) > 1 and ((steps >= 0).all() or (steps <= 0).all()):
        return {"linestyle": dashes}
    return {"linestyle": "none", "marker": "o", "markersize": marker_only, "markeredgewidth": 0}


def measured_curve(flexion: np.ndarray) -> dict[str, Any]:
    """How measured poses are drawn: black points without a line, smaller where they are many.

    Args:
        flexion: of the poses, `(n,)`, degrees.

    Returns:
        Keywords for `Axes.plot`.
    """
    size = 3.0 if len(flexion) <= DENSE else 1.6
    return {
        "linestyle": "none", "marker": "o", "markersize": size, "markeredgewidth": 0,
        "color": MEASURED,
    }  # fmt: skip


def flexion_axis(
    axes: Axes, flexion: np.ndarray, labelled: bool = True, *, label: str = FLEXION
) -> None:
    """Make the horizontal axis one of flexion: limits, ticks at clinical angles, label.

    Args:
        axes: of the panel.
        flexion: of what is drawn, `(n,)`, degrees (or steps, where flexion is constant).
        labelled: whether the label is written; panels above others leave it out.
        label: of the axis; only that of flexion has ticks at multiples of 15 or 30.
    """
    from matplotlib.ticker import MultipleLocator

    low, high = np.nanmin(flexion), np.nanmax(flexion)
    pad = 0.02 * (high - low) or 1.0
    axes.set_xlim(low - pad, high + pad)
    if label == FLEXION and 60 <= high - low <= 200:
        axes.xaxis.set_major_locator(MultipleLocator(30 if high - low > 90 else 15))
    if labelled:
        axes.set_xlabel(label)


def mark_status(axes: Axes, x: np.ndarray, status: np.ndarray, color: str, height: float) -> dict:
    """Mark doubtful rows at the bottom edge; returns the handles by legend entry."""
    handles = {}
    for entry, outcomes, marker in _MARKS:
        rows = np.isin(status, outcomes)
        if rows.any():
            (handles[entry],) = axes.plot(
                x[rows], np.full(rows.sum(), height), marker, color=color, markersize=4.5,
                markeredgewidth=1.2, transform=axes.get_xaxis_transform(), clip_on=False, zorder=5,
            )
    return handles


def part_styles(names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Colour and dashes of each ligament: a colour for each structure, dashes for its bundles.

    Args:
        names: of ligaments, bundles or fibres.

    Returns:
        Name -> keywords for `Axes.plot`.

    Example:
        >>> part_styles(["aACL", "pACL"])
        {'aACL': {'color': '#D55E00', 'linestyle': '-'}, 'pACL': {'color': '#D55E00', \
'linestyle': '--'}}
    """
    styles: dict[str, dict[str, Any]] = {}
    seen: dict[str, int] = {}
    for name in names:
        structure = next((one for one in _STRUCTURES if one in name), name)
        if structure not in seen:
            seen[structure] = 0
        others = [one for one in seen if one not in _STRUCTURES]
        color = _STRUCTURES.get(structure) or _OTHERS[others.index(structure) % len(_OTHERS)]
        styles[name] = {"color": color, "linestyle": _DASHES[seen[structure] % len(_DASHES)]}
        seen[structure] += 1
    return styles


def draw_ligaments(
    axes: Axes,
    x: np.ndarray,
    knee: Knee,
    tension: ArrayLike,
    *,
    among: Sequence[str] | None = None,
    most: int = 8,
    rows: Sequence[Any] = (slice(None),),
    columns: int = 4,
) -> None:
    """Draw the ligaments that carry most, the fibres of a group together.

    Args:
        axes: of the panel.
        x: of the poses, `(poses,)`.
        knee: whose fibres they are.
        tension: of the fibres, `(poses, fibres)`, N.
        among: names of the fibres that count; all by default.
        most: how many are drawn.
        rows: poses that are one line each.
        columns: of the legend.
    """
    forces = bundle_forces(knee, tension, among)
    size = {name: float(np.nanmax(np.abs(f), initial=0.0)) for name, f in forces.items()}
    largest, styles = max(size.values(), default=0.0), part_styles([*forces])
    shown = sorted((x for x in forces if size[x] > _SMALL * largest), key=lambda x: -size[x])
    for name in shown[:most]:
        for k, of_line in enumerate(rows):
            label = verbatim(name) if k == 0 else None
            axes.plot(x[of_line], forces[name][of_line], label=label, **styles[name])
    axes.set_ylabel("Ligament force, N")
    legend_above(axes, columns)


def draw_named(
    axes: Axes,
    x: ArrayLike,
    curves: Mapping[str, Any],
    label: str,
    *,
    colors: Sequence[str] = PARTS,
    columns: int = 4,
    size: float = 7.5,
    **style: Any,
) -> None:
    """Draw a line for each name, with a legend above the panel.

    Args:
        axes: of the panel.
        x: of the curves, `(n,)`.
        curves: name -> values, `(n,)`.
        label: of the vertical axis.
        colors: of the curves, in turn.
        columns: of the legend.
        size: of its letters.
        style: keywords for `Axes.plot`.
    """
    for (name, values), color in zip(curves.items(), itertools.cycle(colors), strict=False):
        own = {"color": color, "label": verbatim(name), **style}
        axes.plot(np.asarray(x), np.asarray(values), **own)
    axes.set_ylabel(label)
    legend_above(axes, columns, size)


def panel_grid(
    rows: int, columns: int, height: float, title: str, *, shared: bool = False
) -> tuple[Figure, np.ndarray]:
    """A figure as wide as a page with a title, and its panels in reading order.

    Args:
        rows: of panels.
        columns: of panels.
        height: inches.
        title: of the whole.
        shared: whether all have the same horizontal axis, written below the last row.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, height))
    panels, left = figure.subplots(rows, columns, sharex=shared), 0.09 if columns == 2 else 0.075
    figure.subplots_adjust(
        left=left, right=0.985, top=1 - 0.68 / height, bottom=0.46 / height,
        wspace=0.26 if columns == 2 else 0.33, hspace=0.3 if shared else 0.5,
    )  # fmt: skip
    figure.suptitle(verbatim(title), x=left, ha="left", fontsize=9.5)
    return figure, panels.ravel()


def legend_above(axes: Axes, columns: int = 4, size: float = 7.5) -> None:
    """Put the legend above a panel, if it has one."""
    if axes.get_legend_handles_labels()[0]:
        axes.legend(
            fontsize=size, ncol=columns, loc="lower left", bbox_to_anchor=(-0.03, 0.99),
            borderaxespad=0.1, columnspacing=0.8, handlelength=1.2, handletextpad=0.4,
        )  # fmt: skip


def part_legend(axes: Axes, drawn: list, corner: tuple[float, float], **layout: Any) -> None:
    """Lines and their names, the upper left corner in the axes' coordinates."""
    if drawn:
        lines, names = zip(*drawn, strict=True)
        layout = {"fontsize": 7.5, **layout}
        axes.legend(
            lines, names, loc="upper left", bbox_to_anchor=corner, borderaxespad=0, **layout
        )
