"""One look for every figure."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, ParamSpec, TypeVar

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_P = ParamSpec("_P")
_R = TypeVar("_R")


#: The five free coordinates as figures show them: translations, then rotations.
SHOWN = ("lateral", "anterior", "superior", "adduction", "internal_rotation")

#: Colours that stay apart for colour-blind readers (Okabe and Ito).
BLACK, BLUE, VERMILLION, GREEN = "#000000", "#0072B2", "#D55E00", "#009E73"
PURPLE, ORANGE, SKY, YELLOW = "#CC79A7", "#E69F00", "#56B4E9", "#B8A900"
GREY, LIGHT = "#666666", "#E4E7EA"
MEASURED, START = BLACK, BLUE
#: Colours of the procedures; the first is the answer.
FITS = (VERMILLION, GREEN, PURPLE, ORANGE, SKY)
#: Colours of ligaments, twelve before they repeat, and of contacts.
PARTS = (
    BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY, BLACK, YELLOW,
    "#7A4B9A", "#8C564B", "#5B8C5A", "#999999",
)  # fmt: skip

CONTACT_PARTS = (BLACK, "#7A4B9A", "#8C564B", GREY)

WIDTH = 7.0  # inches: the text width of a page

_SETTINGS = {
    "font.family": "DejaVu Sans",
    "font.size": 8,
    "axes.labelsize": 8,
    "axes.titlesize": 9,
    "axes.titlelocation": "left",
    "axes.titlepad": 4,
    "axes.linewidth": 0.7,
    "axes.edgecolor": "#444444",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.unicode_minus": True,
    "grid.color": "#E6E6E6",
    "grid.linewidth": 0.6,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "xtick.minor.visible": False,
    "ytick.minor.visible": False,
    "legend.frameon": False,
    "legend.fontsize": 8,
    "lines.linewidth": 1.3,
    "hatch.linewidth": 0.5,
    "svg.fonttype": "none",
}


def styled(draw: Callable[_P, _R]) -> Callable[_P, _R]:
    """Make a function draw in the package's style, leaving the user's settings alone.

    Args:
        draw: makes a figure.

    Returns:
        The same function, under the style.
    """

    @functools.wraps(draw)
    def wrapped(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        import matplotlib

        with matplotlib.rc_context(_SETTINGS):
            return draw(*args, **kwargs)

    return wrapped


def without_frame(axes: Axes) -> None:
    """Of a matrix its cells are enough: no ticks, grid or spines."""
    axes.tick_params(length=0)
    axes.grid(False)
    axes.spines[:].set_visible(False)


def verbatim(text: str) -> str:
    """Text that a figure shows as it is: a dollar sign opens no formula."""
    return text.replace("$", r"\$")


def readable(name: str) -> str:
    """A parameter's name for labels: `ACL.stiffness` becomes `ACL stiffness`."""
    return verbatim(name.replace(".", " ").replace("_", " "))
