"""Every stable balance at a flexion, not only the one that a test finds."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import kneejax as kj
from kneejax.geometry import FREE_COORDINATES, Pose, State, scales
from kneejax.mechanics import add_lane_axis, load_of
from kneejax.statics import force

FLEXION = [60.0, 75.0, 90.0]
VALGUS = [load_of(varus_Nm=-40.0)]


@pytest.fixture(scope="module")
def found(knee):
    """Under a heavy valgus moment the knee turns far inwards, or far outwards."""
    return kj.branches(knee, FLEXION, VALGUS)


def test_what_decides_by_numbers_says_that_it_has_no_derivative(knee):
    with pytest.raises(TypeError, match="branches: has no derivatives.*passive_flexion can"):
        jax.grad(lambda x: kj.branches(knee, x)[0].apart_mm)(30.0)
    (test,) = kj.lab_tests("drawer", [30.0], steps=2)
    nodes, part = np.zeros((1, 1), int), np.zeros(1)
    with pytest.raises(TypeError, match="laxity: has no derivatives.*load_curves"):
        # Whatever the motion is.
        jax.grad(lambda x: kj.laxity(kj.Curves(test, x, nodes, part, nodes[0]))[0].range)(0.0)


@pytest.mark.long
def test_a_knee_without_load_rests_in_one_pose(knee):
    found = kj.branches(knee, FLEXION)
    assert [branch.by_test for branch in found] == [True, True, True]
    table = np.asarray(kj.passive_flexion(knee, FLEXION).to_table())
    np.testing.assert_array_equal([branch.pose for branch in found], table)
    assert all(branch.starts > 20 for branch in found)


@pytest.mark.long
def test_both_ways_to_give_are_found_at_every_angle(found):
    turned = {load_case: [] for load_case in range(3)}
    for branch in found:
        turned[branch.load_case].append(branch.pose[2])
    for angles in turned.values():
        assert len(angles) == 2 and min(angles) < -10.0 and max(angles) > 40.0
    # A test ends on one of them, or gives way between.
    assert [branch.load_case for branch in found if branch.by_test] == [0, 2]
    others = [branch for branch in found if not branch.by_test]
    assert [np.isnan(branch.apart_mm) for branch in others] == [False, True, True, False]
    assert min(branch.apart_mm for branch in (others[0], others[-1])) > 30.0


@pytest.mark.long
def test_each_of_them_is_in_balance(knee, found):
    poses = Pose.from_table(np.array([branch.pose for branch in found]))
    lanes = add_lane_axis(dataclasses.replace(knee, loads=(*knee.loads, *VALGUS)))
    held, q = {"flexion": poses.flexion}, State({"tibia": poses}).at(FREE_COORDINATES)
    left, _ = force(lanes, held, q)
    assert float(jnp.abs(left * jnp.asarray(scales(FREE_COORDINATES))[:, None]).max()) < 1e-3
