"""What choices of tunnels and tension do to a knee; maps, the optimum, tolerances."""

import dataclasses

import numpy as np
import pytest

import kneejax as kj
from kneejax.planning import (
    Limits,
    Protocol,
    Surgery,
    best_of,
    criteria_of,
    follow,
    footprint_of,
    missed,
    octagon,
    optimise,
    pareto_front,
    reconstruction_of,
    tolerances,
    tunnel_map,
    undominated,
)

pytest.importorskip("dtaidistance")

BASE = np.array([0.0, 0.0, 0.0, 0.0, 80.0])


def surgery_of(knee, angles):
    plan = reconstruction_of(knee)
    through = Protocol(np.linspace(80.0, 0.0, angles), (20.0, 90.0), 100.0)
    tibia, femur = (footprint_of(knee, "ACL", bone) for bone in ("tibia", "femur"))
    limits = Limits(400.0, 1.0, (20.0, 150.0))
    return Surgery(plan, tibia, femur, (plan.torn,), 20.0, through, 5, limits)


@pytest.fixture(scope="module")
def surgery():
    return surgery_of(kj.load_knee("four_ligament"), 9)


@pytest.fixture(scope="module")
def planned(surgery):
    return surgery.try_out(BASE, slopes=True)


def test_without_the_ligament_the_tibia_comes_forward_and_the_graft_holds_it(surgery, planned):
    intact, torn = surgery.laxity(surgery.before)
    assert (torn > 3.0 * intact).all()
    assert np.abs(planned.laxity_mm[0] - intact).max() < 1.0


def test_the_graft_pulls_as_it_was_fixed(surgery, planned):
    at = np.flatnonzero(surgery.protocol.flexion_deg == 20.0)[0]
    assert planned.graft_N[0, at, 0] == pytest.approx(80.0, abs=1e-5)
    assert planned.peak_N[0] == planned.graft_N.max()


def test_derivatives_are_those_of_central_differences(surgery, planned):
    # A walk leaves contact points within 3e-4 mm; from its balances they are found to rounding.
    planned = surgery.try_out(BASE, slopes=True, near=planned.near)
    step = np.array([1e-4, 1e-4, 1e-4, 1e-4, 1e-3])
    for k, h in enumerate(step):
        away = np.zeros(5)
        away[k] = h
        up, down = (
            surgery.try_out(BASE + way * away, slopes=True, near=planned.near) for way in (1, -1)
        )
        for name in ("total", "laxity_mm", "graft_N"):
            rise = (getattr(up, name) - getattr(down, name)) / (2.0 * h)
            exact = planned.slopes[name][..., k]
            size = 1e-7 * np.abs(exact).max()
            assert exact == pytest.approx(rise, rel=1e-6, abs=size), (name, k)


def test_a_graft_that_could_not_be_fixed_has_no_numbers(surgery):
    found = surgery.try_out(np.r_[BASE[:4], 1e6], slopes=True)
    assert np.isnan(found.slack_mm).all() and found.status[0] != 0
    for told in (found.total, found.laxity_mm, found.peak_N, found.isometry_mm):
        assert np.isnan(told).all()


def test_nothing_is_read_of_a_knee_without_a_balance(surgery):
    ends, _ = surgery.ends(np.vstack([BASE[:4], BASE[:4]]) @ np.eye(4, 5))
    pulled = surgery.plan.value(ends, tension_N=np.array([[80.0], [1e6]]), elastic=False)
    found = follow(surgery.plan, pulled, Protocol(np.array([20.0]), (), 0.0))
    assert found.converged[:, 0].tolist() == [True, False]
    for read in (found.length_mm, found.strain, found.tension_N, found.anterior_mm):
        assert np.isfinite(read[0]).all() and np.isnan(read[1]).all()


def test_length_change_is_between_the_longest_and_the_shortest_of_the_motion(surgery, planned):
    length = planned.followed.length_mm[0, surgery.protocol.motion, -1]
    assert planned.isometry_mm[0, 0] == pytest.approx(np.ptp(length), abs=1e-12)


