"""The posterior of parameters, and what its draws say."""

__all__ = ["Posterior", "check_counts", "posterior"]

import dataclasses
import time
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from kneejax.geometry import BY_COORDINATE, FREE_COORDINATES
from kneejax.inference.bayesian._nuts import ChainState, sample
from kneejax.inference.bayesian._priors import (
    MotionDensity,
    Prior,
    laplace_covariance,
    most_probable,
    normal_priors,
)
from kneejax.inference.calibration import versions
from kneejax.inference.fit import Problem, named, table_of
from kneejax.inference.identification import noise_of
from kneejax.numerics import Named, adding_up, imported
from kneejax.parameters import UnsuitableData
from kneejax.statics import Slopes

#: Probabilities of the quantiles over the motion.
LEVELS = (0.025, 0.25, 0.5, 0.75, 0.975)


@dataclasses.dataclass(frozen=True)
class Posterior(Named):
    """Draws of the parameters that a motion and the priors leave possible.

    Attributes:
        names: of the parameters; `offset.COORDINATE` for those of frames.
        units: of the parameters.
        draws: `(chains, draws, p)`.
        log_density: of each draw but for a constant, `(chains, draws)`.
        r_hat: rank-normalised, split; `(p,)`.
        effective_sample_size: of the middle (bulk), `(p,)`.
        tail_effective_sample_size: of the 5 and 95 % quantiles, `(p,)`.
        divergent: trajectories that ended because their energy was lost, `(chains, draws)`.
        unbalanced: those of them that ran into parameters with which a pose has no balance.
        measured: the motion, `(n, 6)`, degrees and mm; rows that count.
        noise: its standard deviations, `(5,)`, degrees and mm.
        motions: of four hundred draws, evenly spread over the chains, without noise and with the
            frame offset: `(chains, k, n, 5)`.
        levels: probabilities of the quantiles.
        motion_quantiles: of the motion that the model makes, `(5, n, levels)`.
        predictive_quantiles: of a new measurement of it, noise included, `(5, n, levels)`.
        priors: one for each parameter.
        laplace_mean: the most probable parameters, `(p,)`.
        laplace_covariance: of the normal density there, from the exact Jacobian and the priors,
            `(p, p)`; NaN where they do not determine the parameters.
        truth: parameter -> value that made synthetic data; empty for measured data.
        acceptance: mean acceptance of a trajectory's points.
        evaluations: gradients of the density: `warmup`, `sampling`, and `equilibria` of both.
        seconds: `compile`, `warmup`, `sampling`, `motions`, `other`, and `total`, their sum.
        versions: package -> version.
        settings: `chains`, `draws`, `warmup`, `seed`, `noise_mm`, `noise_deg`: with the priors all
            that is needed to draw it again.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    draws: np.ndarray
    log_density: np.ndarray
    r_hat: np.ndarray
    effective_sample_size: np.ndarray
    tail_effective_sample_size: np.ndarray
    divergent: np.ndarray
    unbalanced: int
    measured: np.ndarray
    noise: np.ndarray
    motions: np.ndarray
    levels: tuple[float, ...]
    motion_quantiles: np.ndarray
    predictive_quantiles: np.ndarray
    priors: tuple[Prior, ...]
    laplace_mean: np.ndarray
    laplace_covariance: np.ndarray
    truth: dict[str, float]
    acceptance: float
    evaluations: dict[str, int]
    seconds: dict[str, float]
    versions: dict[str, str]
    settings: dict[str, float]

    OVER = {
        "chain draw parameter": {"draws": ""}, "chain draw": {"log_density": "1", "divergent": ""},
        "parameter": dict.fromkeys(
            ("r_hat", "effective_sample_size", "tail_effective_sample_size"), "1"),
        "coordinate pose level": {"motion_quantiles": "", "predictive_quantiles": ""},
    }  # fmt: skip

    def _named(self) -> dict[str, tuple]:
        own = {"parameter": self.names, "parameter_unit": self.units}
        flexion = {"flexion_deg": ("pose", self.measured[:, 0]), "level": ("level", self.levels)}
        labels = {name: ("parameter", values) for name, values in own.items()}
        return super()._named() | labels | flexion | BY_COORDINATE

    @property
    def seed(self) -> int:
        """Of the random numbers."""
        return int(self.settings["seed"])

    @property
    def divergences(self) -> int:
        """How many trajectories diverged."""
        return int(self.divergent.sum())

    @property
    def mean(self) -> np.ndarray:
        """Posterior means, `(p,)`."""
        return self.draws.mean(axis=(0, 1))

    @property
    def sd(self) -> np.ndarray:
        """Posterior standard deviations, `(p,)`."""
        return self.draws.std(axis=(0, 1), ddof=1)

    @property
    def correlation(self) -> np.ndarray:
        """Posterior correlations, `(p, p)`."""
        return np.corrcoef(self.draws.reshape(-1, len(self.names)).T).reshape(2 * [len(self.names)])

    def quantiles(self, levels: tuple[float, ...] = LEVELS) -> np.ndarray:
        """Quantiles of the parameters, `(p, levels)`."""
        return np.quantile(self.draws, levels, axis=(0, 1)).T

    def to_arviz(self) -> Any:
        """The same as an ArviZ `InferenceData`.

        Groups: `posterior` (one variable per parameter, under its name), `sample_stats` (`lp`,
        `diverging`), `posterior_predictive` (`motion`: without noise, over `flexion_deg` and
        `coordinate`, of fewer draws), `observed_data`, `constant_data` (`noise`).

        Raises:
            UnsuitableData: ArviZ is not installed.
        """
        arviz = imported("arviz", "arviz")
        coords = {"pose": np.arange(len(self.measured)), "coordinate": list(FREE_COORDINATES)}
        dims = {"motion": ["pose", "coordinate"]}
        found = arviz.from_dict(
            posterior=dict(zip(self.names, np.moveaxis(self.draws, -1, 0), strict=True)),
            sample_stats={"lp": self.log_density, "diverging": self.divergent},
            observed_data={"motion": self.measured[:, 1:]},
            constant_data={"noise": self.noise, "flexion_deg": self.measured[:, 0]},
            coords=coords,
            dims=dims | {"noise": ["coordinate"], "flexion_deg": ["pose"]},
        )
        # Fewer draws than the posterior has: a group of its own number.
        motions = {"motion": self.motions}
        found.extend(arviz.from_dict(posterior_predictive=motions, coords=coords, dims=dims))
        for name, unit in zip(self.names, self.units, strict=True):
            found.posterior[name].attrs["units"] = unit
        return found


# Draws of all chains whose motion is computed, and noise drawn for each motion.
_MOTIONS, _NOISES = 400, 25


def posterior(
    problem: Problem,
    fit: np.ndarray,
    noise_mm: float,
    noise_deg: float,
    *,
    priors: Mapping[str, tuple[float, float]] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    chains: int = 4,
    draws: int = 1000,
    warmup: int = 300,
    seed: int = 0,
    truth: Mapping[str, float] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Posterior:
    """Sample the posterior of ligament parameters by NUTS, several chains at once.

    The likelihood is that of independent normal noise on the five free coordinates at each measured
    flexion; priors are normal within bounds. Parameters with which a pose has no balance have
    density zero. Chains begin around the most probable parameters, twice as far apart as the normal
    density there, and move in coordinates in which that has unit covariance. Drawing is some five
    times faster after `kneejax.use_shared_fusion()`, which the command line calls.

    Args:
        problem: what is fitted; its knee is where the calibration began. Its weights are not used.
        fit: parameters and offsets to search from, `(p,)`, e.g. a calibration's answer.
        noise_mm: standard deviation of measured positions.
        noise_deg: standard deviation of measured rotations.
        priors: name, `*.quantity` or quantity -> mean and standard deviation, which may be
            infinite; see `normal_priors` for the others.
        bounds: name, `*.quantity` or quantity -> lower and upper bound; as in `calibrate`.
        chains: at least 2, since convergence is judged by their agreement.
        draws: of each chain, after the warm-up.
        warmup: draws of each chain before.
        seed: of starts, momenta and noise.
        truth: values that made the data, for synthetic studies.
        progress: called now and then with draws done and asked for.

    Returns:
        The `Posterior`.

    Raises:
        UnsuitableData: noise, priors, bounds or counts that make no sense, a fit without balanced
            poses, or a package that is not installed.
        UnknownParameter: a prior or bounds of something that is not free.

    Source: Vehtari et al. 2021, Bayesian Analysis 16, 667, for R-hat and effective sample size.
    """
    begun = time.perf_counter()
    noise = noise_of(noise_mm, noise_deg)
    check_counts(chains, draws, warmup)
    imported("blackjax", "blackjax")
    arviz = imported("arviz", "arviz")
    # A calibration's problem must not forget its own weights and poses.
    problem = problem.weighing(noise)
    beliefs = normal_priors(problem, priors, bounds)
    found = most_probable(problem, beliefs, np.asarray(fit, float))
    _, jacobian = problem.residual(found)
    precision = jacobian.T @ jacobian + np.diag([p.sd**-2.0 for p in beliefs])
    covariance = laplace_covariance(precision)
    deviation = np.sqrt(np.diag(covariance))
    density = MotionDensity.of(problem, noise, beliefs, found, deviation)
    origin, spread = _without_bounds(density, beliefs, found.values[0], deviation, precision)
    start = _starts(problem, density, found, origin, spread, chains, seed)
    begun_drawing = time.perf_counter()
    drawn = sample(
        density, start, origin, spread, draws=draws, warmup=warmup, seed=seed, progress=progress
    )
    values = np.asarray(density.values(jnp.asarray(drawn.position)))
    ended = time.perf_counter()
    motions = _motions(problem, found, values)
    seconds = drawn.seconds | {"motions": time.perf_counter() - ended}
    seconds["compile"] += begun_drawing - begun
    seconds["other"] = time.perf_counter() - begun - sum(seconds.values())
    settings = {"chains": chains, "draws": draws, "warmup": warmup, "seed": seed}
    settings |= {"noise_mm": noise_mm, "noise_deg": noise_deg}
    dataset = arviz.convert_to_dataset({"values": values})
    r_hat, bulk, tail = (
        np.asarray(x["values"])
        for x in (arviz.rhat(dataset), arviz.ess(dataset), arviz.ess(dataset, method="tail"))
    )
    flat = motions.reshape(-1, *motions.shape[2:])
    random = np.random.default_rng([seed, 1])
    noisy = flat + noise * random.standard_normal((_NOISES, *flat.shape))
    every = flat, noisy.reshape(-1, *flat.shape[1:])
    without_noise, with_noise = (np.quantile(each, LEVELS, axis=0).T for each in every)
    evaluations = {"warmup": drawn.warmup_evaluations, "sampling": int(drawn.evaluations.sum())}
    evaluations["equilibria"] = sum(evaluations.values()) * int(problem.used.sum())
    packages = {x: imported(x, x).__version__ for x in ("blackjax", "arviz")}
    return Posterior(
        names=tuple(prior.name for prior in beliefs),
        units=tuple(unit for _, unit in named(problem.selection, problem.offsets)), draws=values,
        log_density=drawn.value, r_hat=r_hat, effective_sample_size=bulk,
        tail_effective_sample_size=tail, divergent=drawn.divergent,
        unbalanced=int(drawn.lost.sum()), measured=problem.measured[problem.used], noise=noise,
        motions=motions, levels=LEVELS, motion_quantiles=without_noise,
        predictive_quantiles=with_noise, priors=beliefs, laplace_mean=found.values[0],
        laplace_covariance=covariance, acceptance=float(drawn.acceptance.mean()),
        truth={p.name: truth[p.name] for p in beliefs if truth and p.name in truth},
        evaluations=evaluations, seconds=adding_up(seconds), versions=versions() | packages,
        settings=settings,
    )  # fmt: skip


def check_counts(chains: int, draws: int, warmup: int = 300) -> None:
    """Refuse, before anything is computed, too few chains or draws (`UnsuitableData`)."""
    for name, value, least in (("chains", chains, 2), ("draws", draws, 20), ("warmup", warmup, 1)):
        if value < least:
            raise UnsuitableData(f"{name}: {value}: expected {least} or more")


def _without_bounds(density: MotionDensity, priors, likely, deviation, precision):
    """A middle and a covariance in the coordinates that have no bounds."""
    lower, upper = np.array([(p.lower, p.upper) for p in priors]).T
    # At a bound those coordinates are of no use: inside by a standard deviation.
    room = np.fmin(deviation, 0.25 * (upper - lower))
    values = jnp.asarray(np.clip(likely, lower + room, upper - room))
    middle, each = density.position(values), jnp.ones(len(values))
    rate = np.asarray(jax.jvp(density.values, (middle,), (each,))[1])
    bend = np.asarray(jax.jvp(jax.grad(density.widening), (middle,), (each,))[1])
    return np.asarray(middle), np.linalg.inv(precision * np.outer(rate, rate) - np.diag(bend))


def _starts(
    problem: Problem, density: MotionDensity, near: Slopes, origin, spread, chains, seed
) -> ChainState:
    """Begin twice as far out as the normal density reaches, or nearer where nothing balances."""
    random = np.random.default_rng(seed)
    away = 2.0 * random.standard_normal((chains, len(origin))) @ np.linalg.cholesky(spread).T
    rows = []
    for shift in away:
        for part in (1.0, 0.5, 0.25, 0.1, 0.0):
            place = jnp.asarray(origin + part * shift)
            values, rate = jax.jvp(density.values, (place,), (jnp.ones_like(place),))
            # The problem's own poses are compiled already.
            residual, jacobian = problem.residual(problem.balance(np.asarray(values)[None], near))
            prior, slope = jax.value_and_grad(density.prior)(place)
            value = float(prior) - 0.5 * float(residual @ residual)
            if np.isfinite(value):
                gradient = np.asarray(slope) - (residual @ jacobian) * np.asarray(rate)
                rows.append((origin + part * shift, value, gradient))
                break
        else:
            raise UnsuitableData("no balance near the most probable parameters: check the bounds")
    return ChainState(*(jnp.array(column) for column in zip(*rows, strict=True)))


def _motions(problem: Problem, near: Slopes, values: np.ndarray) -> np.ndarray:
    """Motion of evenly spread draws, frame offset included, `(chains, k, n, 5)`."""
    rows = np.unique(np.linspace(0, values.shape[1] - 1, _MOTIONS // len(values)).astype(int))
    chosen = values[:, rows].reshape(-1, values.shape[-1])
    found = problem.balance(chosen, near.take(np.zeros(len(chosen), int)))
    tables = table_of(found)[0][:, problem.used]
    return tables.reshape(len(values), len(rows), -1, 5)
