"""How far an answer scatters when its data are drawn again."""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from kneejax.experiments import MeasuredTest
from kneejax.inference.calibration import CalibrationProblem
from kneejax.inference.fit import Observations, fit_lanes, rows_of_tests
from kneejax.parameters import UnsuitableData
from kneejax.statics import Slopes

#: Draws that are fitted at once: bounds memory.
_AT_ONCE = 100
_MOST_EVALUATIONS = 100


def answered(problem: CalibrationProblem, answer: Sequence[float]) -> tuple[Observations, Slopes]:
    """Load cases of which those count at which an answer balances, and its balances."""
    check_redrawn(problem.fitted.tests)
    fitted = problem.fitted
    first = fitted.begin(np.asarray(answer, float)[None])
    if not first.converged[0].any():
        raise UnsuitableData("bootstrap: the answer has no balance")
    return fitted.with_used(first.converged[0] & fitted.used).cases, first


def _refitted(
    problem: CalibrationProblem, cases: Observations, first: Slopes, draws: Sequence[int],
    drawn: Callable[[int], tuple[np.ndarray, np.ndarray]],
) -> np.ndarray:  # fmt: skip
    """Fits of each draw, `(draws, p)`, from the answer; NaN where one did not converge."""
    found = [np.empty((0, len(problem.start)))]
    for place in range(0, len(draws), _AT_ONCE):
        some = draws[place : place + _AT_ONCE]
        target, spread = map(np.array, zip(*map(drawn, some), strict=True))
        data, begin = dataclasses.replace(cases, target=target, spread=spread), [0] * len(some)
        fits = fit_lanes(
            problem.fitted.balance, data, first.take(begin), first.values[begin], problem.lower,
            problem.upper, most=_MOST_EVALUATIONS,
        )  # fmt: skip
        found.append(np.where(fits.converged[:, None], fits.values, np.nan))
    return np.concatenate(found)


def check_redrawn(tests: Sequence[MeasuredTest]) -> None:
    """Refuse (`UnsuitableData`) readings of parts: these are not drawn again."""
    for test in tests:
        if test.readings:
            words = ", ".join(test.readings)
            raise UnsuitableData(f"bootstrap: {test.name}: {words}: expected poses alone")


#: Flexions of one test are one curve as long as neighbours are no farther apart, degrees.
_APART_DEG = 2.0
#: Curves of which draws tell anything: of five, one draw in 26 is less than three of them.
FEWEST_CURVES = 6


def curves_of(poses: int, tests: Sequence[MeasuredTest]) -> list[np.ndarray]:
    """Load cases of each measured curve, in the order of `observations`: the passive motion of so
    many poses, and each test at one flexion. Rows that share unknown constants, or that a knee in
    motion passes, are one."""
    found = [np.arange(poses)] if poses else []
    for test, place in zip(tests, rows_of_tests(poses, tests), strict=True):
        flexion = np.asarray(test.flexion_deg)
        own = np.zeros(len(flexion), int)
        if test.frames is None and (test.groups >= 0).any():
            own = test.groups
        elif test.frames is None:
            order = np.argsort(flexion, kind="stable")
            own[order] = np.r_[0, np.cumsum(np.diff(flexion[order]) > _APART_DEG)]
        found += [place.start + np.flatnonzero(own == k) for k in np.unique(own)]
    return found


def bootstrap_by_blocks(
    problem: CalibrationProblem, answer: Sequence[float], draws: Sequence[int], seed: int = 0
) -> np.ndarray:
    """Values that as many measured curves as there are, drawn with replacement, give, `(draws, p)`;
    as `bootstrap`. What all rows of a curve share (how the leg lay in the rig, where the load took
    hold) is drawn with it, which no noise of single readings knows (A. C. Davison and D. V.
    Hinkley, Bootstrap Methods and their Application, 1997, section 3.8)."""
    cases, first = answered(problem, answer)
    curves = curves_of(int(cases.posed.sum()), problem.fitted.tests)
    check_curves(curves)
    count, spread = len(curves), cases.spread

    def drawn(number: int) -> tuple[np.ndarray, np.ndarray]:
        chosen = np.random.default_rng([seed, number]).integers(0, count, count)
        times = np.ones((len(spread), 1))
        for rows, often in zip(curves, np.bincount(chosen, minlength=count), strict=True):
            times[rows] = often
        with np.errstate(divide="ignore"):  # what is not drawn counts for nothing
            return cases.target, spread / np.sqrt(times)

    return _refitted(problem, cases, first, draws, drawn)


def check_curves(curves: Sequence[np.ndarray]) -> None:
    """Refuse (`UnsuitableData`) to draw among fewer than six curves (`curves_of`)."""
    count = len(curves)
    if count < FEWEST_CURVES:
        raise UnsuitableData(
            f"bootstrap by blocks: {count} curve{'s' * (count != 1)}: expected at least "
            f"{FEWEST_CURVES} (the passive motion, and each test at one flexion)"
        )


def bootstrap(
    problem: CalibrationProblem, answer: Sequence[float], noise: Sequence[float],
    draws: Sequence[int], seed: int = 0,
) -> np.ndarray:  # fmt: skip
    """Values that the answer's own data, `(p,)`, with new noise, `(5,)` in degrees and mm, give,
    `(draws, p)`; NaN where a fit did not converge. A draw depends on the seed and its own number
    alone, begins at the answer, and is fitted with all parameters free, whatever the procedure; a
    prior stays. Source: B. Efron and R. J. Tibshirani, An Introduction to the Bootstrap (1993),
    section 6.5."""
    cases, first = answered(problem, answer)
    model, spread = cases.observed(first)[0][0], cases.spread
    scatter = np.where(np.isfinite(noise), noise, 0.0) * spread

    def drawn(number: int) -> tuple[np.ndarray, np.ndarray]:
        errors = scatter * np.random.default_rng([seed, number]).standard_normal(model.shape)
        return np.where(np.isnan(cases.target), np.nan, model + errors), spread

    return _refitted(problem, cases, first, draws, drawn)
