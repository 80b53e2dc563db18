"""A parameter over a cohort: its mean, its spread, and what each knee's own data add to them.

Knee `j` has an estimate `y_j` with standard error `s_j` of its own value `theta_j`, and values
scatter about a mean: `y_j ~ N(theta_j, s_j^2)`, `theta_j ~ N(mu, tau^2)`. Given `tau` all of it is
closed (Gelman et al., Bayesian Data Analysis, 3rd ed., section 5.4), so the posterior is a sum over
one dimension, and nothing is sampled. Priors are flat in `mu` and in `tau`.
"""

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
    """Whether a logarithm scatters like a normal number: of stiffnesses, the law's strains."""
    return name.rpartition(".")[2] in _FACTORS


@dataclasses.dataclass(frozen=True, eq=False)
class Population:
    """A parameter over a cohort; all of its logarithm where `log`."""

    mean: float  # of the population, posterior mean
    mean_limits: tuple[float, float]  # of 95 %
    spread: float  # standard deviation between knees, posterior median
    spread_limits: tuple[float, float]  # of 95 %
    # Of each knee, `(knees,)`: posterior mean, which its own data say, drawn to the mean as far as
    # they leave room, and its standard deviation.
    shrunk: np.ndarray
    deviation: np.ndarray
    # Part of what is known of each knee that its own data bring, `(knees,)`: one minus the variance
    # beside the others', as a share of the variance without its data.
    own: np.ndarray
    next_deviation: float  # of a knee of which nothing is measured, with that spread
    log: bool
    knees: int  # how many bring an estimate

    def in_own_unit(self, value: float) -> float:
        """A value as the parameter has it."""
        return float(np.exp(value)) if self.log else float(value)

    @property
    def prior(self) -> tuple[float, float]:
        """Mean and standard deviation of a knee not measured, in the parameter's unit."""
        if not self.log:
            return self.mean, self.next_deviation
        # The mean and the deviation of a logarithmic normal number.
        square = self.next_deviation**2
        mean = float(np.exp(self.mean + 0.5 * square))
        return mean, mean * float(np.sqrt(np.expm1(square)))


def population(value: ArrayLike, error: ArrayLike, log: bool = False) -> Population | None:
    """Mean and spread of a parameter over knees, and each knee in their light (Gelman et al., eqs
    5.17 to 5.21), by estimates and standard errors, `(knees,)`, of the logarithm where `log`; NaN
    or infinite where there is none. None where fewer than three knees bring an estimate."""
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
