"""Standard errors and correlations from the curvature at a fit."""

from __future__ import annotations

import dataclasses

import numpy as np

#: Singular values below this part of the largest are rounding.
_ROUNDING = 1e-7


@dataclasses.dataclass(frozen=True, eq=False)
class Uncertainty:
    """Linear error propagation at a fit.

    Attributes:
        covariance: shape `(p, p)`; NaN for values that were held or of which nothing is known.
        standard_error: shape `(p,)`.
        correlation: shape `(p, p)`.
    """

    covariance: np.ndarray
    standard_error: np.ndarray
    correlation: np.ndarray


def uncertainty(slope: np.ndarray, held: np.ndarray | None = None) -> Uncertainty:
    """Propagate the scatter of residuals, one each, to the values that minimise their squares.

    Args:
        slope: derivatives of residuals in units of their noise by the values, `(r, p)`.
        held: values that do not move (on a bound), `(p,)`; none by default.

    Returns:
        The `Uncertainty`: the inverse of `slope^T slope`.

    Example:
        >>> uncertainty(np.array([[3.0, 0.0], [4.0, 0.0], [0.0, 0.5]])).standard_error.tolist()
        [0.2, 2.0]
    """
    size = slope.shape[1]
    free = np.arange(size) if held is None else np.flatnonzero(~held)
    columns = slope[:, free]
    scale = np.linalg.norm(columns, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    _, singular, right = np.linalg.svd(columns / scale, full_matrices=True)
    roots = np.zeros(len(free))
    roots[: len(singular)] = singular
    known = roots > _ROUNDING * roots.max(initial=0.0)
    half = right[known].T / roots[known] / scale[:, None]
    part = half @ half.T
    unknown = (right[~known] ** 2).sum(axis=0) > 1e-12
    part[unknown], part[:, unknown] = np.nan, np.nan
    covariance = np.full((size, size), np.nan)
    covariance[np.ix_(free, free)] = part
    error = np.sqrt(np.diag(covariance))
    return Uncertainty(covariance, error, covariance / np.outer(error, error))
