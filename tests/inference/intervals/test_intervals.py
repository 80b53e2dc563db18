"""What is printed of a parameter holds the truth as often as it says."""

import numpy as np
import pytest

import kneejax as kj
from kneejax.inference import Observations, balances_of, fit_lanes
from kneejax.inference.fit import TABLE_UNITS, ManyFits, Noise
from kneejax.inference.fit._problem import add_offsets, with_offsets, without_offsets
from kneejax.inference.intervals._estimate import Interval, IntervalKind, estimate
from kneejax.inference.intervals._profile_arms import Pace
from kneejax.inference.intervals._profiles import Profile, _led, follow, follow_to_the_lowest, named
from kneejax.statics import LoadCases, Slopes, Status, balance_with_slopes

NAMES = ("*.stiffness", "*.reference_strain")
#: Paper 1, Table 3.
TRUTH = np.array([5876.0, 2814.0, 8904.0, 7048.0, 0.037, -0.047, 0.023, 0.039])
LOWER = np.r_[np.full(4, 300.0), np.full(4, -0.2)]
UPPER = np.r_[np.full(4, 10000.0), np.full(4, 0.2)]
TWELVE = LoadCases.at(np.linspace(0.0, 110.0, 12))


def profile(low=2.0, high=8.0, low_open="", high_open=""):
    """Of a parameter between 0 and 10."""
    points = np.array([low, 5.0, high])
    return Profile(
        "X.stiffness", "N", 5.0, 1.5, points, points, points[:, None], low, high, low_open,
        high_open, 3.8415,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("followed", "error", "kind", "ends"),
    [
        (profile(), 3.0 / 1.96, IntervalKind.STANDARD_ERROR, (2.0, 8.0)),
        (profile(), 1.0 / 1.96, IntervalKind.PROFILE, (2.0, 8.0)),
        (profile(), np.nan, IntervalKind.PROFILE, (2.0, 8.0)),
        (profile(high=10.0, high_open="its bound"), 1.5, IntervalKind.ONE_SIDED, (2.0, np.nan)),
        (profile(low=0.0, low_open="its bound"), 1.5, IntervalKind.ONE_SIDED, (np.nan, 8.0)),
        (profile(0.0, 10.0, "its bound", "its bound"), 1.5, IntervalKind.NOT_DETERMINED, None),
        # What was not computed says nothing of the data.
        (
            profile(0.0, 10.0, "no balance beyond", "its bound"),
            1.5,
            IntervalKind.NOT_COMPUTED,
            None,
        ),
        (profile(high=10.0, high_open="given up"), 1.5, IntervalKind.ONE_SIDED, (2.0, np.nan)),
        # All but a tenth of what bounds allow is no knowledge.
        (profile(0.5, 10.0, "", "its bound"), 1.5, IntervalKind.NOT_DETERMINED, None),
    ],
)
def test_the_kind_of_an_interval_follows_from_its_profile(followed, error, kind, ends):
    found = Interval.of(followed, 5.0, error, 0.0, 10.0)
    assert found.kind is kind
    np.testing.assert_array_equal([found.low, found.high], ends or (np.nan, np.nan))
    assert np.isfinite(found.standard_error) == (kind is IntervalKind.STANDARD_ERROR)
    ends = followed.low_open, followed.high_open
    assert found.reason == next((end for end in ends if end not in ("", "its bound")), "")


def linear(values, near=None):
    """Superior in mm is ten times the first value and next to nothing of the second."""
    values = np.asarray(values, float)
    slope = np.zeros((2, 5, 2))
    slope[:, 3] = [[10.0, 0.02], [10.0, -0.02]]
    shape = (len(values), 2)
    return Slopes(
        values, np.einsum("scp,vp->vsc", slope, values), np.tile(slope, (len(values), 1, 1, 1)),
        np.zeros((*shape, 0, 2)), np.zeros((*shape, 0, 2, 2)), np.zeros((*shape, 5, 5)),
        np.full(shape, Status.BALANCED),
    )  # fmt: skip


