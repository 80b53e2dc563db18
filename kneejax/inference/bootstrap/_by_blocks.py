"""Bootstrap by blocks: whole curves that were measured are drawn with replacement, and fitted."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from kneejax.experiments import MeasuredTest
from kneejax.inference.bootstrap._answered import Answered
from kneejax.inference.calibration import CalibrationProblem
from kneejax.inference.fit import Observations, rows_of_tests
from kneejax.parameters import UnsuitableData

#: Flexions of one test that are farther apart are curves of their own, degrees.
_APART_DEG = 2.0
#: Curves of which draws tell anything: of five, one draw in 26 is less than three of them.
FEWEST_CURVES = 6


def curves_of(poses: int, tests: Sequence[MeasuredTest]) -> list[np.ndarray]:
    """Load cases of each curve that was measured: of the passive motion, or a test at one flexion.

    Rows of a test that share unknown constants, or that a knee in motion passes, are one curve.

    Args:
        poses: of the passive motion; they are one curve.
        tests: that were made beside it.

    Returns:
        Their numbers among the load cases, as `observations` orders these.

    Example:
        >>> import kneejax as kj
        >>> (test,) = kj.lab_tests("drawer", [0.0, 30.0], steps=2)
        >>> (curves,) = kj.load_curves(kj.load_knee("four_ligament"), test)
        >>> [one.tolist() for one in curves_of(2, [kj.MeasuredTest.of(curves)])]
        [[0, 1], [2, 3, 4], [5, 6, 7]]
    """
    found = [np.arange(poses)] if poses else []
    for test, place in zip(tests, rows_of_tests(poses, tests), strict=True):
        own = _within(test)
        found += [place.start + np.flatnonzero(own == k) for k in range(own.max() + 1)]
    return found


def bootstrap_by_blocks(
    problem: CalibrationProblem, answer: Sequence[float], draws: Sequence[int], seed: int = 0
) -> np.ndarray:
    """Fit as many of the measured curves as there are, drawn with replacement, many times.

    What all rows of a curve share (how the leg lay in the rig, where the load took hold) is drawn
    with it, which no noise of single readings knows. A draw depends on the seed and on its own
    number alone, begins at the answer, and is fitted with all parameters free.

    Args:
        problem: that was solved (`calibrate`).
        answer: values of its parameters, then of constants between frames, `(p,)`.
        draws: numbers of the draws, from zero.
        seed: of the draws.

    Returns:
        Values of each draw, `(draws, p)`; NaN where its fit did not converge.

    Raises:
        UnsuitableData: fewer than six curves, forces were read beside poses, or the answer has no
            balance.

    Source: A. C. Davison and D. V. Hinkley, Bootstrap Methods and their Application (1997),
    section 3.8.
    """
    answered = Answered.of(problem, answer)
    cases = answered.cases
    curves = curves_of(int(cases.posed.sum()), problem.fitted.tests)
    check_curves(curves)
    count, shape = len(curves), cases.target.shape
    spread = np.ones(shape) if cases.spread is None else cases.spread

    def drawn(some: Sequence[int]) -> Observations:
        times = np.ones((len(some), *shape))
        for place, k in enumerate(some):
            lot = np.random.default_rng([seed, k]).integers(0, count, count)
            for rows, often in zip(curves, np.bincount(lot, minlength=count), strict=True):
                times[place, rows] = often
        with np.errstate(divide="ignore"):  # what is not drawn counts for nothing
            return dataclasses.replace(
                cases, target=np.tile(cases.target, (len(some), 1, 1)),
                spread=spread / np.sqrt(times),
            )  # fmt: skip

    return answered.fitted(draws, drawn)


def check_curves(curves: Sequence[np.ndarray]) -> None:
    """Refuse to draw among too few curves (`curves_of`).

    Raises:
        UnsuitableData: they are fewer than six.
    """
    count = len(curves)
    if count < FEWEST_CURVES:
        raise UnsuitableData(
            f"bootstrap by blocks: {count} curve{'s' * (count != 1)}: expected at least "
            f"{FEWEST_CURVES} (the passive motion, and each test at one flexion)"
        )


def _within(test: MeasuredTest) -> np.ndarray:
    """Which of a test's curves each of its rows is of, `(n,)`."""
    flexion = np.asarray(test.flexion_deg)
    if test.frames is not None:
        return np.zeros(len(flexion), int)
    if (test.groups >= 0).any():
        return np.unique(test.groups, return_inverse=True)[1]
    order = np.argsort(flexion, kind="stable")
    number = np.zeros(len(flexion), int)
    number[order] = np.r_[0, np.cumsum(np.diff(flexion[order]) > _APART_DEG)]
    return number
