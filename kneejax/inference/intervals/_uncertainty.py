"""Standard errors and correlations from the Jacobian at a fit."""

from __future__ import annotations

import dataclasses

import numpy as np


@dataclasses.dataclass(frozen=True)
class Uncertainty:
    """Linear error propagation at a fit.

    Attributes:
        covariance: shape `(p, p)`; NaN for parameters that were held.
        standard_error: shape `(p,)`.
        correlation: shape `(p, p)`.
        noise: standard deviation of the measurement by coordinate, as given or as estimated from
            the residual.
    """

    covariance: np.ndarray
    standard_error: np.ndarray
    correlation: np.ndarray
    noise: np.ndarray


def uncertainty(
    jacobian: np.ndarray,
    error: np.ndarray,
    weights: np.ndarray,
    held: np.ndarray,
    noise: np.ndarray | None = None,
    seen: np.ndarray | None = None,
    beside: np.ndarray | None = None,
) -> Uncertainty:
    """Propagate the scatter of the data to the parameters.

    The weights of the objective need not be the inverse variances of the measurement (those of
    paper 1 are not), so the covariance is the general one of a weighted fit,
    `(J^T W J)^-1 J^T W S W J (J^T W J)^-1`, with the variances `S` of displacements and of
    rotations estimated from the residuals themselves where they are not known.

    Args:
        jacobian: derivative of the coordinates with respect to the parameters, `(5, n, p)`.
        error: model minus measurement, `(5, n)`.
        weights: of the objective, `(5,)`; a coordinate without weight tells nothing.
        held: parameters that do not move (at a bound), `(p,)`.
        noise: standard deviations of the measurement, `(5,)`; estimated where NaN, and by default.
        seen: what was observed, `(5, n)`; error and Jacobian are zero elsewhere. All by default.
        beside: derivatives of further residuals, each in its own standard deviation, `(k, p)`, in
            an objective to which they add their squares (`Observations.beside_poses`).

    Returns:
        The `Uncertainty`.
    """
    size = jacobian.shape[2]
    free = ~held
    used = np.isfinite(error).all(axis=0) & np.isfinite(jacobian).all(axis=(0, 2))
    j, e = jacobian[:, used][:, :, free], error[:, used]
    scale = np.sqrt((j**2).sum(axis=(0, 1)))
    scale = np.where(scale > 0, scale, 1.0)
    weighted = (np.sqrt(weights)[:, None, None] * j / scale).reshape(-1, free.sum())
    rows = len(weighted)
    if beside is not None:
        weighted = np.vstack([weighted, beside[:, free] / scale])
    left, singular, right = np.linalg.svd(weighted, full_matrices=False)
    with np.errstate(divide="ignore", invalid="ignore"):
        pseudo = (right.T / singular) @ left.T
    # Leverage: the part of each coordinate's scatter that the parameters have absorbed.
    leverage = (left[:rows] ** 2).sum(axis=1).reshape(5, -1)
    observed = np.ones(e.shape) if seen is None else seen[:, used]
    left_over = np.full(5, np.inf)
    for group in ([0, 1], [2, 3, 4]):
        weighed = [row for row in group if weights[row] > 0]
        spare = (observed[weighed] - leverage[weighed]).sum()
        squares = (e[weighed] ** 2).sum()
        left_over[weighed] = np.sqrt(squares / spare) if spare > 1e-9 else np.nan
    noise = left_over if noise is None else np.where(np.isnan(noise), left_over, noise)
    with np.errstate(invalid="ignore"):
        spread = np.repeat(np.where(weights > 0, np.sqrt(weights) * noise, 0.0), used.sum())
    spread = np.r_[spread, np.ones(len(weighted) - rows)]
    part = (pseudo * spread) @ (pseudo * spread).T / np.outer(scale, scale)
    covariance = np.full((size, size), np.nan)
    covariance[np.ix_(free, free)] = part
    error_bars = np.sqrt(np.diag(covariance))
    with np.errstate(divide="ignore", invalid="ignore"):
        correlation = covariance / np.outer(error_bars, error_bars)
    return Uncertainty(covariance, error_bars, correlation, noise)
