"""Fits recover the surface that the points were taken from."""

import jax.numpy as jnp
import numpy as np
import pytest

import kneejax.geometry as geo

NOISE = 0.05
ANGLE, WIDTH = (20.0, 160.0), (-11.0, 11.0)


def body_points(surface, a, b):
    """Points of a surface in its bone's frame, shape `(n, 3)`."""
    place = surface.frame.placement
    return np.stack(place.apply(surface.point(jnp.asarray(a), jnp.asarray(b))).full(), axis=1)


def grid(first, second, count=14):
    a, b = np.meshgrid(np.linspace(*first, count), np.linspace(*second, count), indexing="ij")
    return a.ravel(), b.ravel()


def noisy(points, rng):
    return points + NOISE * rng.normal(size=points.shape)


def test_a_plane_is_recovered_with_its_tilt_and_its_size(rng):
    true = geo.Plane(geo.Frame([3.0, -30.0, 20.0], [0.06, 0.0, -0.12]))
    points = body_points(true, *grid((-15, 15), (-10, 10)))
    fit = geo.fit_plane(points)
    assert fit.maximum < 1e-12
    normal = fit.surface.frame.placement.turn((0.0, 1.0, 0.0))
    expected = true.frame.placement.turn((0.0, 1.0, 0.0))
    np.testing.assert_allclose(normal.full(), expected.full(), atol=1e-12)
    np.testing.assert_allclose(np.asarray(fit.surface.frame.origin), [3, -30, 20], atol=1e-12)
    np.testing.assert_allclose(np.asarray(fit.surface.half_extent), [15, 10], rtol=0.02)
    rough = geo.fit_plane(noisy(points, rng))
    assert rough.rms == pytest.approx(NOISE, rel=0.15)
    downwards = geo.fit_plane(points, up=(0, -1, 0)).surface.frame.placement.turn((0.0, 1.0, 0.0))
    np.testing.assert_allclose(downwards.full(), -np.array(expected.full()), atol=1e-12)


def test_a_sphere_is_recovered_from_a_cap(rng):
    true = geo.Sphere(22.0, geo.Frame([1.0, 2.0, 25.0]))
    points = body_points(true, *grid((0.5, 2.6), (-0.6, 0.6)))
    fit = geo.fit_sphere(points)
    assert fit.maximum < 1e-9
    assert float(fit.surface.radius) == pytest.approx(22.0, abs=1e-9)
    np.testing.assert_allclose(np.asarray(fit.surface.frame.origin), [1, 2, 25], atol=1e-9)
    rough = geo.fit_sphere(noisy(points, rng))
    assert rough.rms == pytest.approx(NOISE, rel=0.15)
    assert float(rough.surface.radius) == pytest.approx(22.0, abs=0.2)


@pytest.mark.long
@pytest.mark.parametrize("turned", [False, True])
def test_an_ellipsoid_is_recovered_with_its_turn(turned, rng):
    rotation = [0.1, -0.15, 0.2] if turned else None
    true = geo.Ellipsoid((26.0, 21.0, 14.0), geo.Frame([1.0, -2.0, 22.0], rotation))
    points = body_points(true, *grid((-0.5, 3.6), (-1.2, 1.2)))
    fit = geo.fit_ellipsoid(points, turned=turned)
    assert fit.maximum < 1e-8
    np.testing.assert_allclose(np.asarray(fit.surface.frame.origin), [1, -2, 22], atol=1e-7)
    np.testing.assert_allclose(
        np.sort(np.asarray(fit.surface.semi_axes)), [14, 21, 26], atol=1e-7
    )
    if not turned:
        return
    rough = geo.fit_ellipsoid(noisy(points, rng), turned=turned)
    assert rough.rms == pytest.approx(NOISE, rel=0.15)
    np.testing.assert_allclose(np.sort(np.asarray(rough.surface.semi_axes)), [14, 21, 26], atol=0.2)


def test_the_transverse_axis_of_a_tilted_cylinder_is_recovered(rng):
    true = geo.Condyle(
        [[21.0]], np.deg2rad(ANGLE), (-35.0, 35.0), geo.Frame([2.0, 1.0, 0.0], [0.05, -0.08, 0.0])
    )
    points = body_points(true, *grid(np.deg2rad(ANGLE), (-35, 35)))
    for cloud, close in ((points, 1e-7), (noisy(points, rng), 0.05)):
        axis = geo.fit_transverse_axis(cloud).placement
        direction = axis.turn((0.0, 0.0, 1.0)).full()
        expected = true.frame.placement.turn((0.0, 0.0, 1.0)).full()
        np.testing.assert_allclose(direction, expected, atol=close)
        np.testing.assert_allclose(axis.translation.full(), [2.0, 1.0, 0.0], atol=close)


