"""Priors, and the normal approximation of a posterior."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from jax.scipy.stats import truncnorm
from numpy.typing import ArrayLike

from kneejax.inference.fit import Problem, fit_lanes
from kneejax.mechanics import Knee
from kneejax.parameters import (
    Selection,
    UnsuitableData,
    doubt_prior,
    doubt_value,
    prior_scales,
    stated,
    stated_bounds,
)
from kneejax.statics import Slopes

#: A frame is rarely off by more than 10 mm or degrees.
_OFFSET_BOUND, _OFFSET_SD = 10.0, 5.0


@dataclasses.dataclass(frozen=True)
class Prior:
    """A normal density, cut off at bounds.

    Attributes:
        name: of the parameter.
        mean: of the normal density before it is cut off, in the parameter's unit.
        sd: its standard deviation; infinite for a prior that is flat between the bounds.
        lower: bound.
        upper: bound.

    Example:
        >>> Prior("ACL.stiffness", 4500.0, float("inf"), 500.0, 8500.0).density([200.0, 5000.0])
        array([0.      , 0.000125])
    """

    name: str
    mean: float
    sd: float
    lower: float
    upper: float

    def density(self, values: ArrayLike) -> np.ndarray:
        """Probability density at values, normalised between the bounds."""
        values = np.asarray(values, float)
        if np.isinf(self.sd):
            inside = (values >= self.lower) & (values <= self.upper)
            return inside / (self.upper - self.lower)
        low, high = ((limit - self.mean) / self.sd for limit in (self.lower, self.upper))
        return np.asarray(truncnorm.pdf(values, low, high, self.mean, self.sd))

    @property
    def spread(self) -> float:
        """Standard deviation of what is left between the bounds."""
        reach = 8.0 * self.sd
        low, high = max(self.lower, self.mean - reach), min(self.upper, self.mean + reach)
        every = np.linspace(low, high, 4001)
        weight = self.density(every) / self.density(every).sum()
        return float(np.sqrt(weight @ (every - weight @ every) ** 2))


def normal_priors(
    problem: Problem,
    given: Mapping[str, tuple[float, float]] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
) -> tuple[Prior, ...]:
    """Priors of a problem's parameters and frame offsets.

    By default a prior is centred on the value of the problem's knee, the literature's where a
    calibration begins, and as wide as `prior_scales` says: 30 % of a stiffness, 0.02 of a
    reference strain, which is how far published values of one ligament are apart. The bounds keep a
    stiffness positive; a lognormal density, the other usual choice, differs from a normal one of
    30 % only far from its middle. Frame offsets: zero, with a standard deviation of 5 mm or
    degrees, within 10.

    Args:
        problem: what is fitted; its knee is the start, not the fit.
        given: name, `*.quantity` or quantity -> mean and standard deviation; the latter may be
            infinite.
        bounds: name, `*.quantity` or quantity -> lower and upper bound; as in `calibrate`.

    Returns:
        One prior for each parameter, then for each offset.

    Raises:
        UnknownParameter: a prior or bounds of something that is not free.
        UnsuitableData: a standard deviation that is not positive, a mean that is not finite or
            outside the bounds, bounds in the wrong order.
    """
    found = [*parameter_priors(problem.knee, problem.selection, given, bounds)]
    for coordinate in problem.offsets:
        name = f"offset.{coordinate}"
        found.append(Prior(name, 0.0, _OFFSET_SD, -_OFFSET_BOUND, _OFFSET_BOUND))
    return tuple(found)


def parameter_priors(
    knee: Knee,
    selection: Selection,
    given: Mapping[str, tuple[float, float]] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
) -> tuple[Prior, ...]:
    """Priors of parameters alone, one each; as `normal_priors`.

    Args:
        knee: whose values are the middles where none is given.
        selection: the parameters.
        given: as in `normal_priors`.
        bounds: likewise.
    """
    values = np.asarray(selection.read(knee))
    usual = prior_scales(selection, values)
    stated(selection, bounds or {}, "bounds")
    lower, upper = stated_bounds(knee, selection, bounds or {})
    found = []
    for i, own in enumerate(stated(selection, given or {}, "prior")):
        mean, sd = own or (values[i], usual[i])
        if own:
            doubt_value(knee, selection.names[i], mean)
            doubt_prior(knee, selection.names[i], sd)
        numbers = map(float, (mean, sd, lower[i], upper[i]))
        found.append(_checked(Prior(selection.names[i], *numbers)))
    return tuple(found)


def _checked(prior: Prior) -> Prior:
    if not prior.sd > 0:
        raise UnsuitableData(
            f"{prior.name}: prior of width {prior.sd:g}: expected a standard deviation above zero; "
            "leave the parameter out if it is known exactly"
        )
    if not np.isfinite(prior.mean):
        raise UnsuitableData(f"{prior.name}: prior of mean {prior.mean:g}: expected a number")
    if not prior.lower <= prior.mean <= prior.upper:
        raise UnsuitableData(
            f"{prior.name}: bounds {prior.lower:g} to {prior.upper:g} exclude the prior's mean "
            f"{prior.mean:g}"
        )
    return prior


_MOST_STEPS = 60


def most_probable(problem: Problem, priors: tuple[Prior, ...], fit: np.ndarray) -> Slopes:
    """Balances, one variant, where likelihood times prior is largest within the bounds.

    The problem is weighted by one over the noise's variances; the search begins at parameters and
    offsets `fit`, `(p,)`, and raises where a pose that counts has no balance there.
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
    """Covariance of the normal density at the most probable parameters (Laplace's approximation),
    `(p, p)`; NaN where data and priors do not determine the parameters."""
    _, jacobian = problem.residual(found)
    precision = jacobian.T @ jacobian + np.diag([p.sd**-2.0 for p in priors])
    unit = np.sqrt(np.maximum(np.diag(precision), 1e-300))
    scaled = precision / np.outer(unit, unit)
    if not np.linalg.cond(scaled) < 1e14:
        return np.full_like(precision, np.nan)
    return np.linalg.inv(scaled) / np.outer(unit, unit)
