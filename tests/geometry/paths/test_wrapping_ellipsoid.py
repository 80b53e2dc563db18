"""Geodesics of the ellipsoid against an independent minimisation, and against a sphere's."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize

import kneejax.geometry as geo

#: All tests take as many lines, and draw them from as many: one program each serves them all.
COUNT, DRAWN = 200, 8000


@jax.jit
def _taut(axes, start, end):
    return geo.taut(geo.WrapEllipsoid(axes), geo.Vector.of(start), geo.Vector.of(end), 1e-3)


@jax.jit
def _taut_of(obstacle, start, end):
    return geo.taut(obstacle, geo.Vector.of(start), geo.Vector.of(end), 1e-3)


def _random_lines(rng, aspect, size=(5.0, 40.0), heights=(1.02, 4.0)):
    """Obstacles and lines that they are in the way of: semi-axes and ends, each `(3, COUNT)`."""
    axes = np.exp(rng.uniform(*np.log(size), (3, DRAWN)))
    ends = []
    for _ in range(2):
        out = rng.normal(size=axes.shape)
        out *= np.exp(rng.uniform(*np.log(heights), DRAWN)) / np.linalg.norm(out, axis=0)
        ends.append(out * axes)
    angle = np.asarray(_taut(axes, *ends).angle)
    keep = (axes.max(0) / axes.min(0) < aspect) & (angle > 0.01) & (angle < np.deg2rad(150.0))
    keep = np.flatnonzero(keep)[:COUNT]
    assert len(keep) == COUNT
    return axes[:, keep], ends[0][:, keep], ends[1][:, keep]


MODES = 8


def _curve_length(unknowns, axes, ends, nodes):
    """Length of a path round an ellipsoid that need not be a geodesic.

    It leaves the start on some tangent, reaches the end on some tangent (two angles), and between
    follows the projection of a chord that is bent sideways by a sine series.
    """
    contacts = []
    for i in (0, 1):
        p, q = ends[i] / axes, ends[1 - i] / axes
        square = p @ p
        across = q - (q @ p) / square * p
        across /= jnp.linalg.norm(across)
        beside = jnp.cross(p, across) / jnp.sqrt(square)
        circle = jnp.cos(unknowns[i]) * across + jnp.sin(unknowns[i]) * beside
        contacts.append(p / square + jnp.sqrt((square - 1.0) / square) * circle)
    u, w = contacts
    x, weights = np.polynomial.legendre.leggauss(nodes)
    t, k = 0.5 * (x + 1.0), np.pi * np.arange(1, MODES + 1)[:, None]
    sideways = jnp.cross(u, w)
    sideways /= jnp.linalg.norm(sideways)
    x = jnp.outer(u, 1.0 - t) + jnp.outer(w, t) + jnp.outer(sideways, unknowns[2:] @ np.sin(k * t))
    d = (w - u)[:, None] + jnp.outer(sideways, unknowns[2:] @ (k * np.cos(k * t)))
    size = jnp.linalg.norm(x, axis=0)
    rate = d / size - x * (jnp.sum(x * d, 0) / size**3)
    arc = 0.5 * weights @ jnp.linalg.norm(axes[:, None] * rate, axis=0)
    return arc + sum(jnp.linalg.norm(axes * a - b) for a, b in zip((u, w), ends, strict=True))


_slope = jax.jit(jax.value_and_grad(_curve_length), static_argnums=3)


def _least(axes, start, end):
    """Least length over four sides to begin from, as a finer rule sums it.

    A chord bent through the centre has a projection that jumps, which no rule sums: such a result
    is shorter than the straight line, and dropped.
    """
    ends, lengths = jnp.stack([start, end]), []
    for side in np.deg2rad([0.0, 90.0, 180.0, 270.0]):
        first = np.concatenate([[side, -side], np.zeros(MODES)])
        options = {"gtol": 1e-7}
        found = minimize(_slope, first, (axes, ends, 40), "BFGS", jac=True, options=options)
        lengths.append(float(_slope(found.x, axes, ends, 400)[0]))
    return min(x for x in lengths if x > np.linalg.norm(start - end))


@pytest.mark.long
def test_geodesics_against_an_independent_minimisation(rng):
    """The shortest of all, over the range that a knee's obstacles may have."""
    lines = _random_lines(rng, 3.0)
    lengths = np.asarray(_taut(*lines).length)[:40]
    least = [_least(*columns) for columns in zip(*(x.T[:40] for x in lines), strict=True)]
    np.testing.assert_allclose(lengths, least, atol=1e-4)


