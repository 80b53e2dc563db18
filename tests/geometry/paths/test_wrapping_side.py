"""Paths that must pass a cylinder on one side, as the quadriceps passes in front of the femur."""

import jax
import numpy as np
import pytest

import kneejax.geometry as geo

RADIUS = 12.0
#: Above the cylinder and a little in front, as the quadriceps begins.
START = np.array([3.0, 40.0, 2.0])
BEGIN = np.arctan2(START[1], START[0])
#: Where an end stands that goes down in front, under and up behind, rad.
AROUND = np.deg2rad(np.arange(20.0, -231.0, -10.0))

taut = jax.jit(geo.taut)
path_points = jax.jit(geo.path_points, static_argnums=3)


def ends_at(angles, distance=20.0):
    return distance * np.cos(angles), distance * np.sin(angles), np.full_like(angles, -5.0)


def around(side, ends, start=START):
    return taut(geo.WrapCylinder(RADIUS, 60.0, None, side), tuple(start), tuple(ends))


def test_it_is_a_helix_as_far_round_as_its_ends_ask():
    """Past half a turn too, where the way behind has long been shorter."""
    path = around("+x", ends_at(AROUND))
    tangents = np.sqrt(START[0] ** 2 + START[1] ** 2 - RADIUS**2), np.sqrt(20.0**2 - RADIUS**2)
    free = np.arctan2(tangents[0], RADIUS) + np.arctan2(tangents[1], RADIUS)
    turn = BEGIN - AROUND - free
    flat = sum(tangents) + RADIUS * turn
    np.testing.assert_allclose(path.angle, turn, atol=1e-12)
    wraps = turn > 0.02
    length = np.hypot(flat, START[2] + 5.0)
    np.testing.assert_allclose(np.asarray(path.length)[wraps], length[wraps], rtol=1e-12)
    shorter = around("", ends_at(AROUND)).length
    assert turn.max() > np.pi and path.length[-1] > shorter[-1] + 40.0


def test_it_is_the_shortest_path_where_that_passes_there():
    ends = ends_at(AROUND)
    free, held = around("", ends), around("+x", ends)
    there = np.asarray(free.side)[0] > 0.0
    assert 8 < there.sum() < len(AROUND) - 6
    for ours, shortest in zip(jax.tree.leaves(held[:4]), jax.tree.leaves(free[:4]), strict=True):
        np.testing.assert_allclose(
            np.asarray(ours)[..., there], np.asarray(shortest)[..., there], atol=1e-12
        )


def test_it_never_flips():
    """Its side turns as slowly as the end goes round, and no other way is offered."""
    path = around("+x", ends_at(np.deg2rad(np.arange(20.0, -240.0, -1.0))))
    side = np.stack([np.asarray(c) for c in path.side])
    assert (side[:, 1:] * side[:, :-1]).sum(axis=0).min() > np.cos(np.deg2rad(1.5))
    assert np.isinf(np.asarray(path.detour_other_side)).all()


@pytest.mark.parametrize("degrees", [-60.0, -93.0, -150.0, -200.0])
def test_length_and_pull_follow_both_ends(degrees, central_difference):
    obstacle = geo.WrapCylinder(RADIUS, 60.0, None, "+x")
    ends = np.r_[START, [float(c) for c in ends_at(np.deg2rad(degrees))]]

    @jax.jit
    def pulls(x):
        path = geo.taut(obstacle, geo.Vector.of(x[:3]), geo.Vector.of(x[3:]))
        return path.length, jax.numpy.stack([*path.pull_start, *path.pull_end])

    exact = pulls(ends)[1]
    np.testing.assert_allclose(exact, central_difference(lambda x: pulls(x)[0], ends), atol=2e-7)
    stiffness = jax.jit(jax.jacfwd(lambda x: pulls(x)[1]))(ends)
    np.testing.assert_allclose(
        stiffness, central_difference(lambda x: pulls(x)[1], ends), atol=1e-6
    )
    np.testing.assert_allclose(stiffness, np.transpose(stiffness), atol=1e-10)


