"""Laxity as data of a fit: read along the loads' axes, counted from the unloaded pose."""

import dataclasses

import numpy as np
import pytest

import kneejax as kj
from kneejax.inference.fit import LoadCases, Problem, cases_of_tests, fit_lanes
from kneejax.statics import Stations

NAMES = ["ACL.stiffness", "ACL.reference_strain", "PCL.reference_strain", "MCL.reference_strain"]
NOISE = np.full(5, 0.1)


@pytest.fixture(scope="module")
def knee():
    return kj.load_knee("four_ligament")


@pytest.fixture(scope="module")
def tests():
    angles = [20.0, 60.0]
    return [
        test
        for name, size in (("drawer", {"force_N": 60.0}), ("varus-valgus", {"moment_Nm": 4.0}))
        for test in kj.lab_tests(name, angles, both=True, steps=2, **size)
    ]


@pytest.fixture(scope="module")
def problem(knee, tests):
    measured = [np.asarray(one.displacement) for one in kj.load_curves(knee, tests)]
    passive = np.asarray(kj.passive_flexion(knee, [0.0, 45.0]).to_table("grood-suntay"))
    return Problem(knee, kj.select(knee, NAMES), cases_of_tests(tests, measured, NOISE, passive))


def test_a_knee_shows_no_residual_against_its_own_curves(knee, problem):
    start = np.asarray(problem.selection.read(knee))
    residual, _ = problem.residual(problem.begin(start[None]))
    assert np.abs(residual).max() < 1e-5


def test_residuals_have_exact_derivatives(knee, problem, central_difference):
    start = np.asarray(problem.selection.read(knee))
    begin = problem.begin(start[None])
    size = np.abs(start)
    _, slope = problem.residual(begin)

    def residual(x):
        return problem.residual(problem.balance((x * size)[None], begin))[0]

    assert slope * size == pytest.approx(
        central_difference(residual, start / size, 1e-4), rel=1e-6, abs=1e-4
    )


def test_where_the_robots_zero_lies_does_not_matter(problem, knee):
    # A constant in the measured neutral changes both poses alike, so only differences count.
    cases = problem.cases
    start = np.asarray(problem.selection.read(knee))
    begin = problem.begin(start[None])
    moved = dataclasses.replace(begin, q=begin.q + [0.0, 0.0, 0.0, 0.0, 0.7])
    passive = int((cases.neutral < 0).sum())
    apart = cases.residual(moved)[0] - cases.residual(begin)[0]
    apart = apart.reshape(-1, 5)
    assert np.abs(apart[passive:]).max() < 1e-9
    assert apart[:passive, 4] == pytest.approx(np.full(passive, 7.0))


def test_a_twin_without_noise_comes_back(knee, problem):
    truth = np.asarray(problem.selection.read(knee))
    start = truth * 1.1
    wide = 0.5 * np.abs(truth)
    fits = fit_lanes(
        problem.balance, problem.cases, problem.begin(start[None]), start[None],
        (truth - wide)[None], (truth + wide)[None], far=True,
    )  # fmt: skip
    assert fits.values[0] == pytest.approx(truth, rel=1e-4)


def test_what_is_read_in_the_packages_own_convention_is_what_was_found(knee, problem):
    start = np.asarray(problem.selection.read(knee))
    found = problem.begin(start[None])
    plain = LoadCases(Stations.at(np.zeros(len(found.q[0]))), np.zeros((1, 5)), NOISE)
    value, slope = plain.observed(found)
    assert value[0, 0, 0] == pytest.approx(np.rad2deg(found.q[0, 0, 0]))
    assert slope[0, 0, 2] == pytest.approx(found.jacobian[0, 0, 2])


def test_a_table_of_another_shape_is_refused(tests):
    with pytest.raises(ValueError, match=r"drawer: measured is \(2, 3\); expected \(2, 9\)"):
        cases_of_tests(tests, [np.zeros((2, 3)), np.zeros((2, 9))], NOISE)
