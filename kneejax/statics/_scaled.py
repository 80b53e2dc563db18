"""Steps and stiffness in mm: rotations count at 30 mm."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import jax.numpy as jnp
from jax import Array, lax

from kneejax.numerics import identity, solve, symmetric

# N/mm that are tried first where a stiffness is not positive definite.
_LEAST = 0.25


def size_of(rows: tuple[Array, ...]) -> Array:
    """Largest entry of each lane."""
    return functools.reduce(jnp.maximum, map(jnp.abs, rows))


def scaled(rows: tuple[Array, ...], scales: Sequence[float]) -> tuple[Array, ...]:
    """Rows, each times the scale of its coordinate."""
    return tuple(scale * row for scale, row in zip(scales, rows, strict=True))


def lift(tangent: Array, scales: Sequence[float]) -> Array:
    """N/mm that make a scaled tangent positive definite, two to eight times what is missing; 0
    where nothing is.

    Gershgorin's discs, which bound it, are far larger: with them a patella that tips by a
    stiffness of -1 N/mm was led away in steps so short that 80 looks found nothing.
    """
    stiffness, size = symmetric(scaled_tangent(tangent, scales)), len(scales)
    lanes = tangent.shape[2:]
    nothing, unit = (jnp.zeros(lanes),) * size, identity(size, len(lanes))
    most = jnp.max(jnp.sum(jnp.abs(stiffness), axis=1), axis=0)

    def grown(state: tuple[Array, Array]) -> tuple[Array, Array]:
        added, _ = state
        _, pivots = solve(stiffness + added * unit, nothing)
        definite = functools.reduce(jnp.logical_and, [pivot > 0 for pivot in pivots])
        more = jnp.where(added > 0.0, 4.0 * added, _LEAST)
        return jnp.where(definite, added, more), definite

    def lacks(state: tuple[Array, Array]) -> Array:
        added, definite = state
        return jnp.any(~definite & (added <= most))

    added, _ = lax.while_loop(lacks, grown, (jnp.zeros(lanes), jnp.zeros(lanes, bool)))
    return 2.0 * added


def newton_step(
    tangent: Array, residual: tuple[Array, ...], extra: Array, scales: Sequence[float]
) -> tuple[Array, ...]:
    """Newton step in scaled coordinates, in rows, with a multiple of the identity added."""
    right = tuple(-row for row in scaled(residual, scales))
    lifted = scaled_tangent(tangent, scales) + extra * identity(len(scales), extra.ndim)
    return solve(lifted, right)[0]


def scaled_tangent(tangent: Array, scales: Sequence[float]) -> Array:
    """A stiffness in N/mm: per mm of every coordinate, rotations at 30 mm."""
    units = jnp.asarray(scales).reshape(len(scales), *(1,) * (tangent.ndim - 2))
    return tangent * units[:, None] * units[None]
