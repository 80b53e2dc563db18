"""Maps of the objective over two parameters."""

__all__ = ["map_figure", "map_matrix_figure"]

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, MaxNLocator, NullLocator
from scipy import ndimage

from kneejax.geometry import COORDINATES
from kneejax.inference import Condition, ParameterMap
from kneejax.report.look.colours import VERMILLION
from kneejax.report.look.page import Answer, Drawing, Section, Verdict, prose
from kneejax.report.look.style import SHOWN, WIDTH, Axes, Figure, readable, styled
from kneejax.report.look.tables import Column, Table, number
from kneejax.report.panels import colour_bar, figure_legend, grid

#: What is not coloured, by condition: hatch, and its legend entry.
_HATCHES = {2: ("////", "unphysiological"), 3: ("xxxx", "unstable"), 4: ("\\\\\\\\", "no balance")}
#: The condition whose colours fade: numbers are valid there, but in doubt.
_FADED = 1
_FADED_LABEL, _LOWEST = "faded: outside fitted surfaces", "lowest grid point"
#: Most decades -> levels of a decade: so many that a valley's floor shows.
_STEPS = ((1.3, (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)),
          (2.7, (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)), (5.0, (1.0, 2.0, 5.0)), (9.0, (1.0, 3.0)))
_ERRORS = "Sums of squared errors between simulated and measured motion"


@styled
def map_figure(found: ParameterMap, begun: str = "start") -> Figure:
    """Draw the objective and its five partial objectives over two parameters.

    Args:
        found: the map.
        begun: what the knee's own values are: `start` of a search, or its `fit`.

    Returns:
        Six panels, contours over decades; regions that mean nothing are hatched, those outside the
        fitted surfaces faded, the start and the best grid point are marked.
    """
    figure, panels = grid(2, 3, 5.55, right=0.39, top=0.55, bottom=0.92, apart=(0.45, 0.37),
                          sharex=True, sharey=True)  # fmt: skip
    figure.text(0.01, 0.99, f"{_ERRORS}; the objective is their weighted sum", va="top")
    names, handles = list(COORDINATES)[1:], {}
    shown = [("Objective", found.objective)]
    for name in SHOWN:
        label = f"{COORDINATES[name].label}, {COORDINATES[name].unit}$^2$"
        shown.append((label, found.partial_objectives[names.index(name)]))
    for k, (axes, (title, values)) in enumerate(zip(panels.flat, shown, strict=True)):
        axes.set_title(title)
        filled, regions = _filled(axes, found, values)
        if filled is not None:
            bar = figure.colorbar(filled, ax=axes, pad=0.03, fraction=0.07)
            bar.ax.tick_params(labelsize=6.5, length=2)
            _decade_ticks(bar, _ends(values[found.drawn]))
        handles |= regions | _marks(axes, found, values, begun)
        _axes(axes, found, left=k % 3 == 0, bottom=k > 2)
    order = (begun, _LOWEST, _FADED_LABEL, *(label for _, label in _HATCHES.values()))
    labels = [label for label in order if label in handles]
    figure_legend(figure, {label: handles[label] for label in labels}, handlelength=1.8,
                  bbox_to_anchor=(0.5, 0.005), ncols=min(len(labels), 6))  # fmt: skip
    return figure


