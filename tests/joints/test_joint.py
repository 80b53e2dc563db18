"""The moving axis, the hinge and their generalisation."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator
from scipy.spatial.transform import Rotation

from kneejax.geometry import Pose
from kneejax.joints import (
    INTERPOLATIONS,
    Joint,
    UnsuitableAxis,
    axis_between,
    generalised_axis,
    hinge,
    moving_axis,
)
from tests.joints.paper5_equations import linear_points, residual, tibia_in_femur, untwisted

#: Two and four poses of a knee like those of paper 5, and its axis points there.
ENDS = np.array([[3.5, 0.1, 5.1, -3.4, -34.6, 4.8], [86.6, -2.6, 11.3, 10.6, -33.5, 2.6]])
INNER = [[25.0, -1.2, 8.0, 1.0, -35.6, 2.9], [60.0, -2.6, 10.2, 7.0, -35.0, 3.0]]
FOUR = np.array([ENDS[0], *INNER, ENDS[1]])
EXTENSION, FLEXED = [[6.0, 8.0, -21.5], [1.0, 11.0, 23.0]], [[0.5, 1.5, -21.0], [-2.0, 1.0, 23.5]]
_rate = jax.jit(
    lambda joint, x: jax.jvp(lambda y: joint.pose(y).to_table(), (x,), (jnp.ones_like(x),))[1]
)
_poses = jax.jit(lambda joint, flexion: joint.pose(flexion).to_table())


def _table(joint, degrees):
    return np.asarray(_poses(joint, jnp.deg2rad(jnp.asarray(degrees, float))))


def _moving() -> Joint:
    return moving_axis([EXTENSION, FLEXED], Pose.from_table(ENDS))


def _general(interpolation="monotone") -> Joint:
    points = axis_between(EXTENSION, FLEXED, jnp.asarray(FOUR[:, 0]))
    return generalised_axis(points, Pose.from_table(FOUR), interpolation)


def _apart(table, other):
    return np.abs(np.asarray(table) - np.asarray(other))


@st.composite
def _random_joints(draw):
    """Two calibration poses and transverse axes, as far as a knee may go and beyond."""
    seed = draw(st.integers(0, 2**32 - 1))
    rng = np.random.default_rng(seed)
    flexion = np.sort(rng.uniform(-20, 150, 2)) + [0.0, 1.0]
    poses = np.c_[flexion, rng.uniform(-15, 15, (2, 2)), rng.uniform(-40, 40, (2, 3))]
    middle = np.array([[0, 0, -25.0], [0, 0, 25.0]])
    return middle + rng.uniform(-8, 8, (2, 2, 3)), poses


@given(_random_joints())
@settings(max_examples=60, deadline=None)
def test_random_joints_meet_their_poses_and_the_equations(drawn):
    points, poses = drawn
    joint = moving_axis(points, Pose.from_table(poses))
    assert _apart(_table(joint, poses[:, 0]), poses).max() < 1e-9
    between = np.r_[-30.0, np.linspace(poses[0, 0] - 10, poses[1, 0] + 10, 5), 179.0]
    tibial = np.asarray(joint.tibial)
    for flexion, row in zip(between, _table(joint, between), strict=True):
        f = linear_points(poses[:, 0], points, flexion)
        t = linear_points(poses[:, 0], tibial, flexion)
        assert np.abs(residual(row, f, t, flexion)).max() < 1e-12


def test_the_equations_can_fail():
    joint = _moving()
    row = _table(joint, [45.0])[0]
    f, t = (linear_points(ENDS[:, 0], np.asarray(x), 45.0) for x in (joint.femoral, joint.tibial))
    for i in range(6):
        wrong = row + 1e-3 * np.eye(6)[i]
        assert np.abs(residual(wrong, f, t, 45.0)).max() > 1e-6


def test_a_search_finds_the_same_poses():
    """Newton's method on the six equations that tie the tibia, from the last pose."""
    from scipy.optimize import fsolve

    joint, row = _moving(), ENDS[0]
    for flexion in np.linspace(3.5, 86.6, 8):
        points = np.asarray(joint.femoral), np.asarray(joint.tibial)
        f, t = (linear_points(ENDS[:, 0], x, flexion) for x in points)

        def equations(y, f=f, t=t, flexion=flexion):
            turn, place = tibia_in_femur(y)
            axes = untwisted(f[1] - f[0]).T @ turn @ untwisted(t[1] - t[0])
            return np.r_[f[0] - place - turn @ t[0], axes[:2, 2], np.deg2rad(y[0] - flexion)]

        row = fsolve(equations, row, xtol=1e-13)
        assert _apart(_table(joint, [flexion])[0], row).max() < 1e-8


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
def test_every_calibration_pose_is_met(interpolation):
    assert _apart(_table(_general(interpolation), FOUR[:, 0]), FOUR).max() < 1e-9


