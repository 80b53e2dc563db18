"""Paths around spheres and cylinders: closed forms, symmetries, limits, derivatives."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import kneejax.geometry as geo

WIDTH = 0.02
KINDS = {
    "sphere": geo.WrapSphere(12.0),
    "cylinder": geo.WrapCylinder(12.0, 60.0),
    "ellipsoid": geo.WrapEllipsoid([16.0, 11.0, 8.0]),
}
every_kind = pytest.mark.parametrize("kind", KINDS)
number = st.floats(-60.0, 60.0, allow_nan=False)
point = st.tuples(number, number, number)


# One program for each kind of obstacle and each shape of the ends.
taut = jax.jit(geo.taut)
path_points = jax.jit(geo.path_points, static_argnums=3)


@jax.jit
def path_of(obstacle, start, end):
    return geo.taut(obstacle, geo.Vector.of(start), geo.Vector.of(end), WIDTH)


def _array(vector):
    return np.stack([np.asarray(c) for c in vector])


def _length(obstacle, ends):
    return path_of(obstacle, ends[:3], ends[3:]).length


def _pulls(obstacle, ends):
    path = path_of(obstacle, ends[:3], ends[3:])
    return jnp.stack([*path.pull_start, *path.pull_end])


class ByEnds(NamedTuple):
    """Derivatives by the six coordinates of the ends.

    Attributes:
        length: of the length.
        forward: of the pulls, `(6, 6)`.
        reverse: the same in reverse mode.
        hessian: second ones of the length.
    """

    length: jax.Array
    forward: jax.Array
    reverse: jax.Array
    hessian: jax.Array


@jax.jit
def by_ends(obstacle, ends):
    def length(x):
        return _length(obstacle, x)

    def pulls(x):
        return _pulls(obstacle, x)

    return ByEnds(
        jax.grad(length)(ends),
        jax.jacfwd(pulls)(ends),
        jax.jacrev(pulls)(ends),
        jax.hessian(length)(ends),
    )


@jax.jit
def length_and_pulls(obstacle, size, ends):
    """Of an obstacle of another size: radius, or semi-axes."""
    _, *rest = jax.tree.leaves(obstacle)
    resized = jax.tree.unflatten(jax.tree.structure(obstacle), [size, *rest])
    return jnp.stack([_length(resized, ends), *_pulls(resized, ends)])


@jax.jit
def by_size(obstacle, ends):
    """Derivatives of `length_and_pulls` by the size, in both modes."""
    size = jax.tree.leaves(obstacle)[0]
    modes = (jax.jacfwd, jax.jacrev)
    return [mode(lambda x: length_and_pulls(obstacle, x, ends))(size) for mode in modes]


def _straight(start, end):
    return np.linalg.norm(np.asarray(end, float) - np.asarray(start, float))


def test_sphere_tangents_and_great_circle():
    radius, start, end = 10.0, np.array([-25.0, 3.0, 2.0]), np.array([18.0, 5.0, -4.0])
    path = path_of(geo.WrapSphere(radius), start, end)
    far = np.linalg.norm(start), np.linalg.norm(end)
    angle = np.arccos(start @ end / (far[0] * far[1]))
    angle -= np.arccos(radius / far[0]) + np.arccos(radius / far[1])
    length = radius * angle + sum(np.sqrt(d * d - radius**2) for d in far)
    assert path.length == pytest.approx(length, abs=1e-12)
    assert path.angle == pytest.approx(angle, abs=1e-14)
    assert np.linalg.norm(_array(path.leaves)) == pytest.approx(radius)
    assert _array(path.leaves) @ _array(path.pull_start) == pytest.approx(0.0, abs=1e-12)
    assert not path.inside and not path.beyond_ends


def test_cylinder_helix():
    """A quarter turn between points on the tangents: a helix and two lines of its slope."""
    radius, piece, rise = 10.0, 8.0, 30.0
    start, end = np.array([-radius, -piece, 0.0]), np.array([piece, radius, rise])
    path = path_of(geo.WrapCylinder(radius, 100.0), start, end)
    assert path.angle == pytest.approx(0.5 * np.pi)
    assert path.length == pytest.approx(np.hypot(0.5 * np.pi * radius + 2.0 * piece, rise))
    share = piece / (0.5 * np.pi * radius + 2.0 * piece)
    np.testing.assert_allclose(_array(path.leaves), [-radius, 0.0, rise * share], atol=1e-12)
    np.testing.assert_allclose(_array(path.side), [-np.sqrt(0.5), np.sqrt(0.5), 0.0], atol=1e-12)
    # Beside the cylinder the path runs along a generator of the unrolled plane.
    low = path_of(geo.WrapCylinder(radius, 10.0), start, end)
    assert low.beyond_ends and low.length == path.length


def test_free_is_exactly_straight():
    start, end = np.array([-30.0, 15.0, 1.0]), np.array([30.0, 14.0, 5.0])
    for obstacle in KINDS.values():
        if isinstance(obstacle, geo.WrapEllipsoid):
            start, end = start + [0, 5, 0], end + [0, 5, 0]
        path = path_of(obstacle, start, end)
        assert path.excess == 0.0 and path.angle < 0.0
        assert path.length == _straight(start, end)
        np.testing.assert_array_equal(_array(path.pull_end), (end - start) / path.length)
        np.testing.assert_array_equal(_array(path.leaves), _array(path.arrives))


@every_kind
def test_no_obstacle_left_as_it_shrinks(kind):
    start, end = np.array([-20.0, 0.5, 1.0]), np.array([22.0, -0.4, 4.0])
    shrunk = [jax.tree.map(lambda x, s=s: x * s, KINDS[kind]) for s in (1e-3, 1e-5)]
    excess = [float(path_of(o, start, end).excess) for o in shrunk]
    assert 0.0 <= excess[1] < 1e-4 and excess[0] < 1e-2


@every_kind
def test_exchanged_ends(kind):
    start, end = np.array([-20.0, 3.0, 4.0]), np.array([14.0, 5.0, -9.0])
    there, back = path_of(KINDS[kind], start, end), path_of(KINDS[kind], end, start)
    assert there.angle > 0.3
    assert there.length == pytest.approx(float(back.length), abs=2e-7)
    np.testing.assert_allclose(_array(there.pull_start), _array(back.pull_end), atol=3e-8)
    np.testing.assert_allclose(_array(there.leaves), _array(back.arrives), atol=1e-4)


@every_kind
def test_mirrored(kind):
    start, end = np.array([-20.0, 3.0, 4.0]), np.array([14.0, 5.0, -9.0])
    mirror = np.array([1.0, 1.0, -1.0])
    one, other = (
        path_of(KINDS[kind], start, end),
        path_of(KINDS[kind], mirror * start, mirror * end),
    )
    assert one.length == pytest.approx(float(other.length), abs=1e-11)
    for field in ("pull_start", "pull_end", "leaves", "arrives", "side"):
        one_field, other_field = _array(getattr(one, field)), _array(getattr(other, field))
        np.testing.assert_allclose(one_field, mirror * other_field, atol=1e-9)


@every_kind
def test_rotated_about_its_axes(kind):
    """Axes renamed: the same body, the same path."""
    start, end = np.array([-20.0, 3.0, 4.0]), np.array([14.0, 5.0, -9.0])
    if kind == "ellipsoid":
        turned = geo.WrapEllipsoid([8.0, 16.0, 11.0])
        turn = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]])
    else:
        turned, turn = KINDS[kind], np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]])
    one, other = path_of(KINDS[kind], start, end), path_of(turned, turn @ start, turn @ end)
    assert one.length == pytest.approx(float(other.length), abs=1e-11)
    np.testing.assert_allclose(turn @ _array(one.pull_end), _array(other.pull_end), atol=1e-9)


def _brought_to(obstacle, ends, angle):
    """The same line shifted away from the centre until it wraps by this angle."""
    line = ends[3:] - ends[:3]
    out = ends[:3] - (ends[:3] @ line) / (line @ line) * line
    out, low, high = out / np.linalg.norm(out), 0.0, 40.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        shifted = ends + middle * np.tile(out, 2)
        wraps = path_of(obstacle, shifted[:3], shifted[3:]).angle > angle
        low, high = (middle, high) if wraps else (low, middle)
    return shifted


ENDS = np.array([-22.0, 3.0, 4.0, 18.0, 5.0, -9.0])


@pytest.mark.long
@every_kind
@pytest.mark.parametrize("angle", [None, 0.5, 0.015, 0.004, 0.0, -0.008, -0.018, -0.3])
def test_gradients_and_second_derivatives(kind, angle, central_difference):
    """Wrapped, inside the hand-over, and free."""
    obstacle = KINDS[kind]
    ends = ENDS if angle is None else _brought_to(obstacle, ENDS, angle)
    pulls, exact = _pulls(obstacle, ends), by_ends(obstacle, ends)
    step = 2e-4 if angle is not None and abs(angle) < WIDTH else 1e-3
    differences = central_difference(lambda x: _length(obstacle, x), ends, step)
    np.testing.assert_allclose(pulls, differences, atol=2e-7)
    np.testing.assert_allclose(exact.length, pulls, atol=1e-13)
    differences = central_difference(lambda x: _pulls(obstacle, x), ends, step)
    np.testing.assert_allclose(exact.forward, differences, atol=1e-6)
    np.testing.assert_allclose(exact.forward, exact.forward.T, atol=1e-10)
    np.testing.assert_allclose(exact.hessian, exact.forward, atol=1e-10)


@every_kind
def test_derivatives_by_the_shape(kind, central_difference):
    obstacle = KINDS[kind]
    forward, reverse = by_size(obstacle, ENDS)
    differences = central_difference(
        lambda size: length_and_pulls(obstacle, size, ENDS), jax.tree.leaves(obstacle)[0], 1e-3
    )
    np.testing.assert_allclose(forward, differences, atol=1e-6)
    np.testing.assert_allclose(reverse, forward, atol=1e-12)


@every_kind
def test_continuous_through_the_hand_over(kind):
    """Length, pull and stiffness are continuous where the blend begins and ends."""
    obstacle = KINDS[kind]
    for edge in (-WIDTH, WIDTH):
        below, above = (_brought_to(obstacle, ENDS, edge + d) for d in (-1e-7, 1e-7))
        np.testing.assert_allclose(_pulls(obstacle, below), _pulls(obstacle, above), atol=1e-6)
        stiffness = [by_ends(obstacle, ends).forward for ends in (below, above)]
        np.testing.assert_allclose(*stiffness, atol=1e-4)


def test_hand_over_error_is_quadratic_in_the_width(slope_on_log_axes):
    sphere = geo.WrapSphere(12.0)
    heights = np.linspace(11.0, 13.0, 4001)
    start = (np.full_like(heights, -20.0), heights, 0.0 * heights)
    end = (np.full_like(heights, 24.0), heights, 0.0 * heights)
    exact = taut(sphere, start, end, 1e-6).length
    widths = [0.01, 0.02, 0.04]
    errors = [
        float(jnp.max(jnp.abs(taut(sphere, start, end, w).length - exact))) for w in widths
    ]
    assert slope_on_log_axes(widths, errors) == pytest.approx(2.0, abs=0.1)
    assert errors[1] < 3e-4


@every_kind
def test_vmap_is_a_loop(kind, rng):
    obstacle = KINDS[kind]
    ends = rng.uniform(-40.0, 40.0, (20, 6))
    mapped = jax.vmap(lambda x: path_of(obstacle, x[:3], x[3:]))(jnp.asarray(ends))
    for i, x in enumerate(ends):
        one = path_of(obstacle, x[:3], x[3:])
        assert one.length == pytest.approx(float(mapped.length[i]), rel=1e-13)
        np.testing.assert_allclose(_array(one.pull_end), _array(mapped.pull_end)[:, i], atol=1e-11)


def test_fibres_by_lanes_and_an_obstacle_in_lanes():
    start = tuple(jnp.full((3, 5), c) for c in (-20.0, 1.0, 2.0))
    radii = jnp.linspace(5.0, 12.0, 5)
    path = taut(geo.WrapSphere(radii), start, (20.0, 1.0, 2.0), WIDTH)
    assert path.length.shape == (3, 5)
    single = path_of(geo.WrapSphere(radii[3]), np.array([-20.0, 1, 2]), np.array([20.0, 1, 2]))
    assert path.length[1, 3] == pytest.approx(float(single.length), rel=1e-14)


DEGENERATE = {
    "through the centre": ([-30.0, 0.0, 0.0], [25.0, 0.0, 0.0]),
    "through the centre, oblique": ([-30.0, -15.0, 9.0], [20.0, 10.0, -6.0]),
    "along the cylinder's axis": ([0.0, 0.0, -30.0], [0.0, 0.0, 30.0]),
    "beside the axis": ([20.0, 0.0, -30.0], [20.0, 0.0, 30.0]),
    "no length": ([20.0, 0.0, 0.0], [20.0, 0.0, 0.0]),
    "no length, inside": ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
    "start inside": ([1.0, 2.0, 0.0], [40.0, 0.0, 0.0]),
    "end at the centre": ([30.0, 2.0, 0.0], [0.0, 0.0, 0.0]),
    "start on the surface": (None, [-30.0, -8.0, 1.0]),
    "both on the surface": (None, None),
    "very far": ([-1e5, 1.0, 0.0], [1e5, 2.0, 1.0]),
}


@every_kind
@pytest.mark.parametrize("case", DEGENERATE)
def test_nothing_is_nan(kind, case):
    obstacle = KINDS[kind]
    start, end = DEGENERATE[case]
    axes = np.minimum([float(a) for a in obstacle.semi_axes_along_frame], 1e3)
    start = np.array([axes[0], 0.0, 0.0]) if start is None else np.asarray(start)
    end = np.array([-0.6 * axes[0], 0.8 * axes[1], 0.0]) if end is None else np.asarray(end)
    path = path_of(obstacle, start, end)
    assert not any(np.isnan(leaf).any() for leaf in jax.tree.leaves(path))
    ends = np.concatenate([start, end])
    exact = by_ends(obstacle, ends)
    for slope in (exact.length, exact.forward, exact.reverse, *by_size(obstacle, ends)):
        assert np.isfinite(slope).all()


def test_line_through_a_sphere_goes_round_by_a_half_circle():
    path = path_of(geo.WrapSphere(10.0), np.array([-20.0, 0, 0]), np.array([20.0, 0, 0]))
    assert path.length == pytest.approx(10.0 * np.pi / 3.0 + 20.0 * np.sqrt(3.0))
    assert path.detour_other_side == pytest.approx(0.0, abs=1e-9)


@every_kind
def test_inside_is_straight_and_says_so(kind):
    path = path_of(KINDS[kind], np.array([1.0, 2.0, 0.5]), np.array([40.0, 3.0, 0.0]))
    assert path.inside and path.excess == 0.0


@pytest.mark.long
@every_kind
def test_path_flips_where_the_other_side_is_as_short(kind):
    """Past the centre the side turns over, and the detour shrinks to nothing on the way."""
    heights = np.array([2.0, 0.5, 0.02, -0.02, -0.5, -2.0])
    zero = np.zeros(6)
    # An ellipsoid's least way round is over its least axis.
    across = (zero, heights) if kind == "ellipsoid" else (heights, zero)
    path = taut(KINDS[kind], (zero - 25.0, *across), (zero + 25.0, *across), WIDTH)
    assert (np.diff(path.detour_other_side[:3]) < 0).all() and path.detour_other_side[2] < 0.1
    side = _array(path.side)
    assert side[:, 2] @ side[:, 3] == pytest.approx(-1.0)
    assert side[:, 1] @ side[:, 2] == pytest.approx(1.0)


@every_kind
def test_drawn_points_have_the_path_s_length(kind):
    free = np.array([30.0, 0.0, 0.0, 30.0, 9.0, 0.0])
    points, beside = (
        np.asarray(path_points(KINDS[kind], tuple(ends[:3]), tuple(ends[3:]), 401))
        for ends in (ENDS, free)
    )
    assert points.shape == (401, 3)
    np.testing.assert_allclose(points[[0, -1]], [ENDS[:3], ENDS[3:]])
    length = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    assert length == pytest.approx(float(_length(KINDS[kind], ENDS)), abs=1e-3)
    np.testing.assert_allclose(beside[:, 1], np.linspace(0.0, 9.0, 401))


@given(start=point, end=point, axes=st.tuples(*[st.floats(4.0, 20.0)] * 3))
def test_bounds_of_any_path(start, end, axes):
    """Not shorter than the line, not longer than around the ball that holds the obstacle."""
    start, end = np.array(start), np.array(end)
    for obstacle in (
        geo.WrapSphere(max(axes)),
        geo.WrapEllipsoid(axes),
        geo.WrapCylinder(min(axes), 9),
    ):
        path = path_of(obstacle, start, end)
        assert not any(np.isnan(leaf).any() for leaf in jax.tree.leaves(path))
        assert path.excess >= -1e-12
        assert path.length == pytest.approx(_straight(start, end) + path.excess)
        if isinstance(obstacle, geo.WrapSphere):
            around = path.length
        elif isinstance(obstacle, geo.WrapEllipsoid) and min(
            map(np.linalg.norm, (start, end))
        ) > max(axes):
            assert path.length <= around * (1.0 + 1e-9) + 1e-9
