"""What is known before a motion is measured, and the density of parameters given one."""

__all__ = ["Prior", "normal_priors", "parameter_priors"]

import dataclasses
from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.nn import log_sigmoid, softplus
from jax.scipy.stats import truncnorm
from numpy.typing import ArrayLike

from kneejax.geometry import FREE_COORDINATES
from kneejax.inference.fit import TABLE_UNITS, Problem, fit_lanes, without_offsets
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
from kneejax.statics import Guess, LoadCases, Slopes, in_lanes, solve_equilibrium

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
    """Priors of parameters alone, one each, around the knee's values; as `normal_priors`."""
    values = np.asarray(selection.read(knee))
    usual = prior_scales(selection, values)
    stated(selection, bounds or {}, "bounds")
    lower, upper = stated_bounds(knee, selection, bounds or {})
    found = []
    for i, own in enumerate(stated(selection, given or {}, "prior")):
        name, (mean, sd) = selection.names[i], own or (values[i], usual[i])
        if own:
            doubt_value(knee, name, mean)
            doubt_prior(knee, name, sd)
        if not sd > 0:
            raise UnsuitableData(
                f"{name}: prior of width {sd:g}: expected a standard deviation above zero; "
                "leave the parameter out if it is known exactly"
            )
        if not np.isfinite(mean):
            raise UnsuitableData(f"{name}: prior of mean {mean:g}: expected a number")
        if not lower[i] <= mean <= upper[i]:
            raise UnsuitableData(
                f"{name}: bounds {lower[i]:g} to {upper[i]:g} exclude the prior's mean {mean:g}"
            )
        found.append(Prior(name, *map(float, (mean, sd, lower[i], upper[i]))))
    return tuple(found)


_MOST_STEPS = 60


def most_probable(problem: Problem, priors: tuple[Prior, ...], fit: np.ndarray) -> Slopes:
    """Balances where likelihood times prior is largest within the bounds, from `(p,)`."""
    lower, upper, mean, sd = np.array([(p.lower, p.upper, p.mean, p.sd) for p in priors]).T
    begin = problem.begin(np.clip(fit[None], lower, upper))
    cases = dataclasses.replace(problem.cases, prior=(mean, sd))
    found = fit_lanes(
        problem.balance, cases, begin, begin.values, lower, upper, most=_MOST_STEPS, far=True
    )
    if not np.isfinite(found.chi2[0]):
        raise UnsuitableData(
            "a pose has no balance with the parameters of the fit: sample around one that balances "
            "all poses that count, or leave those poses out"
        )
    return found.slopes


def laplace_covariance(precision: np.ndarray) -> np.ndarray:
    """Laplace's approximation, `(p, p)`; NaN where the parameters are not determined."""
    unit = np.sqrt(np.maximum(np.diag(precision), 1e-300))
    scaled = precision / np.outer(unit, unit)
    if not np.linalg.cond(scaled) < 1e14:
        return np.full_like(precision, np.nan)
    return np.linalg.inv(scaled) / np.outer(unit, unit)


