"""Profiles, intervals and what they are built from: many bounded fits at once."""

import numpy as np
import pytest

import kneejax as kj
from kneejax.inference import Observations, balances_of, fit_lanes, identify, profiles
from kneejax.parameters import UnknownParameter, UnsuitableData
from kneejax.report.identification import fit_doubts
from kneejax.statics import LoadCases, balance_with_slopes

pytestmark = pytest.mark.usefixtures("optimised_code")

NAMES = ("*.stiffness", "*.reference_strain")
FLEXION = np.arange(0.0, 121.0, 5.0)
UNITS = np.r_[np.rad2deg([1.0, 1.0]), 1.0, 1.0, 1.0]
#: Paper 1, Table 3.
TRUTH = np.array([5876.0, 2814.0, 8904.0, 7048.0, 0.037, -0.047, 0.023, 0.039])
LOWER = np.r_[np.full(4, 300.0), np.full(4, -0.2)]
#: Beyond paper 1's 10,000 N: a truth beside a bound has no interval of its own.
UPPER = np.r_[np.full(4, 30000.0), np.full(4, 0.2)]
BOUNDS = {"stiffness": (300.0, 30000.0)}


@pytest.fixture(scope="module")
def chosen(knee):
    return kj.select(knee, NAMES)


@pytest.fixture(scope="module")
def exact(knee, chosen):
    """The true knee's motion with its slopes."""
    return balance_with_slopes(knee, chosen.apply, TRUTH[None], LoadCases.at(FLEXION))


def data_of(exact, draws, noise=0.1, seed=0):
    errors = np.random.default_rng(seed).standard_normal((draws, len(FLEXION), 5))
    return Observations(
        LoadCases.at(FLEXION), exact.q[0] * UNITS + noise * errors, np.full(5, noise)
    )


def box(count):
    return np.tile(LOWER, (count, 1)), np.tile(UPPER, (count, 1))


@pytest.mark.slow
def test_intervals_hold_the_truth_as_often_as_they_say(knee, chosen, exact):
    """200 motions with 0.1 mm and 0.1 degrees of noise: 95 % intervals hold it in 90 to 98 %.

    The truth lies within a profile's interval where holding the parameter there raises chi squared
    by less than 3.84.
    """
    draws = 200
    data, begin = data_of(exact, draws), exact.take(np.zeros(draws, int))
    balance = balances_of(knee, chosen, data)
    free = fit_lanes(balance, data, begin, np.tile(TRUTH, (draws, 1)), *box(draws))
    assert free.converged.all()
    # 125 numbers for 8 parameters: chi squared with 117 degrees of freedom, mean of 200.
    assert abs(free.chi2.mean() - 117.0) < 4.0 * np.sqrt(2 * 117.0 / draws)
    inside = np.empty((8, draws), bool)
    for i in range(8):
        (low, high), start = box(draws), free.values.copy()
        low[:, i] = high[:, i] = start[:, i] = TRUTH[i]
        held = fit_lanes(balance, data, free.slopes, start, low, high)
        np.testing.assert_array_equal(held.values[:, i], TRUTH[i])
        rise = held.chi2 - free.chi2
        assert (rise > -1e-6 * free.chi2).all()
        inside[i] = rise < 3.8415
    assert 0.90 <= inside.mean() <= 0.98
    assert (inside.mean(axis=1) >= 0.90).all() and (inside.mean(axis=1) <= 0.98).all()


@pytest.fixture(scope="module")
def clean(knee, chosen, exact):
    """Profiles of a motion that is hardly noisy: the problem is all but linear."""
    data = data_of(exact, 1, noise=1e-3)
    fit = fit_lanes(balances_of(knee, chosen, data), data, exact, TRUTH[None], *box(1))
    one = Observations(data.load_cases, data.target[0], data.noise)
    return fit, profiles(knee, chosen, one, fit.slopes, LOWER, UPPER, 3.8415)


def test_profiles_of_a_linear_problem_are_parabolas(clean):
    fit, found = clean
    for i, profile in enumerate(found):
        assert profile.closed and not profile.better
        assert profile.estimate == fit.values[0, i]
        parabola = ((profile.values - profile.estimate) / profile.standard_error) ** 2
        np.testing.assert_allclose(profile.rise, parabola, rtol=0.1, atol=0.02)
        width = np.sqrt(3.8415) * profile.standard_error
        expected = [profile.estimate - width, profile.estimate + width]
        np.testing.assert_allclose([profile.low, profile.high], expected, atol=0.05 * width)


def test_limits_are_where_a_fit_held_there_rises_by_the_threshold(knee, chosen, exact):
    """The interval's ends, which are interpolated, against fits at those very values."""
    data = data_of(exact, 1, seed=1)
    fit = fit_lanes(balances_of(knee, chosen, data), data, exact, TRUTH[None], *box(1))
    one = Observations(data.load_cases, data.target[0], data.noise)
    found = profiles(knee, chosen, one, fit.slopes, LOWER, UPPER, 3.8415)
    ends = [(i, end) for i, p in enumerate(found) for end in (p.low, p.high)]
    (low, high), starts = box(len(ends)), np.tile(fit.values[0], (len(ends), 1))
    for row, (i, end) in enumerate(ends):
        nearest = found[i].parameters[np.argmin(np.abs(found[i].values - end))]
        starts[row] = nearest
        starts[row, i] = low[row, i] = high[row, i] = end
    begin = balance_with_slopes(knee, chosen.apply, starts, data.load_cases)
    held = fit_lanes(balances_of(knee, chosen, one), one, begin, starts, low, high)
    np.testing.assert_allclose(held.chi2 - fit.chi2[0], 3.8415, atol=0.05)