def test_axis_is_constant_outside():
    """Beyond the ends the motion is a turn about one axis in both bones."""
    joint = _moving()
    for degrees, end in ((np.array([-30.0, -5.0, 3.5]), 0), (np.array([86.6, 110.0, 140.0]), 1)):
        femoral, tibial = joint.axis_points(jnp.deg2rad(degrees))
        assert _apart(np.moveaxis(femoral, -1, 0), joint.femoral[end]).max() < 1e-12
        assert _apart(np.moveaxis(tibial, -1, 0), joint.tibial[end]).max() < 1e-12
        fixed = hinge(joint.femoral[end], Pose.from_table(ENDS[end]))
        assert _apart(_table(joint, degrees), _table(fixed, degrees)).max() < 1e-10


def test_axis_moves_in_proportion_to_flexion():
    joint = _moving()
    middle = 0.5 * (ENDS[0, 0] + ENDS[1, 0])
    femoral, tibial = joint.axis_points(jnp.deg2rad(jnp.array([middle])))
    np.testing.assert_allclose(femoral[..., 0], joint.femoral.mean(axis=0), atol=1e-12)
    np.testing.assert_allclose(tibial[..., 0], joint.tibial.mean(axis=0), atol=1e-12)


@pytest.mark.parametrize("joint", [_moving(), _general(), _general("linear")])
def test_motion_is_continuous(joint):
    """Half the step, half the largest jump."""
    jumps = []
    for count in (401, 801):
        table = _table(joint, np.linspace(-20, 120, count))
        jumps.append(np.abs(np.diff(table, axis=0)).max())
    assert jumps[0] / jumps[1] == pytest.approx(2.0, abs=0.1)


def test_monotone_motion_is_differentiable_between_the_ends():
    inner = jnp.asarray(FOUR[1:-1, 0])

    def jump(joint):
        before, after = (_rate(joint, jnp.deg2rad(inner + x)) for x in (-1e-6, 1e-6))
        return _apart(before, after).max()

    assert jump(_general()) < 1e-3
    assert jump(_general("linear")) > 1.0  # corners


def test_points_are_those_of_scipy():
    joint, degrees = _general(), np.linspace(FOUR[0, 0], FOUR[-1, 0], 57)
    angle = np.deg2rad(degrees)
    for ours, values in zip(joint.axis_points(angle), (joint.femoral, joint.tibial), strict=True):
        theirs = PchipInterpolator(np.asarray(joint.flexion), np.asarray(values))(angle)
        np.testing.assert_allclose(np.moveaxis(ours, -1, 0), theirs, atol=1e-12)


def test_points_rise_and_fall_only_where_given_ones_do():
    rng = np.random.default_rng(2)
    points = np.array([[0, 0, -25.0], [0, 0, 25.0]]) + rng.uniform(-8, 8, (4, 2, 3))
    joint = generalised_axis(points, Pose.from_table(FOUR))
    for i in range(3):
        inside = np.deg2rad(np.linspace(*FOUR[i : i + 2, 0], 41))
        steps = np.diff(np.asarray(joint.axis_points(inside)[0]), axis=-1)
        rise = np.sign(points[i + 1] - points[i])[..., None]
        assert (steps * rise >= -1e-12).all()


def test_two_poses_generalised_are_the_moving_axis():
    other = generalised_axis([EXTENSION, FLEXED], Pose.from_table(ENDS))
    degrees = np.linspace(-10, 120, 27)
    assert _apart(_table(other, degrees), _table(_moving(), degrees)).max() < 1e-10