class MotionDensity(eqx.Module):
    """Posterior density of a problem's parameters, in coordinates without bounds.

    The poses of all chains are lanes of one solve, each with its chain's parameters. Every search
    begins at the linear prediction from the same balanced poses, so the density is a function of
    the parameters and nothing else. Measured coordinates have independent normal noise.

    Positions are parameters, stiffnesses in their logarithm, bent near the bounds so that they
    never reach them. Stiffness and reference strain make up for each other along a ridge that is
    straighter with the logarithm: what a strain has to make up for goes with force over stiffness.
    A sigmoid, the usual way to keep bounds, bends it everywhere: paper 1's twin then took 14
    gradients a draw, and 860 of 4000 draws were effective; like this 6 gradients, and 2500.
    """

    selection: Selection = eqx.field(static=True)  # the parameters
    # Free coordinates with an unknown offset to the measurement.
    offsets: tuple[str, ...] = eqx.field(static=True)
    knee: Knee  # gives everything else
    load_cases: LoadCases  # `(n,)`; the problem's load cases that count, as are the following
    target: Array  # measured coordinates, degrees and mm, `(5, n)`; NaN where not observed
    noise: Array  # its standard deviation, `(5,)`
    # Parameters `(p,)` and balances there to predict from, fields of `Slopes`; arrays begin with
    # the load case.
    near: dict[str, Array]
    mean: Array  # of the priors, `(p,)`
    precision: Array  # one over their variances, zero where flat, `(p,)`
    in_log: Array  # which parameters count by their logarithm, `(p,)`
    lower: Array  # bounds, of the logarithm where that counts, `(p,)`
    upper: Array  # likewise
    edge: Array  # how far from a bound the bending begins, likewise

    @classmethod
    def of(
        cls, problem: Problem, noise: np.ndarray, priors: tuple[Prior, ...], near: Slopes,
        deviation: np.ndarray,
    ) -> "MotionDensity":  # fmt: skip
        """The density of a problem with noise `(5,)`, from balances `near` at values that are
        uncertain by about a `deviation`, `(p,)`, NaN if unknown."""
        values, own = near.values[0], without_offsets(near, problem.offsets, problem.cases.posed)
        in_log = np.array([p.name.endswith(".stiffness") and p.lower > 0.0 for p in priors])
        ends = np.array([(p.lower, p.upper) for p in priors])
        lower, upper = np.where(in_log, np.log(np.where(in_log, ends.T, 1.0)), ends.T)
        deviation = deviation / np.where(in_log, values, 1.0)
        rows = np.flatnonzero(problem.used)
        counted = own.at(rows)
        arrays = {f.name: getattr(counted, f.name)[0] for f in dataclasses.fields(counted)}
        known = {name: jnp.asarray(x) for name, x in arrays.items() if name != "knee"}
        target, edge = problem.cases.target.T[:, rows], 0.25 * (upper - lower)
        mean, precision = np.array([(prior.mean, prior.sd**-2.0) for prior in priors]).T
        numbers = mean, precision, in_log, lower, upper, np.fmin(0.5 * deviation, edge)
        return cls(
            problem.selection, problem.offsets, problem.knee, problem.cases.load_cases.take(rows),
            jnp.asarray(target), jnp.asarray(noise), known, *map(jnp.asarray, numbers),
        )  # fmt: skip

    def values(self, position: Array) -> Array:
        """Parameters and offsets at positions `(..., p)`."""
        between = self._between(position)
        return jnp.where(self.in_log, jnp.exp(jnp.where(self.in_log, between, 0.0)), between)

    def position(self, values: Array) -> Array:
        """Where parameters and offsets `(..., p)` are without bounds."""
        log = jnp.log(jnp.where(self.in_log, values, 1.0))
        between = jnp.where(self.in_log, log, values)
        width = self.upper - self.lower
        share = (between - self.lower) / width * softplus(width / self.edge)
        below = self.lower + self.edge * _softplus_inverse(share)
        return self.upper - self.edge * _softplus_inverse((self.upper - below) / self.edge)

    def _below(self, position: Array) -> Array:
        """Positions bent so that they stay below the upper bounds."""
        return self.upper - self.edge * softplus((self.upper - position) / self.edge)

    def _between(self, position: Array) -> Array:
        """Positions bent so that they stay between the bounds."""
        width, below = self.upper - self.lower, self._below(position)
        share = softplus((below - self.lower) / self.edge) / softplus(width / self.edge)
        return self.lower + width * share

    def prior(self, position: Array) -> Array:
        """Log density of the priors at positions `(..., p)`, but for a constant."""
        bell = -0.5 * self.precision * (self.values(position) - self.mean) ** 2
        return jnp.sum(bell, axis=-1) + self.widening(position)

    def widening(self, position: Array) -> Array:
        """How much wider positions `(..., p)` lie than values, as a log density."""
        at_upper = log_sigmoid((self.upper - position) / self.edge)
        at_lower = log_sigmoid((self._below(position) - self.lower) / self.edge)
        stretch = jnp.where(self.in_log, self._between(position), 0.0)
        return jnp.sum(at_upper + at_lower + stretch, axis=-1)

    def __call__(self, position: Array) -> tuple[Array, Array]:
        """Log densities and gradients at positions `(chains, p)`; chains share no lane, so the
        gradient of their sum, in reverse through the implicit derivative, has each chain's in its
        row."""

        def total(position: Array) -> tuple[Array, tuple[Array, Array]]:
            likelihood, balanced = self._likelihood(self.values(position))
            each = likelihood + self.prior(position)
            return jnp.sum(each), (each, balanced)

        gradient, (value, balanced) = jax.grad(total, has_aux=True)(position)
        return (jnp.where(balanced, value, -jnp.inf), jnp.where(balanced[:, None], gradient, 0.0))

    def _likelihood(self, values: Array) -> tuple[Array, Array]:
        """Log likelihood of each chain, and whether all poses that count are balanced; lanes run
        over the chains' poses, chain by chain, each from the known poses to first order."""
        (chains, _), poses, size = values.shape, len(self.load_cases), len(self.selection)
        own, near = values[:, :size], self.near

        def of_its_chain(leaf: Array) -> Array:
            return jnp.repeat(leaf, poses, axis=-1) if leaf.shape[-1] == chains else leaf

        lanes = in_lanes(self.knee, self.selection.apply, own)
        q = near["q"] + jnp.einsum("ncp,vp->vnc", near["jacobian"], own - near["values"])
        points = jnp.broadcast_to(near["contact_points"], (chains, *near["contact_points"].shape))
        known = (x.reshape(chains * poses, *x.shape[2:]) for x in (q, points))
        guess = Guess(*(jnp.moveaxis(x, 0, -1) for x in known))
        every = jax.tree.map(lambda x: jnp.concatenate([x] * chains), self.load_cases)
        knees = every.load(jax.tree.map(of_its_chain, lanes))
        found = solve_equilibrium(knees, every.prescribed, guess).q[: len(TABLE_UNITS)]
        table = found.reshape(len(found), chains, -1) * TABLE_UNITS[:, None, None]
        for k, name in enumerate(self.offsets):
            table = table.at[FREE_COORDINATES.index(name)].add(values[:, size + k, None])
        # Gradients of a NaN are NaN even where it is not chosen: it is replaced beforehand.
        balanced = ~jnp.any(jnp.isnan(table), axis=(0, 2))
        table = jnp.where(jnp.isnan(table), 0.0, table)
        error = (table - self.target[:, None]) / self.noise[:, None, None]
        error = jnp.where(jnp.isnan(self.target[:, None]), 0.0, error)
        return -0.5 * jnp.sum(error**2, axis=(0, 2)), balanced


def _softplus_inverse(x: Array) -> Array:
    """`log(exp(x) - 1)` that does not overflow."""
    return x + jnp.log(-jnp.expm1(-x))