def test_geodesics_of_slender_ellipsoids(rng):
    lines = _random_lines(rng, 5.0)
    lengths = np.asarray(_taut(*lines).length)[:40]
    least = [_least(*columns) for columns in zip(*(x.T[:40] for x in lines), strict=True)]
    np.testing.assert_allclose(lengths, least, atol=5e-3)


def test_equal_axes_are_a_sphere(rng):
    radius = np.full((3, COUNT), 14.0)
    start, end = rng.uniform(-40.0, 40.0, (2, 3, COUNT))
    found = _taut(radius, start, end)
    sphere = _taut_of(geo.WrapSphere(14.0), start, end)
    assert (np.asarray(found.angle) > 0).sum() > 20
    np.testing.assert_allclose(found.length, sphere.length, atol=1e-10)
    # Where all planes are nearly equal the plane converges more slowly than the length.
    clear = np.asarray(sphere.detour_other_side) > 1.0
    for name in ("pull_start", "pull_end", "leaves", "arrives", "side"):
        for one, other in zip(getattr(found, name), getattr(sphere, name), strict=True):
            np.testing.assert_allclose(one[clear], other[clear], atol=1e-7)


def test_long_ellipsoid_is_nearly_a_cylinder():
    """Across its middle, with little rise: the difference is of the order of (z / long axis)^2."""
    start, end = np.array([-20.0, -3.0, -2.0]), np.array([18.0, -2.0, 2.0])
    cylinder = _taut_of(geo.WrapCylinder(10.0, 100.0), start, end)
    lines = (np.repeat(x[:, None], COUNT, axis=1) for x in (start, end))
    long = np.geomspace(100.0, 1000.0, COUNT)
    slender = _taut(np.stack([0 * long + 10.0, 0 * long + 10.0, long]), *lines)
    for which, tolerance in ((0, 2e-2), (-1, 2e-4)):
        assert slender.length[which] == pytest.approx(float(cylinder.length), abs=tolerance)


@pytest.mark.long
def test_pulls_over_many_obstacles(rng, central_difference):
    """Gradients and second derivatives for 200 obstacles at once."""
    axes, start, end = _random_lines(rng, 2.5, size=(8.0, 30.0), heights=(1.1, 3.0))
    ends = np.concatenate([start, end])

    def pulls(shift):
        moved = jnp.asarray(ends) + shift[:, None]
        path = _taut(axes, moved[:3], moved[3:])
        pull = jnp.stack([*path.pull_start, *path.pull_end])
        return pull, (path.length, path.detour_other_side)

    # Fused, without optimisation, values are computed anew at each of their many uses.
    @functools.partial(jax.jit, compiler_options={"xla_disable_hlo_passes": "fusion"})
    def followed(shift):
        pull, push, rest = jax.linearize(pulls, shift, has_aux=True)
        return pull, *rest, jax.vmap(push, out_axes=-1)(jnp.eye(6))

    pull, _, detour, second = followed(np.zeros(6))
    clear = np.asarray(detour) > 0.5
    assert clear.sum() > 150
    error = pull - central_difference(lambda x: followed(x)[1], np.zeros(6)).T
    assert np.quantile(np.abs(error)[:, clear], [0.99, 1.0]) == pytest.approx([0, 0], abs=2e-5)
    error = second - central_difference(lambda x: followed(x)[0], np.zeros(6))
    assert np.quantile(np.abs(error)[:, clear], 0.95) < 1e-6


def test_path_stays_outside_and_leaves_on_tangents(rng):
    axes, start, end = _random_lines(rng, 3.0)
    path = _taut(axes, start, end)
    for point, end_point in ((path.leaves, start), (path.arrives, end)):
        point = np.stack(point)
        np.testing.assert_allclose(np.sum((point / axes) ** 2, 0), 1.0, atol=1e-5)
        np.testing.assert_allclose(np.sum(point * end_point / axes**2, 0), 1.0, atol=1e-5)
    drawn = jax.jit(geo.path_points, static_argnums=3)
    points = np.asarray(drawn(geo.WrapEllipsoid(axes), tuple(start), tuple(end), 101))
    heights = np.sum((points / axes) ** 2, 1)
    np.testing.assert_allclose(heights[1:-1], 1.0, atol=1e-5)
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1).sum(0)
    np.testing.assert_allclose(lengths, path.length, rtol=2e-4)
