"""Varus and valgus: the loads' work, the end of a ramp, and a knee and its mirror image."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from kneejax.geometry import FREE_COORDINATES, Frame, Plane, Pose, Sphere, State
from kneejax.mechanics import Contact, Knee, Ligaments
from kneejax.papers.varus_valgus import VarusValgus, VarusValgusRamp
from kneejax.statics import Equilibria, Status, balance_many, itself

TURNED = Pose.from_table([0.0, 7.0, -12.0, 3.0, -2.0, 1.0])


def at(pose, flexion_deg):
    return dataclasses.replace(pose, flexion=jnp.deg2rad(flexion_deg))


@pytest.mark.parametrize("flexion_deg", [0.0, 35.0])
def test_the_moment_works_on_adduction_alone(small_knee, flexion_deg):
    ramp = VarusValgusRamp("varus", 30.0, 600.0, 2, 3, flexion_deg)
    pose = at(TURNED, flexion_deg)
    full, axial = (
        sum(np.stack(load.work(State({"tibia": pose}), FREE_COORDINATES))
            for load in loads_at(ramp, step))
        for step in (-1, 1)
    )  # fmt: skip
    assert full - axial == pytest.approx([30e3, 0, 0, 0, 0], abs=1e-9)


def test_the_axial_load_pushes_the_tibia_along_its_long_axis(small_knee):
    ramp = VarusValgusRamp("varus", 30.0, 600.0, 2, 3)
    pushed = dataclasses.replace(small_knee, loads=loads_at(ramp, 1))
    # Through the tibia's origin: no moment, 300 N up the tibia.
    work = np.asarray(pushed.load_work(State({"tibia": TURNED}), FREE_COORDINATES))
    along = np.array([float(x) for x in TURNED.placement.turn((0.0, 1.0, 0.0))])
    assert work == pytest.approx([0, 0, *(300 * along)], abs=1e-9)


def loads_at(ramp, step):
    return jax.tree.map(lambda x: x[step], ramp.load_cases.loads)


def test_steps_and_time_are_those_of_table_2():
    ramp = VarusValgusRamp("valgus", 40.0, 650.0, 2, 4)
    assert ramp.axial_N.tolist() == [162.5, 325.0, 325.0, 325.0, 325.0, 325.0]
    assert ramp.moment_Nm.tolist() == [0.0, 0.0, -10.0, -20.0, -30.0, -40.0]
    assert ramp.time == pytest.approx([1.75, 2.0, 2.25, 2.5, 2.75, 3.0])
    assert ramp.loaded.tolist() == [False] + [True] * 5


def made_up_run(status, adduction_deg):
    status = np.array(status)
    q = np.zeros((*status.shape, 5))
    q[..., 0] = np.deg2rad(adduction_deg)
    nothing = np.zeros((*status.shape, 0, 2))
    ramp = VarusValgusRamp("varus", 40.0, 650.0, 2, 4)
    steps, left = np.zeros(status.shape, int), np.zeros(status.shape)
    return VarusValgus(ramp, Equilibria(q, nothing, status, steps, left + 1.0, status, left))


def test_a_ramp_ends_at_the_first_step_that_is_not_sound():
    fine, outside, unstable = Status.BALANCED, Status.OUTSIDE_REGION, Status.UNSTABLE
    gentle = np.arange(6.0)
    run = made_up_run(
        [
            [fine] * 6,
            [fine, fine, fine, outside, fine, fine],
            [fine, fine, unstable, fine, fine, fine],
            [Status.NOT_CONVERGED] * 6,
            [fine] * 6,
        ],
        [gentle, gentle, gentle, gentle, np.r_[gentle[:4], 25.0, 26.0]],
    )
    assert run.reached.tolist() == [6, 3, 2, 0, 4]
    assert run.ending == ("", "outside_region", "unstable", "not_converged", "jump")
    assert run.moment_reached_Nm.tolist() == [40.0, 10.0, 0.0, 0.0, 20.0]
    assert run.time_reached == pytest.approx([3.0, 2.25, 2.0, 1.5, 2.5])
    assert np.isnan(run.adduction_deg[4]).tolist() == [False] * 4 + [True] * 2


def ball_knee(mirrored):
    """Two unlike balls on planes, held by four unlike fibres; or its image in the mirror."""
    sign = np.array([1.0, 1.0, -1.0 if mirrored else 1.0])
    contacts = tuple(
        Contact(
            Sphere(radius, Frame([0.0, 0.0, sign[2] * side])),
            Plane(Frame([0.0, -radius, 0.0])),
            onset_width=0.05,
        )
        for radius, side in ((30.0, -20.0), (32.0, 24.0))
    )
    ligaments = Ligaments(
        sign * [[0, 5, -40], [0, 5, 40], [-5, 0, 4], [4, 2, -6]],
        sign * [[2, -75, -38], [-4, -60, 42], [12, -28, -3], [-14, -30, 2]],
        [5000.0, 4000.0, 4000.0, 3500.0],
        [78.0, 62.0, 31.0, 34.0],
        [0.06] * 4,
        [0.002] * 4,
        ["MCL", "LCL", "ACL", "PCL"],
    )
    return Knee(ligaments, contacts, (), (), Pose.from_table([0.0] * 6), ("medial", "lateral"))


def varus_valgus(knee, ramp):
    return VarusValgus(ramp, balance_many(knee, itself, np.zeros(1), ramp.load_cases))


def test_a_moment_is_reached_by_way_of_the_lighter_ones():
    # Each step from the one before takes a few looks; each from the unloaded knee takes the more
    # the larger it is.
    ramp = VarusValgusRamp("varus", 6.0, 600.0, 2, 12)
    steps = varus_valgus(ball_knee(mirrored=False), ramp).balances.steps[0]
    assert steps[3:].max() <= 3


@pytest.mark.long
def test_varus_of_a_mirrored_knee_is_valgus():
    coarse = {"full_Nm": 6.0, "body_weight_N": 600.0, "axial_steps": 2, "moment_steps": 4}
    varus, valgus = (
        varus_valgus(ball_knee(mirrored), VarusValgusRamp(direction, **coarse))
        for mirrored, direction in ((False, "varus"), (True, "valgus"))
    )
    assert varus.reached.tolist() == valgus.reached.tolist() == [6]
    table = varus.balances.table[0]
    assert table[-1, 0] > table[1, 0] + 0.2
    # Adduction, internal rotation and lateral change sign in the mirror.
    assert valgus.balances.table[0] * [-1, -1, 1, 1, -1] == pytest.approx(table, abs=1e-5)