def test_a_bound_leaves_an_end_open(knee, chosen, exact):
    """MCL stiffness beside paper 1's bound of 10,000 N."""
    data = data_of(exact, 1, seed=1)
    one = Observations(data.load_cases, data.target[0], data.noise)
    upper = np.r_[np.full(4, 10000.0), np.full(4, 0.2)]
    balance = balances_of(knee, chosen, one)
    fit = fit_lanes(balance, one, exact, TRUTH[None], LOWER[None], upper[None])
    mcl = profiles(knee, chosen, one, fit.slopes, LOWER, upper, 3.8415)[2]
    assert mcl.high_open == "its bound" and mcl.high == 10000.0
    assert not mcl.low_open and 300.0 < mcl.low < fit.values[0, 2]
    assert mcl.values[-1] == pytest.approx(10000.0)


def test_fits_do_not_know_of_each_other(knee, chosen, exact):
    """The same data twice, beside data that no knee can have made."""
    data = data_of(exact, 3, seed=5)
    data.target[2] = data.target[0]
    data.target[1, :, 3] += np.linspace(0.0, 60.0, len(FLEXION))
    begin = exact.take(np.zeros(3, int))
    balance = balances_of(knee, chosen, data)
    found = fit_lanes(balance, data, begin, np.tile(TRUTH, (3, 1)), *box(3))
    np.testing.assert_allclose(found.values[2], found.values[0], rtol=1e-6)
    assert found.chi2[1] > 100.0 * found.chi2[0]


@pytest.fixture(scope="module")
def measured(exact):
    return np.column_stack([FLEXION, data_of(exact, 1, seed=1).target[0]])


@pytest.fixture(scope="module")
def found(knee, measured):
    return identify(knee, measured, NAMES, noise_mm=0.1, noise_deg=0.1, bounds=BOUNDS)


def test_identify_finds_the_best_fit_and_says_how_sure_it_is(knee, chosen, exact, measured, found):
    data = data_of(exact, 1, seed=1)
    fit = fit_lanes(balances_of(knee, chosen, data), data, exact, TRUTH[None], *box(1))
    np.testing.assert_allclose(found.values, fit.values[0], rtol=1e-4)
    assert found.chi2 == pytest.approx(fit.chi2[0], rel=1e-6)
    assert found.converged and not found.noise_estimated and found.data == 125
    assert [p.name for p in found.profiles] == list(found.selection.names)
    for i, profile in enumerate(found.profiles):
        assert profile.low <= TRUTH[i] <= profile.high
        assert found.information.standard_error[i] == pytest.approx(profile.standard_error, 1e-6)


def test_noise_is_estimated_from_what_the_fit_leaves(knee, measured):
    found = identify(knee, measured, NAMES, bounds=BOUNDS, with_profiles=False)
    # 117 degrees of freedom: known to 7 per cent, 9 and 11 for each kind.
    np.testing.assert_allclose(found.noise, 0.1, rtol=0.3)
    assert found.noise_estimated and found.noise[0] == found.noise[1]
    assert found.noise[2] == found.noise[3] == found.noise[4]


def test_constant_offsets_of_frames_change_nothing(knee, measured, found):
    moved = measured + np.array([0.0, 0.0, -5.0, 2.0, 0.0, 0.0])
    options = {"noise_mm": 0.1, "noise_deg": 0.1, "bounds": BOUNDS, "with_profiles": False}
    offsets = ("internal_rotation", "anterior")
    here = identify(knee, measured, NAMES, offsets=offsets, **options)
    there = identify(knee, moved, NAMES, offsets=offsets, **options)
    np.testing.assert_allclose(there.values, here.values, rtol=1e-4)
    assert there.offsets["internal_rotation"] - here.offsets["internal_rotation"] == (
        pytest.approx(-5.0, abs=1e-4)
    )
    assert there.offsets["anterior"] - here.offsets["anterior"] == pytest.approx(2.0, abs=1e-4)


def test_doubt_is_said(knee, measured, found):
    assert not fit_doubts(found)
    tight = identify(
        knee, measured, NAMES, noise_mm=0.01, noise_deg=0.01, bounds=BOUNDS, with_profiles=False
    )
    assert any("misses the data by 9" in w for w in fit_doubts(tight))
    few = identify(
        knee, measured[[0]], NAMES, noise_mm=0.1, noise_deg=0.1, bounds=BOUNDS, with_profiles=False
    )
    assert any("fewer data than unknowns" in w for w in fit_doubts(few))


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        ({"parameters": ("ACL.stifness",)}, UnknownParameter, "ACL.stiffness"),
        ({"bounds": {"stiffness": (9000.0, 300.0)}}, UnsuitableData, "lower below upper"),
        ({"bounds": {"ACL.stiffness": (300.0, 400.0)}}, UnsuitableData, "exclude the start"),
        ({"rows": 1}, UnsuitableData, "cannot be estimated"),
        ({"spoil": True}, UnsuitableData, "row 3 is not finite"),
    ],
)
def test_mistakes_are_said(knee, measured, change, error, words):
    table = measured[: change.pop("rows", None)].copy()
    if change.pop("spoil", False):
        table[3, 2] = np.nan
    with pytest.raises(error, match=words):
        identify(knee, table, **{"parameters": NAMES, **change})
