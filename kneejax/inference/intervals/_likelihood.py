"""Fits by maximum likelihood: with the noise that is stated, or with the one that fits leave."""

from __future__ import annotations

import dataclasses

import numpy as np

from kneejax.inference.fit import PATIENT, Balance, ManyFits, Observations, fit_lanes
from kneejax.inference.intervals._uncertainty import uncertainty
from kneejax.parameters import UnsuitableData
from kneejax.statics import Slopes

#: Confidence that is asked for.
CONFIDENCE = 0.95
#: Noise and fit depend on each other: so often each is found anew.
_ROUNDS = 3
#: No data are better known than this, degrees and mm: what a fit without noise leaves is rounding.
_LEAST_NOISE = 1e-9


def stated_noise(noise_mm: float | None, noise_deg: float | None) -> np.ndarray:
    """Standard deviations of the five free coordinates, NaN where none is stated, `(5,)`.

    Raises:
        UnsuitableData: one is not a positive number.
    """
    for name, value in (("noise_mm", noise_mm), ("noise_deg", noise_deg)):
        if value is not None and not (np.isfinite(value) and value > 0):
            raise UnsuitableData(f"{name}: {value:g}: expected a standard deviation above 0")
    return np.array([noise_deg, noise_deg, noise_mm, noise_mm, noise_mm], float)


def check_all_stated(stated: np.ndarray, beside: str) -> None:
    """Refuse noise that is estimated beside what counts in a standard deviation of its own.

    Args:
        stated: as `stated_noise` gives it.
        beside: what counts beside the poses, for the error.

    Raises:
        UnsuitableData: some noise is not stated.
    """
    if np.isnan(stated).any():
        raise UnsuitableData(
            f"{beside}: expected noise_mm and noise_deg too, against which it counts"
        )


def rise_at_limits(spare: int | None) -> float:
    """Rise of chi squared at the limits of a 95 % interval.

    Args:
        spare: numbers measured beyond the unknowns, where the noise is estimated from what the fit
            leaves (F distribution); None where it is known (chi squared).
    """
    # `scipy.stats` takes half a second to import.
    from scipy import special

    if spare is None:
        return float(special.chdtri(1, 1.0 - CONFIDENCE))
    return float(special.fdtri(1, spare, CONFIDENCE))


def likeliest(
    balance: Balance,
    data: Observations,
    near: Slopes,
    stated: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    *,
    far: bool = False,
) -> tuple[ManyFits, Observations]:
    """Fit by maximum likelihood, many times at once.

    Args:
        balance: of the values that are fitted.
        data: measured motion; its noise weighs the first fit where none is stated.
        near: where the fits begin.
        stated: standard deviations of the coordinates, NaN where they are to be estimated, `(5,)`.
        lower: bounds, `(p,)`.
        upper: bounds.
        far: whether the answers may be far.

    Returns:
        The fits, and the data with the noise that is stated or that the fits leave, `(fits, 5)`.
    """
    count = len(near.values)
    box = [np.tile(bound, (count, 1)) for bound in (lower, upper)]
    noise = np.broadcast_to(data.noise, (count, 5))
    noise = np.where(np.isnan(stated) | np.isinf(noise), noise, stated)
    data = dataclasses.replace(data, noise=noise)
    for _ in range(_ROUNDS if np.isnan(stated).any() else 1):
        fits = fit_lanes(balance, data, near, near.values, *box, most=PATIENT, far=far)
        near, far = fits.slopes, False
        data = dataclasses.replace(data, noise=noise_left(data, near, stated, lower, upper))
    return fits, data


def noise_left(
    data: Observations, fits: Slopes, stated: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> np.ndarray:
    """What fits leave, of rotations and of displacements, where no noise is stated: `(fits, 5)`."""
    weighed = np.broadcast_to(data.noise, (len(fits.values), 5))
    if not np.isnan(stated).any():
        return np.where(np.isinf(weighed), weighed, stated)
    held = on_bounds(fits.values, lower, upper)
    seen = data.seen[data.counted].T
    # Each constant that was taken out takes the freedom of one number from its coordinate.
    numbers, taken = seen.sum(axis=1), data.taken
    left = []
    for row in range(len(fits.values)):
        error, jacobian = errors(data.take([row]), fits.take([row]))
        noise = uncertainty(jacobian, error, weighed[row] ** -2.0, held[row], stated, seen).noise
        for group in ([0, 1], [2, 3, 4]):
            share = 1.0 - taken[group].sum() / max(numbers[group].sum(), 1)
            estimated = [k for k in group if np.isnan(stated[k])]
            noise[estimated] /= np.sqrt(max(share, 1e-9))
        left.append(np.maximum(np.where(np.isnan(noise), weighed[row], noise), _LEAST_NOISE))
    return np.array(left)


def errors(data: Observations, fit: Slopes) -> tuple[np.ndarray, np.ndarray]:
    """Model minus measurement `(5, poses)` of one fit, degrees and mm, and its Jacobian, where
    noise is its coordinate's; less where an observation has more (`Observations.spread`)."""
    plain = dataclasses.replace(data, noise=np.ones(5), prior=None, readings=None)
    residual, slope = plain.residual(fit)
    poses = int(data.counted.sum())
    return residual[0].reshape(poses, 5).T, np.moveaxis(slope[0].reshape(poses, 5, -1), 0, 1)


def on_bounds(values: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Which values lie on a bound."""
    width = upper - lower
    return (values - lower < 1e-9 * width) | (upper - values < 1e-9 * width)