@styled
def map_matrix_figure(found: Sequence[ParameterMap], begun: str = "start") -> Figure:
    """Draw the objective over every pair of parameters, as a lower triangle.

    Args:
        found: a map of every pair, the grids alike.
        begun: what the knee's own values are: `start` of a search, or its `fit`.

    Returns:
        One panel per pair, all on one scale of colours.
    """
    names = list(dict.fromkeys(name for one in found for name in one.names))
    size = len(names) - 1
    side = max(WIDTH, 1.4 * size + 1.3)
    figure, panels = grid(size, size, side, width=side, left=0.75, right=0.07, bottom=0.75, top=0.1,
                          apart=(0.22, 0.22))  # fmt: skip
    for axes in panels.flat:
        axes.set_axis_off()
    limits = _ends(np.concatenate([one.objective[one.drawn] for one in found]))
    handles: dict[str, Any] = {}
    filled = None
    for one in found:
        low, high = sorted(names.index(name) for name in one.names)
        axes = panels[high - 1, low]
        axes.set_axis_on()
        if names.index(one.names[0]) != low:
            flipped = {key: np.swapaxes(getattr(one, key), -1, -2)
                       for key in ("objective", "partial_objectives", "condition", "lost")}
            flipped |= {key: getattr(one, key)[::-1] for key in ("names", "units", "start")}
            one = dataclasses.replace(one, x=one.y, y=one.x, **flipped)
        filled, marks = _filled(axes, one, one.objective, limits)
        handles |= marks | _marks(axes, one, one.objective, begun, figure)
        _axes(axes, one, left=low == 0, bottom=high == size, small=True)
    if filled is not None:
        place = figure.add_axes((0.62, 0.93, 0.35, 0.016))
        label = "Objective: weighted sum of squared errors"
        _decade_ticks(colour_bar(figure, place, filled, label), limits)
    figure_legend(figure, handles, loc="upper right", bbox_to_anchor=(0.985, 0.87), ncols=1,
                  handlelength=1.6)  # fmt: skip
    return figure


def _ends(values: np.ndarray) -> tuple[float, float] | None:
    return (float(values.min()), float(values.max())) if values.size else None


def _filled(axes: Axes, found: ParameterMap, values: np.ndarray, limits=None):
    """Colours where they mean something, hatches elsewhere; the contour set and legend handles."""
    handles, filled = {}, None
    shown = np.ma.masked_invalid(np.where(found.drawn & (values > 0), values, np.nan))
    if shown.count():
        levels = _levels(*map(float, limits or (shown.min(), shown.max())))
        filled = axes.contourf(found.x, found.y, shown, levels, cmap="viridis", extend="neither",
                               norm=LogNorm(levels[0], levels[-1]))  # fmt: skip
        axes.contour(found.x, found.y, shown, levels, colors="white", linewidths=0.35, alpha=0.7)
    for condition, (hatch, label) in {_FADED: ("", _FADED_LABEL), **_HATCHES}.items():
        where = found.condition == condition
        if not where.any():
            continue
        # With the neighbours: between grid points nothing is drawn otherwise.
        beyond = np.logical_not(ndimage.binary_dilation(where))
        inside = np.ma.masked_where(beyond, np.ones(where.shape))
        look, key = {"colors": "white", "alpha": 0.6}, {"facecolor": "#B5D5D2", "edgecolor": "none"}
        if hatch:
            look = {"colors": "none", "hatches": [hatch]}
            key = {"facecolor": "none", "edgecolor": "#555555", "hatch": hatch}
        axes.contourf(found.x, found.y, inside, [0.5, 1.5], zorder=2, **look)
        handles[label] = Patch(**key)
    return filled, handles


def _levels(low: float, high: float) -> np.ndarray:
    """Levels that people can read: some ten where there are few decades, fewer of each of many."""
    low, high = max(low, 1e-12), max(high, 1e-12)
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high * (1 + 1e-12)))
    last = max(last, first + 1)
    decades = math.log10(high / low) if high > low else 0.0
    steps = next((steps for most, steps in _STEPS if decades <= most), (1.0,))
    levels = np.array([s * 10.0**d for d in range(first, last) for s in steps] + [10.0**last])
    inside = levels[(levels > low) & (levels < high)]
    below, above = levels[levels <= low][-1:], levels[levels >= high][:1]
    found = np.concatenate([below, inside, above])
    return found if len(found) > 1 else np.array([10.0**first, 10.0**last])


