"""The angle of a point against NumPy's."""

import jax
import jax.numpy as jnp
import numpy as np

from kneejax.numerics._safe import arctan2


def test_the_angle_is_numpys_to_the_last_digits_all_around(rng):
    angle = rng.uniform(-np.pi, np.pi, 100_000)
    size = 10.0 ** rng.uniform(-6, 6, angle.size)
    y, x = size * np.sin(angle), size * np.cos(angle)
    np.testing.assert_allclose(jax.jit(arctan2)(y, x), np.arctan2(y, x), rtol=5e-16)


def test_on_the_axes_it_has_numpys_sides_and_at_the_origin_it_is_harmless():
    for y, x in ((0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0), (-1e-300, -1.0), (0.0, 0.0)):
        found = arctan2(jnp.asarray(y), jnp.asarray(x))
        np.testing.assert_allclose(found, np.arctan2(y, x), rtol=5e-16)
    assert jax.grad(arctan2, (0, 1))(0.0, 0.0) == (0.0, 0.0)


def test_its_derivatives_are_those_of_the_angle(rng, central_difference):
    for _ in range(4):
        point = rng.normal(size=2)
        exact = jax.grad(lambda p: arctan2(p[0], p[1]))(jnp.asarray(point))
        expected = central_difference(lambda p: np.arctan2(p[0], p[1]), point, 1e-3)
        np.testing.assert_allclose(exact, expected, rtol=1e-6, atol=1e-6)
        twice = jax.hessian(lambda p: arctan2(p[0], p[1]))(jnp.asarray(point))
        square = point @ point
        y, x = point
        closed = np.array([[-2 * x * y, y * y - x * x], [y * y - x * x, 2 * x * y]]) / square**2
        np.testing.assert_allclose(twice, closed, rtol=1e-12, atol=1e-12)
