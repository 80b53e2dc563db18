"""L-BFGS-B through jaxopt: converged, within bounds, honest when it is not."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

pytest.importorskip("jaxopt")

from kneejax.inference._lbfgsb import minimise_bounded


def test_a_bound_is_respected_and_convergence_checked():
    both = jax.value_and_grad(lambda x: jnp.sum((x - jnp.array([2.0, -1.0])) ** 2))
    low, high = np.array([-1.0, -3.0]), np.array([1.0, 3.0])
    x, converged, _ = minimise_bounded(both, np.zeros(2), low, high)
    assert converged
    assert np.allclose(x, [1.0, -1.0], atol=1e-5)


def test_too_few_steps_are_reported():
    def valley(x):
        return 100 * (x[1] - x[0] ** 2) ** 2 + (1 - x[0]) ** 2

    both = jax.value_and_grad(valley)
    low, high = np.full(2, -3.0), np.full(2, 3.0)
    _, converged, _ = minimise_bounded(both, np.array([-1.2, 1.0]), low, high, max_steps=2)
    assert not converged
