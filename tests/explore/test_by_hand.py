"""A motion that follows the hand is the motion of the knee with these parameters."""

import numpy as np
import pytest

import kneejax as kj
from kneejax import inference, parameters
from kneejax.explorer import ByHand
from kneejax.geometry import FREE_COORDINATES
from kneejax.statics import converged
from kneejax.studies import Study

pytestmark = pytest.mark.usefixtures("optimised_code")

FLEXION = np.array([0.0, 5.0, 10.0, 20.0, 40.0, 80.0, 120.0])


@pytest.fixture(scope="module")
def measured(knee):
    return np.asarray(kj.passive_flexion(knee, FLEXION).to_table())


def study(knee, measured, **more):
    return Study(title="by hand", knee=knee, measured=measured, weights="paper1",
                 parameters=["*.stiffness", "*.reference_strain"], **more)  # fmt: skip


@pytest.fixture(scope="module")
def begun(knee, measured):
    return ByHand(study(knee, measured))


@pytest.fixture
def hand(begun):
    begun.move(begun.begin)
    return begun


def motion(knee, values):
    return np.asarray(kj.passive_flexion(knee.replace(values), FLEXION).to_table())


def test_begins_at_the_knee_itself(knee, hand):
    assert hand.objective == pytest.approx(0.0, abs=1e-12)
    assert hand.condition == inference.Condition.SOUND
    own = hand.study.selection.read(knee)
    assert list(hand.values.values()) == pytest.approx(own.tolist())


def test_each_move_gives_passive_flexion_of_that_knee(knee, hand):
    moves = [
        ("ACL.stiffness", 4700.0), ("MCL.reference_strain", 0.06), ("PCL.stiffness", 900.0),
        ("LCL.reference_strain", 0.02), ("ACL.stiffness", 9300.0),
    ]  # fmt: skip
    for name, value in moves:
        table = hand.move({name: value}).table
        assert hand.values[name] == value
        np.testing.assert_allclose(table, motion(knee, hand.values), atol=1e-6)


def test_objective_is_the_weighted_sum_of_squares(knee, measured, hand):
    moved = hand.move({"PCL.stiffness": 3000.0}).table
    error = moved[:, 1:] - measured[:, 1:]
    np.testing.assert_allclose(moved, motion(knee, hand.values), atol=1e-6)
    assert hand.objective == pytest.approx(float((error**2 @ [8, 8, 1, 1, 1]).sum()), rel=1e-9)


def test_derivative_is_the_slope_of_moves(hand):
    name, step = "MCL.stiffness", 5.0
    value = hand.values[name]
    low, high = (hand.move({name: value + s}).table[:, 1:].T for s in (-step, step))
    hand.move({name: value})
    exact = hand.jacobian[:, :, hand.names.index(name)]
    np.testing.assert_allclose(exact, (high - low) / (2 * step), atol=1e-6 * np.abs(exact).max())


def test_coupling_is_that_of_the_linear_fit(hand):
    """Two parameters make up for each other as their columns of the Jacobian say."""
    pair = ("PCL.stiffness", "PCL.reference_strain")
    alone, free, ellipse = hand.coupling(pair)
    rows = np.sqrt([8.0, 8.0, 1.0, 1.0, 1.0])[:, None, None] * hand.jacobian
    rows = rows.reshape(-1, len(hand.names))
    one, other = (rows[:, hand.names.index(name)] for name in pair)
    cosine = one @ other / np.linalg.norm(one) / np.linalg.norm(other)
    assert alone == pytest.approx(-cosine, rel=1e-6)
    assert -1.0 <= free <= 1.0 and ellipse.shape[0] == 2
    here = np.array([[hand.values[name]] for name in pair])
    moved = np.stack([one, other], axis=1) @ (ellipse - here)
    np.testing.assert_allclose((moved**2).sum(axis=0), 1.0, rtol=0.02)


def test_a_constant_between_frames_costs_nothing(knee, measured):
    """It is left free by the study: the best one is taken off."""
    apart = measured + np.array([0.0, 0.0, 0.0, 3.0, 0.0, 0.0])
    held, free = (
        ByHand(study(knee, apart, **more)) for more in ({}, {"frame_offset": ["anterior"]})
    )
    assert held.objective == pytest.approx(len(FLEXION) * 9.0, rel=1e-6)
    assert free.objective == pytest.approx(0.0, abs=1e-9)
    assert FREE_COORDINATES[2] == "anterior"


def test_a_hand_that_returns_finds_the_motion_it_left(hand, measured):
    """On its way the knee at 0 to 10 degrees goes over to a second balance, 16 mm away."""
    hand.move({"MCL.reference_strain": -0.08})
    home = hand.move({"MCL.reference_strain": 0.07})
    np.testing.assert_allclose(home.table, measured, atol=1e-6)


def test_what_has_no_balance_says_so_and_comes_back(hand, measured):
    lost = hand.move({"MCL.reference_strain": -0.2})
    assert hand.condition != inference.Condition.SOUND
    gone = ~converged(lost.status)
    assert np.isnan(lost.table[gone, 1:]).all() and np.isfinite(lost.table[~gone]).all()
    assert np.isnan(hand.objective) == gone.any()
    back = hand.move(hand.begin)
    np.testing.assert_allclose(back.table, measured, atol=1e-6)


@pytest.mark.slow
def test_a_drag_through_lost_poses_and_back_changes_nothing(hand, measured):
    lost = []
    for strain in [*np.linspace(0.07, -0.1, 18), *np.linspace(-0.1, 0.07, 18)]:
        moved = hand.move({"MCL.reference_strain": strain})
        lost.append((~converged(moved.status)).any())
    assert any(lost) and not lost[-1]
    np.testing.assert_allclose(moved.table, measured, atol=1e-6)


def test_bad_moves_change_nothing(hand):
    before = hand.now
    with pytest.raises(parameters.UnknownParameter, match=r"ACL.slack_length.*8 free numbers"):
        hand.move({"ACL.slack_length": 30.0})
    with pytest.raises(parameters.UnsuitableData, match="ACL.stiffness: nan is not finite"):
        hand.move({"ACL.stiffness": np.nan})
    assert hand.now is before


def test_a_study_of_tests_alone_has_no_curves():
    class Poseless(Study):
        def poses(self):
            return np.empty((0, 6))

    tests = Poseless(title="no poses", knee="four_ligament", parameters=["*.stiffness"],
                     measured=[[30.0, 0.0, 2.0, 1.0, 0.0, 0.5]])  # fmt: skip
    with pytest.raises(parameters.UnsuitableData, match="without poses"):
        ByHand(tests)


@pytest.mark.parametrize("bad", [np.zeros((3, 5)), np.zeros((0, 6)), np.full((2, 6), np.nan)])
def test_measurements_that_cannot_be_followed(knee, bad):
    with pytest.raises(kj.InputProblem):
        study(knee, bad)
