"""A matrix as a picture: coloured cells with their numbers, rows downwards."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from kneejax.report.look._style import BLUE, VERMILLION, without_frame

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import QuadMesh
    from matplotlib.colors import Colormap
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
