"""Every smooth function of the geometry against central differences, at random numbers."""

from functools import cache

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jax.flatten_util import ravel_pytree

import kneejax.geometry as geo
from kneejax import numerics
from kneejax.geometry._bases import partials
from tests.derivatives import both_ways

RADIANS, MM = 0.3, 10.0
seeds = st.integers(0, 2**31)


def _rows(vector):
    return jnp.stack([*geo.Vector(*vector).full()])


def conventions(x):
    state = geo.State.of({"flexion": x[0]}, x[1:])
    names = list(geo.CONVENTIONS)
    # Each is read once and written once.
    changed = [geo.convert(x, s, t) for s, t in zip(names, names[1:] + names[:1], strict=True)]
    return jnp.concatenate([*changed, geo.convert(state.at(geo.COORDINATES), "femoral", "tibial")])


def tables(x):
    pose = geo.Pose.from_table(x)
    free = geo.State({"tibia": pose}).at(geo.FREE_COORDINATES)
    again = geo.State.of({"flexion": pose.flexion}, free).tibia
    return jnp.concatenate([again.to_table(), free, _rows(pose.placement.translation)])


def motions(x):
    first, second = (geo.Frame(y[:3], y[3:]).placement for y in (x[:6], x[6:12]))
    plain, point = geo.Frame(x[:3]).placement, geo.Vector.of(x[12:])
    images = [
        *(act(point) for p in (first, plain) for act in (p.apply, p.apply_inverse)),
        *(act(point) for p in (first, plain) for act in (p.turn, p.turn_back)),
        first.after(second).apply(point),
        plain.after(second).apply(point),
        second.inverse().apply(point),
        geo.angles_from_rotation(geo.rotation_from_angles(*x[3:6])),
        first.rotation.T @ point,
    ]
    return jnp.concatenate([_rows(image) for image in images])


def algebra(x):
    a, b = geo.Vector.of(x[:3]), geo.Vector.of(x[3:6])
    vectors = [a + b, a - b, a.cross(b), x[6] * a]
    vectors += [a * b, a.cross(geo.AXES.y)]
    return jnp.concatenate([*map(_rows, vectors), jnp.stack([a @ b, a.norm()])])


def primitives(x):
    logarithm = numerics.branch(
        x[0] > 10.0, jnp.log, lambda y: 0.1 * y, x[0], inside=1.0, outside=1.0
    )
    root = numerics.safe_sqrt(jnp.stack([x[0], -x[0]]))
    return jnp.stack([logarithm, *root, numerics.positive_part(x[1], x[2])])


def polynomial(x):
    table = partials(x[:12].reshape(3, 4), x[12], x[13], 2)
    return jnp.stack([y for row in table for y in row])


def _uniform(lower, upper):
    lower, upper = np.broadcast_arrays(np.asarray(lower, float), np.asarray(upper, float))
    return lambda rng: rng.uniform(lower, upper)


def _at_first_touch(rng):
    """Numbers for the primitives, with zero depth once in three times."""
    return np.array([rng.uniform(1.0, 9.0), rng.integers(-1, 2) * rng.uniform(), 0.3])


POSE_SIZE = np.r_[np.full(3, RADIANS), np.full(3, MM)]
FUNCTIONS = {
    "conventions": (
        conventions,
        _uniform([-0.2, -0.6, -0.6, -40, -40, -40], [2.4, 0.6, 0.6, 40, 40, 40]),
        POSE_SIZE,
    ),
    "tables": (tables, _uniform(-30.0, np.full(6, 30.0)), np.full(6, MM)),
    "motions": (
        motions,
        _uniform(-1.0, [*[30, 30, 30, 1, 1, 1] * 2, 30, 30, 30]),
        np.r_[np.tile([MM, MM, MM, RADIANS, RADIANS, RADIANS], 2), MM, MM, MM],
    ),
    "algebra": (algebra, _uniform(-5.0, np.full(7, 5.0)), np.ones(7)),
    "primitives": (primitives, _at_first_touch, np.full(3, 0.1)),
    "polynomial": (polynomial, _uniform(-1.0, np.ones(14)), np.ones(14)),
}


