"""A motion that follows the hand is the motion of the knee with these parameters."""

import numpy as np
import pytest

import kneejax as kj
from kneejax import inference, parameters
from kneejax.statics import converged

pytestmark = pytest.mark.usefixtures("optimised_code")

FLEXION = np.array([0.0, 5.0, 10.0, 20.0, 40.0, 80.0, 120.0])


@pytest.fixture(scope="module")
def measured(knee):
    return np.asarray(kj.passive_flexion(knee, FLEXION).to_table())


@pytest.fixture
def live(knee, measured):
    return inference.LiveMotion(knee, measured)


def motion(knee, values):
    return np.asarray(kj.passive_flexion(kj.with_values(knee, values), FLEXION).to_table())


def test_begins_at_the_knee_itself(knee, live, measured):
    assert live.now.objective == pytest.approx(0.0, abs=1e-12)
    assert live.now.condition == inference.Condition.SOUND
    own = live.selection.read(knee)
    assert list(live.now.values.values()) == pytest.approx(own.tolist())


def test_each_move_gives_passive_flexion_of_that_knee(knee, live):
    moves = [
        ("ACL.stiffness", 4700.0), ("MCL.reference_strain", 0.06), ("PCL.stiffness", 900.0),
        ("LCL.reference_strain", 0.02), ("ACL.stiffness", 9300.0),
    ]  # fmt: skip
    for name, value in moves:
        moved = live.move(name, value)
        assert moved.values[name] == value
        np.testing.assert_allclose(moved.table, motion(knee, moved.values), atol=1e-6)


def test_objective_is_the_weighted_sum_of_squares(knee, measured):
    weights = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    moved = inference.LiveMotion(knee, measured, weights=weights).move("PCL.stiffness", 3000.0)
    error = motion(knee, moved.values)[:, 1:] - measured[:, 1:]
    assert moved.objective == pytest.approx(float((error**2 @ weights).sum()), rel=1e-6)


def test_derivative_is_the_slope_of_moves(live):
    name, step = "MCL.stiffness", 5.0
    i = live.selection.names.index(name)
    value = live.now.values[name]
    low, high = (live.move(name, value + s).table[:, 1:].T for s in (-step, step))
    exact = live.move(name, value).jacobian[:, :, i]
    np.testing.assert_allclose(exact, (high - low) / (2 * step), atol=1e-6 * np.abs(exact).max())


def test_a_hand_that_returns_finds_the_motion_it_left(live, measured):
    """On its way the knee at 0 to 10 degrees goes over to a second balance, 16 mm away."""
    live.move("MCL.reference_strain", -0.08)
    home = live.move("MCL.reference_strain", 0.07)
    np.testing.assert_allclose(home.table, measured, atol=1e-6)


def test_what_has_no_balance_says_so_and_comes_back(live, measured):
    begin = live.now.values
    lost = live.move_to(begin | {"MCL.reference_strain": -0.2})
    assert lost.condition != inference.Condition.SOUND
    gone = ~converged(lost.status)
    assert np.isnan(lost.table[gone, 1:]).all() and np.isfinite(lost.table[~gone]).all()
    assert np.isnan(lost.objective) == gone.any()
    back = live.move_to(begin)
    np.testing.assert_allclose(back.table, measured, atol=1e-6)


@pytest.mark.slow
def test_a_drag_through_lost_poses_and_back_changes_nothing(live, measured):
    lost = []
    for strain in [*np.linspace(0.07, -0.1, 18), *np.linspace(-0.1, 0.07, 18)]:
        moved = live.move("MCL.reference_strain", strain)
        lost.append((~converged(moved.status)).any())
    assert any(lost) and not lost[-1]
    np.testing.assert_allclose(moved.table, measured, atol=1e-6)


def test_bad_moves_change_nothing(live):
    before = live.now
    with pytest.raises(parameters.UnknownParameter, match=r"ACL.slack_length.*selected are"):
        live.move("ACL.slack_length", 30.0)
    with pytest.raises(parameters.UnsuitableData, match="ACL.stiffness: nan is not finite"):
        live.move("ACL.stiffness", np.nan)
    assert live.now is before


@pytest.mark.parametrize(
    ("measured", "words"),
    [
        (np.zeros((3, 5)), r"shape \(3, 5\)"),
        (np.zeros((0, 6)), r"shape \(0, 6\)"),
        (np.full((2, 6), np.nan), "row 0 is not finite"),
    ],
)
def test_measurements_that_cannot_be_followed(knee, measured, words):
    with pytest.raises(parameters.UnsuitableData, match=words):
        inference.LiveMotion(knee, measured)
