"""Random studies of a curve: an estimate lies within its limits, and no prior is widened."""

import dataclasses

import numpy as np
import pytest

from kneejax.experiments import MeasuredTest
from kneejax.inference.fit import TABLE_UNITS, Noise, Observations, observations
from kneejax.inference.intervals import IntervalKind, estimate, uncertainty
from kneejax.statics import LoadCases, Slopes, Status

NAMES = [("offset", "mm"), ("height", "mm"), ("rate", "")]
LOWER, UPPER = np.array([-5.0, 0.1, 0.2]), np.array([5.0, 10.0, 3.0])


def curve(flexion):
    """Adduction rises with flexion, anterior translation saturates: `height (1 - e^(-rate x))`."""
    x = np.asarray(flexion)[None]

    def balance(values, near=None):
        offset, height, rate = np.asarray(values, float).T[:, :, None]
        gone = np.exp(-rate * x)
        value = np.zeros((*gone.shape, 5))
        slope = np.zeros((*gone.shape, 5, 3))
        value[..., 0], slope[..., 0, 2] = rate * x, x
        value[..., 2] = offset + height * (1.0 - gone)
        slope[..., 2, 0] = 1.0
        slope[..., 2, 1], slope[..., 2, 2] = 1.0 - gone, height * x * gone
        shape = gone.shape
        return Slopes(
            np.asarray(values, float), value / TABLE_UNITS, slope / TABLE_UNITS[:, None],
            np.zeros((*shape, 0, 2)), np.zeros((*shape, 5, 5)), np.full(shape, Status.BALANCED),
        )  # fmt: skip

    return balance


def random_study(seed):
    """What was measured, the noise as it is stated, and where the search begins."""
    random = np.random.default_rng(seed)
    flexion = np.sort(random.uniform(0.0, 2.0, random.integers(5, 12)))
    balance, truth = curve(flexion), random.uniform(LOWER, UPPER)
    mm, deg = 10.0 ** random.uniform(-2.5, 0.0, 2)
    scatter = np.array([deg, deg, mm, mm, mm])
    exact = balance(truth[None])
    target = exact.q * TABLE_UNITS + scatter * random.standard_normal(exact.q.shape)
    prior = None
    if seed % 4 == 3:
        sd = np.where(random.random(3) < 0.5, random.uniform(0.05, 1.0, 3), np.inf)
        prior = np.clip(truth + np.where(np.isinf(sd), 0.0, sd) * 0.5, LOWER, UPPER), sd
    weights = [None, [8.0, 8.0, 1.0, 1.0, 1.0], [np.nan, 0.0, np.nan, 0.0, 0.0]][seed % 3]
    stated = (mm, deg) if prior is not None or random.random() < 0.5 else ()
    noise = Noise.of(*stated, weights=weights) if stated else Noise.of(weights=weights)
    if prior is not None:
        noise = noise.as_stated()
    data = Observations(LoadCases.at(flexion), target, noise.first, prior=prior)
    return balance, data, noise, balance(random.uniform(LOWER, UPPER)[None])


@pytest.mark.parametrize("first", range(0, 200, 50))
def test_no_estimate_lies_outside_its_limits_and_no_limits_are_wider_than_a_priors(first):
    told = 0
    for seed in range(first, first + 50):
        balance, data, noise, begin = random_study(seed)
        (sure,) = estimate(balance, data, begin, noise, LOWER, UPPER, NAMES, far=True)
        sd = np.full(3, np.inf) if data.prior is None else data.prior[1]
        for value, one, own in zip(sure.best.values[0], sure.intervals, sd, strict=True):
            assert not (value < one.low or value > one.high), seed
            assert not one.high - one.low > 2.0 * 1.9601 * own, seed
            told += one.kind.has_limits
        assert np.all((sure.best.values >= LOWER) & (sure.best.values <= UPPER))
    assert told > 100


