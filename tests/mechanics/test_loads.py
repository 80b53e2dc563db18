"""Loads do the work of their wrench; lines of constant tension pull along themselves."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import kneejax.geometry as geo
from kneejax.mechanics import (
    AXES,
    BONES,
    NAMED_LOADS,
    ConstantTensionLine,
    Load,
    load_called,
    load_of,
    load_words,
)

FLEXION = 0.6
Q = np.array([0.05, -0.15, 3.0, -28.0, 2.0])
FORCE, MOMENT, POINT = np.array([70.0, -20.0, 30.0]), np.array([900.0, -2500.0, 400.0]), [4, -60, 9]


def placed(q):
    """Rotation matrix and translation of the tibia."""
    place = geo.State.of({"flexion": FLEXION}, jnp.asarray(q)).tibia.placement
    return np.array([[float(x) for x in r] for r in place.rotation]), np.asarray(q[2:])


@pytest.mark.parametrize(("axes", "point_in"), list(itertools.product(AXES, BONES)))
def test_a_load_does_the_work_of_moving_the_tibia(axes, point_in, central_difference):
    load = Load(FORCE, MOMENT, POINT, axes, point_in)
    state = geo.State.of({"flexion": FLEXION}, jnp.asarray(Q))
    ours = np.stack(load.work(state, geo.FREE_COORDINATES))
    r0, t0 = placed(Q)
    columns = {
        "femur": np.eye(3),
        "tibia": r0,
        "grood_suntay": np.array(geo.grood_suntay_axes(state.tibia.placement), float).T,
    }[axes]
    force, moment = columns @ FORCE, columns @ MOMENT
    point = r0 @ POINT + t0 if point_in == "tibia" else np.array(POINT, float)
    material = r0.T @ (point - t0)

    def work(q):
        r, t = placed(q)
        turned = Rotation.from_matrix(r @ r0.T).as_rotvec()
        return force @ (r @ material + t - point) + moment @ turned

    numeric = central_difference(work, Q)
    np.testing.assert_allclose(ours, numeric, rtol=1e-6, atol=1e-6 * np.abs(numeric).max())


def test_a_dead_force_on_a_tibial_point_is_the_slope_of_a_potential():
    load = Load(FORCE, point=POINT)

    def potential(q):
        tip = geo.State.of({"flexion": FLEXION}, q).tibia.placement.apply(geo.Vector.of(load.point))
        return -(geo.Vector.of(load.force) @ tip)

    state = geo.State.of({"flexion": FLEXION}, jnp.asarray(Q))
    ours = load.work(state, geo.FREE_COORDINATES)
    expected = -np.asarray(jax.grad(potential)(jnp.asarray(Q)))
    np.testing.assert_allclose(np.asarray(ours), expected, rtol=1e-12, atol=1e-10)


def test_a_load_in_a_batch_has_a_row_for_each_coordinate():
    load = jax.tree.map(lambda x: x[..., None], Load(FORCE, MOMENT, POINT, "tibia", "femur"))
    q = jnp.asarray(Q)[:, None] + jnp.linspace(0.0, 0.1, 4)
    state = geo.State.of({"flexion": FLEXION}, q)
    together = np.stack(load.work(state, geo.FREE_COORDINATES))
    assert together.shape == (5, 4)
    one = geo.State.of({"flexion": FLEXION}, q[:, 2])
    single = Load(FORCE, MOMENT, POINT, "tibia", "femur")
    alone = single.work(one, geo.FREE_COORDINATES)
    np.testing.assert_allclose(np.asarray(together[:, 2]), np.asarray(alone), rtol=1e-12)


def test_an_unknown_bone_is_an_error_that_names_the_field():
    with pytest.raises(ValueError, match=r"Load.axes is 'patella'; expected one of"):
        Load(axes="patella")
    with pytest.raises(ValueError, match=r"Load.point_in is 'ground'; expected one of"):
        Load(point_in="ground")


def test_a_line_of_constant_tension_has_the_energy_of_its_length_and_pulls_along_itself():
    line = ConstantTensionLine(20.0, [[30.0, 40.0, 0.0], [5.0, -10.0, 1.0]], [12.0, -50.0, 3.0])
    upper = np.array([30.0, 40.0, 0.0]) + FLEXION * np.array([5.0, -10.0, 1.0])
    r, t = placed(Q)
    lower = r @ [12.0, -50.0, 3.0] + t

    def energy(q):
        return line.energy(geo.State.of({"flexion": FLEXION}, q))

    assert float(energy(Q)) == pytest.approx(20.0 * np.linalg.norm(lower - upper), rel=1e-13)
    pull = -np.asarray(jax.grad(energy)(jnp.asarray(Q)))[2:]
    np.testing.assert_allclose(
        pull, 20.0 * (upper - lower) / np.linalg.norm(upper - lower), rtol=1e-12
    )


def test_a_line_with_one_row_has_a_fixed_upper_end():
    line = ConstantTensionLine(20.0, [[30.0, 40.0, 0.0]], [12.0, -50.0, 3.0])
    still = geo.State.of({"flexion": FLEXION}, jnp.asarray(Q))
    assert float(line.work_of_end(still)) == 0.0


def converted(pose, convention):
    """The six coordinates of a pose in another convention."""
    state = geo.State({"tibia": pose})
    return geo.convert(state.at(geo.COORDINATES), "femoral", convention)


def left_twin_pose(table):
    """The same pose of a left knee, in its own axes with Z to the person's right."""
    return geo.Pose.from_table(np.asarray(table) * [1.0, -1.0, -1.0, 1.0, 1.0, -1.0])


