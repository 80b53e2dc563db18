"""Parametric bootstrap: data made again from the answer, with the noise, and fitted again."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from kneejax.inference.bootstrap._answered import Answered
from kneejax.inference.calibration import CalibrationProblem
from kneejax.inference.fit import Observations


def bootstrap(
    problem: CalibrationProblem,
    answer: Sequence[float],
    noise: Sequence[float],
    draws: Sequence[int],
    seed: int = 0,
) -> np.ndarray:
    """Fit data that the answer itself would give, with new noise, many times.

    A draw depends on the seed and on its own number alone. Each begins at the answer and is fitted
    with all parameters free, whatever the procedure; a prior stays as it is.

    Args:
        problem: that was solved (`calibrate`).
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
    answered = Answered.of(problem, answer)
    cases = answered.cases
    model, spread = cases.observed(answered.first)[0][0], np.asarray(noise, float)
    spread = np.where(np.isfinite(spread), spread, 0.0)
    if cases.spread is not None:
        spread = spread * cases.spread

    def made_again(some: Sequence[int]) -> Observations:
        scatter = [np.random.default_rng([seed, k]).standard_normal(model.shape) for k in some]
        target = model + spread * np.array(scatter)
        return dataclasses.replace(cases, target=np.where(np.isnan(cases.target), np.nan, target))

    return answered.fitted(draws, made_again)