def test_a_search_that_ends_beside_the_best_fit_has_no_limits_or_no_standard_error():
    balance, data, noise, begin = random_study(0)
    (sure,) = estimate(balance, data, begin, noise, LOWER, UPPER, NAMES, far=True)
    one, best = sure.intervals[1], float(sure.best.values[0, 1])
    assert one.beside(best, best) == one
    outside = one.beside(one.high + 1.0, best)
    assert outside.kind is IntervalKind.NOT_COMPUTED and f"{best:.4g}" in outside.reason
    near = one.beside(best + 0.45 * (one.high - best), best)
    assert (near.low, near.high) == (one.low, one.high)


def test_noise_that_is_not_stated_is_what_the_fit_leaves_of_each_unit():
    """With many poses the scatter of both units comes back, whatever the first weights."""
    flexion, random = np.linspace(0.0, 2.0, 400), np.random.default_rng(2)
    balance, truth = curve(flexion), np.array([[1.0, 4.0, 1.0]])
    exact = balance(truth)
    scatter = np.array([0.02, 0.02, 0.5, 0.5, 0.5])
    target = exact.q * TABLE_UNITS + scatter * random.standard_normal(exact.q.shape)
    for noise in (Noise.of(), Noise.of(noise_mm=0.5)):
        data = Observations(LoadCases.at(flexion), target, noise.first)
        (sure,) = estimate(balance, data, exact, noise, LOWER, UPPER, NAMES)
        np.testing.assert_allclose(sure.noise, scatter, rtol=0.06)
        assert sure.noise_estimated


def test_given_weights_fix_the_ratios_of_the_noise_and_the_fit_its_size():
    noise = Noise.of(0.2, 0.2, weights=[8.0, 8.0, 1.0, 1.0, 0.0])
    assert noise.given and noise.unknown.tolist() == [True] * 4 + [False]
    balance, data, _, begin = random_study(5)
    data = dataclasses.replace(data, noise=noise.first)
    (sure,) = estimate(balance, data, begin, noise, LOWER, UPPER, NAMES, far=True)
    assert sure.noise[2] / sure.noise[0] == pytest.approx(np.sqrt(8.0))
    assert np.isinf(sure.noise[4])
    # One over the stated variances is what is stated.
    assert not Noise.of(0.5, 0.25, weights=[16.0, 16.0, 4.0, 4.0, 4.0]).estimated


def test_a_test_with_its_own_noise_may_leave_out_a_coordinate_that_does_not_count():
    noise = Noise.of(1.0, 1.0, weights=[np.nan, np.nan, np.nan, np.nan, 0.0])
    drawer = {"anterior_N": np.array([0.0, 90.0])}
    test = MeasuredTest("drawer", np.zeros(2), drawer, np.zeros((2, 5)), sd_mm=0.5)
    cases = observations(np.zeros((0, 6)), noise.first, tests=[test], stated=noise.stated)
    assert cases.spread[1].tolist() == [1.0, 1.0, 0.5, 0.5, 1.0]


def test_a_pose_that_was_lost_says_nothing_of_the_noise_nor_of_what_is_known():
    flexion = np.linspace(0.0, 2.0, 40)
    exact = curve(flexion)(np.array([[1.0, 4.0, 1.0]]))
    scatter = 0.3 * np.random.default_rng(4).standard_normal(exact.q.shape)
    data = Observations(LoadCases.at(flexion), exact.q * TABLE_UNITS + scatter, Noise.of().first)
    whole = dataclasses.replace(data, used=np.arange(40) != 7)
    exact.q[:, 7], exact.jacobian[:, 7] = np.nan, np.nan
    for noise in (Noise.of(), Noise.of(weights=np.ones(5))):
        lost, without = (noise.left(one, exact, LOWER, UPPER) for one in (data, whole))
        assert lost == pytest.approx(without)
    slope = np.array([[3.0, 0.0], [np.nan, 1.0], [0.0, 2.0]])
    assert uncertainty(slope).standard_error == pytest.approx([1 / 3, 1 / 2])
