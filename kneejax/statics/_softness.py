"""How far a pose is from a balance, and how little holds it there: what a stiffness tells."""

from __future__ import annotations

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.numerics import solve, symmetric
from kneejax.statics._scaled import scaled_tangent

#: Squares of a load that is unlike in every coordinate, of up to three bodies.
_PRIMES = (2.0, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0, 19.0, 23.0, 29.0, 31.0, 37.0,
           41.0, 43.0, 47.0, 53.0, 59.0, 61.0)  # fmt: skip


def newton_step_left(
    tangent: Array, residual: Sequence[Array] | Array, scales: Sequence[float]
) -> tuple[Array, Array]:
    """How far a pose is from a balance.

    Args:
        tangent: stiffness, `(free, free, lanes)`.
        residual: unbalanced force, rows of lanes.
        scales: rad and mm of each free coordinate that count as 1 mm.

    Returns:
        The largest part of the Newton step that is left, mm (rotations at 30 mm), `(lanes,)`; and
        the pivots of the scaled symmetric tangent, `(free, lanes)`.
    """
    scaled = scaled_tangent(symmetric(tangent), tuple(scales))
    right = [row * scale for row, scale in zip(residual, scales, strict=True)]
    step, pivots = map(jnp.stack, solve(scaled, right))
    return jnp.max(jnp.abs(step), axis=0), pivots


def softness_of(tangent: Array, scales: Sequence[float]) -> tuple[Array, Array]:
    """How little force moves a knee; near zero where the stiffness is singular.

    Pivots alone do not tell: the least eigenvalue was a twentieth of the least pivot where a knee
    gave way by turning and sliding at once. A step under some load in every coordinate does.

    Args:
        tangent: stiffness, `(free, free, lanes)`.
        scales: rad and mm of each free coordinate that count as 1 mm.

    Returns:
        Force by the step that it makes, N/mm (rotations at 30 mm), `(lanes,)`, not positive where
        the stiffness is not positive definite; and the pivots of the scaled symmetric tangent.
    """
    # Any load will do that is not square to the direction that gives; these are unlike each other.
    squares = _PRIMES[: len(scales)]
    load = np.sqrt(squares) / np.asarray(scales)
    left, pivots = newton_step_left(tangent, list(load), scales)
    size = float(np.sqrt(sum(squares)))
    return jnp.where(jnp.all(pivots > 0, axis=0), size / left, jnp.min(pivots, axis=0)), pivots
