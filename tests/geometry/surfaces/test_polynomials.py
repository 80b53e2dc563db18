"""Partial derivatives of polynomials against numpy.polynomial and central differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.polynomial import polynomial as P

from kneejax.geometry._bases import partials


def _numpy_partials(c, s, t, order):
    return {
        (i, j): P.polyval2d(s, t, P.polyder(P.polyder(c, i, axis=0), j, axis=1))
        for i in range(order + 1)
        for j in range(order + 1 - i)
    }


@pytest.mark.parametrize("order", range(5))
@pytest.mark.parametrize("shape", [(5, 5), (3, 5), (5, 1), (1, 1), (2, 7)])
def test_partials_equal_those_of_numpy(order, shape, rng):
    c, (s, t) = rng.normal(size=shape), rng.uniform(-1, 1, size=(2, 3))
    ours = partials(jnp.asarray(c), s, t, order)
    assert [len(row) for row in ours] == [order + 1 - i for i in range(order + 1)]
    for (i, j), expected in _numpy_partials(c, s, t, order).items():
        np.testing.assert_allclose(np.asarray(ours[i][j]), expected, rtol=1e-11, atol=1e-11)


def test_each_lane_may_have_its_own_coefficients(rng):
    c, (s, t) = rng.normal(size=(4, 3, 6)), rng.uniform(-1, 1, size=(2, 6))
    ours = partials(jnp.asarray(c), s, t, 2)
    for k in range(6):
        for (i, j), expected in _numpy_partials(c[:, :, k], s[k], t[k], 2).items():
            np.testing.assert_allclose(float(ours[i][j][k]), expected, rtol=1e-12, atol=1e-12)


def test_no_kernel_turns_a_table(rng):
    """By two of XLA's emitters a contact that did was wrong (jaxlib 0.10.2)."""
    c, (s, t) = rng.normal(size=(4, 3)), rng.uniform(-1, 1, size=(2, 6))
    lowered = jax.jit(partials, static_argnums=3).lower(c, s, t, 2)
    assert "stablehlo.transpose" not in lowered.as_text()


@pytest.mark.parametrize("order", range(5))
def test_derivatives_equal_central_differences(order, rng, central_difference):
    c, s, t = rng.normal(size=(5, 5)), 0.3, -0.6

    def flat(c, s, t):
        return jnp.stack([x for row in partials(c, s, t, order) for x in row])

    exact = jax.jit(jax.jacfwd(flat, argnums=(0, 1, 2)))(c, s, t)
    size = 1.0 + np.abs(np.asarray(flat(c, s, t)))
    for place, x in enumerate((c, s, t)):
        arguments = [c, s, t]

        def moved(y, place=place, arguments=arguments):
            return flat(*arguments[:place], jnp.asarray(y), *arguments[place + 1 :])

        wanted = central_difference(moved, x)
        wide = size.reshape((-1,) + (1,) * (wanted.ndim - 1))
        np.testing.assert_allclose(np.asarray(exact[place]) / wide, wanted / wide, atol=1e-6)


def test_reverse_and_forward_derivatives_agree_to_the_third_order(rng):
    c = jnp.asarray(rng.normal(size=(5, 4)))

    def value(x):
        return partials(c, x[0], x[1], 0)[0][0]

    x = jnp.array([0.2, -0.5])
    third = jax.jacfwd(jax.jacrev(jax.grad(value)))(x)
    d = partials(c, *x, 3)
    np.testing.assert_allclose(float(third[0, 0, 1]), float(d[2][1]), rtol=1e-12)
    np.testing.assert_allclose(float(third[1, 1, 1]), float(d[0][3]), rtol=1e-12)
    np.testing.assert_allclose(float(third[0, 0, 0]), float(d[3][0]), rtol=1e-12)


def test_a_polynomial_is_linear_in_its_coefficients(rng):
    c, s, t = rng.normal(size=(3, 4)), 0.4, 0.7
    slope = jax.grad(lambda c: partials(c, s, t, 0)[0][0])(jnp.asarray(c))
    np.testing.assert_allclose(np.asarray(slope), np.outer(s ** np.arange(3), t ** np.arange(4)))


def test_derivatives_beyond_the_degree_are_known_zeros(rng):
    """The number 0.0, of which nothing is compiled; also where a derivative is taken of others."""
    c, s, t = rng.normal(size=(3, 2)), 0.4, 0.7

    def moved(s):
        d = partials(c, s, t, 3)
        beyond = [(i, j) for i in range(4) for j in range(4 - i) if isinstance(d[i][j], float)]
        assert beyond == [(0, 2), (0, 3), (1, 2), (3, 0)]
        return d[2][1]

    assert float(jax.grad(moved)(s)) == 0.0
