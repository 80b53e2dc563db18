"""The most probable parameters, and the normal density that the posterior is near there."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from kneejax.inference.bayesian._priors import Prior
from kneejax.inference.fit import BoundedLevenbergMarquardt, Evaluation, Problem
from kneejax.parameters import UnsuitableData

_MOST_STEPS = 60


def most_probable(
    problem: Problem, priors: tuple[Prior, ...], fit: np.ndarray
) -> tuple[np.ndarray, Evaluation]:
    """Where likelihood times prior is largest, within the bounds.

    Args:
        problem: what is fitted, weighted by one over the noise's variances.
        priors: one for each parameter and offset.
        fit: parameters and offsets to search from, `(p,)`.

    Returns:
        Parameters and offsets, `(p,)`, and the balanced poses there.

    Raises:
        UnsuitableData: a pose that counts has no balance where the search begins.
    """
    lower, upper = (np.array([getattr(p, end) for p in priors]) for end in ("lower", "upper"))
    mean, root = np.array([p.mean for p in priors]), np.array([1.0 / p.sd for p in priors])
    solver = BoundedLevenbergMarquardt(  # pyright: ignore[reportCallIssue]
        jnp.asarray(lower), jnp.asarray(upper), jacobian_from_aux=True
    )
    trials: list[tuple[np.ndarray, Evaluation]] = []
    best: tuple[np.ndarray, Evaluation] | None = None

    def look(y, _):
        x = np.asarray(y)
        trials.append((x, problem.poses(x)))
        residual, jacobian = problem.residual(*trials[-1])
        return jnp.r_[residual, root * (x - mean)], (jnp.r_[jacobian, np.diag(root)],)

    y, tags = jnp.asarray(np.clip(fit, lower, upper)), frozenset()
    struct = jax.ShapeDtypeStruct((problem.target.size + len(priors),), float)
    state = solver.init(look, y, None, {}, struct, None, tags)
    for _ in range(_MOST_STEPS):
        y, state, _ = solver.step(look, y, None, {}, state, tags)
        if bool(state.accepted):
            best = trials[-1]
            problem.keep(*best)
        if bool(solver.terminate(look, y, None, {}, state, tags)[0]):
            break
    if best is None:
        raise UnsuitableData(
            "a pose has no balance with the parameters of the fit: sample around one that balances "
            "all poses that count, or leave those poses out"
        )
    return best


def laplace_covariance(
    problem: Problem, values: np.ndarray, found: Evaluation, priors: tuple[Prior, ...]
) -> np.ndarray:
    """Covariance of the normal density at the most probable parameters (Laplace's approximation).

    Args:
        problem: as in `most_probable`.
        values: the most probable parameters and offsets, `(p,)`.
        found: the poses there.
        priors: one for each parameter and offset.

    Returns:
        `(p, p)`; NaN where data and priors do not determine the parameters.
    """
    _, jacobian = problem.residual(values, found)
    precision = jacobian.T @ jacobian + np.diag([p.sd**-2.0 for p in priors])
    unit = np.sqrt(np.maximum(np.diag(precision), 1e-300))
    scaled = precision / np.outer(unit, unit)
    if not np.linalg.cond(scaled) < 1e14:
        return np.full_like(precision, np.nan)
    return np.linalg.inv(scaled) / np.outer(unit, unit)
