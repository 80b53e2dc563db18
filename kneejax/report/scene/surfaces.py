"""Grids of points on surfaces and obstacles, for pictures."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from kneejax.geometry import Obstacle, Surface, Vector, WrapCylinder

_ROUND = 48
#: Surfaces whose points are kept: a knee has four to eight, and is drawn again at every pose.
_REMEMBERED = 32
#: A long cylinder is drawn this far beyond the fibres that pass it, mm.
_BEYOND = 12.0


def remembered(find: Callable[..., np.ndarray]) -> Callable[..., np.ndarray]:
    """A function of surfaces and arrays that does not compute again what it has found of equals."""
    known: dict[tuple, np.ndarray] = {}

    @functools.wraps(find)
    def answer(*given: Any) -> np.ndarray:
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


def obstacle_grid(obstacle: Obstacle, passing_mm: np.ndarray) -> np.ndarray:
    """Points on a wrap obstacle, `(m, n, 3)`, in its bone's frame, mm."""
    around, up = np.meshgrid(np.linspace(0, 2 * np.pi, _ROUND + 1),
                             np.linspace(0, np.pi, _ROUND // 2 + 1), indexing="ij")  # fmt: skip
    if isinstance(obstacle, WrapCylinder):
        radius, half = float(obstacle.radius), 0.5 * float(obstacle.length)
        inside = obstacle.frame.placement.apply_inverse(Vector.of(passing_mm.T))
        along = np.asarray(inside[2])
        low, high = max(-half, along.min() - _BEYOND), min(half, along.max() + _BEYOND)
        t = low + (high - low) * up / np.pi
        own = np.stack([radius * np.cos(around), radius * np.sin(around), t], axis=-1)
    else:
        axes = (float(x) for x in obstacle.semi_axes_along_frame)
        unit = [np.cos(around) * np.sin(up), np.sin(around) * np.sin(up), np.cos(up)]
        own = np.stack([r * x for r, x in zip(axes, unit, strict=True)], axis=-1)
    there = obstacle.frame.placement.apply(Vector.of(np.moveaxis(own, -1, 0)))
    return _stacked(there, own.shape[:2])


def _stacked(point, shape: tuple[int, ...]) -> np.ndarray:
    return np.stack([np.broadcast_to(np.asarray(x), shape) for x in point], axis=-1)
