"""Unrolled elimination for small symmetric systems over lanes.

LAPACK called once a lane is 5 to 7 times slower than elementwise elimination of five unknowns.
Entries and answers are separate arrays: what a compiler computes into a stack it computes for each
row.
"""

from __future__ import annotations

from collections.abc import Sequence

import jax.numpy as jnp
from jax import Array


def solve(
    matrix: Array, right: Sequence[Array] | Array
) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
    """Solve by elimination without pivoting.

    Args:
        matrix: shape `(n, n, lanes)`; without pivoting this is safe for matrices that are
            positive definite or nearly so, which is what a stable knee has.
        right: `n` rows of lanes.

    Returns:
        The solution and the pivots, `n` rows of lanes each. All pivots of a symmetric matrix are
        positive exactly if it is positive definite.
    """
    size = range(len(right))
    rows = [[matrix[i, j] for j in size] for i in size]
    known = [right[i] for i in size]
    for k in size:
        for i in size[k + 1 :]:
            factor = rows[i][k] / rows[k][k]
            known[i] = known[i] - factor * known[k]
            for j in size[k + 1 :]:
                rows[i][j] = rows[i][j] - factor * rows[k][j]
    solution = list(known)
    for i in reversed(size):
        for j in size[i + 1 :]:
            solution[i] = solution[i] - rows[i][j] * solution[j]
        solution[i] = solution[i] / rows[i][i]
    return tuple(solution), tuple(rows[k][k] for k in size)


def identity(size: int, lane_axes: int) -> Array:
    """The identity matrix, `(size, size, 1, ...)`, as it meets lanes."""
    return jnp.eye(size).reshape(size, size, *(1,) * lane_axes)


def symmetric(matrix: Array) -> Array:
    """Symmetric part over the first two axes."""
    return 0.5 * (matrix + matrix.swapaxes(0, 1))
