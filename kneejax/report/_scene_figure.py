"""Rendered scenes with words around them: one pose from several sides, several poses, a film."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from kneejax.report._pressure_map import PRESSURE_COLOURS, spread
from kneejax.report._scene import Scene
from kneejax.report._scene_colours import STRAIN_COLOURS, pressure_limit, strain_limit
from kneejax.report._scene_render import VIEWS, Camera, camera, render
from kneejax.report._style import BLACK, GREY, WIDTH, styled, verbatim

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Views of `scene_figure`, and of `motion_figure` and the film.
STILL, MOVING = ("anterior", "medial", "anteromedial, from above"), ("anterior", "medial")
_MOST_LABELS = 24
_LABEL_SIZE = 7.0


@styled
def scene_figure(scene: Scene, views: Sequence[str] = STILL) -> Figure:
    """A knee at a pose from several sides, with its ligaments named.

    Args:
        scene: from `scenes`.
        views: names in `VIEWS`.

    Returns:
        The figure; fibres are coloured by strain (thin where slack), plateaux by pressure.

    Raises:
        MissingPackage: PyVista is not installed.
        CannotRender: PyVista finds nothing to draw with.
        ValueError: a view has no such name.
    """
    from matplotlib.figure import Figure

    _check(views)
    limits = strain_limit([scene]), pressure_limit([scene])
    cameras = [camera(view, [scene]) for view in views]
    shares = [c.half_mm[0] / c.half_mm[1] for c in cameras]
    height = 2.9
    figure = Figure(figsize=(WIDTH * 1.25, height + 1.05), layout="constrained")
    grid = figure.add_gridspec(1, len(views), width_ratios=[share + 0.35 for share in shares])
    for number, (name, view) in enumerate(zip(views, cameras, strict=True)):
        axes = figure.add_subplot(grid[0, number])
        _show(axes, render(scene, view, *limits), view)
        axes.set_title(_sentence(name), loc="center")
        _name_groups(axes, scene, view)
        _triad(axes, scene, view)
        if number == 0:
            _ruler(axes, view)
    _bars(figure, figure.axes[: len(views)], *limits)
    figure.suptitle(
        f"{verbatim(scene.title)} at {scene.flexion_deg:.0f}° flexion",
        fontsize=9,
        x=0.01,
        ha="left",
    )
    return figure


@styled
def scenes_figure(every: Sequence[Scene], views: Sequence[str] = MOVING, most: int = 5) -> Figure:
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
    from matplotlib.figure import Figure

    _check(views)
    if not every:
        raise ValueError("no scenes to draw")
    shown = [every[row] for row in spread(len(every), most)]
    limits = strain_limit(shown), pressure_limit(shown)
    cameras = [camera(view, shown) for view in views]
    width = WIDTH * 1.25 / max(len(shown), 3)
    heights = [width * c.half_mm[1] / c.half_mm[0] for c in cameras]
    figure = Figure(
        figsize=(width * max(len(shown), 3), sum(heights) + 0.25 * len(views) + 1.0),
        layout="constrained",
    )
    panels = figure.subplots(
        len(views), len(shown), squeeze=False, gridspec_kw={"height_ratios": heights}
    )
    for row, (name, view) in enumerate(zip(views, cameras, strict=True)):
        for column, scene in enumerate(shown):
            axes = panels[row, column]
            _show(axes, render(scene, view, *limits, height=600), view)
            if row == 0:
                axes.set_title(f"{scene.flexion_deg:.0f}°", loc="center")
        panels[row, 0].set_ylabel(f"{_sentence(name)} view", color=BLACK)
        _triad(panels[row, 0], shown[0], view)
        _ruler(panels[row, -1], view)
    _bars(figure, list(panels.flat), *limits)
    figure.suptitle(
        f"{verbatim(shown[0].title)}: flexion, the tibia held still", fontsize=9, x=0.01, ha="left"
    )
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
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from PIL import Image

    _check([view])
    if not every:
        raise ValueError("no scenes to draw")
    shown = [every[row] for row in spread(len(every), most)]
    limits = strain_limit(shown), pressure_limit(shown)
    seen = camera(view, shown)
    figure = Figure(figsize=(3.6, 3.4 * seen.half_mm[1] / seen.half_mm[0] + 1.0), dpi=110)
    figure.set_layout_engine("constrained")
    axes = figure.add_subplot()
    _bars(figure, [axes], *limits)
    pictures = []
    for scene in shown:
        axes.clear()
        _show(axes, render(scene, seen, *limits, height=500), seen)
        _triad(axes, scene, seen)
        axes.set_title(f"{scene.title}: {scene.flexion_deg:.0f}° flexion", loc="left")
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        pictures.append(Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3]))
        # One arrangement for all pictures: the titles' digits shall not move them.
        figure.set_layout_engine("none")
    palette = pictures[len(pictures) // 2].quantize(255, dither=Image.Dither.NONE)
    frames = [p.quantize(palette=palette, dither=Image.Dither.NONE) for p in pictures]
    frames += frames[-2:0:-1]
    stream = io.BytesIO()
    frames[0].save(
        stream, format="GIF", save_all=True, append_images=frames[1:], duration=90, loop=0
    )
    return stream.getvalue()


def _check(views: Sequence[str]) -> None:
    for view in views:
        if view not in VIEWS:
            raise ValueError(f"a view {view!r}; expected one of {', '.join(VIEWS)}")


def _sentence(name: str) -> str:
    return name[0].upper() + name[1:]


def _show(axes: Axes, image: np.ndarray, view: Camera) -> None:
    w, h = view.half_mm
    axes.imshow(image, extent=(-w, w, -h, h), interpolation="lanczos", aspect="equal")
    axes.set_xticks([])
    axes.set_yticks([])
    axes.grid(False)
    for spine in axes.spines.values():
        spine.set_visible(False)


def _name_groups(axes: Axes, scene: Scene, view: Camera) -> None:
    """Names in both margins, each with a thin line to the middle of its fibres."""
    groups = scene.groups
    if len(groups) > _MOST_LABELS:
        return
    # Where each name points: the middle of its fibres' middles.
    target = {
        name: view.seen(np.mean([_middle(fibre.points_mm) for fibre in fibres], axis=0))
        for name, fibres in groups.items()
    }
    w, h = view.half_mm
    order = sorted(target, key=lambda name: target[name][0])
    half = len(order) // 2 if len(order) % 2 == 0 else int(np.sum(
        [target[name][0] < 0 for name in order]
    ))  # fmt: skip
    half = min(max(half, len(order) // 2), -(-len(order) // 2))
    for side, names in ((-1.0, order[:half]), (1.0, order[half:])):
        places = _apart([float(target[name][1]) for name in names], h, 2 * h / 22.0)
        for name, y in zip(names, places, strict=True):
            axes.annotate(
                verbatim(name),
                xy=tuple(target[name]),
                xytext=(side * (w + 1.0), y),
                ha="right" if side < 0 else "left",
                va="center",
                fontsize=_LABEL_SIZE,
                annotation_clip=False,
                arrowprops={
                    "arrowstyle": "-", "lw": 0.5, "color": GREY, "shrinkA": 1, "shrinkB": 0,
                },
            )  # fmt: skip


def _apart(wanted: list[float], half: float, gap: float) -> list[float]:
    """Heights near the wanted ones, at least a gap from each other and within the picture.

    Example:
        >>> [round(y, 2) for y in _apart([0.0, 0.1, 5.0], 6.0, 1.0)]
        [-0.45, 0.55, 5.0]
    """
    order = np.argsort(wanted, kind="stable")
    free = np.asarray(wanted, float)[order] - gap * np.arange(len(wanted))
    # Isotonic regression: the least change that keeps them in order and apart.
    blocks: list[list[float]] = []
    for value in free:
        blocks.append([value])
        while len(blocks) > 1 and np.mean(blocks[-2]) > np.mean(blocks[-1]):
            last = blocks.pop()
            blocks[-1] += last
    found = np.array([np.mean(block) for block in blocks for _ in block])
    top = half - gap * max(len(wanted) - 1, 0)
    found = np.clip(found, -half, max(top, -half)) + gap * np.arange(len(wanted))
    answer = np.empty(len(wanted))
    answer[order] = found
    return answer.tolist()


def _middle(line: np.ndarray) -> np.ndarray:
    """Point halfway along a polyline."""
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(steps)])
    return np.array([np.interp(0.5 * way[-1], way, line[:, k]) for k in range(3)])


def _triad(axes: Axes, scene: Scene, view: Camera) -> None:
    """The anatomical axes in the lower left corner."""
    w, h = view.half_mm
    size = 0.2 * min(w, h)
    start = np.array([-w + 1.6 * size, -h + 1.2 * size])
    for word in ("anterior", "superior", "lateral", "medial", "posterior"):
        flat = np.array([scene.directions[word] @ view.right, scene.directions[word] @ view.up])
        if np.linalg.norm(flat) < 0.3 or (word in ("medial", "posterior")):
            continue
        arrow = {"arrowstyle": "-|>", "lw": 0.8, "color": BLACK, "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", tuple(start + size * flat), tuple(start), arrowprops=arrow)
        beside = start + size * flat + 0.35 * size * flat / np.linalg.norm(flat)
        ha = "center" if abs(flat[0]) < 0.5 else ("left" if flat[0] > 0 else "right")
        axes.text(*beside, word[:3], ha=ha, va="center", fontsize=6.0)


def _ruler(axes: Axes, view: Camera) -> None:
    w, h = view.half_mm
    axes.plot([w - 21.0, w - 1.0], [-h + 1.0] * 2, color=BLACK, lw=1.4, solid_capstyle="butt")
    axes.text(w - 11.0, -h + 2.0, "20 mm", ha="center", va="bottom", fontsize=6.5)


def _bars(figure: Figure, panels: list[Axes], strain: float, pressure: float) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    for scale, colours, label in (
        (Normalize(-100 * strain, 100 * strain), STRAIN_COLOURS, "Strain, %   (thin: slack)"),
        (Normalize(0.0, pressure), PRESSURE_COLOURS, "Contact pressure, MPa"),
    ):
        bar = figure.colorbar(
            ScalarMappable(scale, colours),
            ax=panels,
            location="bottom",
            shrink=0.42,
            aspect=32,
            pad=0.02,
            anchor=(0.1, 0.5) if colours == STRAIN_COLOURS else (0.9, 0.5),
        )
        bar.set_label(label)
        bar.outline.set_visible(False)
