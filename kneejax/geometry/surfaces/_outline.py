"""The border of a sheet in the plane of a surface's parameters."""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

from kneejax.numerics import safe_sqrt

#: A share that is but rounding: half a rectangle off, none of it counts, whatever the compiler.
_NOTHING = 1e-9


def covered(outline: Array, a: Array, b: Array, spacing: tuple[Array, Array]) -> Array:
    """Share of small rectangles that lies within a closed outline, to first order.

    A rectangle counts by the distance of its centre from the border, in units of its own size: 0.5
    on the border, 0 or 1 from half a rectangle on.

    Args:
        outline: corners in order, shape `(k, 2, ...)`; the last is joined to the first.
        a: centres, first parameter, shape `(n, ...)`.
        b: second parameter, same shape.
        spacing: sizes of the rectangles along both parameters.

    Returns:
        Shares, 0 to 1.

    Example:
        >>> square = jnp.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]])
        >>> a, b = jnp.array([2.0, 4.0, 3.75, 5.0]), jnp.array([2.0, 1.0, 1.0, 1.0])
        >>> covered(square, a, b, (1.0, 1.0)).tolist()
        [1.0, 0.5, 0.75, 0.0]
    """
    corner = jnp.expand_dims(outline, tuple(range(2, 2 + jnp.ndim(a) - (outline.ndim - 2))))
    (x0, z0), (x1, z1) = (
        (c[:, 0], c[:, 1]) for c in (corner, jnp.roll(corner, -1, axis=0))
    )
    dx, dz = x1 - x0, z1 - z0
    length = dx * dx + dz * dz
    along = jnp.clip(
        ((a - x0) * dx + (b - z0) * dz) / jnp.where(length > 0, length, 1.0), 0.0, 1.0
    )
    away_a, away_b = (x0 + along * dx - a) / spacing[0], (z0 + along * dz - b) / spacing[1]
    nearest = safe_sqrt(jnp.min(away_a * away_a + away_b * away_b, axis=0))
    # A ray along the first parameter leaves the outline an odd number of times from inside.
    spans = (z0 > b) != (z1 > b)
    crosses = spans & (a < x0 + (b - z0) * dx / jnp.where(spans, dz, 1.0))
    inside = jnp.sum(crosses, axis=0) % 2 == 1
    share = jnp.clip(0.5 + jnp.where(inside, nearest, -nearest), 0.0, 1.0)
    return jnp.where(share > _NOTHING, share, 0.0)
