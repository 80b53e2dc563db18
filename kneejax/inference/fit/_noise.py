"""How measured coordinates scatter, as stated or as a fit leaves it; squares weigh by it."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from kneejax.inference.fit._observed import Observations
from kneejax.parameters import UnsuitableData
from kneejax.statics import Slopes

#: Weights of paper 1, section 3.4: 8 per degree^2, 1 per mm^2, in the order of the coordinates.
DEFAULT_WEIGHTS = np.array([8.0, 8.0, 1.0, 1.0, 1.0])
#: No data are better known than this, degrees and mm: what a fit without noise leaves is rounding.
_LEAST = 1e-9


@dataclasses.dataclass(frozen=True, eq=False)
class Noise:
    """Standard deviations of the five free coordinates, degrees and mm.

    What is not stated is estimated from what the best fit leaves, of rotations and of displacements
    apart, and the fit is made again with it, so that estimates and their limits are of one sum of
    squares. Weights that a person gives fix the ratios of the deviations, and one factor of all is
    estimated.

    Attributes:
        stated: standard deviations, NaN where nobody states one, infinite for a coordinate that
            does not count, `(5,)`.
        ratio: of those that are estimated to each other, `(5,)`.
        given: whether weights were given, so that all is estimated, whatever is stated.

    Example:
        >>> Noise.of(noise_mm=0.2).first.round(3).tolist()
        [0.071, 0.071, 0.2, 0.2, 0.2]
    """

    stated: np.ndarray
    ratio: np.ndarray
    given: bool = False

    @classmethod
    def of(
        cls,
        noise_mm: float | None = None,
        noise_deg: float | None = None,
        weights: ArrayLike | None = None,
    ) -> Noise:
        """From what a person states.

        Args:
            noise_mm: standard deviation of measured displacements; None to be estimated.
            noise_deg: of measured rotations.
            weights: of squared errors, per degree^2 and per mm^2, `(5,)`: 0 for a coordinate that
                does not count, NaN for one whose noise weighs it.

        Raises:
            UnsuitableData: a deviation that is not a positive number.
        """
        for name, value in (("noise_mm", noise_mm), ("noise_deg", noise_deg)):
            if value is not None and not (np.isfinite(value) and value > 0):
                raise UnsuitableData(f"{name}: {value:g}: expected a standard deviation above 0")
        stated = np.array([noise_deg, noise_deg, noise_mm, noise_mm, noise_mm], float)
        weights = np.full(5, np.nan) if weights is None else np.asarray(weights, float)
        counts = ~(weights == 0)
        stated = np.where(counts, stated, np.inf)
        given = weights[counts]
        if np.isnan(given).any():
            return cls(stated, DEFAULT_WEIGHTS**-0.5)
        units = given * stated[counts] ** 2
        ratio = np.where(counts, weights, 1.0) ** -0.5
        if np.allclose(units, units[0], rtol=1e-6):
            return cls(stated, ratio)
        return cls(stated, ratio, given=True)

    @property
    def counted(self) -> np.ndarray:
        """Coordinates that count, `(5,)`."""
        return ~np.isinf(self.stated)

    @property
    def unknown(self) -> np.ndarray:
        """Coordinates whose noise is estimated, `(5,)`."""
        return self.counted if self.given else np.isnan(self.stated)

    @property
    def estimated(self) -> bool:
        """Whether any of it is."""
        return bool(self.unknown.any())

    @property
    def weighs(self) -> bool:
        """Whether it decides, as estimated, what a square weighs."""
        return self.estimated and not self.given

    @property
    def unit(self) -> float:
        """What the first sum of squares rises by where chi squared does by one; infinite where the
        noise is not known."""
        return np.inf if self.estimated else 1.0

    @property
    def first(self) -> np.ndarray:
        """Standard deviations with which a search begins, `(5,)`: where some are stated, the others
        in their ratio to these."""
        known = self.counted & ~self.unknown
        scale = (self.stated / self.ratio)[known].mean() if known.any() else 1.0
        return np.where(self.unknown, scale * self.ratio, self.stated)

    def as_stated(self) -> Noise:
        """The same by what is stated alone: of weights counts only which are zero."""
        return Noise(self.stated, DEFAULT_WEIGHTS**-0.5)

    def left(
        self, data: Observations, fits: Slopes, lower: np.ndarray, upper: np.ndarray
    ) -> np.ndarray:
        """The noise as the best fits within bounds leave it, `(fits, 5)`; what is stated stays. The
        noise of the data weighs what the parameters have absorbed."""
        noise = np.array(np.broadcast_to(data.noise, (len(fits.values), 5)), float)
        noise = np.where(self.unknown, noise, self.stated)
        if not self.estimated:
            return noise
        poses = int(data.used.sum())
        seen = data.seen[data.used].T
        # Each constant that was taken out takes the freedom of one number from its coordinate.
        share = 1.0 - data.taken / np.maximum(seen.sum(axis=1), 1)
        residual, slope = dataclasses.replace(data, noise=noise).residual(fits)
        for row, free in enumerate(~on_bounds(fits.values, lower, upper)):
            columns = slope[row, : 5 * poses, free].T.reshape(poses, 5, -1)
            errors = residual[row, : 5 * poses].reshape(poses, 5)
            # A pose that was lost says nothing.
            known = np.isfinite(columns).all(axis=(1, 2)) & np.isfinite(errors).all(axis=1)
            columns = columns[known].reshape(5 * known.sum(), -1)
            size = np.linalg.norm(columns, axis=0)
            left, *_ = np.linalg.svd(columns / np.where(size > 0, size, 1.0), full_matrices=False)
            absorbed = (left**2).sum(axis=1).reshape(-1, 5).T
            squares = errors[known].T ** 2
            # Coordinates that share an estimated factor.
            for group in ((0, 1, 2, 3, 4),) if self.given else ((0, 1), (2, 3, 4)):
                own = [k for k in group if self.unknown[k]]
                spare = float((seen[own][:, known] - absorbed[own]).sum(axis=1) @ share[own])
                if spare > 1e-9:
                    sums = squares[own].sum(axis=1) * (noise[row, own] / self.ratio[own]) ** 2
                    factor = np.sqrt(sums.sum() / spare)
                    noise[row, own] = np.maximum(factor * self.ratio[own], _LEAST)
        return noise


def on_bounds(values: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Which values lie on a bound."""
    width = upper - lower
    return (values - lower < 1e-9 * width) | (upper - values < 1e-9 * width)
