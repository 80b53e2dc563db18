"""A parameter over knees: limits with closed forms, and how often intervals hold the truth."""

import numpy as np
import pytest

from kneejax.inference.population import in_log, population


def test_knees_that_are_known_exactly_are_themselves():
    values = np.array([1.0, 2.0, 4.0, 5.0, 3.0, 3.5])
    found = population(values, np.full(6, 1e-6))
    np.testing.assert_allclose(found.shrunk, values, atol=1e-5)
    assert found.mean == pytest.approx(values.mean(), abs=1e-6)
    np.testing.assert_allclose(found.own, 1.0, atol=1e-4)
    # A flat prior on the spread: chi squared with n - 2 degrees of freedom.
    assert found.spread == pytest.approx(1.7, abs=0.15)


def test_a_knee_of_which_nothing_is_known_is_the_population():
    values, errors = np.array([1.0, 2.0, 3.0, 2.5, np.nan]), np.array([0.1] * 4 + [np.inf])
    found = population(values, errors)
    assert found.shrunk[-1] == pytest.approx(found.mean, abs=1e-9)
    assert found.deviation[-1] >= found.next_deviation
    assert found.own[-1] == pytest.approx(0.0, abs=1e-9)
    assert found.knees == 4


def test_noise_alone_is_no_spread():
    """Of values that scatter as their errors say, knees are drawn to the mean."""
    errors = np.full(40, 0.5)
    values = 0.5 * np.random.default_rng(3).standard_normal(40)
    found = population(values, errors)
    assert found.spread_limits[0] < 0.1
    assert np.std(found.shrunk) < 0.5 * np.std(values)
    # The mean's variance is that of the values, over their number.
    half = 0.5 * np.ptp(found.mean_limits)
    assert half == pytest.approx(1.96 * 0.5 / np.sqrt(40), rel=0.25)


def test_intervals_hold_the_truth_as_often_as_they_say(rng):
    mean, spread, knees = 1.0, 0.2, 30
    held = []
    for _ in range(200):
        errors = rng.uniform(0.05, 0.4, knees)
        truth = mean + spread * rng.standard_normal(knees)
        found = population(truth + errors * rng.standard_normal(knees), errors)
        held.append(
            [
                found.mean_limits[0] <= mean <= found.mean_limits[1],
                found.spread_limits[0] <= spread <= found.spread_limits[1],
                np.mean(np.abs(truth - found.shrunk) <= 1.96 * found.deviation),
            ]
        )
    assert (np.mean(held, axis=0) > 0.9).all() and (np.mean(held, axis=0) < 0.98).all()


def test_fewer_than_three_knees_are_no_population():
    assert population([1.0, 2.0, np.nan], [0.1, 0.1, 0.1]) is None


def test_the_prior_of_a_logarithm_is_in_the_parameter_s_own_unit():
    values = np.log([3000.0, 4000.0, 5000.0, 6000.0])
    found = population(values, np.full(4, 0.01), log=True)
    mean, sd = found.prior
    drawn = np.exp(found.mean + found.next_deviation * np.random.default_rng(0).normal(size=100000))
    assert (mean, sd) == (
        pytest.approx(drawn.mean(), rel=0.03), pytest.approx(drawn.std(), rel=0.1),
    )  # fmt: skip
    assert in_log("ACL.stiffness") and not in_log("ACL.femoral_attachment.anterior")