def test_hinge_is_a_known_rotation():
    """Every motion of a hinge is a turn about its axis, by SciPy's rotations."""
    pose = [10.0, 1.5, 4.0, 2.0, -30.0, 1.0]
    points = np.array([[1.0, 2.0, -40.0], [-2.0, 5.0, 42.0]])
    joint = hinge(points, Pose.from_table(pose))
    first, place = tibia_in_femur(pose)
    axis = (points[1] - points[0]) / np.linalg.norm(points[1] - points[0])
    degrees = np.array([-10.0, 0.0, 10.0, 47.0, 90.0, 130.0])
    for flexion, row in zip(degrees, _table(joint, degrees), strict=True):
        turn, there = tibia_in_femur(row)
        whole = Rotation.from_matrix(turn @ first.T).as_rotvec()
        assert np.linalg.norm(np.cross(whole, axis)) < 1e-12
        moved = points[0] + turn @ first.T @ (place - points[0])
        assert np.abs(moved - there).max() < 1e-10
        assert row[0] == pytest.approx(flexion, abs=1e-10)


def test_hinge_along_z_changes_flexion_alone():
    joint = hinge([[0.0, 0.0, -20.0], [0.0, 0.0, 20.0]], Pose.from_table([0, 3, 7, 0, 0, 5.0]))
    table = _table(joint, [0.0, 60.0, 120.0])
    assert _apart(table[:, 1:], [[3, 7, 0, 0, 5.0]] * 3).max() < 1e-12


def test_moving_the_femurs_frame_changes_no_motion():
    """Another origin of the femur's frame: the same tibia, seen from there."""
    shift = np.array([4.0, -7.0, 2.0])
    moved = ENDS + np.r_[0, 0, 0, -shift]
    points = np.array([EXTENSION, FLEXED]) - shift
    degrees = np.linspace(-10, 120, 27)
    other = _table(moving_axis(points, Pose.from_table(moved)), degrees)
    assert _apart(other[:, :3], _table(_moving(), degrees)[:, :3]).max() < 1e-10
    assert _apart(other[:, 3:] + shift, _table(_moving(), degrees)[:, 3:]).max() < 1e-10


def test_femur_frame_turned_about_z_is_another_zero_of_flexion():
    angle, degrees = 20.0, np.linspace(0, 100, 21)
    turn = Rotation.from_euler("Z", angle, degrees=True).as_matrix()
    turned = np.c_[ENDS[:, :1] - angle, ENDS[:, 1:3], ENDS[:, 3:] @ turn.T]
    fixed = [np.array(EXTENSION) @ turn.T] * 2
    other = generalised_axis(np.array(fixed)[:1], Pose.from_table(turned[:1]))
    ours = hinge(EXTENSION, Pose.from_table(ENDS[0]))
    table, theirs = _table(ours, degrees), _table(other, degrees - angle)
    assert _apart(theirs[:, 1:3], table[:, 1:3]).max() < 1e-10
    assert _apart(theirs[:, 3:], table[:, 3:] @ turn.T).max() < 1e-10


def test_a_mirrored_knee_moves_as_in_a_mirror():
    """Medial and lateral, varus and valgus, inwards and outwards change places."""
    mirror = np.array([1, -1, -1, 1, 1, -1.0])
    points = np.array([EXTENSION, FLEXED])[:, ::-1] * [1, 1, -1]
    other = moving_axis(points, Pose.from_table(ENDS * mirror))
    # The lateral point now leads, in the mirror; the axis is the same line where it does not move.
    degrees = np.array([-20.0, 3.5, 86.6, 120.0])
    assert _apart(_table(other, degrees) * mirror, _table(_moving(), degrees)).max() < 1e-9


def _objective(joint, flexion):
    table = joint.pose(flexion).to_table()
    return jnp.sum(table * jnp.cos(jnp.arange(table.size).reshape(table.shape)))


