"""A knee calibrated to its laxity: a twin with passive motion and 12 curves of 11 steps.

    python benchmarks/laxity_twin.py [--knee lenhart2015_reduced] [--draws 20]

Stiffness and reference strain of every ligament are free. The twin's curves (drawer, torsion and
varus-valgus at 0, 30, 60 and 90 degrees) and its passive motion carry 0.1 mm and 0.1 degree of
noise. Reported: seconds of a fit, also as SciPy's least squares with finite differences needs them
on the same balances; errors of a fit without noise; of many draws, how many standard errors hold
the truth, where the data determine a parameter (its standard error is below a tenth of the range of
its bounds).
"""

from __future__ import annotations

import dataclasses
import time

import numpy as np
from _protocol import arguments, finish, load
from scipy.optimize import least_squares

import kneejax as kj
from kneejax.inference.fit import Problem, fit_lanes

FLEXION = (0.0, 30.0, 60.0, 90.0)
PASSIVE = np.arange(0.0, 91.0, 15.0)
PATH = tuple(np.linspace(-1.0, 1.0, 11))
NOISE = np.full(5, 0.1)


def twin(knee) -> Problem:
    """What is fitted, with data that carry no noise."""
    selection = kj.select(knee, ["*.stiffness", "*.reference_strain"])
    tests = [
        dataclasses.replace(test, path=PATH)
        for name in ("drawer", "torsion", "varus-valgus")
        for test in kj.lab_tests(name, FLEXION)
    ]
    measured = [kj.MeasuredTest.of(one) for one in kj.load_curves(knee, tests)]
    passive = np.asarray(kj.passive_flexion(knee, PASSIVE).to_table())
    return Problem.of(knee, selection, passive, NOISE**-2.0, tests=measured)


def fitted(problem: Problem, target: np.ndarray, start, lower, upper):
    """Fits to targets `(fits, load_cases, 5)` from one start."""
    cases = dataclasses.replace(problem.cases, target=target)
    count = len(target)
    begin = problem.begin(start[None]).take(np.zeros(count, int))
    return fit_lanes(
        problem.balance, cases, begin, np.tile(start, (count, 1)), np.tile(lower, (count, 1)),
        np.tile(upper, (count, 1)), far=True,
    )  # fmt: skip


def by_differences(problem: Problem, start, lower, upper) -> tuple[float, int]:
    """Seconds and evaluations of SciPy's least squares, which sees balances alone."""
    begin, count = problem.begin(start[None]), 0

    def residual(x):
        nonlocal count
        count += 1
        return problem.residual(problem.balance((lower + x * (upper - lower))[None], begin))[0]

    begun = time.perf_counter()
    least_squares(residual, (start - lower) / (upper - lower), bounds=(0.0, 1.0), max_nfev=20)
    return time.perf_counter() - begun, count


def main() -> None:
    options = arguments("laxity_twin", __doc__, draws=20, seed=0, scipy=1)
    knee = load(options.knee)
    problem, begun = twin(knee), time.perf_counter()
    truth, clean = np.asarray(problem.selection.read(knee)), problem.cases.target
    wide = np.where(np.abs(truth) > 1.0, 0.5 * np.abs(truth), 0.05)
    lower, upper = truth - wide, truth + wide
    draws = np.random.default_rng(options.seed)
    start = truth + 0.4 * wide * draws.uniform(-1.0, 1.0, len(truth))
    rows: dict[str, float] = {"parameters": len(truth), "load_cases": len(clean)}
    taken = []
    for _ in range(3):
        begun = time.perf_counter()
        exact = fitted(problem, clean[None], start, lower, upper)
        taken.append(time.perf_counter() - begun)
    off = np.abs(exact.values[0] - truth) / np.abs(truth)
    rows |= {"first_s": taken[0], "hot_s": min(taken[1:]), "evaluations": exact.evaluations,
             "without_noise_worst_relative_error": off.max(),
             "without_noise_median_relative_error": float(np.median(off))}  # fmt: skip
    if options.draws:
        noisy = clean + 0.1 * draws.standard_normal((options.draws, *clean.shape))
        begun = time.perf_counter()
        found = fitted(problem, noisy, start, lower, upper)
        rows["draws_s"] = time.perf_counter() - begun
        _, slope = dataclasses.replace(problem.cases, target=noisy).residual(found.slopes)
        error = np.sqrt(np.array([np.diag(np.linalg.pinv(x.T @ x)) for x in slope]))
        known = error < 0.1 * (upper - lower)
        holds = np.abs(found.values - truth) < 1.96 * error
        rows |= {"determined_percent": 100.0 * known.mean(),
                 "intervals_hold_percent": 100.0 * holds[known].mean(),
                 "ended_percent": 100.0 * found.converged.mean()}  # fmt: skip
    if options.scipy:
        rows["scipy_s"], rows["scipy_evaluations"] = by_differences(problem, start, lower, upper)
        rows["scipy_over_ours"] = rows["scipy_s"] / rows["hot_s"]
    finish(options.out, f"A twin with laxity, {knee.name}", rows)


if __name__ == "__main__":
    main()
