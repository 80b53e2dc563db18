"""What measured motion can and cannot tell of a knee's parameters."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from kneejax.geometry import FREE_COORDINATES
from kneejax.inference._information import Information, fit_information
from kneejax.inference._many_fits import ManyFits, MotionData, best_offsets, fit_many
from kneejax.inference._parameters import (
    Selection,
    UnsuitableData,
    select,
    start_within,
    stated_bounds,
)
from kneejax.inference._problem import DEFAULT_WEIGHTS, Problem
from kneejax.inference._profiles import CONFIDENCE, Profile, profiles
from kneejax.inference._uncertainty import uncertainty
from kneejax.mechanics import Knee
from kneejax.statics import Slopes, Stations, balance_with_slopes

#: Chi squared per degree of freedom beyond which the noise that was given is doubted.
_MISFIT = 2.0
#: How often a lower valley that a profile finds is followed.
_RESTARTS = 4


@dataclasses.dataclass(frozen=True)
class Identification:
    """A fit by maximum likelihood, and what the data say about it.

    Attributes:
        selection: the free parameters.
        values: the estimates, `(p,)`.
        lower: bounds, `(p,)`.
        upper: bounds.
        at_bound: estimates on a bound, `(p,)`.
        offsets: free coordinate -> constant difference of the frames at the fit, degrees or mm.
        noise: standard deviation of each coordinate, degrees and mm, `(5,)`.
        noise_estimated: whether that was estimated from the misfit of the fit itself.
        chi2: sum of squared errors over their variances.
        data: how many numbers were measured.
        converged: whether the fit converged.
        information: Fisher information at the fit.
        profiles: one a parameter; empty if none were asked for.
        problem: for what builds on the fit (posterior, next test).
        warnings: what a reader must know.
    """

    selection: Selection
    values: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    at_bound: np.ndarray
    offsets: dict[str, float]
    noise: np.ndarray
    noise_estimated: bool
    chi2: float
    data: int
    converged: bool
    information: Information
    profiles: tuple[Profile, ...]
    problem: Problem
    warnings: tuple[str, ...]

    @property
    def vector(self) -> np.ndarray:
        """Parameters, then frame offsets in the order of the problem."""
        return np.r_[self.values, list(self.offsets.values())]


def identify(
    knee: Knee,
    measured: np.ndarray,
    parameters: tuple[str, ...] = ("*.stiffness", "*.reference_strain"),
    *,
    noise_mm: float | None = None,
    noise_deg: float | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    weights: np.ndarray | None = None,
    offsets: tuple[str, ...] = (),
    with_profiles: bool = True,
) -> Identification:
    """Fit a motion by maximum likelihood and ask what its data determine.

    Errors are taken as independent and normal. Where their size is not given it is estimated from
    what the fit leaves, for displacements and rotations apart.

    Args:
        knee: gives everything that is not free, and the start of what is.
        measured: `(n, 6)` in the order of `kneejax.geometry.COLUMNS`, degrees and mm.
        parameters: names, with `*` for every ligament.
        noise_mm: standard deviation of measured displacements; estimated by default.
        noise_deg: of measured rotations; likewise.
        bounds: by name, wildcard or quantity; those of paper 1 by default.
        weights: `(5,)`, of the first fit, from which noise is estimated; paper 1's by default.
        offsets: free coordinates whose constant difference to the measurement is free.
        with_profiles: whether to follow the profiles.

    Returns:
        The `Identification`.

    Raises:
        UnknownParameter: a name that the knee does not have.
        UnsuitableData: bounds that exclude the start, data that are not finite, no more data than
            parameters while the noise must be estimated, or no pose that balances.
    """
    measured = np.asarray(measured, float)
    selection = select(knee, parameters)
    rows = tuple(FREE_COORDINATES.index(name) for name in offsets)
    if not np.isfinite(measured).all():
        row = int(np.flatnonzero(~np.isfinite(measured).all(axis=1))[0])
        raise UnsuitableData(f"measured row {row} is not finite: leave it out")
    for name, value in (("noise_mm", noise_mm), ("noise_deg", noise_deg)):
        if value is not None and not (np.isfinite(value) and value > 0):
            raise UnsuitableData(f"{name}: {value:g}: expected a standard deviation above 0")
    lower, upper = stated_bounds(knee, selection, bounds or {})
    start = start_within(knee, selection, lower, upper)
    stations = Stations.at(measured[:, 0])
    begin = balance_with_slopes(knee, selection.apply, start[None], stations)
    used = begin.converged[0]
    if not used.any():
        raise UnsuitableData("no measured flexion has a balance with the start's parameters")
    given = np.array([noise_deg, noise_deg, noise_mm, noise_mm, noise_mm], float)
    estimated = bool(np.isnan(given).any())
    spare = 5 * int(used.sum()) - len(selection) - len(offsets)
    if estimated and spare <= 0:
        raise UnsuitableData(
            f"{5 * int(used.sum())} measured numbers for {len(selection) + len(offsets)} unknowns: "
            "their noise cannot be estimated; give noise_mm and noise_deg, or free fewer parameters"
        )
    weights = DEFAULT_WEIGHTS if weights is None else np.asarray(weights, float)
    with np.errstate(divide="ignore"):
        noise = np.where(np.isnan(given), 1.0 / np.sqrt(weights), given)
    fit: ManyFits | None = None
    for _ in range(3 if estimated else 1):
        data = MotionData(stations, measured[:, 1:], noise, offsets, used)
        near = begin if fit is None else fit.slopes
        box = lower[None], upper[None]
        fit = fit_many(knee, selection, data, near, near.values, *box, far=fit is None)
        if estimated:
            noise = np.where(np.isnan(given), _noise_left(data, fit.slopes, lower, upper), given)
    assert fit is not None
    # The last estimate of the noise belongs to the fit; its own weights were the one before.
    data = dataclasses.replace(data, noise=noise)
    threshold, followed = _threshold(spare if estimated else None), ()
    for _ in range(_RESTARTS if with_profiles else 0):
        followed = profiles(knee, selection, data, fit.slopes, lower, upper, threshold)
        best = max(followed, key=lambda profile: profile.better)
        if not best.better:
            break
        # A profile has found a lower valley: the fit moves there.
        near = balance_with_slopes(knee, selection.apply, best.lowest[None], stations)
        fit = fit_many(knee, selection, data, near, near.values, *box, far=True)
    residual, _ = data.residual(fit.slopes)
    values, width = fit.values[0], upper - lower
    at_bound = (values - lower < 1e-9 * width) | (upper - values < 1e-9 * width)
    problem = Problem(knee, selection, measured, 1.0 / noise**2, rows)
    problem.use_only(used)
    answer = Identification(
        selection,
        values,
        lower,
        upper,
        at_bound,
        dict(zip(offsets, best_offsets(data, fit.slopes), strict=True)),
        noise,
        estimated,
        float(residual[0] @ residual[0]),
        data.count,
        bool(fit.converged[0]),
        fit_information(knee, selection, data, fit.slopes, at_bound=at_bound),
        followed,
        problem,
        (),
    )
    return dataclasses.replace(answer, warnings=_warnings(answer, used, spare))


def _threshold(spare: int | None) -> float:
    """Rise of chi squared at the limits; with estimated noise by the F distribution."""
    from scipy import stats

    if spare is None:
        return float(stats.chi2.ppf(CONFIDENCE, 1))
    return float(stats.f.ppf(CONFIDENCE, 1, spare))


def _noise_left(data: MotionData, fit: Slopes, lower, upper) -> np.ndarray:
    """Scatter that the fit leaves, of rotations and of displacements."""
    residual, slope = data.residual(fit)
    poses = int(data.counted.sum())
    width = upper - lower
    held = (fit.values[0] - lower < 1e-9 * width) | (upper - fit.values[0] < 1e-9 * width)
    error = (residual[0].reshape(poses, 5) * data.noise).T
    jacobian = np.moveaxis((slope[0].reshape(poses, 5, -1) * data.noise[:, None]), 0, 1)
    found = uncertainty(jacobian, error, 1.0 / data.noise**2, held).noise
    # Each offset takes the freedom of one pose from its coordinate.
    freed = np.array([name in data.offsets for name in FREE_COORDINATES])
    for group in ([0, 1], [2, 3, 4]):
        share = 1.0 - freed[group].sum() / (len(group) * poses)
        found[group] /= np.sqrt(max(share, 1e-9))
    return np.maximum(found, 1e-9)


def _warnings(answer: Identification, used: np.ndarray, spare: int) -> tuple[str, ...]:
    notes = []
    if not answer.converged:
        notes.append("The fit did not converge: free fewer parameters or start nearer.")
    lost = int((~used).sum())
    if lost:
        notes.append(f"{lost} measured poses count nowhere: the start has no balance there.")
    per_freedom = answer.chi2 / max(spare, 1)
    if not answer.noise_estimated and spare > 0 and per_freedom > _MISFIT:
        notes.append(
            f"The fit misses the data by {np.sqrt(per_freedom):.2g} times the noise that was "
            "given: the model lacks something, or the noise is larger; all limits are too narrow."
        )
    if spare <= 0:
        notes.append(
            f"{answer.data} measured numbers for {len(answer.values)} parameters: fewer data than "
            "unknowns; what follows is what priors leave."
        )
    for profile in answer.profiles:
        if profile.better:
            notes.append(
                f"Along the profile of {profile.name} chi squared falls {profile.better:.3g} below "
                "the fit: there is a better fit; start the calibration from there."
            )
    names = [n for n, on in zip(answer.selection.names, answer.at_bound, strict=True) if on]
    if names:
        notes.append(
            f"On a bound: {', '.join(names)}. Standard errors of the others hold them there."
        )
    return tuple(notes)