def _decade_ticks(bar: Any, limits: tuple[float, float] | None) -> None:
    if limits is None:
        return
    levels = _levels(*limits)
    decades = [x for x in levels if abs(math.log10(x) - round(math.log10(x))) < 1e-9]
    ticks = decades if len(decades) >= 3 else list(levels)
    along = bar.ax.xaxis if bar.orientation == "horizontal" else bar.ax.yaxis
    bar.set_ticks(ticks[:: -(-len(ticks) // 7)])
    along.set_minor_locator(NullLocator())
    along.set_major_formatter(FuncFormatter(lambda x, _: _plain(x)))


def _plain(x: float) -> str:
    if 1e-3 < x < 9999:
        return f"{x:g}"
    exponent = math.floor(math.log10(x) + 1e-9)
    digit = round(x / 10.0**exponent)
    factor = "" if digit == 1 else f"{digit}\\cdot"
    return f"${factor}10^{{{exponent}}}$"


def _marks(
    axes: Axes, found: ParameterMap, values: np.ndarray, begun: str, above: Figure | None = None
) -> dict[str, Any]:
    """The knee's own values, and the best point; that of the figure `above` no next panel cuts."""
    handles, best = {}, np.where(found.drawn, values, np.inf)
    style = {"linestyle": "none", "clip_on": False, "zorder": 6, "markeredgecolor": "black",
             "markeredgewidth": 0.8}  # fmt: skip
    edges = zip((found.x, found.y), found.start, strict=True)
    if all(line[0] <= own <= line[-1] for line, own in edges):
        (handles[begun],) = axes.plot(*found.start, "o", markersize=5, color="white", **style)
    if np.isfinite(best).any():
        row, column = np.unravel_index(np.argmin(best), best.shape)
        looks = {"marker": "*", "markersize": 9, "color": VERMILLION, **style}
        star = Line2D([found.x[column]], [found.y[row]], transform=axes.transData, **looks)
        (axes if above is None else above).add_artist(star)
        handles[_LOWEST] = star
    return handles


def _axes(axes: Axes, found: ParameterMap, left: bool, bottom: bool, small: bool = False) -> None:
    axes.grid(False)
    axes.set(xlim=found.x[[0, -1]], ylim=found.y[[0, -1]])
    axes.locator_params(nbins=4)
    if small:
        axes.tick_params(labelsize=6.5)
        for along in (axes.xaxis, axes.yaxis):
            along.set_major_locator(MaxNLocator(3, prune="both"))
    x, y = (readable(*one).replace(" ", "\n", 1 if small else 0)
            for one in zip(found.names, found.units, strict=True))  # fmt: skip
    axes.tick_params(labelleft=left, labelbottom=bottom)
    axes.set(xlabel=x if bottom else "", ylabel=y if left else "")


_COLUMNS = ("x", "y", "x_minimum", "y_minimum", "objective_minimum", "x_start", "y_start",
            "objective_start", *(condition.word for condition in Condition))  # fmt: skip

def map_answer(
    maps: Sequence[ParameterMap], about: Mapping[str, str], versions: Mapping[str, str],
    begun: str = "start",
) -> Answer:
    """What maps of the objective show."""
    drawings, rows = {}, []
    for one in maps:
        name = "map" if len(maps) == 1 else f"map-{one.names[0]}-{one.names[1]}"
        drawings[name] = Drawing(map_figure, one, begun)
        counts = [int((one.condition == condition).sum()) for condition in Condition]
        rows.append([*one.names, *(one.minimum or [np.nan] * 3), *one.start, one.start_objective,
                     *counts])  # fmt: skip
    single, picture = list(drawings), next(iter(drawings))
    if len(maps) > 2:
        picture = "maps"
        drawings["maps"] = Drawing(map_matrix_figure, maps, begun, more=prose("map_figure"))
    empty = [one for one in maps if not one.drawn.any()]
    found = [(" and ".join(one.names), _doubt(one, begun)) for one in maps]
    doubts = [f"{pair}: {doubt}" for pair, doubt in found if doubt]
    counts = np.sum([row[-len(Condition) :] for row in rows], axis=0).tolist()
    notes = [f"{n} grid point{'s' * (n > 1)}: {one.sentence}"
             for one, n in zip(Condition, counts, strict=True) if one and n]  # fmt: skip
    if maps[0].left_out:
        doubts.append(prose("map.left_out", count=maps[0].left_out))
    over = " and ".join(maps[0].names) if len(maps) == 1 else f"{len(maps)} pairs of parameters"
    return Answer(
        title=f"Objective over {over}", asked=prose("map", **about),
        verdict=Verdict.FAILED if len(empty) == len(maps) else None,
        sentence=" ".join(_sentence(one) for one in maps[:3] if one.drawn.any()),
        tables={"maps": Table(_COLUMNS, rows)}, main=[lowest_table(maps, begun)],
        drawings=drawings, picture=picture, doubts=doubts,
        sections=[Section("Grid points that do not count", notes, printed=True),
                  Section("Each pair", drawings=[x for x in single if x != picture])],
        document={"about": dict(about), "versions": dict(versions)},
        exit_status=int(bool(empty) or any(one.left_out for one in maps)),
    )  # fmt: skip


def lowest_table(maps: Sequence[ParameterMap], begun: str = "start") -> Table:
    """Where the objective is lowest, and how well the pair is determined there."""
    rows = []
    for one in maps:
        best = one.minimum or [np.nan] * 3
        near = (one.drawn & (one.objective <= 2.0 * best[2])).sum() / max(one.drawn.sum(), 1)
        rows.append([*one.names, *best, one.start_objective, near, correlation(one),
                     1.0 - one.drawn.mean()])  # fmt: skip
    columns = ["x", "y", "lowest_at_x", "at_y", "objective", f"at_the_{begun}",
               Column("within_twice", show=".1%"), Column("correlation", show="2"),
               Column("not_drawn", show=".1%")]  # fmt: skip
    return Table(columns, rows, "Lowest grid point of each pair", prose("lowest"),
                 ("not_drawn", f"at_the_{begun}"))  # fmt: skip


def _best(one: ParameterMap) -> tuple[int, int]:
    """Row and column of the lowest grid point that may be coloured."""
    best = np.argmin(np.where(one.drawn, one.objective, np.inf))
    return tuple(map(int, np.unravel_index(best, one.objective.shape)))


def correlation(one: ParameterMap) -> float:
    """Correlation of two estimates by the curvature of the objective at its lowest grid point."""
    row, column = _best(one)
    values = np.pad(np.where(one.drawn, one.objective, np.nan), 1, constant_values=np.nan)
    near = values[row : row + 3, column : column + 3]
    along = near[1, 2] - 2 * near[1, 1] + near[1, 0], near[2, 1] - 2 * near[1, 1] + near[0, 1]
    across = (near[2, 2] - near[2, 0] - near[0, 2] + near[0, 0]) / 4
    product = along[0] * along[1]
    return float(-across / np.sqrt(product)) if across**2 < product else np.nan


def _doubt(one: ParameterMap, begun: str) -> str:
    """Why the lowest grid point may not be where the data are fitted best; empty where it is."""
    if not one.drawn.any():
        return "no grid point has a result that counts"
    row, column = _best(one)
    if one.start_objective < one.objective[row, column]:
        return (f"the {begun} has a lower objective, {number(one.start_objective)}, than any grid "
                "point; a finer grid shows its valley")
    if row in (0, len(one.y) - 1) or column in (0, len(one.x) - 1):
        return "the lowest point lies on the edge of the map; a wider range may hold a lower one"
    condition = Condition(int(one.condition[row, column]))
    return f"at the lowest point, {condition.sentence}" if condition else ""


def _sentence(one: ParameterMap) -> str:
    x, y, objective = one.minimum or (np.nan, np.nan, np.nan)
    triples = zip(one.names, (x, y), one.units, strict=True)
    at = ", ".join(f"{name} {number(value)} {unit}".strip() for name, value, unit in triples)
    sentence = f"Of the grid points the objective is lowest, {number(objective)}, at {at}"
    found = correlation(one)
    if not np.isfinite(found):
        return f"{sentence}."
    kind = "compensate each other" if abs(found) > 0.9 else "are determined apart from each other"
    return f"{sentence}; there the two {kind} (correlation {round(found, 2) + 0.0:.2f})."
