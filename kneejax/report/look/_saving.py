"""Figures as pictures and files that are complete or absent."""

from __future__ import annotations

import io
import os
import re
from pathlib import Path
from typing import TYPE_CHECKING

from kneejax import _whole_files

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DPI = 200
#: Narrower than the font that figures are measured with, so nothing is cut.
_FONTS = "Arial, Helvetica, 'Liberation Sans', 'DejaVu Sans', sans-serif"


def write_whole(path: Path, content: bytes) -> Path:
    """Write a file so that it is never seen half written.

    Args:
        path: where; folders are made.
        content: all of it.

    Returns:
        The path.

    Raises:
        OSError: the file cannot be written.
    """
    _whole_files.write_whole(path, content)
    return path


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
    figure.savefig(
        stream,
        format="png",
        dpi=_DPI,
        metadata={"Software": None},
        pil_kwargs={"compress_level": 2},
    )
    return stream.getvalue()


def save_figure(
    figure: Figure, folder: str | os.PathLike[str], name: str, *, svg: bool = False
) -> list[Path]:
    """Save a figure as `NAME.png` (200 dpi).

    Args:
        figure: what to save.
        folder: where; made if needed.
        name: of the files, without ending.
        svg: whether `NAME.svg` is saved as well.

    Returns:
        The paths.
    """
    drawn = picture_svg(figure, name) if svg else None
    return _saved(figure, Path(folder), name, drawn)


def save_and_inline(
    figure: Figure, folder: Path, name: str, *, svg: bool = False
) -> tuple[list[Path], str]:
    """As `save_figure`, and hand back its SVG for a page, rendered once.

    Returns:
        The paths, and the `<svg>` element.
    """
    drawn = picture_svg(figure, name)
    return _saved(figure, folder, name, drawn if svg else None), drawn


def _saved(figure: Figure, folder: Path, name: str, svg: str | None) -> list[Path]:
    paths = [write_whole(folder / f"{name}.png", picture_png(figure))]
    if svg is not None:
        preamble = '<?xml version="1.0" encoding="utf-8"?>\n'
        paths.append(write_whole(folder / f"{name}.svg", (preamble + svg).encode()))
    return paths