@pytest.mark.long
@pytest.mark.parametrize("joint", [_moving(), _general()], ids=["moving", "general"])
def test_gradients_are_central_differences(joint):
    flexion = jnp.deg2rad(jnp.array([-5.0, 12.0, 41.0, 77.0, 95.0]))
    value = jax.jit(_objective)
    exact = jax.jit(jax.grad(_objective, argnums=(0, 1)))(joint, flexion)
    leaves, tree = jax.tree.flatten((joint, flexion))
    for number, (leaf, slope) in enumerate(zip(leaves, jax.tree.leaves(exact), strict=True)):
        for i in np.ndindex(leaf.shape):
            step = 1e-5 if leaf.ndim == 1 else 1e-3
            up, down = (
                value(*jax.tree.unflatten(
                    tree, [x.at[i].add(s) if j == number else x for j, x in enumerate(leaves)]
                ))
                for s in (step, -step)
            )  # fmt: skip
            difference = float(up - down) / (2 * step)
            assert difference == pytest.approx(float(slope[i]), rel=1e-6, abs=1e-6)


def test_calibration_can_be_differentiated():
    """By its poses and points, through the constructor."""

    @jax.jit
    def anterior(table, points):
        return moving_axis(points, Pose.from_table(table)).pose(jnp.deg2rad(45.0)[None]).anterior[0]

    points, table = jnp.array([EXTENSION, FLEXED]), jnp.array(ENDS)
    slope = jax.grad(anterior, argnums=(0, 1))(table, points)
    for k, x in enumerate((table, points)):
        for i in np.ndindex(x.shape):
            moved = [[table, points][j] if j != k else None for j in range(2)]
            ends = []
            for s in (1e-4, -1e-4):
                moved[k] = x.at[i].add(s)
                ends.append(anterior(*moved))
            difference = float(ends[0] - ends[1]) / 2e-4
            assert difference == pytest.approx(float(slope[k][i]), rel=1e-6, abs=1e-6)


def test_many_joints_at_once():
    """A joint is a pytree: poses of perturbed joints by vmap."""
    joint, flexion = _moving(), jnp.deg2rad(jnp.array([10.0, 50.0]))
    shifts = jnp.array([0.0, 1.0])

    @jax.jit
    @jax.vmap
    def shifted(s):
        return eqx.tree_at(lambda j: j.femoral, joint, joint.femoral + s).pose(flexion)

    many = shifted(shifts)
    np.testing.assert_allclose(many.to_table()[0], _poses(joint, flexion), atol=1e-12)
    np.testing.assert_allclose(many.anterior[1] - many.anterior[0], 1.0, atol=1e-9)


def test_bad_input_is_named():
    poses = Pose.from_table(ENDS)
    same = Pose.from_table(ENDS * [0, 1, 1, 1, 1, 1.0])
    with pytest.raises(UnsuitableAxis, match="0 degrees in poses 1 and 2"):
        moving_axis([EXTENSION, FLEXED], same)
    with pytest.raises(UnsuitableAxis, match="86.6, then 3.5 degrees"):
        moving_axis([EXTENSION, FLEXED], Pose.from_table(ENDS[::-1]))
    with pytest.raises(UnsuitableAxis, match="lateral of the medial one"):
        moving_axis([EXTENSION[::-1], FLEXED[::-1]], poses)
    with pytest.raises(UnsuitableAxis, match="degrees off the medial-lateral"):
        hinge([[0, 0, -1.0], [0, 30, 1.0]], Pose.from_table(ENDS[0]))
    with pytest.raises(UnsuitableAxis, match="not finite"):
        hinge([[0, 0, -1.0], [0, np.nan, 1.0]], Pose.from_table(ENDS[0]))
    with pytest.raises(ValueError, match=r"expected \(2, 2, 3\)"):
        moving_axis([EXTENSION], poses)
    with pytest.raises(ValueError, match=r"expected \(k, 2, 3\)"):
        generalised_axis([EXTENSION], poses)
    with pytest.raises(ValueError, match=r"flexion has shape \(\); expected \(lanes,\)"):
        _moving().pose(0.3)
    with pytest.raises(ValueError, match="interpolation is 'cubic'"):
        generalised_axis([EXTENSION, FLEXED], poses, "cubic")
    with pytest.raises(ValueError, match=r"tibial has shape \(1, 2, 3\)"):
        Joint(jnp.zeros(2), jnp.zeros((2, 2, 3)), jnp.zeros((1, 2, 3)))
