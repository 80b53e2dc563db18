"""Analytic surfaces: level, normals, jets, heights and curvatures."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import kneejax.geometry as geo
from kneejax.geometry import Surface

ANGLE, WIDTH = np.deg2rad([10.0, 170.0]), (-12.0, 10.0)


def condyle():
    c = np.random.default_rng(1).normal(size=(5, 5)) * 0.3
    c[0, 0] = 24.0
    return geo.Condyle(c, ANGLE, WIDTH)


def plateau():
    c = np.random.default_rng(2).normal(size=(5, 4)) * 0.4
    return geo.Plateau(c, (-20.0, 15.0), (-12.0, 14.0))


SURFACES = {
    "plane": geo.Plane(half_extent=(20.0, 15.0)),
    "sphere": geo.Sphere(23.0),
    "ellipsoid": geo.Ellipsoid((27.0, 22.0, 15.0)),
    "condyle": condyle(),
    "plateau": plateau(),
}
every_surface = pytest.mark.parametrize("name", SURFACES)


jet_of = jax.jit(geo.jet)
normal_of = jax.jit(geo.normal)
curvatures_of = jax.jit(geo.principal_curvatures)
area_of = jax.jit(geo.area_element)
generic_jet = jax.jit(lambda surface, a, b: Surface.jet(surface, a, b, 3))
generic_height = jax.jit(Surface.height)
height_of = jax.jit(lambda surface, point: surface.height(point))
level_of = jax.jit(lambda surface, point: surface.level(point))
point_on = jax.jit(lambda surface, a, b: surface.point(a, b).full())
gradient_of = jax.jit(jax.grad(lambda surface, point: jnp.sum(surface.level(point)), 1))


def parameters(surface, count=9):
    """Random parameters well inside the region."""
    rng = np.random.default_rng(5)
    (la, ua), (lb, ub) = surface.bounds()
    a, b = rng.uniform(0.1, 0.9, size=(2, count))
    return jnp.asarray(la + a * (ua - la)), jnp.asarray(lb + b * (ub - lb))


def numbers(vector, like=0.0):
    """Components as rows, broadcast to the shape of `like`."""
    return np.array([np.asarray(c) + 0.0 * np.asarray(like) for c in vector.full()])


@every_surface
def test_the_level_vanishes_on_the_surface_with_unit_gradient(name):
    surface = SURFACES[name]
    point = point_on(surface, *parameters(surface))
    np.testing.assert_allclose(np.asarray(level_of(surface, point)), 0.0, atol=1e-12)
    gradient = numbers(gradient_of(surface, point))
    np.testing.assert_allclose(np.linalg.norm(gradient, axis=0), 1.0, atol=1e-12)


@every_surface
def test_normals_are_unit_point_outwards_and_are_the_gradient_of_the_level(name):
    surface = SURFACES[name]
    a, b = parameters(surface)
    point, normal = point_on(surface, a, b), normal_of(surface, a, b)
    np.testing.assert_allclose(np.linalg.norm(numbers(normal), axis=0), 1.0, atol=1e-12)
    gradient = numbers(gradient_of(surface, point))
    np.testing.assert_allclose(numbers(normal), gradient, atol=1e-11)
    out = level_of(surface, point + 0.01 * normal)
    into = level_of(surface, point - 0.01 * normal)
    assert (np.asarray(out) > 0).all() and (np.asarray(into) < 0).all()
    assert (np.asarray(surface.outwards(point) @ normal) > 0).all()


@every_surface
def test_the_jet_equals_central_differences_of_the_point(name, central_difference):
    surface = SURFACES[name]
    a, b = parameters(surface, 1)
    jet = jet_of(surface, a[0], b[0])

    def point(x):
        return numbers(point_on(surface, jnp.asarray(x[0]), jnp.asarray(x[1])))

    def slopes(x):
        return central_difference(point, x)

    x = np.array([float(a[0]), float(b[0])])
    np.testing.assert_allclose(numbers(jet.vector(jet.point)), point(x), atol=1e-12)
    first, second = slopes(x), central_difference(slopes, x)
    for ours, theirs in (
        (jet.a, first[:, 0]),
        (jet.b, first[:, 1]),
        (jet.aa, second[:, 0, 0]),
        (jet.ab, second[:, 0, 1]),
        (jet.bb, second[:, 1, 1]),
    ):
        np.testing.assert_allclose(numbers(jet.vector(ours)), theirs, atol=1e-6)


def test_the_condyles_own_jet_equals_the_generic_one():
    surface = SURFACES["condyle"]
    a, b = parameters(surface)
    own, generic = jet_to_third_order(surface, a, b), generic_jet(surface, a, b)
    for of in (*FIRST_AND_SECOND, *THIRD):
        np.testing.assert_allclose(
            numbers(own.vector(of(own)), a), numbers(generic.vector(of(generic)), a), atol=1e-10
        )


FIRST_AND_SECOND = [
    lambda jet, field=field: getattr(jet, field) for field in ("point", "a", "b", "aa", "ab", "bb")
]
THIRD = [lambda jet, k=k: jet.third[k] for k in range(4)]
jet_to_third_order = jax.jit(lambda surface, a, b: surface.jet(a, b, 3))


@pytest.mark.parametrize("name", ["plateau", "ellipsoid"])
def test_third_derivatives_of_a_jet_equal_central_differences_of_the_second(
    name, central_difference
):
    surface = SURFACES[name]
    a, b = (x[:1] for x in parameters(surface, 1))
    jet = jet_to_third_order(surface, a, b)

    def second(shift):
        there = jet_to_third_order(surface, a + shift[0], b + shift[1])
        return np.array([numbers(there.vector(x), a)[:, 0] for x in (there.aa, there.ab, there.bb)])

    numeric = central_difference(second, np.zeros(2), 1e-3)
    aaa, aab, abb, bbb = (numbers(jet.vector(x), a)[:, 0] for x in jet.third)
    expected = np.array([[aaa, aab], [aab, abb], [abb, bbb]]).transpose(0, 2, 1)
    np.testing.assert_allclose(numeric, expected, atol=1e-7)


@pytest.mark.parametrize("name", ["plateau", "ellipsoid"])
def test_third_derivatives_of_a_height_equal_central_differences_of_the_hessian(
    name, central_difference
):
    surface = SURFACES[name]
    point = numbers(point_on(surface, *parameters(surface, 1)))[:, 0] + 0.3

    def hessian(x):
        rows = height_to_third_order(surface, geo.Vector(*(jnp.asarray(c) for c in x))).hessian
        return np.array([numbers(row, 0.0) for row in rows])

    third = height_to_third_order(surface, geo.Vector(*(jnp.asarray(c) for c in point))).third
    exact = np.array([[numbers(row, 0.0) for row in matrix] for matrix in third])
    numeric = central_difference(hessian, point, 1e-2)
    np.testing.assert_allclose(np.moveaxis(exact, 0, -1), numeric, atol=1e-7)


height_to_third_order = jax.jit(lambda surface, point: surface.height(point, 3))


def test_basis_of_the_condyles_jet_is_orthonormal():
    surface = SURFACES["condyle"]
    jet = jet_of(surface, *parameters(surface, 1))
    basis = np.array([numbers(e, np.zeros(1))[:, 0] for e in jet.basis])
    np.testing.assert_allclose(basis @ basis.T, np.eye(3), atol=1e-14)


@pytest.mark.parametrize("name", ["plateau", "plane"])
def test_a_height_that_is_written_out_differs_from_the_generic_one_by_a_factor(name):
    surface = SURFACES[name]
    on = point_on(surface, *parameters(surface))
    own, generic = height_of(surface, on), generic_height(surface, on)
    gradient = numbers(own.gradient, on[0])
    np.testing.assert_allclose(np.asarray(own.value), 0.0, atol=1e-12)
    unit = gradient / np.linalg.norm(gradient, axis=0)
    np.testing.assert_allclose(unit, numbers(generic.gradient), atol=1e-11)


def test_the_plateaus_height_has_the_derivatives_of_its_value():
    surface = SURFACES["plateau"]
    a, b = parameters(surface)
    point = geo.Vector(a, surface.point(a, b)[1] + 0.4, b)

    def value(p):
        return jnp.sum(surface.height(p).value)

    own = height_of(surface, point)
    gradient = jax.grad(value)(point)
    np.testing.assert_allclose(numbers(own.gradient, a), numbers(gradient), atol=1e-12)
    one, zero = jnp.ones_like(a), jnp.zeros_like(a)
    for row, direction in enumerate(((one, zero, zero), (zero, one, zero), (zero, zero, one))):
        _, expected = jax.jvp(jax.grad(value), (point,), (geo.Vector(*direction),))
        np.testing.assert_allclose(numbers(own.hessian[row], a), numbers(expected), atol=1e-12)


@pytest.mark.parametrize("name", ["sphere", "ellipsoid", "condyle"])
def test_the_generic_height_equals_central_differences_of_the_level(name, central_difference):
    surface = SURFACES[name]
    point = numbers(point_on(surface, *parameters(surface, 1)))[:, 0] + 0.3

    def level(x):
        return np.asarray(level_of(surface, geo.Vector(*(jnp.asarray(c) for c in x))))

    def gradient(x):
        return numbers(height_of(surface, geo.Vector(*(jnp.asarray(c) for c in x))).gradient)

    height = height_of(surface, geo.Vector(*(jnp.asarray(c) for c in point)))
    np.testing.assert_allclose(
        numbers(height.gradient), central_difference(level, point), atol=1e-8
    )
    hessian = np.array([numbers(row) for row in height.hessian])
    np.testing.assert_allclose(hessian, central_difference(gradient, point), atol=1e-8)
    np.testing.assert_allclose(hessian, hessian.T, atol=1e-12)


def curvatures(surface, a, b):
    return [float(k) for k in curvatures_of(surface, a, b)]


def test_a_sphere_has_the_curvature_of_its_radius_everywhere():
    a, b = parameters(SURFACES["sphere"])
    for k in curvatures_of(SURFACES["sphere"], a, b):
        np.testing.assert_allclose(np.asarray(k), 1 / 23.0, rtol=1e-6)


def test_an_ellipsoid_has_its_closed_curvatures_at_its_poles():
    x, y, z = 27.0, 22.0, 15.0
    surface = SURFACES["ellipsoid"]
    anterior, distal = curvatures(surface, 0.0, 0.0), curvatures(surface, 0.5 * np.pi, 0.0)
    np.testing.assert_allclose(anterior, sorted([x / y**2, x / z**2], reverse=True), rtol=1e-12)
    np.testing.assert_allclose(distal, sorted([y / x**2, y / z**2], reverse=True), rtol=1e-12)


def test_the_gauss_curvature_of_an_ellipsoid_is_its_closed_form_everywhere():
    semi = np.array([27.0, 22.0, 15.0])
    a, b = parameters(SURFACES["ellipsoid"])
    k1, k2 = curvatures_of(SURFACES["ellipsoid"], a, b)
    point = numbers(SURFACES["ellipsoid"].point(a, b))
    q = (point**2 / semi[:, None] ** 4).sum(axis=0)
    np.testing.assert_allclose(np.asarray(k1 * k2), 1 / (np.prod(semi**2) * q**2), rtol=1e-10)


def test_a_condyle_of_constant_radius_is_a_cylinder():
    surface = geo.Condyle([[22.0]], ANGLE, WIDTH)
    a, b = parameters(surface)
    k1, k2 = curvatures_of(surface, a, b)
    np.testing.assert_allclose(np.asarray(k1), 1 / 22.0, rtol=1e-12)
    np.testing.assert_allclose(np.asarray(k2), 0.0, atol=1e-9)


def test_a_paraboloid_plateau_has_its_curvatures_at_the_bottom_and_is_hollow():
    # y = x^2 / 80 + z^2 / 60 over +-20 by +-15 mm.
    surface = geo.Plateau(
        [[0, 0, 15**2 / 60], [0, 0, 0], [20**2 / 80, 0, 0]], (-20, 20), (-15, 15)
    )
    np.testing.assert_allclose(curvatures(surface, 0.0, 0.0), [-1 / 40, -1 / 30], rtol=1e-12)


def test_a_plane_has_no_curvature_and_a_unit_area():
    a, b = parameters(SURFACES["plane"])
    for k in curvatures_of(SURFACES["plane"], a, b):
        np.testing.assert_allclose(np.asarray(k), 0.0, atol=1e-15)
    np.testing.assert_allclose(np.asarray(area_of(SURFACES["plane"], a, b)), 1.0)


def test_the_area_element_of_a_sphere_sums_to_its_area():
    nodes, weights = np.polynomial.legendre.leggauss(20)
    b = 0.5 * np.pi * nodes
    area = area_of(geo.Sphere(7.0), np.zeros_like(b), b)
    total = 2 * np.pi * 0.5 * np.pi * (weights * np.asarray(area)).sum()
    assert total == pytest.approx(4 * np.pi * 49.0, rel=1e-12)


@pytest.mark.parametrize("name", ["sphere", "ellipsoid"])
def test_the_first_guess_has_the_requested_normal(name):
    surface = SURFACES[name]
    direction = np.random.default_rng(3).normal(size=(3, 7))
    direction /= np.linalg.norm(direction, axis=0)
    a, b = surface.start(geo.Vector.of(jnp.asarray(direction)))
    np.testing.assert_allclose(numbers(normal_of(surface, a, b)), direction, atol=1e-9)


def test_the_first_guess_on_a_condyle_faces_the_requested_direction():
    direction = geo.Vector(*(jnp.asarray(x) for x in (np.cos(1.2), -np.sin(1.2), 0.0)))
    a, b = SURFACES["condyle"].start(direction)
    np.testing.assert_allclose([float(a), float(b)], [1.2, -1.0], atol=1e-12)


def test_angles_of_a_condyle_run_from_anterior_through_distal_to_posterior():
    surface = geo.Condyle([[20.0]], (0.0, np.pi), WIDTH)
    for angle, expected in ((0.0, (20, 0)), (0.5 * np.pi, (0, -20)), (np.pi, (-20, 0))):
        x, y, _ = surface.point(jnp.asarray(angle), jnp.asarray(0.0))
        np.testing.assert_allclose([float(x), float(y)], expected, atol=1e-12)


def across_the_border(name, distance):
    """Points on the border's surface and beyond it, at distances (mm) along the first parameter."""
    surface = SURFACES[name]
    (_, ua), (lb, ub) = surface.bounds()
    middle = 0.5 * (lb + ub)
    if name == "condyle":
        edge, angle = surface.radius(ua, middle), ua + distance / 25.0
        return edge * jnp.cos(angle), -edge * jnp.sin(angle), middle
    return ua + distance, surface.point(ua, middle)[1], middle


