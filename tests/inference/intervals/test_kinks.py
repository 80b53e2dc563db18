"""Arms in a valley with a kink, seen through a search with small errors of its own."""

import numpy as np
import pytest

from kneejax.inference import Observations
from kneejax.inference.intervals import _profile_arms
from kneejax.inference.intervals._profiles import Pace, follow
from kneejax.statics import LoadCases, Slopes, Status

HALF = 20.0


def kinked(seed):
    """Residuals with kinks across which their derivatives jump, and errors of 1e-7 of which the
    derivatives know nothing; and the lowest point of their sum of squares that was found."""
    random = np.random.default_rng(seed)
    smooth, across = random.normal(size=(6, 3)), random.normal(size=(4, 3))
    weight, place = 3.0 * random.normal(size=(6, 4)), 0.3 * random.normal(size=4)

    def balance(values, near=None):
        values = np.asarray(values, float)
        beyond = values @ across.T - place
        found = values @ smooth.T + (np.abs(beyond) + 1e-7 * np.sin(1e9 * beyond)) @ weight.T
        slope = smooth + np.einsum("rk,nk,kp->nrp", weight, np.sign(beyond), across)
        q, by_values = np.zeros((len(values), 2, 5)), np.zeros((len(values), 2, 5, 3))
        q[:, 0, 2:], q[:, 1, 2:] = found[:, :3], found[:, 3:]
        by_values[:, 0, 2:], by_values[:, 1, 2:] = slope[:, :3], slope[:, 3:]
        shape = (len(values), 2)
        return Slopes(
            values, q, by_values, np.zeros((*shape, 0, 2)), np.zeros((*shape, 0, 2, 3)),
            np.zeros((*shape, 5, 5)), np.full(shape, Status.BALANCED),
        )  # fmt: skip

    grid = np.zeros((1, 3))
    for size in 0.5 ** np.arange(30):
        near = grid + size * random.normal(size=(400, 3))
        near = np.concatenate([grid, near])
        grid = near[[np.argmin(np.sum(balance(near).q ** 2, axis=(1, 2)))]]
    return balance, grid


def followed(seed):
    balance, fit = kinked(seed)
    looks = []

    def counted(values, near=None):
        looks.append(len(values))
        return balance(values)

    data = Observations(LoadCases.at([0.0, 1.0]), np.zeros((1, 2, 5)), np.ones(5))
    box, names = np.full(3, HALF), [(name, "") for name in "xyz"]
    found, _ = follow(counted, data, balance(fit), -box, box, 3.84, names, Pace.LIMITS)
    ends = [(one.low, one.high, one.low_open, one.high_open) for one in found[0]]
    return ends, sum(looks)


@pytest.mark.filterwarnings("error")
def test_steps_that_lead_nowhere_end_an_arm_before_its_model_overflows():
    every = [followed(seed)[0] for seed in range(30)]
    ends = {why for fit in every for one in fit for why in one[2:]}
    assert "no step leads on" in ends


def test_an_arm_that_ends_early_would_not_have_arrived(monkeypatch):
    """The same limits where there are any, in fewer looks."""
    every = [followed(seed) for seed in range(12)]
    monkeypatch.setattr(_profile_arms, "_SHORTEST", 1e-150)
    again = [followed(seed) for seed in range(12)]
    for (ends, _), (others, _) in zip(every, again, strict=True):
        for one, other in zip(ends, others, strict=True):
            assert one[:2] == other[:2]
            assert [bool(why) for why in one[2:]] == [bool(why) for why in other[2:]]
    assert sum(looks for _, looks in every) < 0.9 * sum(looks for _, looks in again)