angle = st.floats(-1.2, 1.2)
pose_of_a_knee = st.builds(
    lambda f, a, r, x, y, z: geo.Pose(*map(jnp.asarray, (f, a, r, x, y, z))),
    st.floats(-0.5, 2.6), angle, angle, *[st.floats(-40.0, 40.0)] * 3,
)  # fmt: skip


@given(pose=pose_of_a_knee)
def test_the_axes_of_grood_and_suntay(pose):
    tibia = pose.placement
    floating, long, transverse = np.array(geo.grood_suntay_axes(tibia), float)
    np.testing.assert_allclose(transverse, [0.0, 0.0, 1.0])
    np.testing.assert_allclose(long, np.array(tibia.turn((0.0, 1.0, 0.0))), atol=1e-15)
    expected = np.cross(long, transverse)
    np.testing.assert_allclose(floating, expected / np.linalg.norm(expected), atol=1e-12)
    # Forwards, and turning with flexion alone.
    flexion = float(pose.flexion)
    np.testing.assert_allclose(floating, [np.cos(flexion), -np.sin(flexion), 0.0], atol=1e-12)


#: What each load by name works on, of flexion, adduction, internal rotation and the anterior,
#: superior and lateral translation of Grood and Suntay, at adduction `a` and superior shift `y`.
#: The femur's transverse and the tibia's long axis are not square in varus: a force along one then
#: also moves the tibia a little along the other.
WORK = {
    "anterior_N": lambda a, y: {"anterior": 1.0},
    "compression_N": lambda a, y: {"superior": 1.0, "lateral": np.sin(a)},
    "lateral_N": lambda a, y: {"lateral": 1.0, "superior": np.sin(a), "adduction": y * np.cos(a)},
    "varus_Nm": lambda a, y: {"adduction": 1000.0},
    "internal_Nm": lambda a, y: {"internal_rotation": 1000.0},
}


@settings(max_examples=25, deadline=None)
@given(pose=pose_of_a_knee)
@pytest.mark.parametrize("name", NAMED_LOADS)
def test_a_load_by_name_works_on_what_its_name_says(name, pose):
    """Power of the load, by central differences of the tibia's motion along each coordinate."""
    wrench = load_of(**{name: 1.0}).wrench(pose.placement)
    force, moment = np.array(wrench.force, float), np.array(wrench.moment, float)
    here = np.array(converted(pose, "grood-suntay"))

    def placed_at(coordinates):
        femoral = geo.convert(jnp.asarray(coordinates), "grood-suntay", "femoral")
        place = geo.State.of({"flexion": femoral[0]}, femoral[1:]).tibia.placement
        rotation = np.array([[float(x) for x in row] for row in place.rotation])
        return rotation, np.array(place.translation)

    expected = WORK[name](float(pose.adduction), here[4])
    for k, coordinate in enumerate(geo.FREE_COORDINATES, 1):
        step = np.eye(6)[k] * (1e-4 if k < 3 else 1e-2)
        (r0, t0), (r1, t1) = placed_at(here - step), placed_at(here + step)
        turned = Rotation.from_matrix(r1 @ r0.T).as_rotvec()
        work = (force @ (t1 - t0) + moment @ turned) / (2.0 * step[k])
        size = max(1.0, *map(abs, expected.values()))
        assert work == pytest.approx(expected.get(coordinate, 0.0), abs=1e-6 * size), coordinate


