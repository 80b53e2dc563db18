"""Figures of what data tell: the spectrum of the information, and how estimates depend."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kneejax.report.calibration import correlation_matrix_figure
from kneejax.report.look import BLUE, GREY, VERMILLION, readable, styled, without_frame

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from kneejax.inference import Information

# Decades that the axis of the spectrum shows below its longest bar.
_DECADES = 8.0


@styled
def spectrum_figure(found: Information) -> Figure:
    """Draw how well each combination of parameters is known, and what it is made of.

    Args:
        found: what the data tell.

    Returns:
        Above, one bar per combination: how many times smaller its standard error is than its prior
        standard deviation. Below, the weights of the parameters in it.
    """
    from matplotlib.colors import LinearSegmentedColormap
    from matplotlib.figure import Figure

    free = ~found.at_bound
    names = [readable(name) for name, on in zip(found.names, free, strict=True) if on]
    vectors, better = found.eigenvectors[free], np.sqrt(found.eigenvalues)
    n = len(names)
    if not n:
        figure = Figure(figsize=(5.0, 0.6))
        figure.text(0.5, 0.5, "Every parameter is on a bound: nothing is free.", ha="center")
        return figure
    cell = min(0.44, 6.0 / max(n, 1))
    left, right = 0.062 * max(map(len, names), default=8) + 0.15, 1.0
    above, bars, between, below = 0.32, 1.35, 0.12, 0.55
    wide, height = left + cell * n + right, above + bars + between + cell * n + below
    wide = max(wide, left + 3.4 + right)
    matrix = cell * n / wide
    figure = Figure(figsize=(wide, height))
    top = figure.add_axes(
        (left / wide, (below + cell * n + between) / height, matrix, bars / height)
    )
    table = figure.add_axes((left / wide, below / height, matrix, cell * n / height))

    shades = LinearSegmentedColormap.from_list("parts", [BLUE, "#FFFFFF", VERMILLION])
    _draw_bars(top, better)
    _draw_weights(table, vectors, names, shades)
    place = (left + 0.15) / wide + matrix, below / height, 0.1 / wide, cell * n / height
    _draw_scale(figure.add_axes(place), shades)
    return figure


def _draw_bars(top: Axes, better: np.ndarray) -> None:
    """One bar per combination: how many times better it is known than before."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    n = len(better)
    low = max(better.max(initial=1.0) * 10.0**-_DECADES, 1e-4)
    floor = min(0.5, max(better[better > low].min(initial=1.0) / 2.0, low))
    places = np.arange(n) + 0.5
    colours = [BLUE if size >= 1.0 else VERMILLION for size in better]
    top.bar(places, np.maximum(better, floor) - floor, bottom=floor, width=0.7, color=colours)
    for place, size in zip(places, better, strict=True):
        word = f"{size:.0f}" if size >= 9.95 else f"{size:.2g}" if size > low else "0"
        if n <= 16:
            top.annotate(
                word, (place, max(size, floor)), (0, 1.5), textcoords="offset points",
                ha="center", va="bottom", fontsize=6.8,
            )  # fmt: skip
    top.axhline(1.0, color=GREY, linewidth=0.8)
    top.annotate(
        "no better than\nthe prior", (n, 1.0), (4, 0), textcoords="offset points",
        va="center", fontsize=7, color=GREY,
    )  # fmt: skip
    top.set_yscale("log")
    most = max(better.max(initial=1.0), 2.0)
    # Room for the number above the longest bar.
    top.set_ylim(floor, most * (most / floor) ** 0.16)
    top.yaxis.set_major_locator(LogLocator(base=10, numticks=6))
    top.yaxis.set_minor_locator(NullLocator())
    top.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    top.set_xlim(0, n)
    top.set_xticks([])
    top.grid(axis="x", visible=False)
    top.set_title("Prior SD over standard error, for each combination of parameters")


def _draw_weights(table: Axes, vectors: np.ndarray, names: list[str], shades) -> None:
    """The weight of each parameter in each combination."""
    n = len(names)
    places = np.arange(n) + 0.5
    table.pcolormesh(vectors, cmap=shades, vmin=-1, vmax=1, edgecolors="white", linewidth=1)
    if n <= 16:
        for i, j in np.argwhere(np.abs(vectors) >= 0.095):
            value = f"{vectors[i, j]:.1f}".replace("-", "\u2212")
            table.text(
                j + 0.5, i + 0.5, value, ha="center", va="center", fontsize=6.8 if n < 12 else 5.5,
                color="white" if vectors[i, j] < -0.8 else "black",
            )  # fmt: skip
    size = 7.5 if n <= 20 else 5.5
    table.set_xlim(0, n)
    table.set_ylim(n, 0)
    table.set_yticks(places, names, fontsize=size)
    table.set_xticks(places, [str(i + 1) for i in range(n)], fontsize=size)
    without_frame(table)
    table.set_xlabel("Combination, from best determined to worst")


def _draw_scale(bar: Axes, shades) -> None:
    """Which shade is which weight."""
    gradient = np.linspace(-1, 1, 101)[:, None]
    bar.pcolormesh(np.repeat(gradient, 2, axis=1), cmap=shades, vmin=-1, vmax=1, rasterized=True)
    bar.set_yticks([0, 50.5, 101], ["\u22121", "0", "+1"], fontsize=7)
    bar.yaxis.tick_right()
    bar.set_xticks([])
    without_frame(bar)
    bar.set_ylabel("Weight", fontsize=7.5)
    bar.yaxis.set_label_position("right")


def information_correlation_figure(found: Information) -> Figure:
    """Draw the correlation of estimates that the data promise; those without one are hatched.

    Args:
        found: what the data tell.

    Returns:
        A matrix with numbers in its cells where they are readable.
    """
    return correlation_matrix_figure(found.names, found.correlation)
