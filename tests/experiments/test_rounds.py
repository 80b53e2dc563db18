"""Rounds between a whole body and a knee: their fixed point where plain rounds run away."""

import numpy as np
import pytest

from kneejax.experiments import Round, weights
from kneejax.report.activity import round_table

FLEXION = np.array([0.0, 20.0, 40.0])
GOAL = np.outer([1.0, 2.0, 3.0], [1.0, -2.0, 0.5, 0.1, 4.0])


def one_round(number, before, slope):
    """A knee whose motion answers to the model's as a straight line with a fixed point."""
    after = GOAL + slope * (before - GOAL)
    return Round(number, FLEXION, before, after, np.zeros(5), (3, 3), 0.0, 0.0)


@pytest.mark.parametrize("slope", [-3.0, -0.5, 0.3])
def test_rounds_end_where_the_knee_moves_as_the_model(slope):
    """Put back whole, changes would grow threefold a round; one secant ends them."""
    before, rounds = np.zeros((3, 5)), []
    for number in range(3):
        rounds.append(one_round(number, before, slope))
        before = before + weights(rounds)[-1] * rounds[-1].change
    last = 1.0 if slope == 0.3 else 1e-12  # what would take more than the whole change is held
    assert np.abs(before - GOAL).max() < last
    assert rounds[-1].residual.max() < rounds[0].residual.max()


def test_the_residual_is_the_change_of_each_coordinate():
    one = one_round(0, np.zeros((3, 5)), 0.0)
    rms, largest = one.residual
    assert rms == pytest.approx(np.sqrt(14.0 / 3.0) * np.abs(GOAL[0]))
    assert largest == pytest.approx(3.0 * np.abs(GOAL[0]))
    rows = round_table([one]).records()
    assert [row["coordinate"] for row in rows] == [
        "adduction_deg", "internal_rotation_deg", "anterior_mm", "superior_mm", "lateral_mm",
    ]  # fmt: skip
    assert rows[1]["residual_largest"] == pytest.approx(6.0)
    assert (rows[4]["residual_largest"], rows[4]["balanced_instants"]) == (pytest.approx(12.0), 3)
