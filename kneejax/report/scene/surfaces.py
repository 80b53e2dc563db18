"""Grids of points on surfaces and obstacles, for pictures."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from kneejax.geometry import Frame, Obstacle, Surface, Vector, WrapCylinder

_ROUND = 48
#: Surfaces whose points are kept: a knee has four to eight, and is drawn again at every pose.
_REMEMBERED = 64
#: A long cylinder is drawn this far beyond the fibres that pass it, in steps of, mm.
_BEYOND, _STEP = 12.0, 5.0


def remembered(find: Callable[..., Any]) -> Callable[..., Any]:
    """A function of surfaces and arrays that does not compute again what it has found of equals."""
    known: dict[tuple, Any] = {}

    @functools.wraps(find)
    def answer(*given: Any) -> Any:
        leaves, structure = jax.tree.flatten(given)
        key = structure, *(np.asarray(x).tobytes() for x in leaves)
        if key not in known:
            if len(known) >= _REMEMBERED:
                known.pop(next(iter(known)))
            known[key] = find(*given)
        return known[key]

    return answer


@remembered
def surface_grid(surface: Surface, points: tuple[int, int]) -> np.ndarray:
    """Points over the whole region of a surface, `(m, n, 3)`, in its bone's frame, mm."""
    (a0, a1), (b0, b1) = surface.bounds()
    a, b = jnp.meshgrid(jnp.linspace(a0, a1, points[0]), jnp.linspace(b0, b1, points[1]),
                        indexing="ij")  # fmt: skip
    return _stacked(surface.frame.placement.apply(surface.point(a, b)), a.shape)


def grid_triangles(rows: int, columns: int) -> np.ndarray:
    """Triangles of a grid of points, `(2 (rows - 1)(columns - 1), 3)`.

    Example:
        >>> grid_triangles(2, 2).tolist()
        [[0, 2, 1], [1, 2, 3]]
    """
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (x.ravel()
                  for x in (number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]))
    return np.concatenate([np.stack([a, c, b], 1), np.stack([b, c, d], 1)])


def tube(line: np.ndarray, thickness: float, sides: int = 8) -> tuple[np.ndarray, np.ndarray]:
    """Corners, `(k sides, 3)`, and triangles around a line of `k` points.

    Example:
        >>> corners, faces = tube(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 5.0]]), 2.0, sides=4)
        >>> corners.shape, faces.shape, round(float(np.abs(corners[:, :2]).max()), 6)
        ((8, 3), (8, 3), 1.0)
    """
    apart = line[1:] - line[:-1]
    along = np.concatenate([apart[:1], apart[1:] + apart[:-1], apart[-1:]])
    along /= np.maximum(np.sqrt((along**2).sum(axis=1, keepdims=True)), 1e-9)
    axis = int(np.argmin(np.abs(line[-1] - line[0])))
    first = -along[:, axis : axis + 1] * along
    first[:, axis] += 1.0
    first *= 0.5 * thickness / np.sqrt((first**2).sum(axis=1, keepdims=True))
    (x, y, z), (u, v, w) = along.T, first.T
    second = np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)
    cosine, sine = _circle(sides)
    rings = line[:, None] + cosine * first[:, None] + sine * second[:, None]
    return rings.reshape(-1, 3).astype(np.float32), _faces(len(line), sides)


@functools.cache
def _circle(sides: int) -> tuple[np.ndarray, np.ndarray]:
    turn = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)[:, None]
    return np.cos(turn), np.sin(turn)


@functools.cache
def _faces(count: int, sides: int) -> np.ndarray:
    """Triangles between rings of corners."""
    number = np.arange(count * sides).reshape(count, sides)
    a, b = number[:-1], np.roll(number[:-1], -1, axis=1)
    c, d = number[1:], np.roll(number[1:], -1, axis=1)
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([b, d, c], -1)]).reshape(-1, 3)
    return faces.astype(np.uint32)


def obstacle_grid(obstacle: Obstacle, passing_mm: np.ndarray) -> np.ndarray:
    """Points on a wrap obstacle, `(m, n, 3)`, in its bone's frame, mm."""
    if not isinstance(obstacle, WrapCylinder):
        return _closed(obstacle)
    turn, shift = _placed(obstacle.frame)
    along, half = (passing_mm - shift) @ turn[:, 2], 0.5 * float(obstacle.length)
    # In whole steps: fibres that slide a little leave it as it is.
    low = _STEP * np.floor((along.min() - _BEYOND) / _STEP)
    high = _STEP * np.ceil((along.max() + _BEYOND) / _STEP)
    t = np.linspace(max(low, -half), min(high, half), _ROUND // 2 + 1)
    around, t = np.meshgrid(np.linspace(0, 2 * np.pi, _ROUND + 1), t, indexing="ij")
    radius = float(obstacle.radius)
    own = np.stack([radius * np.cos(around), radius * np.sin(around), t], axis=-1)
    return own @ turn.T + shift


@remembered
def _closed(obstacle: Obstacle) -> np.ndarray:
    """Points on a ball or an ellipsoid."""
    around, up = np.meshgrid(np.linspace(0, 2 * np.pi, _ROUND + 1),
                             np.linspace(0, np.pi, _ROUND // 2 + 1), indexing="ij")  # fmt: skip
    axes = (float(x) for x in obstacle.semi_axes_along_frame)
    unit = [np.cos(around) * np.sin(up), np.sin(around) * np.sin(up), np.cos(up)]
    own = np.stack([r * x for r, x in zip(axes, unit, strict=True)], axis=-1)
    turn, shift = _placed(obstacle.frame)
    return own @ turn.T + shift


@remembered
def _placed(frame: Frame) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and translation of a frame."""
    origin, *ends = (np.stack([np.asarray(x, float) for x in frame.placement.apply(Vector(*point))])
                     for point in np.vstack([np.zeros(3), np.eye(3)]))  # fmt: skip
    return np.stack(ends, axis=-1) - origin[:, None], origin


def _stacked(point, shape: tuple[int, ...]) -> np.ndarray:
    return np.stack([np.broadcast_to(np.asarray(x), shape) for x in point], axis=-1)
