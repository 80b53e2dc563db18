"""Rendered scenes with words around them: one pose from several sides, several poses, a film."""

__all__ = ["film", "scene_figure", "scenes_figure"]

import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from scipy.optimize import isotonic_regression

from kneejax.report.look.colours import BLACK, GREY
from kneejax.report.look.style import WIDTH, Axes, styled, verbatim, without_frame
from kneejax.report.scene import rendering
from kneejax.report.scene.pressure import PRESSURE_COLOURS, degrees, spread
from kneejax.report.scene.scene import Scene

_VIEWS = ("anterior", "medial", "anteromedial, from above")
_MOST_LABELS = 24
#: Colours of a film that each scale takes.
_STEPS = 44
_LABEL_SIZE = 7.0
#: Inches that a letter of a label takes.
_LETTER = 0.065
#: Length of the axes in the corner, as a part of half a picture.
_TRIAD = 0.2
#: Inches: the page, room for the names beside a view, head, foot, words at the left, gaps.
_PAGE_WIDTH, _LABELS, _HEAD, _FOOT, _SIDE, _GAP = 1.25 * WIDTH, 0.48, 0.3, 0.75, 0.5, 0.08
#: Between what explains two colours, inches.
_KEY = 1.1


@styled
def scene_figure(scene: Scene, views: Sequence[str] = _VIEWS) -> Figure:
    """A knee at a pose from several sides, with its ligaments named.

    Args:
        scene: from `scenes`.
        views: names in `VIEWS`.

    Returns:
        The figure; fibres are coloured by strain (thin and grey where slack), plateaux by pressure.

    Raises:
        MissingPackage: PyVista is not installed.
        CannotRender: PyVista finds nothing to draw with.
        ValueError: a view has no such name.
    """
    _, limits = rendering.chosen([scene], 1)
    cameras = [rendering.camera(view, [scene]) for view in views]
    room = max(_LABELS, _LETTER * max(map(len, scene.groups), default=0))
    scale = (_PAGE_WIDTH - 2 * room * len(views)) / sum(2 * c.half_mm[0] for c in cameras)
    tallest = max(2 * c.half_mm[1] for c in cameras) * scale
    figure = Figure(figsize=(_PAGE_WIDTH, tallest + _HEAD + 0.2 + _FOOT))
    left = 0.0
    for name, view in zip(views, cameras, strict=True):
        width, height = (2 * half * scale for half in view.half_mm)
        left += room
        bottom = _FOOT + 0.5 * (tallest - height)
        axes = _panel(figure, left, bottom, width, height)
        left += width + room
        _show(axes, rendering.render(scene, view, *limits), view)
        axes.text(0.5, 1 + (tallest + 0.1 - 0.5 * (tallest + height)) / height, name.capitalize(),
                  transform=axes.transAxes, ha="center", va="bottom", fontsize=9)  # fmt: skip
        _name_groups(axes, scene, view)
        _triad(axes, scene, view)
    _ruler(figure.axes[0], cameras[0])
    _bars(figure, *limits)
    _head(figure, f"{scene.title} at {degrees(scene.flexion_deg)} flexion", scene)
    return figure


@styled
def scenes_figure(every: Sequence[Scene], views: Sequence[str] = _VIEWS, most: int = 5) -> Figure:
    """A motion as small pictures: a row for each view, a column for each pose.

    The tibia stands still; the femur moves.

    Args:
        every: scenes of one knee, from `scenes`.
        views: names in `VIEWS`.
        most: columns at most; of more poses, evenly spaced ones are shown.

    Returns:
        The figure, with one scale of strain and one of pressure.

    Raises:
        MissingPackage: PyVista is not installed.
        CannotRender: PyVista finds nothing to draw with.
        ValueError: there are no scenes, or a view has no such name.
    """
    shown, limits = rendering.chosen(every, most)
    cameras = [rendering.camera(view, shown) for view in views]
    widest = max(2 * c.half_mm[0] for c in cameras)
    scale = min((_PAGE_WIDTH - _SIDE) / len(shown) - _GAP, 2.2) / widest
    column = widest * scale + _GAP
    heights = [2 * c.half_mm[1] * scale + _GAP for c in cameras]
    page = max(_SIDE + column * len(shown), 4.5)
    figure = Figure(figsize=(page, sum(heights) + _HEAD + 0.2 + _FOOT))
    bottom = _FOOT + sum(heights)
    for row, (name, view) in enumerate(zip(views, cameras, strict=True)):
        bottom -= heights[row]
        width = 2 * view.half_mm[0] * scale
        for number, scene in enumerate(shown):
            left = _SIDE + column * number + 0.5 * (column - width)
            axes = _panel(figure, left, bottom, width, heights[row] - _GAP)
            _show(axes, rendering.render(scene, view, *limits, height=600), view)
            if row == 0:
                axes.set_title(degrees(scene.flexion_deg), loc="center")
            if number == 0:
                middle = (bottom + 0.5 * heights[row]) / figure.get_figheight()
                words = name.capitalize().replace(", ", ",\n")
                figure.text(0.08 / page, middle, words, rotation=90, va="center", ha="left")
                _triad(axes, scene, view)
    _ruler(figure.axes[-1], cameras[-1])
    _bars(figure, *limits)
    _head(figure, f"{shown[0].title}: flexion, the tibia held still", shown[0])
    return figure


