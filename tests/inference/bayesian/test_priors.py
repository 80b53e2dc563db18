"""Priors: normal densities within bounds, centred on the knee's own values."""

import numpy as np
import pytest
from scipy.stats import truncnorm

import kneejax as kj
from kneejax.inference import Problem, normal_priors
from kneejax.inference.bayesian._priors import Prior
from kneejax.parameters import select


@pytest.fixture(scope="module")
def problem():
    knee = kj.load_knee("four_ligament")
    names = ("ACL.stiffness", "PCL.reference_strain", "LCL.slack_length")
    return Problem.of(knee, select(knee, names), np.zeros((3, 6)), np.ones(5), ("anterior",))


@pytest.mark.parametrize(
    "prior",
    [
        Prior("x", 4500.0, 1350.0, 300.0, 10000.0),
        Prior("x", 9900.0, 4000.0, 300.0, 10000.0),
        Prior("x", 0.03, 1e-4, -0.2, 0.2),
    ],
)
def test_a_prior_is_the_truncated_normal_density(prior):
    low, high = ((end - prior.mean) / prior.sd for end in (prior.lower, prior.upper))
    expected = truncnorm(low, high, prior.mean, prior.sd)
    x = np.r_[prior.lower - 1.0, np.linspace(prior.lower, prior.upper, 41), prior.upper + 1.0]
    assert np.allclose(prior.density(x), expected.pdf(x), rtol=1e-9)
    assert prior.spread == pytest.approx(expected.std(), rel=2e-3)


def test_a_prior_of_infinite_width_is_flat_between_its_bounds():
    flat = Prior("x", 0.0, np.inf, -0.2, 0.2)
    assert flat.density([-0.3, -0.1, 0.2]).tolist() == [0.0, 2.5, 2.5]
    assert flat.spread == pytest.approx(0.4 / np.sqrt(12.0), rel=1e-3)


def test_priors_are_centred_on_the_knee_and_as_wide_as_knees_differ(problem):
    stiffness, strain, length, offset = normal_priors(problem)
    assert (stiffness.mean, stiffness.sd) == pytest.approx((4500.0, 1350.0))
    assert (strain.mean, strain.sd) == pytest.approx((-0.1, 0.02))
    assert length.sd == pytest.approx(0.02 * length.mean)
    assert (stiffness.lower, stiffness.upper) == (300.0, 10000.0)
    assert offset == Prior("offset.anterior", 0.0, 5.0, -10.0, 10.0)


def test_what_is_given_counts_before_what_is_usual(problem):
    given = {"stiffness": (5000.0, 100.0), "PCL.reference_strain": (0.0, np.inf)}
    bounds = {"*.reference_strain": (-0.1, 0.05)}
    stiffness, strain, *_ = normal_priors(problem, given, bounds)
    assert stiffness == Prior("ACL.stiffness", 5000.0, 100.0, 300.0, 10000.0)
    assert strain == Prior("PCL.reference_strain", 0.0, np.inf, -0.1, 0.05)


@pytest.mark.parametrize(
    ("given", "bounds", "says"),
    [
        ({"stiffness": (5000.0, 0.0)}, {}, "ACL.stiffness: prior of width 0"),
        ({"stiffness": (5000.0, -1.0)}, {}, "ACL.stiffness: prior of width -1"),
        ({"stiffness": (5000.0, np.nan)}, {}, "ACL.stiffness: prior of width nan"),
        ({"stiffness": (np.nan, 10.0)}, {}, "ACL.stiffness: prior of mean nan"),
        ({"stiffness": (200.0, 10.0)}, {}, "bounds 300 to 10000 exclude the prior's mean 200"),
        ({"ACL.stifness": (5000.0, 10.0)}, {}, "did you mean 'ACL.stiffness'"),
        ({}, {"stiffness": (500.0, 400.0)}, "bounds 500 to 400: expected lower below upper"),
        ({}, {"ACL.slack_length": (5.0, 9.0)}, "not free; did you mean 'LCL.slack_length'"),
    ],
)
def test_what_is_no_prior_is_refused(problem, given, bounds, says):
    with pytest.raises(ValueError, match=says):
        normal_priors(problem, given, bounds)