def test_limits_with_a_prior_are_those_of_the_closed_form_and_name_what_is_the_priors_own():
    """Of a linear problem precisions add."""
    mean, sd, noise = np.array([1.0, 2.0]), np.array([0.5, 3.0]), 0.5
    target = np.full((1, 2, 5), np.nan)
    target[..., 3] = 12.0
    data = Observations(LoadCases.at([0.0, 1.0]), target, np.ones(5), prior=(mean, sd))
    slope = linear(mean[None]).jacobian[0, :, 3] / noise
    precision = slope.T @ slope + np.diag(sd**-2.0)
    best = np.linalg.solve(precision, slope.T @ [24.0, 24.0] + mean / sd**2)
    half = np.sqrt(3.8415 * np.diag(np.linalg.inv(precision)))
    box = np.array([-20.0, -50.0]), np.array([20.0, 50.0])
    (sure,) = estimate(linear, data, linear(best[None]), Noise.of(noise, noise), *box, XY)
    ends = np.array([[one.low, one.high] for one in sure.intervals])
    np.testing.assert_allclose(ends, np.stack([best - half, best + half], 1), atol=2e-2 * half[1])
    np.testing.assert_allclose(ends[0], [best[0] - half[0], best[0] + half[0]], rtol=2e-3)
    kinds = [one.kind for one in sure.intervals]
    assert kinds == [IntervalKind.STANDARD_ERROR, IntervalKind.PRIOR]
    assert (np.ptp(ends, axis=1) <= 2.0 * np.sqrt(3.8415) * sd * (1.0 + 1e-12)).all()


def test_limits_are_never_farther_apart_than_those_of_the_prior():
    wide = Interval.of(profile(), 5.0, 3.0 / 1.96, 0.0, 10.0, prior=2.0 / 1.96)
    assert wide.kind is IntervalKind.PRIOR
    assert (wide.low, wide.high) == pytest.approx((3.0, 7.0), rel=1e-4)
    cut = Interval.of(profile(high=10.0, high_open="its bound"), 5.0, 1.5, 0.0, 10.0, 2.0 / 1.96)
    assert cut.low == pytest.approx(3.0, rel=1e-4) and np.isnan(cut.high)


def two_valleys(values, near=None, longest=np.inf):
    """Along y = 0 a change of x alone is seen at once; with y it is made up for. No balance is
    found by a stride that is too long."""
    x, y = np.asarray(values, float).T
    q, jacobian = np.zeros((len(x), 1, 5)), np.zeros((len(x), 1, 5, 2))
    q[:, 0, 2], q[:, 0, 3] = 2.0 * (x - 3.0 * y**2), 0.8 * y**2
    if near is not None:
        q[np.abs(values - near.values).max(axis=1) > longest] = np.nan
    jacobian[:, 0, 2] = np.stack([np.full(len(x), 2.0), -12.0 * y], axis=1)
    jacobian[:, 0, 3, 1] = 1.6 * y
    shape = (len(x), 1)
    return Slopes(
        np.array(values, float), q, jacobian, np.zeros((*shape, 0, 2)),
        np.zeros((*shape, 0, 2, 2)), np.zeros((*shape, 5, 5)), np.full(shape, Status.BALANCED),
    )  # fmt: skip


BOX = np.array([-5.0, -1.0]), np.array([5.0, 1.0])
XY = [("x", ""), ("y", "")]


@pytest.mark.parametrize("pace", list(Pace))
def test_a_limit_is_where_the_farthest_valley_ends(pace):
    """At x = 3, y = 1 the fit is worse by 0.64 only: nothing that the arm of x alone would see."""
    data = Observations(LoadCases.at([0.0]), np.zeros((1, 1, 5)), np.ones(5))
    ((x, y),), _ = follow(two_valleys, data, two_valleys([[0.0, 0.0]]), *BOX, 3.84, XY, pace)
    assert x.low == pytest.approx(-np.sqrt(3.84) / 2.0, abs=0.02)
    assert x.high == pytest.approx(3.0 + np.sqrt(3.84 - 0.64) / 2.0, abs=0.02)
    assert y.low_open and y.high_open and x.closed


