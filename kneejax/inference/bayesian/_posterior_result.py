"""What a posterior is: draws, how far they can be trusted, and what they say of the motion."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from kneejax.geometry import FREE_COORDINATES
from kneejax.inference.bayesian._priors import Prior
from kneejax.numerics import imported

#: Probabilities of the quantiles over the motion.
LEVELS = (0.025, 0.25, 0.5, 0.75, 0.975)
#: Above this R-hat, below this effective size, chains are not to be trusted (Vehtari et al. 2021).
_R_HAT, _EFFECTIVE_PER_CHAIN = 1.01, 100.0
# Of all trajectories; fewer than that only count (`Posterior.divergences`).
_FEW = 1e-3
# A posterior as wide as this part of its prior says little beyond it.
_LITTLE = 0.9


@dataclasses.dataclass(frozen=True)
class Posterior:
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
        seconds: `compile`, `warmup`, `sampling`, `motions`, `total`.
        warnings: what a reader must know before the numbers are used.
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
    warnings: tuple[str, ...]
    versions: dict[str, str]
    settings: dict[str, float]

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
        found = arviz.from_dict(
            posterior=dict(zip(self.names, np.moveaxis(self.draws, -1, 0), strict=True)),
            sample_stats={"lp": self.log_density, "diverging": self.divergent},
            observed_data={"motion": self.measured[:, 1:]},
            constant_data={"noise": self.noise, "flexion_deg": self.measured[:, 0]},
            coords=coords,
            dims={
                "motion": ["pose", "coordinate"],
                "noise": ["coordinate"],
                "flexion_deg": ["pose"],
            },
        )
        # Fewer draws than the posterior has: a group of its own number.
        with_motion = arviz.from_dict(
            posterior_predictive={"motion": self.motions},
            coords=coords,
            dims={"motion": ["pose", "coordinate"]},
        )
        found.extend(with_motion)
        for name, unit in zip(self.names, self.units, strict=True):
            found.posterior[name].attrs["units"] = unit
        return found


def doubts(result: Posterior) -> tuple[str, ...]:
    """Sentences on what a reader must know before the numbers are used."""
    said, count = [], result.divergent.size
    if result.unbalanced:
        said.append(
            f"{result.unbalanced} of {count} trajectories ran into parameters with which a pose "
            "has no balance; the posterior ends there. Narrower priors or bounds keep away from it."
        )
    diverged = result.divergences - result.unbalanced
    if diverged > _FEW * count:
        said.append(
            f"{diverged} of {count} trajectories diverged: the posterior bends more sharply than "
            "the step size follows. Draw longer warm-ups, or give narrower priors."
        )
    apart = [n for n, r in zip(result.names, result.r_hat, strict=True) if not r <= _R_HAT]
    if apart:
        said.append(
            f"The chains disagree about {', '.join(apart)} (R-hat above {_R_HAT}): draw more, or "
            "look for several modes in the pair plot."
        )
    least = np.fmin(result.effective_sample_size, result.tail_effective_sample_size)
    enough = _EFFECTIVE_PER_CHAIN * len(result.draws)
    few = [n for n, e in zip(result.names, least, strict=True) if not e >= enough]
    if few:
        said.append(
            f"Fewer than {enough:.0f} effective draws of {', '.join(few)}: quantiles are rough; "
            "draw more."
        )
    prior_spread = np.array([prior.spread for prior in result.priors])
    idle = [n for n, s in zip(result.names, result.sd > _LITTLE * prior_spread, strict=True) if s]
    if idle:
        said.append(
            f"These data say little about {', '.join(idle)}: what is shown is the prior, or what "
            "the bounds leave of it."
        )
    if result.measured[:, 1:].size < len(result.names):
        said.append(
            f"{result.measured[:, 1:].size} measured numbers for {len(result.names)} parameters: "
            "the priors decide between them."
        )
    return tuple(said)