def _sphere(rng):
    return geo.Sphere(rng.uniform(15, 30))


def _ellipsoid(rng):
    return geo.Ellipsoid(rng.permutation([27.0, 21.0, 15.0]) + rng.uniform(-2, 2, size=3))


def _plane(rng):
    return geo.Plane(half_extent=rng.uniform(10, 20, size=2))


def _condyle(rng):
    c = rng.normal(size=(4, 3)) * 0.4
    c[0, 0], c[0, 2] = 24.0, -1.5
    return geo.Condyle(c, (0.2, 2.9), (-12.0, 10.0))


def _plateau(rng):
    c = rng.normal(size=(4, 3)) * 0.4
    c[2, 0], c[0, 2] = 1.5, 0.5
    return geo.Plateau(c, (-20.0, 15.0), (-12.0, 14.0))


SURFACES = {
    f.__name__[1:]: f for f in (_sphere, _ellipsoid, _plane, _condyle, _plateau)
}


def _of_surface(structure, round_):
    """Everything smooth that a surface answers, as a function of its numbers and a place."""

    def answers(x):
        surface, a, b, off = structure(x[:-3]), x[-3], x[-2], x[-1]
        jet = geo.jet(surface, a, b)
        on, normal = jet.vector(jet.point), geo.normal(surface, a, b)
        near = on + off * normal
        height = surface.height(near)
        vectors = [jet.vector(y) for y in (jet.a, jet.b, jet.aa, jet.ab, jet.bb)]
        vectors += [on, normal, height.gradient, *(height.hessian or ())]
        k1, k2 = geo.principal_curvatures(surface, a, b)
        # Where all directions bend alike the two are mean and product, not one by one, smooth.
        bends = [k1 + k2, k1 * k2] if round_ else [k1, k2]
        numbers = [surface.level(near), height.value, geo.area_element(surface, a, b), *bends]
        if not isinstance(surface, geo.Plane):
            numbers += surface.start(surface.outwards(near))
        return jnp.concatenate([*map(_rows, vectors), jnp.stack([*map(jnp.asarray, numbers)])])

    return answers


# Where nothing moves an answer, differences show the rounding of its value.
ROUNDING = 1e-6


@cache
def _of_function(name):
    return both_ways(FUNCTIONS[name][0])


@pytest.mark.long
@pytest.mark.parametrize("name", FUNCTIONS)
@given(seed=seeds)
def test_derivatives_of_geometry_equal_central_differences(name, seed):
    _, draw, size = FUNCTIONS[name]
    error = _of_function(name)(draw(np.random.default_rng(seed)), size, of_value=ROUNDING)
    assert error.forward < 1e-6
    assert error.reverse < 1e-9


@cache
def _of_kind(name):
    _, structure = ravel_pytree(SURFACES[name](np.random.default_rng(0)))
    return both_ways(_of_surface(structure, name in ("sphere", "plane")))


@pytest.mark.long
@pytest.mark.parametrize("name", SURFACES)
@settings(max_examples=8)
@given(seed=seeds)
def test_all_that_a_surface_answers_follows_its_numbers_and_the_place(name, seed):
    rng = np.random.default_rng(seed)
    surface = SURFACES[name](rng)
    numbers, _ = ravel_pytree(surface)
    (la, ua), (lb, ub) = surface.bounds()
    place = [la, lb] + rng.uniform(0.2, 0.8, size=2) * np.array([ua - la, ub - lb])
    size = np.r_[np.full(numbers.size, 1.0), 0.3, 0.3, 0.3]
    x = np.r_[numbers, place, rng.uniform(-0.5, 0.5)]
    error = _of_kind(name)(x, size, of_value=ROUNDING)
    assert error.forward < 1e-6
    assert error.reverse < 1e-9