@pytest.mark.parametrize("pace", list(Pace))
def test_a_fit_moves_to_the_valley_that_an_arm_has_found(pace):
    """Of 0.8 measured, y = 0 explains nothing and y = 1 all; it is too far for one stride."""

    def balance(values, near):
        return two_valleys(values, near, longest=2.0)

    target = np.zeros((1, 1, 5))
    target[..., 3] = 0.8
    data = Observations(LoadCases.at([0.0]), target, np.ones(5))
    begin = ManyFits(two_valleys([[0.0, 0.0]]), np.array([0.64]), np.array([True]), 1)
    here, ((x, _),) = follow_to_the_lowest(balance, data, begin, *BOX, 3.84, XY, pace)
    np.testing.assert_allclose(np.abs(here.values), [[3.0, 1.0]], atol=1e-3)
    assert x.high == pytest.approx(3.0 + np.sqrt(3.84) / 2.0, abs=0.05)  # 1 % of the interval
    assert x.low == pytest.approx(-np.sqrt(3.84 - 0.64) / 2.0, abs=0.05)  # 1 % of the interval
    assert not x.better


def test_values_far_away_are_reached_in_shorter_strides():
    def balance(values, near):
        return two_valleys(values, near, longest=0.5)

    found = _led(balance, two_valleys(np.zeros((2, 2))), np.array([[3.0, 1.0], [9.0, 1.0]]))
    np.testing.assert_array_equal(found.values, [[3.0, 1.0], [9.0, 1.0]])
    # Sixteen strides are not enough for the other.
    np.testing.assert_array_equal(np.isfinite(found.q).all(axis=(1, 2)), [True, False])


@pytest.fixture(scope="module")
def exact(knee):
    return balance_with_slopes(knee, kj.select(knee, NAMES).apply, TRUTH[None], TWELVE)


def test_offsets_are_added_and_taken_away(exact):
    names = ("internal_rotation", "lateral")
    moved = add_offsets(exact, np.array([[2.0, -3.0]]), names, np.ones(12, bool))
    np.testing.assert_allclose((moved.q - exact.q) * TABLE_UNITS, [[[0, 2.0, 0, 0, -3.0]] * 12])
    np.testing.assert_allclose(moved.jacobian[0, :, 1, 8] * TABLE_UNITS[1], 1.0)
    back = without_offsets(moved, names, np.ones(12, bool))
    np.testing.assert_allclose(back.q, exact.q, atol=1e-12)
    np.testing.assert_array_equal(back.values, exact.values)


@pytest.mark.slow
def test_printed_intervals_of_a_bent_valley_hold_the_truth(knee, exact):
    """Twelve poses, noise of 0.2 mm and degrees: 24 motions, 192 intervals, none around another
    value than the estimate's.

    `benchmarks/coverage.py` asks the same of 200 motions of each of several designs.
    """
    draws, chosen = 24, kj.select(knee, NAMES)
    errors = np.random.default_rng(0).standard_normal((draws, 12, 5))
    target = exact.q[0] * TABLE_UNITS + 0.2 * errors
    data = Observations(TWELVE, target, np.full(5, 0.2))
    tiles = [np.tile(x, (draws, 1)) for x in (TRUTH, LOWER, UPPER)]
    balance = balances_of(knee, chosen, data)
    fits = fit_lanes(balance, data, exact.take(np.zeros(draws, int)), *tiles)
    balance = with_offsets(balances_of(knee, chosen, data), (), np.ones(12, bool))
    noise = Noise.of(0.2, 0.2)
    found = estimate(balance, data, fits.slopes, noise, LOWER, UPPER, named(chosen))
    held, printed = [], 0
    for sure in found:
        for value, true, one in zip(sure.best.values[0], TRUTH, sure.intervals, strict=True):
            low, high = one.low, one.high
            assert not (value < low or value > high)
            if one.kind is IntervalKind.STANDARD_ERROR:
                low, high = value + 1.96 * one.standard_error * np.array([-1.0, 1.0])
            printed += one.kind is not IntervalKind.NOT_DETERMINED
            held.append(not (true < low or true > high))
    assert printed > 0.95 * len(held)
    # 95 % of 192 scatters by 1.6 %.
    assert 0.90 <= np.mean(held) <= 0.99
