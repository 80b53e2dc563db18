"""Loads do the work of their wrench; lines of constant tension pull along themselves."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import kneejax.geometry as geo
from kneejax.mechanics import BONES, ConstantTensionLine, Load, generalised_force

FLEXION = 0.6
Q = np.array([0.05, -0.15, 3.0, -28.0, 2.0])
FORCE, MOMENT, POINT = np.array([70.0, -20.0, 30.0]), np.array([900.0, -2500.0, 400.0]), [4, -60, 9]


def placed(q):
    """Rotation matrix and translation of the tibia."""
    place = geo.Pose.from_state(FLEXION, jnp.asarray(q)).placement
    return np.array([[float(x) for x in r] for r in place.rotation]), np.asarray(q[2:])


@pytest.mark.parametrize(("axes", "point_in"), list(itertools.product(BONES, BONES)))
def test_a_load_does_the_work_of_moving_the_tibia(axes, point_in, central_difference):
    load = Load(FORCE, MOMENT, POINT, axes, point_in)
    pose = geo.Pose.from_state(FLEXION, jnp.asarray(Q))
    ours = np.stack(generalised_force(pose, pose.placement, load.wrench(pose.placement)))
    r0, t0 = placed(Q)
    force, moment = (r0 @ x if axes == "tibia" else x for x in (FORCE, MOMENT))
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
        tip = geo.Pose.from_state(FLEXION, q).placement.apply(geo.vector(load.point))
        return -geo.dot(geo.vector(load.force), tip)

    pose = geo.Pose.from_state(FLEXION, jnp.asarray(Q))
    ours = generalised_force(pose, pose.placement, load.wrench(pose.placement))
    expected = -np.asarray(jax.grad(potential)(jnp.asarray(Q)))
    np.testing.assert_allclose(np.asarray(ours), expected, rtol=1e-12, atol=1e-10)


def test_a_load_in_a_batch_has_a_row_for_each_coordinate():
    load = jax.tree.map(lambda x: x[..., None], Load(FORCE, MOMENT, POINT, "tibia", "femur"))
    q = jnp.asarray(Q)[:, None] + jnp.linspace(0.0, 0.1, 4)
    pose = geo.Pose.from_state(FLEXION, q)
    together = np.stack(generalised_force(pose, pose.placement, load.wrench(pose.placement)))
    assert together.shape == (5, 4)
    one = geo.Pose.from_state(FLEXION, q[:, 2])
    single = Load(FORCE, MOMENT, POINT, "tibia", "femur")
    alone = generalised_force(one, one.placement, single.wrench(one.placement))
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
        return line.energy(jnp.asarray(FLEXION), geo.Pose.from_state(FLEXION, q).placement)

    assert float(energy(Q)) == pytest.approx(20.0 * np.linalg.norm(lower - upper), rel=1e-13)
    pull = -np.asarray(jax.grad(energy)(jnp.asarray(Q)))[2:]
    np.testing.assert_allclose(
        pull, 20.0 * (upper - lower) / np.linalg.norm(upper - lower), rtol=1e-12
    )


def test_a_line_with_one_row_has_a_fixed_upper_end():
    line = ConstantTensionLine(20.0, [[30.0, 40.0, 0.0]], [12.0, -50.0, 3.0])
    tibia = geo.Pose.from_state(FLEXION, jnp.asarray(Q)).placement
    assert float(line.energy(0.0, tibia)) == float(line.energy(1.0, tibia))
