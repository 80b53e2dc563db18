"""The most probable parameters, and the normal density that the posterior is near there."""

from __future__ import annotations

import dataclasses

import numpy as np

from kneejax.inference.bayesian._priors import Prior
from kneejax.inference.fit import Problem, fit_lanes
from kneejax.parameters import UnsuitableData
from kneejax.statics import Slopes

_MOST_STEPS = 60


def most_probable(problem: Problem, priors: tuple[Prior, ...], fit: np.ndarray) -> Slopes:
    """Where likelihood times prior is largest, within the bounds.

    Args:
        problem: what is fitted, weighted by one over the noise's variances.
        priors: one for each parameter and offset.
        fit: parameters and offsets to search from, `(p,)`.

    Returns:
        Balances there, one variant; its values are parameters and offsets.

    Raises:
        UnsuitableData: a pose that counts has no balance where the search begins.
    """
    lower, upper = (np.array([[getattr(p, end) for p in priors]]) for end in ("lower", "upper"))
    begin = problem.begin(np.clip(fit[None], lower, upper))
    believed = np.array([p.mean for p in priors]), np.array([p.sd for p in priors])
    cases = dataclasses.replace(problem.cases, prior=believed)
    found = fit_lanes(
        problem.balance, cases, begin, begin.values, lower, upper, most=_MOST_STEPS, far=True
    )
    if not np.isfinite(found.chi2[0]):
        raise UnsuitableData(
            "a pose has no balance with the parameters of the fit: sample around one that balances "
            "all poses that count, or leave those poses out"
        )
    return found.slopes


def laplace_covariance(
    problem: Problem, found: Slopes, priors: tuple[Prior, ...]
) -> np.ndarray:
    """Covariance of the normal density at the most probable parameters (Laplace's approximation).

    Args:
        problem: as in `most_probable`.
        found: balances at the most probable values.
        priors: one for each parameter and offset.

    Returns:
        `(p, p)`; NaN where data and priors do not determine the parameters.
    """
    _, jacobian = problem.residual(found)
    precision = jacobian.T @ jacobian + np.diag([p.sd**-2.0 for p in priors])
    unit = np.sqrt(np.maximum(np.diag(precision), 1e-300))
    scaled = precision / np.outer(unit, unit)
    if not np.linalg.cond(scaled) < 1e14:
        return np.full_like(precision, np.nan)
    return np.linalg.inv(scaled) / np.outer(unit, unit)
