"""Lanes of several knees: each is balanced as if it were alone, with its own derivative."""

import equinox as eqx
import numpy as np
import pytest

import kneejax as kj
from kneejax.inference import CalibrationProblem, Noise
from kneejax.inference.calibration._question import SeveralKnees
from kneejax.inference.fit import Problem, form_of
from kneejax.statics import LoadCases, balance_with_slopes

FLEXION = [0.0, 30.0, 60.0]


def knees():
    """The bundled knee, and two whose attachments are elsewhere."""
    base = kj.load_knee("four_ligament")
    places = [base.ligaments.tibial_attachment + shift for shift in (0.0, 0.8, -0.5)]
    return [eqx.tree_at(lambda k: k.ligaments.tibial_attachment, base, x) for x in places]


@pytest.fixture(scope="module")
def several():
    table = np.zeros((3, 6))
    table[:, 0] = FLEXION
    chosen = kj.select(knees()[0], ["*.stiffness"])
    noise = Noise.of(weights=np.ones(5))
    return SeveralKnees.of(
        [CalibrationProblem.of(one, chosen, table, noise=noise) for one in knees()]
    )


@pytest.mark.long
def test_each_lane_is_its_own_knee(several):
    chosen = several.members[0].fitted.selection
    start = np.tile([4000.0, 3500.0, 7000.0, 5500.0], (3, 1))
    (attachments,) = several.whole.own.values()
    assert attachments.shape == (3, 4, 3)
    found = several.whole.begin(start)
    assert found.knee.tolist() == [0, 1, 2] and found.converged.all()
    # Later balances know whose they are from near ones, in any order.
    order = np.array([2, 0])
    moved = several.whole.balance(start[order] * 1.05, found.take(order))
    for row, knee in enumerate(order):
        alone = balance_with_slopes(
            knees()[knee], chosen.apply, start[:1] * 1.05, LoadCases.at(FLEXION)
        )
        np.testing.assert_allclose(moved.q[row], alone.q[0], rtol=0, atol=1e-7)
        scale = np.abs(alone.jacobian[0]).max()
        np.testing.assert_allclose(moved.jacobian[row], alone.jacobian[0], atol=1e-6 * scale)


@pytest.mark.long
def test_a_lane_s_derivative_is_that_of_its_own_knee(several):
    start = np.tile([4000.0, 3500.0, 7000.0, 5500.0], (3, 1))
    begin = several.whole.begin(start)
    step = 20.0
    for i in range(4):
        move = step * np.eye(4)[i]
        ends = [several.whole.balance(start + way * move, begin).q for way in (1, -1)]
        slope = (ends[0] - ends[1]) / (2.0 * step)
        scale = np.abs(begin.jacobian[..., i]).max()
        np.testing.assert_allclose(begin.jacobian[..., i], slope, rtol=0, atol=2e-5 * scale)


def test_knees_of_another_form_do_not_stand_beside_them(several):
    first = several.members[0].fitted
    table = first.measured.copy()
    table[:, 0] += 1.0
    other = Problem.of(first.knee, first.selection, table, np.ones(5))
    assert form_of(first) == form_of(several.members[1].fitted) != form_of(other)
