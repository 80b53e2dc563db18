"""Values with rules: a root of a cubic, found in loops and branches, differentiated twice."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from kneejax.numerics import as_known, instantiate, ruled

MODES = (jax.jacfwd, jax.jacrev)


def newton(x):
    """The root q of q^3 + q = x."""
    return lax.fori_loop(0, 40, lambda _, q: q - (q**3 + q - x) / (3.0 * q**2 + 1.0), 0.0 * x)


def stiffness(q):
    return 3.0 * q**2 + 1.0


def rule(q, arguments, changes):
    _, known = arguments
    return q, instantiate(changes[0]) / as_known(stiffness, known, q)


def root(x):
    q = newton(lax.stop_gradient(x))
    return ruled(rule, q, x, stiffness(q))


def nested(x):
    return root(jnp.sin(x) + 2.0 * root(x))


def in_a_loop(x):
    @jax.checkpoint
    def step(before, _):
        q = root(before * x + 1.0)
        return q, q

    return lax.scan(step, x, None, length=3)[0]


def in_a_branch(x):
    return lax.cond(x > 0.0, lambda: root(x * root(x)), lambda: x)


@pytest.mark.parametrize("function", [nested, in_a_loop, in_a_branch])
def test_second_derivatives_are_exact_in_every_nesting(function):
    """Also where JAX forgets a `custom_jvp`: in what is differentiated backwards within a loop."""
    at, step = np.array([0.3, 0.7, 1.1]), 1e-3
    slope = jax.jit(jax.vmap(jax.grad(function)))
    far, near = (slope(at + k * step) - slope(at - k * step) for k in (1.0, 0.5))
    expected = (8.0 * near - far) / (6.0 * step)
    for outer, inner in itertools.product(MODES, MODES):
        second = jax.vmap(outer(inner(function)))
        np.testing.assert_allclose(second(at), expected, rtol=1e-8)
        np.testing.assert_allclose(jax.jit(second)(at), expected, rtol=1e-8)
        # And of many at once.
        whole = outer(inner(lambda x: jnp.sum(jax.vmap(function)(x))))(jnp.asarray(at))
        np.testing.assert_allclose(np.diag(whole), expected, rtol=1e-8)


def test_a_first_derivative_is_that_of_the_equation():
    for derivative in MODES:
        q = newton(2.0)
        assert derivative(root)(2.0) == pytest.approx(float(1.0 / (3.0 * q**2 + 1.0)), rel=1e-14)