@settings(max_examples=25, deadline=None)
@given(pose=pose_of_a_knee)
def test_with_flexion_prescribed_each_moment_works_on_its_own_rotation_alone(pose):
    state = geo.State({"tibia": pose})
    for row, name in enumerate(("varus_Nm", "internal_Nm")):
        work = np.array(load_of(**{name: 2.0}).work(state, geo.FREE_COORDINATES), float)
        np.testing.assert_allclose(work, 2000.0 * np.eye(5)[row], atol=1e-9)


def test_a_drawer_at_90_degrees_acts_along_the_tibia_not_the_femur():
    """Bent by a right angle, forwards of the tibia is down the femur: its anterior axis says
    nothing of a drawer, the floating axis all."""
    bent = geo.Pose.from_table([90.0, 0.0, 0.0, 2.0, -30.0, 1.0])
    wrench = load_of(anterior_N=90.0).wrench(bent.placement)
    np.testing.assert_allclose(np.array(wrench.force, float), [0.0, -90.0, 0.0], atol=1e-12)
    squeeze = load_of(compression_N=50.0).wrench(bent.placement)
    np.testing.assert_allclose(np.array(squeeze.force, float), [50.0, 0.0, 0.0], atol=1e-12)
    moved = geo.Pose.from_table([90.0, 0.0, 0.0, 2.0, -30.92, 1.0])
    femoral, clinical = (
        np.array(converted(moved, c) - converted(bent, c))[3]
        for c in ("femoral", "grood-suntay")
    )
    assert (femoral, clinical) == (0.0, pytest.approx(0.92, abs=1e-12))


def test_forces_act_at_the_tibias_origin_unless_a_point_is_given():
    bent = geo.Pose.from_table([60.0, 5.0, -9.0, 2.0, -30.0, 1.0])
    plain = load_of(anterior_N=100.0).wrench(bent.placement)
    np.testing.assert_allclose(np.array(plain.moment, float), 0.0, atol=1e-12)
    lower = load_of(anterior_N=100.0, point=(0.0, -50.0, 0.0)).wrench(bent.placement)
    force, arm = (
        np.array([float(x) for x in v])
        for v in (lower.force, bent.placement.turn((0.0, -50.0, 0.0)))
    )
    np.testing.assert_allclose(np.array(lower.moment, float), np.cross(arm, force), atol=1e-9)


def test_loads_of_a_left_knee_mean_the_same():
    """The wrench of a named load on the mirrored twin is the mirror image of that on a left knee,
    whose axes of Grood and Suntay are its own."""
    table = [50.0, 6.0, -14.0, 3.0, -30.0, 2.0]
    right, left = geo.Pose.from_table(table), left_twin_pose(table)
    sizes = (3.0, -90.0, 40.0, 7.0, -2.0)
    named = load_of(**dict(zip(NAMED_LOADS, sizes, strict=True)))
    ours = named.wrench(right.placement)
    mirrored = Load(named.force * jnp.array([1, 1, -1]), named.moment * jnp.array([-1, -1, 1]),
                    axes="grood_suntay").wrench(left.placement)  # fmt: skip
    for mine, theirs, sign in (
        (ours.force, mirrored.force, [1, 1, -1]),
        (ours.moment, mirrored.moment, [-1, -1, 1]),
    ):
        np.testing.assert_allclose(
            np.array(theirs, float), np.array(mine, float) * sign, rtol=1e-12, atol=1e-9
        )


def test_many_loads_at_once_are_rows():
    many = load_of(anterior_N=np.array([1.0, 2.0]), varus_Nm=3.0)
    np.testing.assert_allclose(many.force, [[1, 0, 0], [2, 0, 0]])
    np.testing.assert_allclose(many.moment, [[3000, 0, 0]] * 2)
    assert many.point.shape == (2, 3)


def test_words_of_a_load():
    assert load_words({}) == load_words(dict.fromkeys(NAMED_LOADS, 0.0)) == "no load"
    both = {"compression_N": -20.0, "internal_Nm": -1.5}
    assert load_words(both) == "distraction 20 N, external torque 1.5 N m"
    for load in NAMED_LOADS.values():
        assert {load_called(word) for word in (load.name, *load.also_called)} == {load.name}
