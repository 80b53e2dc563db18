"""Limits, tolerances and the optimum of a surgery in closed form."""

import numpy as np
import pytest

from kneejax.planning import (
    TunnelMap,
    best_of,
    missed,
    optimise,
    tolerances,
    tunnel_map,
)

pytest.importorskip("dtaidistance")

BASE = np.array([0.0, 0.0, 0.0, 0.0, 80.0])
BY = np.array([-0.6, 0.8, 0.3, 0.4, -0.01])


def moved(**by):
    places = {"front": 0, "medial": 1, "forward": 2, "up": 3, "pull": 4}
    choices = BASE.copy()
    for name, far in by.items():
        choices[places[name]] += far
    return choices


@pytest.mark.parametrize(
    ("choices", "off", "by_how_much"),
    [
        (moved(), 0.0, 0.0),
        (moved(), 2.5, 0.25),  # laxer than the band of 2 mm by a quarter of it
        (moved(), -3.0, 0.5),  # tighter
        (moved(pull=74.0), 0.0, 0.1),  # 154 of 140 N
        (moved(front=8.4), 0.0, 0.44),  # (8.4 / 7)^2 - 1
        (moved(up=-9.0), 0.0, 0.44),
        (moved(forward=4.0), 0.0, 0.0),  # on the ellipse
    ],
)
def test_each_limit_is_missed_by_its_part(made_up, choices, off, by_how_much):
    surgery = made_up(off=off)
    assert missed(surgery, surgery.try_out(choices)) == pytest.approx([by_how_much], abs=1e-12)


def test_the_best_keeps_the_limits_before_it_is_near(made_up):
    surgery = made_up(right=6.0)
    # The nearest strains are outside of the ellipse; of those inside the second is nearer.
    outside, inside = moved(front=6.0, medial=4.0), (moved(front=3.0), moved(front=4.0))
    assert best_of(surgery, surgery.try_out(np.stack([outside, *inside]))) == 2
    # Where none is inside, the one that is least outside.
    far = np.stack([outside, moved(front=6.0, medial=3.0)])
    assert best_of(surgery, surgery.try_out(far)) == 1


@pytest.mark.parametrize(("off", "edge"), [(0.5, 1.0), (-0.5, -1.0), (1.5, 1.0)])
def test_a_linear_laxity_leaves_its_band_where_a_line_does(made_up, off, edge):
    surgery = made_up(off=off, by=BY)
    found = tolerances(surgery, surgery.try_out(BASE, slopes=True))
    for one, by in zip(found, (BY[:2], BY[2:4]), strict=True):
        steep = np.linalg.norm(by)
        assert one.slope == pytest.approx(steep)
        assert one.direction == pytest.approx(edge * by / steep)
        expected = (2.0 - abs(off)) / steep
        assert one.expected_mm == pytest.approx(expected)
        assert one.found_mm == pytest.approx(expected)


def test_the_optimum_of_a_linear_problem_is_its_corner(made_up):
    # Strains are right 9 mm in front, outside of the ellipse: the optimum lies on it, and the
    # laxity, which falls there by 0.6 mm a mm, stays within 2 mm by a looser graft.
    surgery = made_up(right=9.0, by=BY)
    found = optimise(surgery, BASE, np.ones(5, bool))
    assert found.starts[0] == pytest.approx(BASE)
    assert found.feasible and found.evaluations <= 60
    best = found.outcome
    assert best.choices[0, 0] == pytest.approx(7.0, abs=0.01)
    assert best.total[0] == pytest.approx(2.0 * 0.01 * 2.0, abs=3e-4)
    assert abs(best.laxity_mm[0, 0] - 3.0) <= 2.0 + 1e-3


def test_few_evaluations_are_spent_on_steps_too(made_up):
    surgery = made_up(right=3.0)
    found = optimise(surgery, BASE, np.ones(5, bool), most=8, starts=2)
    assert found.evaluations <= 8 and len(found.ends) == 1
    # Steps of at most 2 mm, of which the second is the last.
    assert found.outcome.total[0] == pytest.approx(0.0, abs=1e-9)


def test_what_is_not_free_stays(made_up):
    found = optimise(made_up(right=9.0, by=BY), BASE, np.array([True, True, False, False, False]))
    assert found.outcome.choices[0, 2:] == pytest.approx(BASE[2:])
    # The band binds first: 0.6 mm a mm to the front, 0.8 to the medial side.
    assert found.feasible


@pytest.mark.parametrize(("bone", "first"), [("tibia", 0), ("femur", 2)])
def test_a_map_moves_the_tunnel_of_its_bone(made_up, bone, first):
    surgery = made_up(by=BY, right=0.0)
    along, across = np.array([-1.0, 0.0, 2.0]), np.array([-2.0, 1.0])
    found = tunnel_map(surgery, BASE, bone, along, across)
    expected = 3.0 + BY[first] * along + BY[first + 1] * across[:, None]
    assert found.laxity_mm[0] == pytest.approx(expected)
    assert isinstance(found, TunnelMap) and found.total.shape == (2, 3)


def test_the_least_place_of_a_map_is_told_by_its_coordinates(made_up):
    along, across = np.array([-1.0, 0.0, 2.0]), np.array([-2.0, 1.0])
    found = tunnel_map(made_up(right=2.0), BASE, "tibia", along, across)
    assert found.least == pytest.approx((2.0, -2.0, 0.0))
