"""Every stable balance at a flexion, not only the one that a test finds."""

import jax.numpy as jnp
import numpy as np
import pytest

import kneejax as kj
from kneejax.geometry import Pose
from kneejax.mechanics import add_lane_axis
from kneejax.statics import force, with_meeting

LAX = {"MCL.reference_strain": -0.1}


@pytest.fixture(scope="module")
def knee():
    return kj.load_knee("four_ligament")


@pytest.fixture(scope="module")
def lax(knee):
    return kj.with_values(knee, LAX)


@pytest.fixture(scope="module")
def found(lax):
    return kj.branches(lax, [5.0, 25.0])


def test_a_taut_knee_rests_in_one_pose(knee):
    flexion = [0.0, 60.0]
    found = kj.branches(knee, flexion)
    assert [branch.by_test for branch in found] == [True, True]
    table = np.asarray(kj.passive_flexion(knee, flexion).to_table())
    np.testing.assert_array_equal([branch.pose for branch in found], table)
    assert all(branch.starts > 20 for branch in found)


def test_a_lax_knee_rests_in_several_each_in_balance(lax, found):
    assert [branch.station for branch in found] == [0, 0, 1, 1]
    assert [branch.by_test for branch in found] == [True, False, True, False]
    assert all(branch.apart_mm > 1.0 for branch in found if not branch.by_test)
    poses = Pose.from_table(np.array([branch.pose for branch in found]))
    lanes = add_lane_axis(lax)
    guess = with_meeting(lanes, poses.flexion, poses.state)
    left, _ = force(lanes, poses.flexion, poses.state, (guess.meeting[:, 0], guess.meeting[:, 1]))
    assert float(jnp.abs(left * jnp.array([1 / 30, 1 / 30, 1, 1, 1])[:, None]).max()) < 1e-4


def test_what_rests_at_one_angle_is_looked_for_at_the_others(lax, found):
    """Alone, no search at 25 degrees ends in the balance that begins at 5 degrees."""
    alone = kj.branches(lax, [25.0])
    assert len(alone) == 1 and len(found) == 4
    np.testing.assert_allclose(alone[0].pose, found[2].pose, atol=1e-9)
