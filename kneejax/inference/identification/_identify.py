"""What measured motion can and cannot tell of a knee's parameters."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import jax
import numpy as np

from kneejax.experiments import MeasuredTest
from kneejax.inference.calibration import Motion, motion_at
from kneejax.inference.fit import (
    DEFAULT_WEIGHTS,
    Observations,
    Problem,
    balances_of,
    best_offsets,
    check_finite,
    state_of,
)
from kneejax.inference.identification._information import Information, fit_information
from kneejax.inference.intervals import (
    Interval,
    Profile,
    check_all_stated,
    follow_to_the_lowest,
    likeliest,
    named,
    on_bounds,
    rise_at_limits,
    stated_noise,
)
from kneejax.mechanics import Knee, Load
from kneejax.parameters import Selection, UnsuitableData, select, start_within, stated_bounds
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
    loads: Sequence[Load] = (),
    tests: Sequence[MeasuredTest] = (),
    prior: Mapping[str, float] | None = None,
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
        loads: on the tibia while the poses were measured, each one for all poses or one per pose.
        tests: under load that were made beside them.
        prior: name, `*.quantity` or quantity -> standard deviation of a normal prior around the
            start's value; fit, limits and profiles follow it, the information is the data's own.

    Returns:
        The `Identification`.

    Raises:
        UnknownParameter: a name that the knee does not have.
        UnsuitableData: bounds that exclude the start, data that are not finite, no more data than
            parameters while the noise must be estimated, or no pose that balances.
    """
    measured = np.asarray(measured, float)
    selection, stated = select(knee, parameters), stated_noise(noise_mm, noise_deg)
    check_finite(measured)
    lower, upper = stated_bounds(knee, selection, bounds or {})
    start = start_within(knee, selection, lower, upper)
    weights = DEFAULT_WEIGHTS if weights is None else np.asarray(weights, float)
    problem = Problem.of(knee, selection, measured, weights, offsets, loads, tests, stated)
    problem = problem.stepping(start)
    balance = balances_of(knee, selection, problem.cases)
    begin = balance(start[None])
    problem = problem.balanced_by(begin)
    if prior or problem.cases.readings is not None:
        check_all_stated(stated, "prior" if prior else "readings")
    if prior:
        problem = dataclasses.replace(problem, offsets=()).with_prior(start, prior)
    data = dataclasses.replace(problem.cases, offsets=offsets)
    spare = problem.counted_numbers - int(data.taken[weights > 0].sum()) - len(selection)
    estimated = bool(np.isnan(stated).any())
    if estimated:
        check_enough(problem.counted_numbers, len(selection) + len(offsets))
    fits, data = likeliest(balance, data, begin, stated, lower, upper, far=True)
    fit, followed = fits.slopes, ()
    if with_profiles:
        threshold = rise_at_limits(spare if estimated else None)
        fit, (followed,) = follow_to_the_lowest(
            balance, data, fits, lower, upper, threshold, named(selection)
        )
    found = _identification(problem, data, fit, followed, (lower, upper))
    return dataclasses.replace(
        found, noise_estimated=estimated, converged=bool(fits.converged[0]), spare=spare
    )


def _identification(
    problem: Problem, data: Observations, fit: Slopes, followed: tuple[Profile, ...], box
) -> Identification:
    """What the data say of a fit.

    Args:
        problem: as it was asked.
        data: with the noise that the fit has left, and the offsets.
        fit: the likeliest.
        followed: its profiles.
        box: lower and upper bounds, `(p,)`.
    """
    (lower, upper), selection, knee = box, problem.selection, problem.knee
    residual, _ = data.residual(fit)
    values, noise = fit.values[0], data.noise[0]
    at_bound = on_bounds(values, lower, upper)
    one = dataclasses.replace(data, noise=noise)
    alone = dataclasses.replace(one, prior=None)
    believed = np.full(len(values), np.inf) if data.prior is None else data.prior[1]
    told = fit_information(knee, selection, alone, fit, at_bound=at_bound)
    return Identification(
        selection=selection,
        values=values,
        lower=lower,
        upper=upper,
        at_bound=at_bound,
        offsets=dict(zip(data.offsets, best_offsets(one, fit), strict=True)),
        noise=noise,
        noise_estimated=False,
        chi2=float(residual[0] @ residual[0]),
        data=problem.counted_numbers,
        converged=True,
        information=told,
        profiles=followed,
        intervals=tuple(
            map(Interval.of, followed, values, told.standard_error, lower, upper, believed)
        ),
        motion=_motion(selection.apply(knee, values), one, fit),
        problem=dataclasses.replace(
            problem, cases=dataclasses.replace(alone, offsets=()), offsets=data.offsets
        ),
        lost=int((~problem.used).sum()),
        spare=0,
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