def test_its_length_follows_the_radius(central_difference):
    """Along an arc by which it turns more than half way."""
    ends = tuple(float(c) for c in ends_at(np.deg2rad(-225.0)))

    def length(radius):
        return geo.taut(geo.WrapCylinder(radius, 60.0, None, "+x"), tuple(START), ends).length

    exact = jax.jit(jax.grad(length))(RADIUS)
    np.testing.assert_allclose(exact, central_difference(jax.jit(length), RADIUS), atol=1e-7)
    assert exact > np.pi


@pytest.mark.long
@pytest.mark.parametrize("name", geo.SIDES)
def test_every_side_is_the_first_one_turned(name):
    """And what is said of it does not depend on which end is called the first, nor on the mirror
    in the plane across the axis, which is that of a left knee."""
    x, y, _ = geo.SIDES[name]

    def turned(point):
        return x * point[0] - y * point[1], y * point[0] + x * point[1], point[2]

    ends = ends_at(AROUND)
    first = around("+x", ends)
    there = around(name, turned(ends), turned(START))
    np.testing.assert_allclose(there.length, first.length, rtol=1e-14)
    back = taut(
        geo.WrapCylinder(RADIUS, 60.0, None, name), turned(ends), tuple(map(float, turned(START)))
    )
    np.testing.assert_allclose(back.length, first.length, rtol=1e-14)
    left = around("+x", (ends[0], ends[1], -ends[2]), START * [1.0, 1.0, -1.0])
    np.testing.assert_allclose(left.length, first.length, rtol=1e-14)


def test_its_drawing_is_as_long():
    obstacle, ends = geo.WrapCylinder(RADIUS, 60.0, None, "+x"), ends_at(AROUND[-1:])
    points = np.asarray(path_points(obstacle, tuple(START), ends, 801))[..., 0]
    drawn = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    assert drawn == pytest.approx(float(around("+x", ends).length[0]), abs=2e-3)
    assert np.hypot(points[1:-1, 0], points[1:-1, 1]).min() > RADIUS - 1e-9


def test_a_side_that_is_none_is_refused():
    with pytest.raises(ValueError, match="side is 'front', not one of"):
        geo.WrapCylinder(RADIUS, 60.0, None, "front")


@pytest.mark.opensim
def test_opensim_goes_the_same_way():
    """Its `quadrant`; its helix is drawn in pieces, which is worth a tenth of a mm."""
    osim = pytest.importorskip("opensim")
    osim.Logger.setLevelString("Off")
    model = osim.Model()
    body = osim.Body("end", 1.0, osim.Vec3(0), osim.Inertia(1, 1, 1))
    model.addBody(body)
    model.addJoint(osim.FreeJoint("free", model.getGround(), body))
    cylinder = osim.WrapCylinder()
    cylinder.setName("femur")
    cylinder.set_radius(RADIUS / 1e3)
    cylinder.set_length(0.06)
    cylinder.set_quadrant("x")
    model.updGround().addWrapObject(cylinder)
    spring = osim.PathSpring("quadriceps", 1.0, 1.0, 0.0)
    path = spring.updGeometryPath()
    path.appendNewPathPoint("origin", model.getGround(), osim.Vec3(*(START / 1e3)))
    path.appendNewPathPoint("insertion", body, osim.Vec3(0))
    path.addPathWrap(cylinder)
    model.addForce(spring)
    state, theirs = model.initSystem(), []
    ends = ends_at(AROUND[:-2])
    for end in np.transpose(ends) / 1e3:
        for place, value in zip((3, 4, 5), end, strict=True):
            model.getCoordinateSet().get(place).setValue(state, float(value))
        model.realizePosition(state)
        theirs.append(1e3 * spring.getGeometryPath().getLength(state))
    np.testing.assert_allclose(around("+x", ends).length, theirs, atol=0.15)