def test_neighbours_on_a_grid_are_found_where_each_is_found_by_itself(surgery):
    along = np.linspace(-4.0, 4.0, 3)
    found = tunnel_map(surgery, BASE, "tibia", along, along)
    choices = np.tile(BASE, (9, 1))
    choices[:, 0], choices[:, 1] = np.tile(along, 3), np.repeat(along, 3)
    alone = surgery.try_out(choices)
    assert found.total.ravel() == pytest.approx(alone.total, abs=1e-7)
    assert found.laxity_mm[0].ravel() == pytest.approx(alone.laxity_mm[:, 0], abs=1e-7)
    # Grafts of the same lengths do the same, whatever tension gave them.
    looser = np.column_stack([choices[:, :4], np.full(9, 30.0)])
    given = surgery.try_out(looser, slack_mm=alone.slack_mm)
    assert given.laxity_mm == pytest.approx(alone.laxity_mm, abs=1e-9)
    assert given.slopes is None
    # In front the graft is tighter: less of a drawer, more strain in the others.
    assert (np.diff(found.laxity_mm[0], axis=1) < 0).any()


@pytest.mark.slow
def test_two_bundles_in_one_place_are_one_of_both_stiffnesses():
    knee = kj.load_knee("four_ligament")
    one = surgery_of(knee, 3)
    plan = reconstruction_of(knee, bundles=2)
    two = dataclasses.replace(one, plan=plan, replaced=(plan.torn,) * 2)
    alone, both = one.try_out(BASE), two.try_out(np.tile([0.0, 0.0, 0.0, 0.0, 40.0], 2))
    assert both.laxity_mm == pytest.approx(alone.laxity_mm, abs=1e-6)
    assert both.graft_N.sum(axis=2) == pytest.approx(alone.graft_N[..., 0], abs=1e-4)


def test_the_octagon_is_regular():
    corners = octagon(10.0)
    middles = 0.5 * (corners + np.roll(corners, 1, axis=0))
    assert np.linalg.norm(middles, axis=1) == pytest.approx(np.full(8, 10.0))
    # In front on the medial side, then in front on the lateral one.
    assert corners[0].min() > 0.0 and corners[1, 0] > 0.0 > corners[1, 1]
    assert np.linalg.norm(np.diff(corners, axis=0), axis=1).std() == pytest.approx(0.0, abs=1e-12)


@pytest.mark.slow
def test_the_optimum_is_never_worse_than_the_best_of_a_grid():
    surgery = surgery_of(kj.load_knee("four_ligament"), 9)
    found = optimise(surgery, BASE, np.ones(5, bool))
    assert found.feasible and found.evaluations <= 60 and len(found.starts) == 8
    along = np.linspace(-7.0, 7.0, 41)
    grid = np.tile(BASE, (41, 41, 1))
    grid[..., 0], grid[..., 1] = along, along[:, None]
    for place in (BASE, found.outcome.choices[0]):
        every = grid.copy()
        every[..., 2:] = place[2:]
        outcome = surgery.try_out(every.reshape(-1, 5), grid=(41, 41))
        best = best_of(surgery, outcome)
        assert missed(surgery, outcome)[best] <= 1e-6
        assert found.outcome.total[0] <= outcome.total[best]


@pytest.mark.slow
def test_the_front_of_a_knee_holds_where_it_is_asked_again(surgery):
    pytest.importorskip("pymoo")
    front = pareto_front(surgery, BASE, np.ones(5, bool), population=16, generations=6)
    again = surgery.try_out(front.outcome.choices)
    assert criteria_of(again) == pytest.approx(front.criteria, rel=1e-6)
    assert undominated(front.criteria).all() and len(front.criteria) > 4
    assert missed(surgery, again).max() <= 1e-4
    assert (front.criteria <= front.rough * (1.0 + 1e-9)).all()
    gained = (front.rough - front.criteria) / np.ptp(front.criteria, axis=0)
    assert gained.max() > 0.02


@pytest.mark.slow
def test_a_tunnel_that_is_off_by_the_tolerance_has_the_laxity_at_the_edge(surgery, planned):
    own, band = surgery.laxity(surgery.before)[0], surgery.limits.band_mm
    found = tolerances(surgery, planned)
    assert [one.bone for one in found] == ["tibia", "femur"]
    for one in found:
        if not np.isfinite(one.found_mm):
            assert one.checked_mm > 0.0
            continue
        choices = BASE.copy()
        first = 0 if one.bone == "tibia" else 2
        choices[first : first + 2] += one.found_mm * one.direction
        test = surgery.protocol.lachman_deg.index(one.lachman_deg)
        off = abs(surgery.try_out(choices).laxity_mm[0, test] - own[test])
        assert off == pytest.approx(band, abs=0.01)
