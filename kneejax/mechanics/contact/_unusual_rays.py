"""Thorough searches, row by row of points: one unusual ray costs its row a search, not all points.

Of a knee with menisci every other pose has an unusual ray, at one point of 1,400. A row is also
what is searched at once: a program's memory is that of its largest part, asked for in each call,
and all points at once made every solve four times slower.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from kneejax.mechanics.contact._points import Points

Found = TypeVar("Found")
_ROW = 36


def of_usual_rows(sound: Array) -> Array:
    """Whether all rays of the row in which a point stands are sound, `(points, 1, ...)`.

    Args:
        sound: whose rays are, `(points, ...)`.
    """
    rows = jnp.all(_split(sound), axis=tuple(range(1, sound.ndim + 1)))
    return jnp.repeat(rows, _ROW)[: len(sound)].reshape(-1, *(1,) * (sound.ndim - 1))


def over_unusual_rows(
    points: Points,
    known: Array,
    sound: Array,
    search: Callable[[Points, Array, Array], Found],
    nothing: Callable[[Array], Found],
) -> Found:
    """What a function makes of the rows of points that have unusual rays.

    Args:
        points: of tibial surfaces.
        known: depths that have been found, mm, `(points, ...)`.
        sound: whose they are.
        search: of the points of a row, and as much of `known` and `sound`; returns arrays.
        nothing: the same for a row without unusual rays, of its `known`.

    Returns:
        The answers of all rows, `(rows, ...)`.
    """
    count, *lanes = known.shape

    def split(x: Array | float) -> Array:
        x = jnp.asarray(x)
        return _split(jnp.broadcast_to(x, (count, *(x.shape[1:] or (1,) * len(lanes)))))

    own, *of_rays = jax.tree.map(split, (points, known, sound))
    # The last point fills up its row, and does nothing there.
    counted = np.arange(own.area.shape[0] * _ROW).reshape(-1, _ROW, *(1,) * len(lanes)) < count

    def of_row(row: tuple[Points, Array, Array]) -> Found:
        _, known, sound = row
        return lax.cond(jnp.all(sound), lambda: nothing(known), lambda: search(*row))

    return lax.map(of_row, (own.only(counted), *of_rays))


def row_after_row(x: Array) -> Array:
    """What was found at the points of each row, `(rows, ...)`, point after point."""
    return x.reshape(-1, *x.shape[2:])


def _split(x: Array) -> Array:
    """What is known of points, `(points, ...)`, in rows; the last point fills up the last row.

    Joined and not gathered: where a gather is fused, XLA (jaxlib 0.10.2) ends the process while it
    compiles the derivative backwards.
    """
    more = -len(x) % _ROW
    last = jnp.broadcast_to(x[-1:], (more, *x.shape[1:]))
    return jnp.concatenate([x, last]).reshape(-1, _ROW, *x.shape[1:])
