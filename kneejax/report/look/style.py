"""One look for every figure, and figures as files that are complete or absent."""

import functools
import io
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from kneejax._whole_files import write_whole as write_whole

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
else:  # Matplotlib takes long to import; the other rooms' annotations have their types from here.
    Axes = Figure = Any

_P = ParamSpec("_P")
_R = TypeVar("_R")


#: The five free coordinates as figures show them: translations, then rotations.
SHOWN = ("lateral", "anterior", "superior", "adduction", "internal_rotation")

WIDTH = 7.0  # inches: the text width of a page

_SETTINGS = {"font.family": "DejaVu Sans", "font.size": 8, "axes.labelsize": 8, "axes.titlesize": 9,
             "axes.titlelocation": "left", "axes.titlepad": 4, "axes.linewidth": 0.7,
             "axes.edgecolor": "#444444", "axes.spines.top": False, "axes.spines.right": False,
             "axes.grid": True, "axes.axisbelow": True, "axes.unicode_minus": True,
             "grid.color": "#E6E6E6", "grid.linewidth": 0.6, "xtick.labelsize": 8,
             "ytick.labelsize": 8, "xtick.major.width": 0.7, "ytick.major.width": 0.7,
             "xtick.minor.visible": False, "ytick.minor.visible": False, "legend.frameon": False,
             "legend.fontsize": 8, "lines.linewidth": 1.3, "hatch.linewidth": 0.5,
             "svg.fonttype": "none"}


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


def readable(name: str, unit: str = "") -> str:
    """A parameter's name for labels: `ACL.stiffness` in N becomes `ACL stiffness, N`."""
    return verbatim(name.replace(".", " ").replace("_", " ")) + (f", {unit}" if unit else "")


_DPI = 200
#: Narrower than the font that figures are measured with, so nothing is cut.
_FONTS = "Arial, Helvetica, 'Liberation Sans', 'DejaVu Sans', sans-serif"


def picture_svg(figure: Figure, name: str) -> str:
    """Render a figure as SVG with searchable text, the same every time.

    Args:
        figure: what to render.
        name: keeps the identifiers of several figures on one page apart.

    Returns:
        The `<svg>` element, without a preamble.
    """
    import matplotlib

    stream = io.StringIO()
    empty = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": name}):
        figure.savefig(stream, format="svg", metadata=empty)
    svg = stream.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r'<g id="[^"]*"', "<g", svg)
    svg = re.sub(r"'DejaVu Sans'(, sans-serif)?", _FONTS, svg)
    return svg.strip() + "\n"


def picture_png(figure: Figure) -> bytes:
    """Render a figure as PNG, the same every time.

    Args:
        figure: what to render.

    Returns:
        The file's bytes.
    """
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=_DPI, metadata={"Software": None},
                   pil_kwargs={"compress_level": 2})  # fmt: skip
    return stream.getvalue()


def save_figure(
    figure: Figure, folder: str | os.PathLike[str], name: str, *, svg: bool | str = False
) -> list[Path]:
    """Save a figure as `NAME.png` (200 dpi).

    Args:
        figure: what to save.
        folder: where; made if needed.
        name: of the files, without ending.
        svg: whether `NAME.svg` is saved as well; or its element, where it was rendered before.

    Returns:
        The paths.
    """
    paths = [write_whole(Path(folder) / f"{name}.png", picture_png(figure))]
    if svg:
        drawn = svg if isinstance(svg, str) else picture_svg(figure, name)
        whole = f'<?xml version="1.0" encoding="utf-8"?>\n{drawn}'
        paths.append(write_whole(Path(folder) / f"{name}.svg", whole.encode()))
    return paths