def test_a_condyle_is_recovered_with_its_coefficients(rng):
    c = rng.normal(size=(5, 5)) * 0.3
    c[0, 0] = 22.0
    frame = geo.Frame([1.0, 2.0, 24.0], [0.02, 0.1, 0.0])
    true = geo.Condyle(c, np.deg2rad(ANGLE), WIDTH, frame)
    inner = np.deg2rad([ANGLE[0] + 0.1, ANGLE[1] - 0.1])
    points = body_points(true, *grid(inner, (-10.9, 10.9)))
    fit = geo.fit_condyle(points, ANGLE, WIDTH, frame=frame)
    np.testing.assert_allclose(np.asarray(fit.surface.coefficients), c, atol=1e-9)
    assert fit.maximum < 1e-9
    rough = geo.fit_condyle(noisy(points, rng), ANGLE, WIDTH, frame=frame)
    assert rough.rms == pytest.approx(NOISE, rel=0.2)
    probe = jnp.deg2rad(jnp.array([45.0, 90.0, 135.0]))
    np.testing.assert_allclose(
        np.asarray(rough.surface.radius(probe, 0.0 * probe)),
        np.asarray(true.radius(probe, 0.0 * probe)),
        atol=0.05,
    )


def test_the_total_degree_of_a_condyle_can_be_limited_as_in_paper_3(rng):
    c = rng.normal(size=(5, 5)) * 0.2
    i, j = np.indices(c.shape)
    c[i + j > 4] = 0.0
    c[0, 0] = 22.0
    true = geo.Condyle(c, np.deg2rad(ANGLE), WIDTH)
    points = body_points(true, *grid(np.deg2rad([21.0, 159.0]), (-10.9, 10.9)))
    fit = geo.fit_condyle(points, ANGLE, WIDTH, total_degree=4)
    np.testing.assert_allclose(np.asarray(fit.surface.coefficients), c, atol=1e-9)


def test_points_outside_the_region_of_a_condyle_are_left_out(rng):
    true = geo.Condyle([[22.0]], np.deg2rad(ANGLE), WIDTH)
    points = body_points(true, *grid(np.deg2rad([21.0, 159.0]), (-10.9, 10.9)))
    far = np.array([[0.0, -60.0, 0.0], [0.0, -22.0, 30.0], [0.0, 22.0, 0.0]])
    fit = geo.fit_condyle(np.r_[points, far[1:]], ANGLE, WIDTH, degree=(2, 2))
    assert len(fit.points) == len(points)
    assert fit.maximum < 1e-9


def test_a_plateau_is_recovered_with_its_coefficients(rng):
    c = rng.normal(size=(5, 5)) * 0.3
    i, j = np.indices(c.shape)
    c[i + j > 4] = 0.0
    frame = geo.Frame([0.0, -30.0, 22.0], [0.03, 0.0, -0.1])
    true = geo.Plateau(c, (-18.0, 20.0), (-11.0, 12.0), frame)
    points = body_points(true, *grid((-17.9, 19.9), (-10.9, 11.9), 20))
    fit = geo.fit_plateau(points, (-18.0, 20.0), (-11.0, 12.0), frame=frame)
    np.testing.assert_allclose(np.asarray(fit.surface.coefficients), c, atol=1e-9)
    assert fit.maximum < 1e-9
    # The corners are not part of a plateau.
    assert 0.7 < len(fit.points) / len(points) < 0.85
    rough = geo.fit_plateau(noisy(points, rng), (-18.0, 20.0), (-11.0, 12.0), frame=frame)
    assert rough.rms == pytest.approx(NOISE, rel=0.2)


def test_a_point_without_weight_does_not_count(rng):
    true = geo.Sphere(22.0)
    points = body_points(true, *grid((0.5, 2.6), (-0.6, 0.6)))
    spoiled = np.r_[points, [[0.0, -40.0, 0.0]]]
    weights = np.r_[np.ones(len(points)), 0.0]
    for fit, truth in ((geo.fit_sphere, points), (geo.fit_plane, points * [1, 0, 1])):
        cloud = np.r_[truth, spoiled[-1:]]
        assert fit(cloud, weights).rms < 1e-9


@pytest.mark.parametrize(
    ("fit", "least", "what"),
    [
        (geo.fit_plane, 3, "plane"),
        (geo.fit_sphere, 4, "sphere"),
        (geo.fit_ellipsoid, 9, "ellipsoid"),
        (geo.fit_transverse_axis, 6, "cylinder"),
    ],
)
def test_too_few_points_are_an_error_that_says_how_many_are_needed(fit, least, what, rng):
    with pytest.raises(ValueError, match=f"{what}: expected at least {least} points"):
        fit(rng.normal(size=(least - 1, 3)))
    with pytest.raises(ValueError, match=r"got shape \(12, 2\)"):
        fit(rng.normal(size=(12, 2)))
    spoiled = rng.normal(size=(12, 3))
    spoiled[3, 1] = np.nan
    with pytest.raises(ValueError, match="not finite"):
        fit(spoiled)


def test_too_few_points_in_a_region_are_an_error_that_counts_coefficients():
    few = np.array([[0.0, -22.0, z] for z in range(5)])
    with pytest.raises(ValueError, match="condyle: 5 points .* 25 coefficients"):
        geo.fit_condyle(few, ANGLE, WIDTH)
    with pytest.raises(ValueError, match="plateau: 5 points .* 15 coefficients"):
        geo.fit_plateau(few, (-10, 10), (-10, 10))
