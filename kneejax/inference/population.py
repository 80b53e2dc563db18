"""A parameter over a cohort: its mean, its spread, and what each knee's own data add to them.

Knee `j` has an estimate `y_j` with standard error `s_j` of its own value `theta_j`, and values
scatter about a mean: `y_j ~ N(theta_j, s_j^2)`, `theta_j ~ N(mu, tau^2)`. Given `tau` all of it is
closed (Gelman et al., Bayesian Data Analysis, 3rd ed., section 5.4), so the posterior is a sum over
one dimension, and nothing is sampled. Priors are flat in `mu` and in `tau`.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

#: Values of `tau` at which the posterior is taken, and how far it is looked for, in spreads.
_POINTS, _FAR = 400, 10.0
#: Quantities that are positive and differ by factors between knees.
_FACTORS = ("stiffness", "transition_strain", "transition_width", "failure_strain", "damping",
            "youngs_modulus", "tension")  # fmt: skip
#: Of the spread: its limits and its median.
_LEVELS = (0.025, 0.5, 0.975)


def in_log(name: str) -> bool:
    """Whether a parameter's logarithm is what scatters like a normal number: of stiffnesses and the
    law's own strains.

    Example:
        >>> in_log("ACL.stiffness"), in_log("ACL.reference_strain")
        (True, False)
    """
    return name.rpartition(".")[2] in _FACTORS


@dataclasses.dataclass(frozen=True, eq=False)
class Population:
    """A parameter over a cohort.

    Attributes:
        mean: of the population, posterior mean; of the logarithm where `log`.
        mean_limits: its 95 % limits.
        spread: standard deviation between knees, posterior median.
        spread_limits: its 95 % limits.
        shrunk: of each knee, posterior mean, `(knees,)`: what its own data say, drawn to the mean
            as far as they leave room.
        deviation: standard deviation of that, `(knees,)`.
        own: part of what is known of each knee that its own data bring, `(knees,)`: one minus the
            variance beside the others', as a share of the variance without its data.
        next_deviation: standard deviation of a knee of which nothing is measured, with that spread.
        log: whether all of it is of the logarithm.
        knees: how many bring an estimate.
    """

    mean: float
    mean_limits: tuple[float, float]
    spread: float
    spread_limits: tuple[float, float]
    shrunk: np.ndarray
    deviation: np.ndarray
    own: np.ndarray
    next_deviation: float
    log: bool
    knees: int

    def in_own_unit(self, value: float) -> float:
        """A value as the parameter has it."""
        return float(np.exp(value)) if self.log else float(value)

    @property
    def prior(self) -> tuple[float, float]:
        """Mean and standard deviation of a knee of which nothing is measured, in the parameter's
        unit."""
        if not self.log:
            return self.mean, self.next_deviation
        # The mean and the deviation of a logarithmic normal number.
        square = self.next_deviation**2
        mean = float(np.exp(self.mean + 0.5 * square))
        return mean, mean * float(np.sqrt(np.expm1(square)))


def population(value: ArrayLike, error: ArrayLike, log: bool = False) -> Population | None:
    """Mean and spread of a parameter over knees, and each knee in their light.

    Args:
        value: estimates, `(knees,)`; of the logarithm where `log`. NaN where there is none.
        error: standard errors, `(knees,)`; infinite or NaN where the data say nothing.
        log: whether values are logarithms.

    Returns:
        The `Population`; None where fewer than three knees bring an estimate.

    Source: Gelman et al., Bayesian Data Analysis, 3rd ed., eqs 5.17 to 5.21.

    Example:
        >>> found = population([1.0, 2.0, 3.0, 4.0], [0.1, 0.1, 0.1, 0.1])
        >>> round(found.mean, 3), bool(found.spread > 1.0), found.knees
        (2.5, True, 4)
    """
    y, s = np.asarray(value, float), np.asarray(error, float)
    known = np.isfinite(y) & np.isfinite(s) & (s > 0)
    if known.sum() < 3:
        return None
    tau, weight, mean, variance = _posterior(y[known], s[known])
    middle = float(weight @ mean)
    total = float(weight @ (variance + (mean - middle) ** 2))
    below = np.cumsum(weight) - 0.5 * weight
    low, between, high = (float(np.interp(level, below, tau)) for level in _LEVELS)
    share = np.ones((len(y), len(tau)))  # of the population in what is known of a knee
    square = s[known, None] ** 2
    share[known] = square / (square + tau**2)
    each = share * mean + (1.0 - share) * np.where(known, y, 0.0)[:, None]
    shrunk = each @ weight
    inner = share * tau**2 + share**2 * variance
    spread = (inner + (each - shrunk[:, None]) ** 2) @ weight
    alone = float(weight @ (tau**2 + variance + (mean - middle) ** 2))
    # With few knees the tail of the spread is heavy: its median says what to expect.
    following, side = float(np.sqrt(total + between**2)), 1.96 * float(np.sqrt(total))
    own = np.clip(1.0 - spread / alone, 0.0, 1.0)
    return Population(
        middle, (middle - side, middle + side), between, (low, high), shrunk, np.sqrt(spread), own,
        following, log, int(known.sum()),
    )  # fmt: skip


def _posterior(y: np.ndarray, s: np.ndarray):
    """Of `tau` its values and their weights, and given each the mean of `mu` and its variance."""
    width = max(float(np.std(y)), float(np.median(s)), 1e-300)
    # A first look finds where the weight is; a second one lies closely there.
    grid = np.linspace(0.0, _FAR * width, _POINTS)
    for closely in (False, True):
        precision = 1.0 / (s[:, None] ** 2 + grid**2)
        variance = 1.0 / precision.sum(axis=0)
        mean = (precision * y[:, None]).sum(axis=0) * variance
        log = 0.5 * np.log(variance) + 0.5 * np.log(precision).sum(axis=0)
        log -= 0.5 * (precision * (y[:, None] - mean) ** 2).sum(axis=0)
        weight = np.exp(log - log.max())
        weight /= weight.sum()
        far = grid[min(int(np.searchsorted(np.cumsum(weight), 1.0 - 1e-5)) + 2, _POINTS - 1)]
        if not closely:
            grid = np.linspace(0.0, far, _POINTS)
    return grid, weight, mean, variance
