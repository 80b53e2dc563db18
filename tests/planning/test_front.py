"""Several criteria at once: fronts in closed form, and on a knee."""


import dataclasses
from typing import Any

import numpy as np
import pytest

from kneejax.planning import PlanResult, criteria_of, missed, pareto_front, undominated
from kneejax.report.plan import plan_failed

pytest.importorskip("dtaidistance")
pytest.importorskip("pymoo")

BASE = np.array([0.0, 0.0, 0.0, 0.0, 80.0])


@pytest.fixture(scope="module")
def of_two(made_up):
    """Laxity falls by 0.01 mm a newton and grows with the square of the femoral tunnel's place; all
    strains are the intact knee's: two criteria, of which the front is a straight line."""
    surgery = made_up(by=(0.0, 0.0, 0.0, 0.0, -0.01), curved=0.05)
    return surgery, pareto_front(surgery, BASE, np.ones(5, bool), population=24, generations=12)


def test_a_front_in_closed_form(of_two):
    _, front = of_two
    laxity, peak, strains = front.criteria.T
    assert front.names == ("laxity_20_deg_mm", "graft_peak_N", "strain_distance")
    assert laxity == pytest.approx(3.8 - 0.01 * peak, abs=1e-4)
    assert strains == pytest.approx(0.0, abs=1e-12)
    assert len(peak) > 8 and np.ptp(peak) > 80.0
    # Off the line before it is polished.
    assert (front.rough[:, 0] - 3.8 + 0.01 * front.rough[:, 1]).max() > 1e-3


def test_no_point_is_better_than_another_and_none_worse_than_before(of_two):
    surgery, front = of_two
    assert undominated(front.criteria).all()
    assert (front.criteria <= front.rough + 1e-9).all()
    assert missed(surgery, front.outcome).max() <= 1e-4
    assert criteria_of(front.outcome) == pytest.approx(front.criteria)
    assert surgery.count == front.evaluations


def test_the_compromise_of_a_line_is_its_middle(of_two):
    _, front = of_two
    peak = front.criteria[:, 1]
    middle = 0.5 * (peak.min() + peak.max())
    assert abs(peak[front.compromise] - middle) == pytest.approx(np.abs(peak - middle).min())


def test_the_same_seed_gives_the_same_front(of_two, made_up):
    _, front = of_two
    surgery = made_up(by=(0.0, 0.0, 0.0, 0.0, -0.01), curved=0.05)
    again = pareto_front(surgery, BASE, np.ones(5, bool), population=24, generations=12)
    assert (again.criteria == front.criteria).all()


def test_what_is_not_free_stays_and_corners_of_strain_are_kept(made_up):
    # Strains want the tunnel 4 mm in front, where the laxity is smaller: it goes on to the rim.
    surgery = made_up(by=(-0.2, 0.0, 0.0, 0.0, 0.0), right=4.0)
    free = np.array([True, False, False, False, False])
    front = pareto_front(surgery, BASE, free, population=12, generations=8)
    assert (front.outcome.choices[:, 1:] == BASE[1:]).all()
    places = front.outcome.choices[:, 0]
    assert places.min() == pytest.approx(4.0, abs=0.05) and places.max() < 7.0 + 1e-3
    laxity, _, strains = front.criteria.T
    assert laxity == pytest.approx(3.0 - 0.2 * places)
    assert strains == pytest.approx(0.02 * (places - 4.0), abs=1e-9)
    assert (np.diff(strains) >= 0.0).all()


def test_laxity_and_strains_are_polished_together(made_up):
    # The femoral tunnel is best in its middle, wherever the tibial one trades laxity for strains.
    surgery = made_up(by=(-0.2, 0.0, 0.0, 0.0, 0.0), right=4.0, curved=0.05)
    free = np.array([True, False, True, True, False])
    front = pareto_front(surgery, BASE, free, population=12, generations=6)
    laxity, _, strains = front.criteria.T
    assert laxity == pytest.approx(3.0 - 0.2 * (4.0 + strains / 0.02), abs=1e-3)
    assert np.ptp(strains) > 3e-3


def test_where_no_choice_keeps_the_limits_there_is_no_front(made_up):
    front = pareto_front(made_up(off=9.0), BASE, np.ones(5, bool), population=8, generations=2)
    assert front.criteria.shape == (0, 3) and len(front.outcome.choices) == 0
    whole = made_up().try_out(BASE)
    plan: Any = None
    result = PlanResult(plan, whole, whole, whole, (), None, front, None, (), {})
    assert not result.has_front and plan_failed(result)
    assert not plan_failed(dataclasses.replace(result, front=None))


def test_what_is_known_to_be_best_is_a_point_of_the_front(made_up):
    surgery = made_up(by=(-0.2, 0.0, 0.0, 0.0, -0.01), right=4.0, curved=0.05)
    known = np.array([[4.0, 0.0, 0.0, 0.0, 20.0]])  # right strains under the smallest force
    free = np.ones(5, bool)
    front = pareto_front(surgery, BASE, free, known=known, population=8, generations=1)
    assert front.criteria[0] == pytest.approx([2.8, 20.0, 0.0], abs=1e-9)


def test_of_equal_rows_the_first_is_kept():
    rows = np.array([[1.0, 3.0], [3.0, 1.0], [2.0, 2.0], [2.5, 2.5], [2.0, 2.0]])
    assert undominated(rows).tolist() == [True, True, True, False, False]
