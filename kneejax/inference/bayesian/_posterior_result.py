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
