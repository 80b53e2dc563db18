"""Elimination over lanes, unrolled and in a loop, against NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from kneejax.numerics import solve


@pytest.mark.parametrize("count", [1, 5, 6, 7, 11, 12])
def test_answer_and_pivots_are_those_of_linear_algebra(rng, count):
    """A symmetric matrix is L D L^T with D the pivots: products of these are leading minors."""
    roots = rng.normal(size=(3, count, count))
    matrices = roots @ roots.swapaxes(1, 2) + 0.5 * np.eye(count)
    matrices[1] -= 2.0 * np.linalg.eigvalsh(matrices[1])[0] * np.eye(count)  # not positive definite
    right = rng.normal(size=(3, count))
    found, pivots = solve(jnp.asarray(matrices.transpose(1, 2, 0)), jnp.asarray(right.T))
    expected = np.linalg.solve(matrices, right[..., None])[..., 0]
    np.testing.assert_allclose(np.stack(found).T, expected, rtol=1e-9, atol=1e-9)
    minors = [[np.linalg.det(m[:k, :k]) for k in range(1, count + 1)] for m in matrices]
    np.testing.assert_allclose(np.cumprod(np.stack(pivots), axis=0).T, minors, rtol=1e-8)


@pytest.mark.parametrize("count", [5, 11])
def test_the_answer_can_be_transposed_in_its_right_side(rng, count):
    """Reverse mode through an implicit derivative asks for nothing else."""
    root = rng.normal(size=(count, count))
    matrix = root @ root.T + np.eye(count)
    weights = rng.normal(size=count)

    def answer(right):
        found, _ = solve(jnp.asarray(matrix)[..., None], right[:, None])
        return jnp.stack(found)[:, 0] @ weights

    slope = jax.grad(answer)(jnp.asarray(rng.normal(size=count)))
    np.testing.assert_allclose(slope, np.linalg.solve(matrix.T, weights), rtol=1e-9)
