"""Elimination for small symmetric systems over lanes.

LAPACK called once a lane is 5 to 7 times slower than elementwise elimination of five unknowns.
Unrolled, entries and answers are separate arrays: what a compiler computes into a stack it computes
for each row. Of many unknowns that is too much to compile, and a loop does it.
"""

__all__ = ["identity", "solve", "symmetric"]

from collections.abc import Sequence

import jax.numpy as jnp
from jax import Array, lax

#: Unknowns up to which elimination is unrolled: those of one bone. Eleven are 900 operations.
_UNROLLED = 6


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

    Example:
        >>> matrix = jnp.array([[4.0, 1.0], [1.0, 3.0]])[:, :, None]
        >>> found, pivots = solve(matrix, jnp.array([[1.0], [2.0]]))
        >>> [round(float(x[0]), 4) for x in found], [float(x[0]) for x in pivots]
        ([0.0909, 0.6364], [4.0, 2.75])
    """
    if len(right) > _UNROLLED:
        return _solve_in_loop(matrix, right)
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


def _solve_in_loop(
    matrix: Array, right: Sequence[Array] | Array
) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
    """As `solve`; each pivot clears its column above and below."""
    count = len(right)
    lanes = jnp.broadcast_shapes(matrix.shape[2:], *(jnp.shape(row) for row in right))
    matrix = jnp.broadcast_to(matrix, (count, count, *lanes))
    right = jnp.stack([jnp.broadcast_to(row, lanes) for row in right])
    others = 1.0 - identity(count, len(lanes))

    # Matrix and right side apart: the answer is linear in the one, and can be transposed in it.
    def cleared(k, state):
        left, known = state
        row = left[k]
        factor = others[k] * left[:, k] / row[k]
        return left - factor[:, None] * row, known - factor * known[k]

    left, known = lax.fori_loop(0, count, cleared, (matrix, right))
    pivots = [left[k, k] for k in range(count)]
    return tuple(known[k] / pivots[k] for k in range(count)), tuple(pivots)


def identity(size: int, lane_axes: int) -> Array:
    """The identity matrix, `(size, size, 1, ...)`, as it meets lanes.

    Example:
        >>> identity(2, lane_axes=1)[:, :, 0].tolist()
        [[1.0, 0.0], [0.0, 1.0]]
    """
    return jnp.eye(size).reshape(size, size, *(1,) * lane_axes)


def symmetric(matrix: Array) -> Array:
    """Symmetric part over the first two axes.

    Example:
        >>> symmetric(jnp.array([[[1.0], [4.0]], [[0.0], [1.0]]]))[:, :, 0].tolist()
        [[1.0, 2.0], [2.0, 1.0]]
    """
    return 0.5 * (matrix + matrix.swapaxes(0, 1))
