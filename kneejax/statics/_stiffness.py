"""What a stiffness tells: the step to a balance, how far that is, and how little holds a pose.

Lengths are in mm: rotations count at 30 mm.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from kneejax.numerics import identity, solve, symmetric

# N/mm that are tried first where a stiffness is not positive definite, and how much more then.
_LEAST, _MORE, _MOST = 0.5, 4.0, 1e12
#: Squares of a load that is unlike in every coordinate, of up to three bodies.
_PRIMES = (2.0, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0, 19.0, 23.0, 29.0, 31.0, 37.0,
           41.0, 43.0, 47.0, 53.0, 59.0, 61.0)  # fmt: skip


def size_of(rows: Sequence[Array] | Array) -> Array:
    """Largest entry of each lane."""
    return functools.reduce(jnp.maximum, map(jnp.abs, rows))


def scaled(rows: Sequence[Array] | Array, scales: Sequence[float]) -> tuple[Array, ...]:
    """Rows, each times the scale of its coordinate."""
    return tuple(scale * row for scale, row in zip(scales, rows, strict=True))


def scaled_tangent(tangent: Array, scales: Sequence[float]) -> Array:
    """A stiffness in N/mm: per mm of every coordinate."""
    units = jnp.asarray(scales).reshape(len(scales), *(1,) * (tangent.ndim - 2))
    return tangent * units[:, None] * units[None]


def damped_step(
    tangent: Array, residual: Sequence[Array] | Array, damping: Array, scales: Sequence[float]
) -> tuple[Array, Array]:
    """Newton step with a multiple of the identity added to the stiffness.

    Args:
        tangent: stiffness, `(free, free, lanes)`.
        residual: unbalanced force, rows of lanes.
        damping: N/mm, `(lanes,)`: what is added at least; more where the stiffness is not positive
            definite with it.
        scales: rad and mm of each free coordinate that count as 1 mm.

    Returns:
        The step, `(free, lanes)`, mm; and what was added, N/mm.
    """
    right, unit = scaled(residual, scales), identity(len(scales), damping.ndim)
    right, stiffness = tuple(-row for row in right), scaled_tangent(tangent, scales)

    def tried(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        added, _, _ = state
        step, pivots = solve(stiffness + added * unit, right)
        definite = functools.reduce(jnp.logical_and, [~(pivot <= 0.0) for pivot in pivots])
        more = jnp.where(added > 0.0, _MORE * added, _LEAST)
        return jnp.where(definite | (added > _MOST), added, more), definite, jnp.stack(step)

    nothing = jnp.zeros((len(scales), *damping.shape))
    state = damping, jnp.zeros(damping.shape, bool), nothing
    added, _, step = lax.while_loop(
        lambda state: jnp.any(~state[1] & (state[0] <= _MOST)), tried, state
    )
    return step, added


def newton_step_left(
    tangent: Array, residual: Sequence[Array] | Array, scales: Sequence[float]
) -> tuple[Array, Array]:
    """How far a pose is from a balance.

    Args:
        tangent: stiffness, `(free, free, lanes)`.
        residual: unbalanced force, rows of lanes.
        scales: rad and mm of each free coordinate that count as 1 mm.

    Returns:
        The largest part of the Newton step that is left, mm, `(lanes,)`; and the pivots of the
        scaled symmetric tangent, `(free, lanes)`.

    Example:
        >>> left, pivots = newton_step_left(
        ...     jnp.array([[[10.0]]]), [jnp.array([0.05])], (1.0,)
        ... )
        >>> round(float(left[0]), 6)
        0.005
    """
    stiffness = scaled_tangent(symmetric(tangent), scales)
    step, pivots = map(jnp.stack, solve(stiffness, scaled(residual, scales)))
    return jnp.max(jnp.abs(step), axis=0), pivots


def softness_of(tangent: Array, scales: Sequence[float]) -> tuple[Array, Array]:
    """How little force moves a knee; near zero where the stiffness is singular.

    Pivots alone do not tell: the least eigenvalue was a twentieth of the least pivot where a knee
    gave way by turning and sliding at once. A step under some load in every coordinate does.

    Args:
        tangent: stiffness, `(free, free, lanes)`.
        scales: rad and mm of each free coordinate that count as 1 mm.

    Returns:
        Force by the step that it makes, N/mm, `(lanes,)`, not positive where the stiffness is not
        positive definite; and the pivots of the scaled symmetric tangent.
    """
    # Any load will do that is not square to the direction that gives; these are unlike each other.
    squares = _PRIMES[: len(scales)]
    load = np.sqrt(squares) / np.asarray(scales)
    left, pivots = newton_step_left(tangent, list(load), scales)
    size = float(np.sqrt(sum(squares)))
    return jnp.where(jnp.all(pivots > 0, axis=0), size / left, jnp.min(pivots, axis=0)), pivots
