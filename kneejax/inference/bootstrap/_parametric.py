"""Parametric bootstrap: data made again from the answer, with the noise, and fitted again."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from kneejax.inference.calibration import Question, ready
from kneejax.inference.fit import LoadCases, fit_lanes
from kneejax.parameters import UnsuitableData
from kneejax.statics import Slopes

#: Draws that are fitted at once: bounds memory.
_AT_ONCE = 100
_MOST_EVALUATIONS = 100


def bootstrap(
    question: Question,
    answer: Sequence[float],
    noise: Sequence[float],
    draws: Sequence[int],
    seed: int = 0,
) -> np.ndarray:
    """Fit data that the answer itself would give, with new noise, many times.

    A draw depends on the seed and on its own number alone. Each begins at the answer and is fitted
    with all parameters free, whatever the procedure; a prior stays as it is.

    Args:
        question: that was answered (`calibrate`).
        answer: values of its parameters, then of constants between frames, `(p,)`.
        noise: standard deviation of each coordinate, degrees and mm, `(5,)`.
        draws: numbers of the draws, from zero.
        seed: of the noise.

    Returns:
        Values of each draw, `(draws, p)`; NaN where its fit did not converge.

    Raises:
        UnsuitableData: forces were read beside poses, which are not made again, or the answer has
            no balance.

    Source: B. Efron and R. J. Tibshirani, An Introduction to the Bootstrap (1993), section 6.5.
    """
    own = ready(question)
    problem = own.problem
    if problem.cases.readings is not None:
        raise UnsuitableData("bootstrap: forces or strains were read, which it does not make again")
    first = problem.begin(np.asarray(answer, float)[None])
    if not first.converged[0].any():
        raise UnsuitableData("bootstrap: the answer has no balance")
    cases = problem.with_used(first.converged[0] & problem.used).cases
    model, spread = cases.observed(first)[0][0], np.asarray(noise, float)
    spread = np.where(np.isfinite(spread), spread, 0.0)
    if cases.spread is not None:
        spread = spread * cases.spread
    found = []
    for begin in range(0, len(draws), _AT_ONCE):
        some = draws[begin : begin + _AT_ONCE]
        scatter = [np.random.default_rng([seed, k]).standard_normal(model.shape) for k in some]
        target = model + spread * np.array(scatter)
        target = np.where(np.isnan(cases.target), np.nan, target)
        found.append(_fitted(problem.balance, cases, first, target, own.lower, own.upper))
    return np.concatenate(found) if found else np.empty((0, len(own.start)))


def _fitted(balance, cases: LoadCases, first: Slopes, target, lower, upper) -> np.ndarray:
    count = len(target)
    data, begin = dataclasses.replace(cases, target=target), first.take(np.zeros(count, int))
    box = [np.tile(bound, (count, 1)) for bound in (lower, upper)]
    fits = fit_lanes(balance, data, begin, begin.values, *box, most=_MOST_EVALUATIONS)
    return np.where(fits.converged[:, None], fits.values, np.nan)
