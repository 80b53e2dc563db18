"""Strain curves aligned by dynamic time warping."""

import numpy as np
import pytest

from kneejax.planning import offsets, warped_distances

dtw = pytest.importorskip("dtaidistance.dtw")


def by_hand(a, b, window):
    """The recursion of dynamic time warping in its plainest form."""
    least = np.full((len(a) + 1, len(b) + 1), np.inf)
    least[0, 0] = 0.0
    for i in range(1, len(a) + 1):
        for j in range(max(1, i - window), min(len(b), i + window) + 1):
            before = min(least[i - 1, j], least[i, j - 1], least[i - 1, j - 1])
            least[i, j] = abs(a[i - 1] - b[j - 1]) + before
    return least[-1, -1]


def warped(curve, reference, window=5):
    """Distance of a curve from another."""
    return warped_distances(curve[None], reference, window)[0]


def test_the_librarys_own_example():
    first = np.array([0.0, 0, 1, 2, 1, 0, 1, 0, 0])
    second = np.array([0.0, 1, 2, 0, 0, 0, 0, 0, 0])
    # Its documentation gives 1.41, a root of a sum of squares: two ones are left, which are 2 here.
    assert dtw.distance(first, second) == pytest.approx(np.sqrt(2.0))
    assert warped(first, second, window=9) == pytest.approx(2.0)


def test_identical_curves_are_at_no_distance():
    curve = np.sin(np.linspace(0.0, 3.0, 33))
    assert warped(curve, curve) == 0.0
    assert warped_distances(np.stack([curve, curve + 0.01]), curve)[0] == 0.0


def test_a_shifted_curve_costs_what_the_window_leaves_over():
    pulse = np.array([0.0, 0, 0, 1, 2, 1, 0, 0, 0, 0, 0])
    late = np.roll(pulse, 3)
    # Within three places it is the same curve; within two, one place is left: 1 1 1 1.
    assert warped(late, pulse, window=3) == 0.0
    assert warped(late, pulse, window=2) == pytest.approx(4.0)


@pytest.mark.parametrize("window", [0, 2, 5])
def test_it_is_the_plain_recursion(window):
    draw = np.random.default_rng(4)
    for _ in range(5):
        a, b = np.cumsum(draw.normal(size=(2, 17)), axis=1)
        expected = by_hand(a, b, window)
        assert warped(a, b, window) == pytest.approx(expected, rel=1e-12)
        apart, _ = offsets(a[:, None], np.zeros((17, 1, 0)), b[:, None], window)
        assert np.abs(apart).sum() == pytest.approx(expected, rel=1e-12)


def test_the_derivative_is_that_of_the_sum_along_the_alignment():
    draw = np.random.default_rng(5)
    a, b = np.cumsum(draw.normal(size=(2, 20)), axis=1)
    apart, by = offsets(a[:, None], np.eye(20)[:, None], b[:, None])
    slope = np.sign(apart) @ by
    for k in range(len(a)):
        away = np.zeros(len(a))
        away[k] = 1e-6
        rise = (warped(a + away, b) - warped(a - away, b)) / 2e-6
        assert slope[k] == pytest.approx(rise, abs=1e-8)


def test_what_is_not_known_stays_unknown():
    curve = np.zeros(5)
    gap = np.array([0.0, np.nan, 0.0, 0.0, 0.0])
    assert np.isnan(warped(gap, curve)) and np.isnan(warped(curve, gap))
