"""What a status says of a pose."""

import jax.numpy as jnp
import numpy as np
import pytest

from kneejax.statics import Status, converged, sound
from kneejax.statics._status import gives_way


@pytest.mark.parametrize("status", Status)
def test_a_status_says_what_is_wrong_and_what_to_do_next(status):
    assert status.word == status.name.lower()
    assert len(status.sentence.split()) > 2
    wrong = status is not Status.BALANCED
    assert bool(status.fault) == bool(status.advice) == bool(status.remark) == wrong
    assert status.sentence.endswith(status.remark)
    assert ("forces balance" in status.sentence) == (wrong and status.converged)


def test_one_place_says_which_poses_are_balances_and_which_are_sound():
    every = np.array(Status)
    for array in (every, jnp.asarray(every)):
        assert np.asarray(converged(array)).tolist() == [one.converged for one in Status]
        assert np.asarray(sound(array)).tolist() == [one.sound for one in Status]
    lost = {one for one in Status if not one.converged}
    assert lost == {
        Status.TOO_DEEP, Status.NO_PATCH, Status.THROUGH_BONE, Status.GIVES_WAY,
        Status.NOT_CONVERGED,
    }  # fmt: skip
    assert {one for one in Status if one.converged and not one.sound} == {
        Status.UNSTABLE, Status.DISLOCATED,
    }  # fmt: skip


def test_what_holds_part_of_a_load_gives_way_unless_no_pose_lies_beyond():
    """However little the load grows; a search that ended in a pose that no knee has tells none."""
    lost, way = np.array([True, True, True, True, False]), np.array([0.5, 0.5, 0.0, 0.5, 1.0])
    fault = np.array([Status.BALANCED, Status.TOO_DEEP, Status.BALANCED, Status.TOO_DEEP, 0])
    singular = np.array([False, False, True, True, True])
    found = gives_way(lost, way, singular, fault)
    assert found.tolist() == [True, False, False, True, False]
