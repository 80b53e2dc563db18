"""Pressure laws of a layer, per point and over an elliptical patch."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad

from kneejax.mechanics import cartilage_law as law
from tests.mechanics.published_laws import patch_force

K, H = 5.0 * 0.55 / (1.45 * 0.1), 6.0
R = np.sqrt(30.0 * 20.0)
# Depth in mm -> resultant in N for the linear, log and ratio laws.
TABLE = {
    0.1: (2.432, 2.446, 2.460),
    0.5: (60.811, 62.574, 64.415),
    1.0: (243.242, 258.009, 274.171),
    2.0: (972.97, 1103.75, 1263.28),
}
every_law = pytest.mark.parametrize("name", law.LAWS)

PRESSURE = {
    "linear": lambda s: s,
    "log": lambda s: -np.log1p(-s),
    "ratio": lambda s: s / (1 - s),
}
ENERGY = {
    "linear": lambda s: s * s / 2,
    "log": lambda s: (1 - s) * np.log1p(-s) + s,
    "ratio": lambda s: -(s + np.log1p(-s)),
}


def test_the_confined_modulus_has_its_published_values():
    assert float(law.confined_modulus(5.0, 0.45)) == pytest.approx(18.9655, abs=5e-5)
    assert float(law.confined_modulus(10.0, 0.45)) == pytest.approx(37.931, abs=5e-4)


@every_law
@pytest.mark.parametrize("depth", TABLE)
def test_the_patch_force_has_the_tabulated_values(name, depth):
    expected = TABLE[depth][law.LAWS.index(name)]
    force = np.pi * K * 2.0 * depth * R * float(patch_force(name, depth / H))
    assert force == pytest.approx(expected, abs=5e-4 if expected < 900 else 5e-3)


@every_law
def test_pressure_and_energy_have_their_closed_forms(name):
    s = np.linspace(0.001, 0.95, 40)
    np.testing.assert_allclose(np.asarray(law.relative_pressure(name, s)), PRESSURE[name](s))
    np.testing.assert_allclose(
        np.asarray(law.relative_energy(name, s)), ENERGY[name](s), rtol=1e-9
    )


@every_law
def test_the_slope_of_the_energy_is_the_pressure(name, central_difference):
    s = jnp.array([0.0, 1e-6, 0.01, 0.0399, 0.0401, 0.3, 0.8])
    slope = jax.vmap(jax.grad(lambda x: law.relative_energy(name, x)))(s)
    pressure = np.asarray(law.relative_pressure(name, s))
    np.testing.assert_allclose(np.asarray(slope), pressure, rtol=1e-12, atol=1e-14)
    for x, expected in zip(s, pressure, strict=True):
        numeric = central_difference(lambda y: law.relative_energy(name, y), float(x), 1e-3)
        assert float(numeric) == pytest.approx(expected, abs=1e-6)


@every_law
@pytest.mark.parametrize("c", [1e-4, 0.02, 0.039, 0.041, 0.3, 0.9])
def test_patch_energy_and_force_are_means_over_the_patch(name, c):
    # Over the patch the depth is evenly spread between zero and its largest value.
    energy, _ = quad(lambda s: ENERGY[name](s) if s > 1e-3 else s * s / 2 * (1 + s / 3), 0, c)
    force, _ = quad(PRESSURE[name], 0, c, epsabs=0)
    tolerance = 1e-3 if c < 1e-3 else 1e-6
    assert float(law.patch_energy(name, c)) == pytest.approx(energy, rel=tolerance)
    assert float(patch_force(name, c)) == pytest.approx(force / c, rel=1e-9)


@every_law
def test_the_resultant_is_the_slope_of_the_patchs_energy_by_depth(name, central_difference):
    def energy(d):
        return K * H * H * jnp.pi * 2.0 * R * law.patch_energy(name, d / H)

    def force(d):
        return np.pi * K * 2.0 * d * R * float(patch_force(name, d / H))

    for depth in (0.01, 0.1, 0.239, 0.241, 1.0, 3.0, 5.0):
        slope = float(jax.grad(energy)(depth))
        assert slope == pytest.approx(force(depth), rel=1e-12)
        numeric = float(central_difference(energy, depth, 1e-3))
        assert numeric == pytest.approx(force(depth), rel=1e-6)


@pytest.mark.parametrize("name", ["log", "ratio"])
@pytest.mark.parametrize("over_patch", [False, True])
def test_series_and_closed_form_agree_at_the_switch_with_two_derivatives(name, over_patch):
    def series(c):
        return law._series(c, name, over_patch)

    def closed(c):
        return law._closed(c, name, over_patch)

    for c in (law._SERIES_BELOW, 1.1 * law._SERIES_BELOW):
        for order in range(3):
            left, right = series, closed
            for _ in range(order):
                left, right = jax.grad(left), jax.grad(right)
            assert float(left(c)) == pytest.approx(float(right(c)), abs=1e-12)


@every_law
def test_all_derivatives_are_finite_at_zero_depth(name):
    for function in (law.relative_pressure, law.relative_energy, law.patch_energy, patch_force):
        slope = jax.grad(lambda s, f=function: f(name, s))
        assert np.isfinite(float(slope(0.0)))
        assert float(function(name, 0.0)) == 0.0
    assert float(jax.grad(jax.grad(lambda s: law.relative_energy(name, s)))(0.0)) == 1.0
    third = jax.grad(jax.grad(jax.grad(lambda s: law.patch_energy(name, s))))
    assert float(third(0.0)) == 1.0
    assert float(jax.grad(lambda s: patch_force(name, s))(0.0)) == 0.5


@pytest.mark.parametrize("name", ["log", "ratio"])
@pytest.mark.parametrize("s", [1.0, 1.5, np.nan])
def test_beyond_the_layer_there_is_no_value(name, s):
    for function in (
        law.relative_pressure, law.relative_energy, law.patch_energy, patch_force
    ):
        assert np.isnan(float(function(name, s)))


def test_the_linear_law_has_values_beyond_the_layer_and_one_bad_lane_stays_alone():
    assert float(law.relative_pressure("linear", 1.5)) == 1.5
    values = np.asarray(law.patch_energy("log", jnp.array([0.1, 1.2, 0.5])))
    assert np.isfinite(values[[0, 2]]).all() and np.isnan(values[1])
    slopes = jax.vmap(jax.grad(lambda s: law.patch_energy("log", s)))(jnp.array([0.1, 1.2, 0.5]))
    assert np.isfinite(np.asarray(slopes)[[0, 2]]).all()


def test_laws_order_by_hardness_and_agree_when_shallow():
    s = jnp.linspace(0.01, 0.9, 30)
    linear, log, ratio = (np.asarray(law.relative_pressure(name, s)) for name in law.LAWS)
    assert (linear < log).all() and (log < ratio).all()
    shallow = [float(patch_force(name, 1e-6)) for name in law.LAWS]
    np.testing.assert_allclose(shallow, shallow[0], rtol=1e-6)
