"""Steps and stiffness in mm: rotations count at 30 mm."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import jax.numpy as jnp
from jax import Array

from kneejax.numerics import identity, solve, symmetric


def size_of(rows: tuple[Array, ...]) -> Array:
    """Largest entry of each lane."""
    return functools.reduce(jnp.maximum, map(jnp.abs, rows))


def scaled(rows: tuple[Array, ...], scales: Sequence[float]) -> tuple[Array, ...]:
    """Rows, each times the scale of its coordinate."""
    return tuple(scale * row for scale, row in zip(scales, rows, strict=True))


def lift(tangent: Array, scales: Sequence[float]) -> Array:
    """N/mm that make a scaled tangent positive definite in any case; 0 where it is."""
    stiffness, size = scaled_tangent(tangent, scales), len(scales)
    _, pivots = solve(symmetric(stiffness), (jnp.zeros(tangent.shape[2:]),) * size)
    definite = functools.reduce(jnp.logical_and, [pivot > 0 for pivot in pivots])
    # Gershgorin's discs.
    spread = jnp.sum(jnp.abs(stiffness), axis=1)
    diagonal = [stiffness[i, i] for i in range(size)]
    needed = functools.reduce(
        jnp.maximum, [s - jnp.abs(d) - d for s, d in zip(spread, diagonal, strict=True)]
    )
    return jnp.where(definite, 0.0, jnp.clip(needed + 1.0, 1.0))


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
