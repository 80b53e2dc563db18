"""Unrolled elimination for systems of five unknowns over lanes.

LAPACK called once a lane is 5 to 7 times slower than elementwise elimination at this size.
"""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array


def solve(matrix: Array, right: Array) -> tuple[Array, Array]:
    """Solve by elimination without pivoting.

    Args:
        matrix: shape `(n, n, lanes)`; without pivoting this is safe for matrices that are
            positive definite or nearly so, which is what a stable knee has.
        right: shape `(n, lanes)`.

    Returns:
        The solution `(n, lanes)` and the pivots `(n, lanes)`. All pivots of a symmetric matrix
        are positive exactly if it is positive definite.
    """
    size = matrix.shape[0]
    pivots = []
    for k in range(size):
        pivot = matrix[0, 0]
        pivots.append(pivot)
        factor = matrix[1:, 0] / pivot
        if k == 0:
            rows, rights = [matrix[0]], [right[0]]
        else:
            rows.append(matrix[0])
            rights.append(right[0])
        right = right[1:] - factor * right[0]
        matrix = matrix[1:, 1:] - factor[:, None] * matrix[0, None, 1:]
    solution: list[Array] = []
    for k in range(size - 1, -1, -1):
        known = sum((rows[k][j + 1] * x for j, x in enumerate(reversed(solution))), 0.0)
        solution.append((rights[k] - known) / pivots[k])
    return jnp.stack(solution[::-1]), jnp.stack(pivots)


def symmetric(matrix: Array) -> Array:
    """Symmetric part over the first two axes."""
    return 0.5 * (matrix + jnp.swapaxes(matrix, 0, 1))
