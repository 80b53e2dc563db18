"""The ligament law: published values, the smooth law's order, energy, tension and stiffness."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kneejax.mechanics import ligament_law as law
from tests.mechanics.published_laws import exact_energy, exact_stiffness

K, TOE, WIDTH, L0 = 3000.0, 0.06, 0.002, 30.0
STRAINS = np.array([-0.1, -0.01, 0.0, 0.01, 0.03, 0.06, 0.08, 0.1])

per_strain = jax.jit(jax.vmap(jax.grad(law.energy), (0, None, None, None, None)))


@pytest.mark.parametrize(
    ("toe", "expected"),
    [
        (0.06, {-0.1: 0, 0.0: 0, 0.01: 1.6667, 0.03: 15, 0.06: 60, 0.08: 100}),
        (0.03, {-0.1: 0, 0.0: 0, 0.01: 3.3333, 0.03: 30, 0.06: 90, 0.08: 130}),
    ],
)
def test_the_published_law_has_the_published_values(toe, expected):
    for strain, tension in expected.items():
        assert float(law.exact_tension(strain, 2000.0, toe)) == pytest.approx(tension, abs=5e-5)


def test_the_published_energy_has_the_values_of_its_closed_form():
    low = TOE / 2
    for strain, per_length in (
        (-0.05, 0.0),
        (0.02, 0.02**3 / (12 * low)),
        (TOE, TOE**3 / (12 * low)),
        (0.1, (0.1 - low) ** 2 / 2 + low**2 / 6),
    ):
        ours = float(exact_energy(strain, K, TOE, L0))
        assert ours == pytest.approx(K * L0 * per_length, rel=1e-13)


@pytest.mark.parametrize("corner", [0.0, TOE])
def test_the_published_law_is_continuous_with_its_slope_at_the_corners(corner):
    step = 1e-9
    for function, scale in (
        (lambda e: exact_energy(e, K, TOE, L0), K * L0),
        (lambda e: law.exact_tension(e, K, TOE), K),
        (lambda e: exact_stiffness(e, K, TOE), K / TOE),
    ):
        jump = float(function(corner + step)) - float(function(corner - step))
        assert abs(jump) < 2.1 * step * scale


def test_published_energy_tension_and_stiffness_are_derivatives_of_each_other():
    energy_slope = jax.vmap(jax.grad(lambda e: exact_energy(e, K, TOE, L0)))(STRAINS)
    np.testing.assert_allclose(
        np.asarray(energy_slope) / L0, np.asarray(law.exact_tension(STRAINS, K, TOE)), atol=1e-10
    )
    away = STRAINS[(STRAINS != 0.0) & (STRAINS != TOE)]
    slope = jax.vmap(jax.grad(lambda e: law.exact_tension(e, K, TOE)))(away)
    np.testing.assert_allclose(
        np.asarray(slope), np.asarray(exact_stiffness(away, K, TOE)), atol=1e-9
    )


@pytest.mark.parametrize("width", [1e-4, WIDTH, 0.02])
def test_the_smooth_energy_has_the_tension_as_its_slope(width, central_difference):
    tension = np.asarray(law.tension(STRAINS, K, TOE, width))
    slope = np.asarray(per_strain(STRAINS, K, TOE, width, L0)) / L0
    np.testing.assert_allclose(slope, tension, rtol=1e-12, atol=1e-12 * K)
    for strain, expected in zip(STRAINS, tension, strict=True):
        numeric = central_difference(lambda e: law.energy(e, K, TOE, width, L0), strain, 1e-5)
        assert numeric / L0 == pytest.approx(expected, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("width", [1e-4, WIDTH, 0.02])
def test_the_smooth_tension_has_the_stiffness_as_its_slope(width, central_difference):
    stiffness = np.asarray(law.stiffness_at(STRAINS, K, TOE, width))
    slope = jax.vmap(jax.grad(law.tension), (0, None, None, None))(STRAINS, K, TOE, width)
    np.testing.assert_allclose(np.asarray(slope), stiffness, rtol=1e-12, atol=1e-12 * K)
    for strain, expected in zip(STRAINS, stiffness, strict=True):
        numeric = central_difference(lambda e: law.tension(e, K, TOE, width), strain, 1e-5)
        assert float(numeric) == pytest.approx(expected, rel=1e-6, abs=1e-6 * K)


def test_the_smooth_law_reaches_the_published_one_with_the_square_of_its_width(slope_on_log_axes):
    strain = jnp.linspace(-0.1, 0.15, 2001)
    widths = np.array([4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4, 1.25e-4])
    exact = law.exact_tension(strain, K, TOE)
    error = [float(jnp.abs(law.tension(strain, K, TOE, w) - exact).max()) for w in widths]
    order = slope_on_log_axes(widths, error)
    assert 1.7 < order < 2.0
    # Without the logarithm of the estimate the order is two.
    factor = 0.5 + np.log(TOE / widths)
    assert slope_on_log_axes(widths, error / factor) == pytest.approx(2.0, abs=0.01)
    predicted = K * widths**2 / (2 * TOE) * factor
    np.testing.assert_allclose(error, predicted, rtol=0.01)


@given(st.floats(500.0, 9000.0), st.floats(0.02, 0.1), st.floats(1e-4, 0.01))
def test_the_largest_tension_error_is_nowhere_exceeded_and_somewhere_reached(k, toe, width):
    strain = jnp.linspace(-0.5 * toe, 1.5 * toe, 2001)
    gap = jnp.abs(law.tension(strain, k, toe, width) - law.exact_tension(strain, k, toe))
    stated = float(law.largest_tension_error(k, toe, width))
    assert float(gap.max()) <= stated * (1 + 1e-9)
    assert float(gap.max()) == pytest.approx(stated, rel=1e-9)


def test_a_slack_fibre_has_a_small_positive_tension_that_grows():
    tension = np.asarray(law.tension(jnp.array([-0.1, -0.05, -0.01, 0.0]), K, TOE, WIDTH))
    assert (tension > 0).all() and (np.diff(tension) > 0).all()
    assert tension[-1] < float(law.largest_tension_error(K, TOE, WIDTH))


@pytest.mark.parametrize("strain", [0.0, TOE])
def test_the_smooth_law_has_finite_derivatives_of_high_order_at_its_corners(strain):
    function = law.tension
    for _ in range(4):
        function = jax.grad(function)
        assert np.isfinite(float(function(strain, K, TOE, WIDTH)))


def test_the_smooth_law_is_differentiable_by_each_of_its_numbers(central_difference):
    x = np.array([0.02, K, TOE, WIDTH])
    exact = np.asarray(jax.jacfwd(lambda y: law.tension(*y))(x))
    relative = jax.jit(lambda y: law.tension(*(jnp.asarray(y) * x)))
    numeric = central_difference(relative, np.ones(4), 1e-4)
    np.testing.assert_allclose(exact * x, numeric, rtol=1e-6, atol=1e-6)


@given(st.floats(20.0, 90.0), st.floats(-0.25, 0.25))
def test_a_slack_length_from_a_strain_gives_that_strain_back(length, strain):
    slack = float(law.slack_length_from_strain(length, strain))
    assert length / slack - 1.0 == pytest.approx(strain, abs=1e-13)


@given(st.floats(0.5, 400.0), st.floats(600.0, 9000.0), st.floats(0.02, 0.1), st.floats(1e-4, 4e-3))
def test_a_slack_length_from_a_force_gives_that_force_back(force, k, toe, width):
    slack = law.slack_length_from_force(32.0, force, k, toe, width)
    tension = law.tension(32.0 / slack - 1.0, k, toe, width)
    assert float(tension) == pytest.approx(force, rel=1e-9)


def test_a_slack_length_from_a_force_is_differentiable(central_difference):
    x = np.array([32.0, 40.0, K, TOE, WIDTH])
    exact = np.asarray(jax.jit(jax.jacrev(lambda y: law.slack_length_from_force(*y)))(x))
    relative = jax.jit(lambda y: law.slack_length_from_force(*(jnp.asarray(y) * x)))
    numeric = central_difference(relative, np.ones(5), 1e-4)
    np.testing.assert_allclose(exact * x, numeric, rtol=1e-6, atol=1e-7)


def test_a_weak_reference_force_still_finds_its_slack_length():
    # Below the smooth law's own tension at zero strain the fibre is slack at the reference pose.
    threshold = float(law.tension(0.0, K, TOE, WIDTH))
    for force in (2.0 * threshold, threshold, 0.5 * threshold):
        slack = law.slack_length_from_force(32.0, force, K, TOE, WIDTH)
        tension = float(law.tension(32.0 / slack - 1.0, K, TOE, WIDTH))
        assert tension == pytest.approx(force, rel=1e-9)
