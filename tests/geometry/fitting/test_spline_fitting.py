"""Smoothed splines recover surfaces, choose their smoothing, and stay calm between points."""

import numpy as np
import pytest

import kneejax.geometry as geo

X, Z = (-18.0, 18.0), (-11.0, 11.0)
REGION = (40.0, 200.0), (-11.0, 11.0)


def heights(x, z):
    return -25.0 + 0.008 * x * x + 0.3 * np.sin(x / 5.0) * np.cos(z / 4.0)


def radii(angle, z):
    return 22.0 + 1.5 * np.cos(angle) - 0.02 * z * z + 0.2 * np.sin(3.0 * angle)


def plateau_points(rng, count=4000):
    x, z = rng.uniform(*X, count), rng.uniform(*Z, count)
    return np.stack([x, heights(x, z), z], axis=1)


def condyle_points(rng, count=5000):
    angle, z = rng.uniform(*np.deg2rad(REGION[0]), count), rng.uniform(*REGION[1], count)
    r = radii(angle, z)
    return np.stack([r * np.cos(angle), -r * np.sin(angle), z], axis=1)


def test_a_plateau_and_a_condyle_are_recovered(rng):
    plateau = geo.fit_plateau_spline(plateau_points(rng), X, Z)
    condyle = geo.fit_condyle_spline(condyle_points(rng), *REGION)
    for fit in (plateau, condyle):
        assert fit.rms < 2e-3 and fit.maximum < 0.03
        assert fit.rms <= fit.held_out_rms < 0.01
        assert fit.cells == tuple(n - 3 for n in fit.surface.coefficients.shape)


def test_noise_is_smoothed_away_without_bias(rng):
    points = plateau_points(rng)
    noise = 0.05 * rng.normal(size=len(points))
    noisy = points + np.outer(noise, [0, 1, 0])
    fit = geo.fit_plateau_spline(noisy, X, Z, smoothing_mm=(0.3, 1.0, 2.0))
    true = fit.residual - noise
    assert fit.rms == pytest.approx(0.05, rel=0.1)
    assert np.sqrt(np.mean(true**2)) < 0.02  # a fifth of what the points suffer, and more
    assert abs(np.mean(true)) < 2e-3


def test_dense_corners_do_not_dominate_where_areas_are_given(rng):
    points = plateau_points(rng, 3000)
    dense = plateau_points(rng, 20000)
    dense = dense[dense[:, 0] > 9.0] + [0, 0.2, 0]  # dense, and 0.2 mm too high
    both = np.r_[points, dense]
    weights = np.r_[np.ones(len(points)), np.full(len(dense), 1e-3)]
    fit = geo.fit_plateau_spline(both, X, Z, weights=weights, cell_mm=4.5, smoothing_mm=0.2)
    assert np.abs(fit.residual[: len(points)].mean()) < 2e-3


def test_corners_without_points_stay_near_their_neighbours(rng):
    points = plateau_points(rng)
    inside = (points[:, 0] / 18) ** 2 + (points[:, 2] / 11) ** 2 < 0.9
    surface = geo.fit_plateau_spline(points[inside], X, Z).surface
    x, z = np.array([-18.0, 18, -18, 18]), np.array([-11.0, -11, 11, 11])
    corner = np.asarray(surface.point(x, z)[1])
    assert np.abs(corner - np.asarray(points[inside][:, 1]).mean()).max() < 3.0


def test_bends_finer_than_the_smoothing_are_lost(rng):
    points = plateau_points(rng)
    rough = [
        geo.fit_plateau_spline(points, X, Z, cell_mm=3.0, smoothing_mm=length).rms
        for length in (0.2, 2.0, 6.0)
    ]
    assert rough[0] < rough[1] < rough[2]


def test_too_few_points_are_an_error_that_says_how_many_are_needed(rng):
    with pytest.raises(ValueError, match="plateau: 3 points .* needs 16"):
        geo.fit_plateau_spline(plateau_points(rng, 3), X, Z)
    with pytest.raises(ValueError, match="condyle: 0 points .* needs 16"):
        geo.fit_condyle_spline(plateau_points(rng), (200.0, 220.0), REGION[1])