@styled
def film(every: Sequence[Scene], view: str = "anteromedial, from above", most: int = 31) -> bytes:
    """A motion as an animated GIF, there and back.

    Args:
        every: scenes of one knee, from `scenes`.
        view: name in `VIEWS`.
        most: pictures at most; of more poses, evenly spaced ones are shown.

    Returns:
        The file's bytes.

    Raises:
        MissingPackage: PyVista is not installed.
        CannotRender: PyVista finds nothing to draw with.
        ValueError: there are no scenes, or the view has no such name.
    """
    from PIL import Image

    shown, limits = rendering.chosen(every, most)
    seen, width = rendering.camera(view, shown), 3.8
    height = width * seen.half_mm[1] / seen.half_mm[0]
    figure = Figure(figsize=(width, height + _HEAD + _FOOT), dpi=160)
    axes = _panel(figure, 0.0, _FOOT, width, height)
    _bars(figure, *limits)
    pictures = []
    for scene in shown:
        axes.clear()
        _show(axes, rendering.render(scene, seen, *limits, height=760), seen)
        _triad(axes, scene, seen, inset=1.6)
        axes.set_title(f" {verbatim(scene.title)}: {degrees(scene.flexion_deg)} flexion")
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        pictures.append(Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3]))
    palette = _one_palette(pictures)
    first, *more = (p.quantize(palette=palette, dither=Image.Dither.NONE) for p in pictures)
    stream = io.BytesIO()
    first.save(stream, format="GIF", save_all=True, append_images=[*more, *more[-2::-1]],
               duration=90, loop=0)  # fmt: skip
    return stream.getvalue()


