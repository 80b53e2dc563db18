"""How far a pose is from a balance, and how little holds it there: what a stiffness tells."""

from __future__ import annotations

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.numerics import solve, symmetric
from kneejax.statics._newton import UNITS


def newton_step_left(
    tangent: Array, residual: Sequence[Array] | Array
) -> tuple[Array, Array]:
    """How far a pose is from a balance.

    Args:
        tangent: stiffness, `(5, 5, lanes)`.
        residual: unbalanced force, five rows of lanes.

    Returns:
        The largest part of the Newton step that is left, mm (rotations at 30 mm), `(lanes,)`; and
        the pivots of the scaled symmetric tangent, `(5, lanes)`.
    """
    units = np.asarray(UNITS).reshape(5, *(1,) * (tangent.ndim - 2))
    scaled = symmetric(tangent) * units[:, None] * units[None]
    right = [row * unit for row, unit in zip(residual, UNITS, strict=True)]
    step, pivots = map(jnp.stack, solve(scaled, right))
    return jnp.max(jnp.abs(step), axis=0), pivots


def softness_of(tangent: Array) -> tuple[Array, Array]:
    """How little force moves a knee; near zero where the stiffness is singular.

    Pivots alone do not tell: the least eigenvalue was a twentieth of the least pivot where a knee
    gave way by turning and sliding at once. A step under some load in every coordinate does.

    Args:
        tangent: stiffness, `(5, 5, lanes)`.

    Returns:
        Force by the step that it makes, N/mm (rotations at 30 mm), `(lanes,)`, not positive where
        the stiffness is not positive definite; and the pivots of the scaled symmetric tangent.
    """
    # Any load will do that is not square to the direction that gives; these are unlike each other.
    load = np.sqrt([2.0, 3.0, 5.0, 7.0, 11.0]) / np.asarray(UNITS)
    left, pivots = newton_step_left(tangent, list(load))
    size = float(np.sqrt(28.0))
    return jnp.where(jnp.all(pivots > 0, axis=0), size / left, jnp.min(pivots, axis=0)), pivots