@pytest.mark.parametrize("name", ["condyle", "plateau"])
def test_beyond_its_region_a_polynomial_comes_to_rest(name):
    surface = SURFACES[name]
    near, far, farther = (
        float(level_of(surface, across_the_border(name, x))) for x in (1e-4, 20.0, 30.0)
    )
    assert abs(near) < 1e-4
    # What it rises or falls by is what its slope at the border gives in about 2 mm.
    slope = abs(float(level_of(surface, across_the_border(name, 1e-3)))) / 1e-3
    assert abs(far) < 3.0 * slope and abs(far - farther) < 0.01 * slope


@pytest.mark.parametrize("name", ["condyle", "plateau"])
def test_a_level_and_its_two_derivatives_go_smoothly_through_the_border(name):
    surface, steps = SURFACES[name], np.linspace(-0.2, 0.2, 401)
    level = np.array([float(level_of(surface, across_the_border(name, x))) for x in steps])
    bend = np.diff(level, 2) / (steps[1] - steps[0]) ** 2
    # A held edge would bend once, by its slope over one step: some hundred times as much.
    assert np.abs(np.diff(bend)).max() < 0.02 * max(np.abs(bend).max(), 0.01)


@every_surface
def test_inside_tells_the_known_region_from_the_rest(name):
    surface = SURFACES[name]
    (la, ua), (lb, ub) = surface.bounds()
    a, b = 0.5 * (la + ua), 0.5 * (lb + ub)
    assert bool(geo.inside(surface, a, b))
    assert not bool(geo.inside(surface, ua + 0.01, b))
    assert not bool(geo.inside(surface, a, lb - 0.01))
    near = la + 0.02 * (ua - la)
    assert bool(geo.inside(surface, near, b))
    assert not bool(geo.inside(surface, near, b, margin=0.05))
