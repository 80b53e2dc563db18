"""Cubic B-splines against SciPy's, their derivatives, and what surfaces make of them."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import BSpline

import kneejax.geometry as geo
from kneejax.geometry import CUBIC_SPLINE
from kneejax.geometry._bases import partials, table_partials

LIMITS = np.array([-1.0, 1.0])
# One program for each shape, where operation by operation would be a hundred small ones.
spline_partials = jax.jit(
    lambda c, s, t, order: table_partials(CUBIC_SPLINE, c, (s, t), (LIMITS, LIMITS), order),
    static_argnums=3,
)
point_of = jax.jit(lambda surface, a, b: surface.point(a, b).full())
level_of = jax.jit(lambda surface, point: surface.level(point))
# To the last bit alike: so no kernel of one may round otherwise than the other's.
UNFUSED = {"xla_disable_hlo_passes": "fusion,multi_output_fusion"}
slope_of = jax.jit(
    lambda surface, point: surface.level_and_slope(point), compiler_options=UNFUSED
)
bend_of = jax.jit(
    lambda surface, point: surface.level_slope_and_bend(point), compiler_options=UNFUSED
)
any_bend_of = jax.jit(geo.Surface.level_slope_and_bend)
jet_of = jax.jit(lambda surface, a, b: surface.jet(a, b, order=3))
covered = jax.jit(lambda surface, a, b, step: surface.covered(a, b, step))

PAIRS = [(i, j) for i in range(4) for j in range(4 - i)]


def knots(count):
    return -1.0 + 2.0 / count * np.arange(-3, count + 4)


def scipy_partial(c, s, t, i, j):
    def design(x, count, order):
        identity = np.eye(count + 3)
        spline = BSpline(knots(count), identity, 3)
        return (spline.derivative(order) if order else spline)(x)

    by_s, by_t = (design(x, n - 3, k) for x, n, k in zip((s, t), c.shape, (i, j), strict=True))
    return np.einsum("pi,ij,pj->p", by_s, c, by_t)


@pytest.mark.parametrize("shape", [(4, 4), (5, 9), (14, 9)])
def test_every_partial_derivative_agrees_with_scipy(shape, rng):
    c, (s, t) = rng.normal(size=shape), rng.uniform(-1, 1, (2, 40))
    d = spline_partials(jnp.asarray(c), jnp.asarray(s), jnp.asarray(t), 3)
    for i, j in PAIRS:
        expected = scipy_partial(c, s, t, i, j)
        np.testing.assert_allclose(d[i][j], expected, rtol=1e-10, atol=1e-10 * 10 ** (i + j))


def test_cubics_are_reproduced(rng):
    """A spline of any number of cells holds every polynomial of degree 3 in each variable."""
    power = rng.normal(size=(4, 4))
    grid = np.cos(np.pi * (np.arange(40) + 0.5) / 40)

    s, t = (x.ravel() for x in np.meshgrid(grid, grid))
    columns = np.stack(
        [
            np.asarray(spline_partials(jnp.asarray(c.reshape(8, 6)), s, t, 0)[0][0])
            for c in np.eye(48)
        ],
        axis=1,
    )
    target = np.polynomial.polynomial.polyval2d(s, t, power)
    control, *_ = np.linalg.lstsq(columns, target, rcond=None)
    a, b = rng.uniform(-1, 1, (2, 30))
    mine = spline_partials(jnp.asarray(control.reshape(8, 6)), jnp.asarray(a), jnp.asarray(b), 3)
    expected = partials(jnp.asarray(power), jnp.asarray(a), jnp.asarray(b), 3)
    for i, j in PAIRS:
        np.testing.assert_allclose(mine[i][j], expected[i][j], atol=1e-8)


@given(st.integers(1, 6), st.integers(0, 6), st.sampled_from([(0, 0), (1, 0), (0, 1)]))
def test_it_is_twice_continuously_differentiable_at_knots(count, knot, derivative):
    c = jnp.asarray(np.random.default_rng(count).normal(size=(count + 3, 5)))
    at = -1.0 + 2.0 * min(knot, count) / count
    i, j = derivative
    left, right = (spline_partials(c, jnp.array(at + e), jnp.array(0.3), 2) for e in (-1e-9, 1e-9))
    for more in range(2):
        np.testing.assert_allclose(left[i + more][j], right[i + more][j], rtol=1e-6, atol=1e-6)


def test_derivatives_through_it_agree_with_central_differences(rng, central_difference):
    c, point = rng.normal(size=(7, 6)), rng.uniform(-0.9, 0.9, 2)

    def table(flat, order):
        d = spline_partials(flat[2:].reshape(7, 6), flat[0], flat[1], order)
        return jnp.stack([x for row in d for x in row])

    @partial(jax.jit, static_argnums=1)
    def followed(flat, order):
        value, push = jax.linearize(lambda x: table(x, order), flat)
        (backward,) = jax.vmap(jax.linear_transpose(push, flat))(jnp.eye(value.size))
        return value, jax.vmap(push, out_axes=-1)(jnp.eye(flat.size)), backward

    x = np.r_[point, c.ravel()]
    for order in (0, 1, 2):
        _, forward, backward = followed(x, order)
        expected = central_difference(lambda y, o=order: followed(y, o)[0], x, 1e-4)
        np.testing.assert_allclose(forward, expected, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(backward, forward, rtol=1e-12, atol=1e-12)


def test_lanes_with_tables_of_their_own(rng):
    c, (s, t) = rng.normal(size=(6, 5, 3)), rng.uniform(-1, 1, (2, 8, 3))
    own = spline_partials(jnp.asarray(c), jnp.asarray(s), jnp.asarray(t), 2)
    mapped = jax.vmap(lambda *x: spline_partials(*x, 2), in_axes=(2, 1, 1), out_axes=1)(
        *(jnp.asarray(x) for x in (c, s, t))
    )
    shared = spline_partials(jnp.asarray(c[..., :1]), jnp.asarray(s), jnp.asarray(t), 2)
    for i, j in PAIRS[:3] + PAIRS[4:6] + PAIRS[7:8]:
        np.testing.assert_allclose(own[i][j], mapped[i][j], rtol=1e-12)
        for lane in range(3):
            alone = spline_partials(
                *(jnp.asarray(x[..., lane]) for x in (c, s, t)), 2
            )
            np.testing.assert_allclose(own[i][j][:, lane], alone[i][j], rtol=1e-12)
        np.testing.assert_allclose(shared[i][j][:, 0], own[i][j][:, 0], rtol=1e-12)


def test_a_lane_that_is_nan_or_far_away_disturbs_no_other(rng):
    c = jnp.asarray(rng.normal(size=(6, 5)))
    s = jnp.array([0.1, np.nan, np.inf, -1e30, 0.1])
    value = spline_partials(c, s, jnp.full(5, 0.2), 0)[0][0]
    assert np.isnan(value[1]) and value[0] == value[4] and np.isfinite(value[0])


def spline_condyle(rng, frame=None):
    c = 22.0 + 0.5 * rng.normal(size=(8, 6))
    return geo.Condyle(c, np.deg2rad([20, 200]), (-12.0, 12.0), frame, basis="cubic_spline")


def spline_plateau(rng, outline=None):
    c = 0.4 * rng.normal(size=(7, 6))
    frame = geo.Frame([0.0, -25.0, 0.0])
    return geo.Plateau(c, (-20, 22), (-11, 12), frame, basis="cubic_spline", outline=outline)


def test_level_and_jet_of_spline_surfaces_agree_with_their_points(rng, central_difference):
    for surface, low, high in (
        (spline_condyle(rng), (0.5, -11.0), (3.3, 11.0)),
        (spline_plateau(rng), (-19.0, -10.0), (21.0, 11.0)),
    ):
        a, b = (jnp.asarray(rng.uniform(lo, hi, 20)) for lo, hi in zip(low, high, strict=True))
        point = point_of(surface, a, b)
        np.testing.assert_allclose(level_of(surface, point), 0.0, atol=1e-9)
        np.testing.assert_allclose(slope_of(surface, point)[0], 0.0, atol=1e-9)
        local = jet_of(surface, a, b)
        for k in (0, 7):
            at = np.array([float(a[k]), float(b[k])])

            def place(x):
                return np.array(point_of(surface, x[0], x[1]))

            d = central_difference(place, at, 1e-4)
            along = [[float(c[k]) for c in local.vector(w).full()] for w in (local.a, local.b)]
            np.testing.assert_allclose(np.transpose(d), along, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("basis", ["cubic_spline", "power"])
def test_slope_and_bend_of_the_level_agree_with_central_differences_everywhere(
    basis, rng, central_difference
):
    surface = spline_condyle(rng)
    if basis == "power":
        c = np.array([[20.0, 0.3, -1.0], [-2.0, 0.4, 0.2], [1.0, -0.3, 0.1]])
        surface = geo.Condyle(c, surface.angle, surface.width)
    for point in ([5.0, -20.0, 3.0], [-18.0, -9.0, 15.0], [-18.0, -9.0, -15.0], [20.0, 6.0, 2.0]):
        def level(x):
            return np.asarray(slope_of(surface, geo.Vector(*x))[0])

        def slope(x):
            return np.stack([np.asarray(c) for c in slope_of(surface, geo.Vector(*x))[1]])

        x = np.array(point)
        value, by_place, bend = bend_of(surface, geo.Vector(*x))
        np.testing.assert_array_equal(value, level(x))
        np.testing.assert_array_equal(by_place.full(), slope(x))
        expected = central_difference(level, x, 1e-4)
        np.testing.assert_allclose(slope(x), expected, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(bend, central_difference(slope, x, 1e-3), rtol=1e-6, atol=1e-6)
        of_any = any_bend_of(surface, geo.Vector(*x))[2]
        np.testing.assert_allclose(of_any, bend, rtol=1e-10, atol=1e-12)


def test_beyond_its_width_a_spline_condyle_falls_and_never_rises(rng):
    surface = spline_condyle(rng)
    angle = jnp.linspace(0.5, 3.0, 9)
    for edge, outwards in zip((-12.0, 12.0), (-1.0, 1.0), strict=True):
        levels = [
            level_of(surface, (20 * jnp.cos(angle), -20 * jnp.sin(angle), edge + outwards * step))
            for step in (0.0, 1.0, 5.0, 40.0)
        ]
        for near, far in zip(levels, levels[1:], strict=False):
            assert (far >= near - 1e-12).all() and np.isfinite(far).all()


def test_an_outline_covers_its_own_area(rng):
    angle = np.linspace(0, 2 * np.pi, 61)[:-1]
    outline = np.stack([1 + 15 * np.cos(angle), 0.5 + 9 * np.sin(angle)], axis=1)
    plateau = spline_plateau(rng, outline)
    expected = 0.5 * abs(np.sum(
        outline[:, 0] * np.roll(outline[:, 1], -1) - np.roll(outline[:, 0], -1) * outline[:, 1]
    ))
    errors = []
    for count in (20, 40):
        step = 42.0 / count, 23.0 / count
        a = jnp.asarray(-20 + step[0] * (np.arange(count) + 0.5))
        b = jnp.asarray(-11 + step[1] * (np.arange(count) + 0.5))
        a, b = (x.ravel() for x in jnp.meshgrid(a, b, indexing="ij"))
        share = covered(plateau, a, b, step)
        assert ((share >= 0) & (share <= 1)).all()
        errors.append(abs(float(share.sum()) * step[0] * step[1] / expected - 1))
        # Lanes: every knee its own outline.
        lanes = geo.Plateau(
            plateau.coefficients[..., None], plateau.x[:, None], plateau.z[:, None],
            basis="cubic_spline", outline=jnp.stack([plateau.outline, plateau.outline + 1], -1),
        )
        both = covered(lanes, a[:, None], b[:, None], step)
        np.testing.assert_allclose(both[:, 0], share)
    assert max(errors) < 5e-3
    assert spline_plateau(rng).covered(a, b, step) == 1.0


@pytest.mark.parametrize("kind", [geo.Condyle, geo.Plateau])
def test_an_unknown_basis_and_a_small_table_are_refused(kind):
    with pytest.raises(ValueError, match="expected one of"):
        kind(np.ones((5, 5)), (0.0, 1.0), (0.0, 1.0), basis="cubic")
    with pytest.raises(ValueError, match="at least 4 x 4"):
        kind(np.ones((3, 5)), (0.0, 1.0), (0.0, 1.0), basis="cubic_spline")


def test_a_cell_half_a_cell_off_the_border_counts_nothing_whatever_rounds_it():
    """Compilers differ in the last digit; a share of 1e-13 would make a point one that touches."""
    rim = np.array([[-20.0, -10.0], [0.0, -10.0], [0.0, 10.0], [-20.0, 10.0]])
    plateau = geo.Plateau([[0.0]], (-20, 20), (-10, 10), outline=rim)
    a, b = jnp.array([0.5 - 1e-12, 0.5, 0.25]), jnp.zeros(3)
    share = plateau.covered(a, b, (1.0, 1.0))
    assert share[:2].tolist() == [0.0, 0.0] and float(share[2]) == pytest.approx(0.25)
