"""What measured motion can and cannot tell of a knee's parameters."""

from __future__ import annotations

import dataclasses

import jax
import numpy as np

from kneejax.inference.calibration import CalibrationProblem, Motion, motion_at
from kneejax.inference.fit import (
    Observations,
    Problem,
    balances_of,
    best_offsets,
    on_bounds,
    state_of,
)
from kneejax.inference.identification._information import Information, fit_information
from kneejax.inference.intervals import (
    Interval,
    MaximumLikelihood,
    Pace,
    Profile,
    estimate,
    maximum_likelihood,
    named,
)
from kneejax.mechanics import Knee
from kneejax.parameters import Selection, UnsuitableData
from kneejax.statics import Slopes


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
        profiles: one per parameter; empty if none were asked for.
        intervals: what they say of each parameter; likewise.
        motion: the poses of the fit, without frame offsets.
        problem: for what builds on the fit (posterior, next test).
        lost: how many measured poses count nowhere, since the start has no balance there.
        spare: numbers measured beyond the unknowns.
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
    intervals: tuple[Interval, ...]
    motion: Motion
    problem: Problem
    lost: int
    spare: int

    @property
    def vector(self) -> np.ndarray:
        """Parameters, then frame offsets in the order of the problem."""
        return np.r_[self.values, list(self.offsets.values())]


def identify(problem: CalibrationProblem, *, with_profiles: bool = True) -> Identification:
    """Fit all parameters of a problem together, and ask what its data determine.

    Estimates and limits are those of `calibrate` by procedure III; constants between frames are
    taken out.

    Args:
        problem: what is fitted; its procedures, stages and starts do not count.
        with_profiles: whether to follow the profiles.

    Returns:
        The `Identification`; fit, limits and profiles follow a prior, the information is the data's
        own.

    Raises:
        UnsuitableData: no more data than unknowns while noise must be estimated, or no pose that
            balances.
    """
    size = len(problem.fitted.selection)
    start, lower, upper = (x[:size] for x in (problem.start, problem.lower, problem.upper))
    offsets, noise = problem.fitted.offsets, problem.noise
    fitted = dataclasses.replace(problem.fitted, offsets=())
    knee, selection = fitted.knee, fitted.selection
    prior = fitted.cases.prior
    if prior is not None:
        prior = prior[0][:size], prior[1][:size]
    balance = balances_of(knee, selection, fitted.cases)
    begin = balance(start[None])
    fitted = fitted.balanced_by(begin)
    data = dataclasses.replace(fitted.cases, offsets=offsets, prior=prior)
    spare = fitted.counted_numbers - int(data.taken[noise.counted].sum()) - size
    if noise.estimated:
        check_enough(fitted.counted_numbers, size + len(offsets))
    box, names = (lower, upper), named(selection)
    if with_profiles:
        (sure,) = estimate(balance, data, begin, noise, *box, names, Pace.FINE, far=True)
    else:
        fits, weighed = maximum_likelihood(balance, data, begin, noise, *box, far=True)
        sure = MaximumLikelihood.of_fit(fits, weighed, noise)
    fit, data = sure.best, dataclasses.replace(data, noise=sure.noise)
    residual, _ = data.residual(fit)
    values = fit.values[0]
    at_bound, alone = on_bounds(values, lower, upper), dataclasses.replace(data, prior=None)
    return Identification(
        selection=selection,
        values=values,
        lower=lower,
        upper=upper,
        at_bound=at_bound,
        offsets=dict(zip(offsets, best_offsets(data, fit), strict=True)),
        noise=sure.noise,
        noise_estimated=noise.estimated,
        chi2=float(residual[0] @ residual[0]),
        data=fitted.counted_numbers,
        converged=sure.converged,
        information=fit_information(knee, selection, alone, fit, at_bound=at_bound),
        profiles=sure.profiles,
        intervals=sure.intervals,
        motion=_motion(selection.apply(knee, values), data, fit),
        problem=dataclasses.replace(
            fitted, cases=dataclasses.replace(alone, offsets=()), offsets=offsets
        ),
        lost=int((~fitted.used).sum()),
        spare=spare,
    )


def check_enough(count: int, unknowns: int) -> None:
    """Refuse data too few to say how large their own noise is.

    Args:
        count: measured numbers.
        unknowns: free parameters and offsets.

    Raises:
        UnsuitableData: nothing would be left over.
    """
    if count <= unknowns:
        raise UnsuitableData(
            f"{count} measured numbers for {unknowns} unknowns: "
            "their noise cannot be estimated; give noise_mm and noise_deg, or free fewer parameters"
        )


def _motion(knee: Knee, data: Observations, fit: Slopes) -> Motion:
    rows = data.posed
    state = jax.tree.map(lambda x: x[rows], state_of(knee, data, fit))
    table, points = np.asarray(state.tibia.to_table()), fit.contact_points[0][rows]
    return motion_at(knee, table, state, np.moveaxis(points, 0, -1), fit.status[0][rows])