def _one_palette(pictures: list[Any]) -> Any:
    """256 colours for all: white, both scales in fine steps, what some pictures have most of."""
    from PIL import Image

    scales = [rendering.strain_colours(), colormaps[PRESSURE_COLOURS]]
    steps = [scale(np.linspace(0.0, 1.0, _STEPS))[:, :3] for scale in scales]
    fixed = np.round(255.0 * np.concatenate([np.ones((1, 3)), *steps])).astype(int).ravel()
    some = [np.asarray(pictures[row]) for row in spread(len(pictures), 4)]
    strip = Image.fromarray(np.concatenate(some, axis=1))
    own = strip.quantize(256 - len(fixed) // 3, kmeans=2, dither=Image.Dither.NONE).getpalette()
    palette = Image.new("P", (1, 1))
    palette.putpalette((fixed.tolist() + (own or []))[: 3 * 256])
    return palette


def _show(axes: Axes, image: np.ndarray, view: rendering.Camera) -> None:
    w, h = view.half_mm
    axes.imshow(image, extent=(-w, w, -h, h), interpolation="lanczos", aspect="equal")
    axes.set(xticks=[], yticks=[])
    without_frame(axes)


def _name_groups(axes: Axes, scene: Scene, view: rendering.Camera) -> None:
    """Names in both margins, each with a thin line to the middle of its fibres."""
    groups = scene.groups
    if len(groups) > _MOST_LABELS:
        return
    target, (w, h) = {}, view.half_mm
    for name, fibres in groups.items():
        middles = np.array([fibre.at(0.5) for fibre in fibres])
        away = np.linalg.norm(middles - middles.mean(axis=0), axis=1)
        # The middle of the fibre that is nearest to the middle of all.
        target[name] = view.seen(middles[np.argmin(np.round(away, 6))])
    order = sorted(target, key=lambda name: target[name][0])
    half = len(order) // 2
    half += len(order) % 2 and sum(target[name][0] < 0 for name in order) > half
    for side, names in ((-1.0, order[:half]), (1.0, order[half:])):
        # In the lower left corner stand the axes.
        low = -h + 2.9 * _TRIAD * min(w, h) if side < 0 else -h
        places = _apart([float(target[name][1]) for name in names], low, h, 2 * h / 22.0)
        for name, y in zip(names, places, strict=True):
            line = {"arrowstyle": "-", "lw": 0.5, "color": GREY, "shrinkA": 1, "shrinkB": 0}
            axes.annotate(verbatim(name), xy=tuple(target[name]), xytext=(side * (w + 1.0), y),
                          va="center", ha="right" if side < 0 else "left", fontsize=_LABEL_SIZE,
                          annotation_clip=False, arrowprops=line)  # fmt: skip


def _apart(wanted: list[float], low: float, high: float, gap: float) -> list[float]:
    """Heights near the wanted ones, in order and at least a gap apart, between two heights."""
    order, apart = np.argsort(wanted, kind="stable"), gap * np.arange(len(wanted))
    answer = np.asarray(wanted, float)
    if len(answer):
        # The least change that keeps them in order and apart.
        found = isotonic_regression(answer[order] - apart).x
        answer[order] = np.clip(found, low, max(high - apart[-1], low)) + apart
    return answer.tolist()


def _triad(axes: Axes, scene: Scene, view: rendering.Camera, inset: float = 0.0) -> None:
    """The anatomical axes in the lower left corner, drawn in by a multiple of their length."""
    w, h = view.half_mm
    size = _TRIAD * min(w, h)
    start = np.array([-w + inset * size, -h + 0.9 * size])
    arrow = {"arrowstyle": "-|>", "lw": 0.8, "color": BLACK, "shrinkA": 0, "shrinkB": 0}
    for word, way in scene.directions.items():
        flat = np.array([way @ view.right, way @ view.up])
        if (long := np.linalg.norm(flat)) < 0.3:
            continue
        end = start + size * flat
        axes.annotate("", tuple(end), tuple(start), arrowprops=arrow, annotation_clip=False)
        ha = "center" if abs(flat[0]) < 0.5 else ("left" if flat[0] > 0 else "right")
        x, y = end + 0.35 * size * flat / long
        axes.text(x, y, word[:3], ha=ha, va="center", fontsize=6.0)


def _ruler(axes: Axes, view: rendering.Camera) -> None:
    w, h = view.half_mm
    axes.plot([w - 21.0, w - 1.0], [-h + 1.0] * 2, color=BLACK, lw=1.4, solid_capstyle="butt")
    axes.text(w - 11.0, -h + 2.0, "20 mm", ha="center", va="bottom", fontsize=6.5)


def _bars(figure: Figure, strain: float, pressure: float) -> None:
    """One scale of strain and one of pressure, side by side at the foot."""
    page = figure.get_figwidth()
    width = min(0.5 * page - 0.5, 2.6)
    for middle, scale, colours, label in (
        (0.27, Normalize(0.0, 100 * strain), rendering.strain_colours(),
         "Strain, %   (thin, grey: slack)"),
        (0.75, Normalize(0.0, pressure), PRESSURE_COLOURS, "Contact pressure, MPa"),
    ):
        axes = _panel(figure, middle * page - 0.5 * width, 0.5, width, 0.1)
        bar = figure.colorbar(ScalarMappable(scale, colours), cax=axes, orientation="horizontal")
        bar.set_label(label)
        bar.outline.set_visible(False)


def _panel(figure: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    """Axes at a place in inches."""
    w, h = figure.get_size_inches()
    return figure.add_axes((left / w, bottom / h, width / w, height / h))


def _head(figure: Figure, text: str, scene: Scene) -> None:
    page, height = figure.get_size_inches()
    figure.text(0.1 / page, 1 - 0.08 / height, verbatim(text), fontsize=9, va="top")
    keys = [("wrap obstacles", rendering.OBSTACLE)] if scene.obstacles else []
    keys += [("quadriceps", rendering.MUSCLE)] if any(x.is_muscle for x in scene.fibres) else []
    for k, (words, colour) in enumerate(keys):
        figure.text(1 - (0.1 + _KEY * k) / page, 1 - 0.08 / height, f"\u25a0 {words}", ha="right",
                    va="top", fontsize=8, color=colour)  # fmt: skip
