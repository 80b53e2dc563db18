"""How long do all eight profiles take, and how often do their 95 % intervals hold the truth?

    python benchmarks/profiles.py [--draws 200] [--repeats 5] [--widest 30000]

Paper 1's protocol: motion made with the parameters of its Table 3, 25 angles, noise of 0.1 mm and
0.1 degrees. A truth lies within its profile's interval where holding the parameter there raises
chi squared by less than 3.84; that is asked of every draw directly.
"""

from __future__ import annotations

import time

import numpy as np
from _protocol import ANGLES, TRUTH, arguments, finish, first_and_median, load, true_knee

import kneejax as kj
from kneejax.inference import Observations, balances_of, fit_lanes, profiles
from kneejax.statics import LoadCases, balance_with_slopes

NAMES = ("*.stiffness", "*.reference_strain")
UNITS = np.r_[np.rad2deg([1.0, 1.0]), 1.0, 1.0, 1.0]
NOISE = np.full(5, 0.1)
_LIMIT = 3.8415


def main() -> None:
    options = arguments("profiles", __doc__, draws=200, repeats=5, widest=30000)
    knee, load_cases = load(options.knee), LoadCases.at(ANGLES)
    chosen = kj.select(knee, NAMES)
    truth = np.array([TRUTH[name] for name in chosen.names])
    exact = balance_with_slopes(true_knee(knee), chosen.apply, truth[None], load_cases)
    draw = np.random.default_rng(0).standard_normal((options.draws, len(ANGLES), 5))
    target = exact.q[0] * UNITS + NOISE * draw
    stiff = [".stiffness" in name for name in chosen.names]
    lower = np.where(stiff, 300.0, -0.2)
    upper = np.where(stiff, float(options.widest), 0.2)

    one = Observations(load_cases, target[0], NOISE)
    balance = balances_of(knee, chosen, one)
    fit = fit_lanes(balance, one, exact, truth[None], lower[None], upper[None])
    first, seconds = first_and_median(
        lambda: profiles(knee, chosen, one, fit.slopes, lower, upper, _LIMIT),
        repeats=options.repeats,
    )
    rows: dict[str, object] = {"profiles_first_call_s": first, "eight_profiles_s": seconds}
    begun = time.perf_counter()
    inside, evaluations = coverage(knee, chosen, exact, target, truth, lower, upper)
    rows |= {
        "draws": options.draws,
        "coverage_s": time.perf_counter() - begun,
        "evaluations_of_a_motion": evaluations,
        "coverage": float(inside.mean()),
        **{f"coverage {n}": float(x) for n, x in zip(chosen.names, inside.mean(1), strict=True)},
    }
    finish(options.out, "Profiles, and how often their intervals hold the truth", rows)


def coverage(knee, chosen, exact, target, truth, lower, upper) -> tuple[np.ndarray, int]:
    """Whether each draw's interval of each parameter holds the truth, `(p, draws)`."""
    draws, size = len(target), len(truth)
    data = Observations(exact_load_cases(), target, NOISE)
    begin = exact.take(np.zeros(draws, int))
    box = [np.tile(x, (draws, 1)) for x in (lower, upper)]
    balance = balances_of(knee, chosen, data)
    free = fit_lanes(balance, data, begin, np.tile(truth, (draws, 1)), *box)
    inside, evaluations = [], free.evaluations
    for i in range(size):
        low, high = (x.copy() for x in box)
        start = free.values.copy()
        low[:, i] = high[:, i] = start[:, i] = truth[i]
        held = fit_lanes(balance, data, free.slopes, start, low, high)
        inside.append(held.chi2 - free.chi2 < _LIMIT)
        evaluations += held.evaluations
    return np.array(inside), evaluations


def exact_load_cases() -> LoadCases:
    return LoadCases.at(ANGLES)


if __name__ == "__main__":
    main()
