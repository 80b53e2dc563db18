"""What measured motion can and cannot tell of a knee's parameters: its fit, Fisher information."""

__all__ = [
    "Identification", "Information", "fit_information", "identify", "information", "noise_of",
]

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from kneejax.geometry import BY_COORDINATE
from kneejax.inference.calibration import CalibrationProblem, Motion, motion_of
from kneejax.inference.fit import (
    Noise,
    Observations,
    Problem,
    best_offsets,
    named,
    on_bounds,
    slack_at,
)
from kneejax.inference.intervals import (
    Interval,
    Pace,
    Profile,
    estimate,
    maximum_likelihood,
    propagated,
)
from kneejax.mechanics import Knee
from kneejax.numerics import Named
from kneejax.parameters import Selection, UnsuitableData, prior_scales
from kneejax.quantities import quantity_of
from kneejax.statics import Slopes


@dataclasses.dataclass(frozen=True)
class Identification(Named):
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
    information: "Information"
    profiles: tuple[Profile, ...]
    intervals: tuple[Interval, ...]
    motion: Motion
    problem: Problem
    lost: int
    spare: int

    OVER = {"parameter": dict.fromkeys(("values", "lower", "upper", "at_bound"), ""),
            "coordinate": {"noise": ""}}  # fmt: skip

    def _named(self) -> dict[str, tuple]:
        limits = {name: ("parameter", [getattr(one, name) for one in self.intervals])
                  for name in ("low", "high") if self.intervals}  # fmt: skip
        return super()._named() | self.information._named() | limits | BY_COORDINATE

    @property
    def vector(self) -> np.ndarray:
        """Parameters, then frame offsets in the order of the problem."""
        return np.r_[self.values, list(self.offsets.values())]


def identify(
    problem: CalibrationProblem, *, with_profiles: bool = True,
    spread: Mapping[str, float] | None = None,
) -> Identification:  # fmt: skip
    """Fit all parameters of a problem together, and ask what its data determine.

    Estimates and limits are those of `calibrate` by procedure III; constants between frames are
    taken out.

    Args:
        problem: what is fitted; its procedures, stages and starts do not count.
        with_profiles: whether to follow the profiles.
        spread: name, wildcard or quantity -> standard deviation before this knee was measured, by
            which its information is scaled; usual ones otherwise (see `prior_scales`).

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
    prior = fitted.cases.prior and tuple(part[:size] for part in fitted.cases.prior)
    balance = fitted.balance
    begin = balance(start[None])
    fitted = fitted.balanced_by(begin)
    data = dataclasses.replace(fitted.cases, offsets=offsets, prior=prior)
    spare = fitted.counted_numbers - int(data.taken[noise.counted].sum()) - size
    if noise.estimated:
        check_enough(fitted.counted_numbers, size + len(offsets))
    box, names = (lower, upper), named(fitted.selection)
    if with_profiles:
        (sure,) = estimate(balance, data, begin, noise, *box, names, Pace.FINE, far=True)
        fit, left, ended = sure.best, sure.noise, sure.converged
        limits = {"profiles": sure.profiles, "intervals": sure.intervals}
    else:
        fits, weighed = maximum_likelihood(balance, data, begin, noise, *box, far=True)
        fit, left, ended = fits.slopes, weighed.noise[0], bool(fits.converged[0])
        limits = {"profiles": (), "intervals": ()}
    data = dataclasses.replace(data, noise=left)
    values, (residual, _) = fit.values[0], data.residual(fit)
    at_bound, alone = on_bounds(values, lower, upper), dataclasses.replace(data, prior=None)
    scale = prior_scales(fitted.selection, values, spread)
    information = fit_information(
        fitted.knee, fitted.selection, alone, fit, at_bound=at_bound, scale=scale
    )
    cases = dataclasses.replace(alone, offsets=())
    return Identification(
        selection=fitted.selection, values=values, lower=lower, upper=upper, at_bound=at_bound,
        offsets=dict(zip(offsets, best_offsets(data, fit), strict=True)), noise=left,
        noise_estimated=noise.estimated, chi2=float(residual[0] @ residual[0]),
        data=fitted.counted_numbers, converged=ended, information=information,
        motion=motion_of(fitted, fit), **limits,
        problem=dataclasses.replace(fitted, cases=cases, offsets=offsets),
        lost=int((~fitted.used).sum()), spare=spare,
    )  # fmt: skip


def check_enough(count: int, unknowns: int) -> None:
    """Refuse as many measured numbers as unknowns (parameters, offsets): no noise is left over."""
    if count <= unknowns:
        raise UnsuitableData(
            f"{count} measured numbers for {unknowns} unknowns: "
            "their noise cannot be estimated; give noise_mm and noise_deg, or free fewer parameters"
        )


# Singular values below this part of the largest are rounding.
_ROUNDING = 1e-13


@dataclasses.dataclass(frozen=True)
class Information(Named):
    """What data tell about parameters, to first order at a fit.

    Parameters are scaled by `scale`, what is known of them before a knee is measured. A combination
    with eigenvalue 100 is then known ten times better from these data than before; one whose
    eigenvalue is below 1 the data leave where it was.

    Attributes:
        names: of the parameters.
        values: at which the derivatives were taken, `(p,)`.
        scale: of each parameter, in its own unit, `(p,)`.
        at_bound: which parameters are on a bound, `(p,)`; these are held in all that follows but
            `matrix`.
        matrix: information of all parameters, scaled, `(p, p)`: `(J/noise)^T (J/noise)`.
        eigenvalues: of the free parameters' part, largest first, `(free,)`.
        eigenvectors: columns, `(p, free)`; zero in rows of parameters on a bound.
        standard_error: in the parameter's unit, `(p,)`; infinite where data say nothing, NaN on a
            bound.
        correlation: of the estimates, `(p, p)`; NaN where there is none.
        condition_number: largest eigenvalue over the smallest; infinite if that is zero.
        weighted: derivative of each measured number, in units of its noise, by each parameter, in
            units of its scale, `(data, p)`.
        lost: how many poses count for nothing, since no balance was found there.
        flexion_deg: of the poses, `(n,)`; None where they are not known.
        slack: ligament or group -> where it is slack, `(n,)`.

    Source: Gutenkunst et al. 2007, PLoS Computational Biology 3, e189, for stiff and sloppy.
    """

    names: tuple[str, ...]
    values: np.ndarray
    scale: np.ndarray
    at_bound: np.ndarray
    matrix: np.ndarray
    eigenvalues: np.ndarray
    eigenvectors: np.ndarray
    standard_error: np.ndarray
    correlation: np.ndarray
    condition_number: float
    weighted: np.ndarray
    lost: int
    flexion_deg: np.ndarray | None
    slack: Mapping[str, np.ndarray]

    OVER = {"parameter": {"scale": "", "standard_error": ""}, "combination": {"eigenvalues": "1"},
            "parameter combination": {"eigenvectors": "1"},
            "parameter other_parameter": {"correlation": "1"}}  # fmt: skip

    def _named(self) -> dict[str, tuple]:
        names = {x: (x, self.names) for x in ("parameter", "other_parameter")}
        units = [quantity_of(name).unit for name in self.names]
        return super()._named() | names | {"parameter_unit": ("parameter", units)}

    @property
    def data(self) -> int:
        """How many numbers were measured."""
        return len(self.weighted)

    @property
    def determined(self) -> np.ndarray:
        """Where data know a parameter better than its scale, `(p,)`."""
        return self.standard_error < self.scale


def information(
    jacobian: np.ndarray, noise: np.ndarray | float, names: Sequence[str], values: np.ndarray, *,
    scale: np.ndarray | None = None, at_bound: np.ndarray | None = None,
    flexion_deg: np.ndarray | None = None, slack: Mapping[str, np.ndarray] | None = None,
) -> Information:  # fmt: skip
    """Fisher information of measured coordinates with independent normal noise.

    A fit that weights its data by `1 / noise^2` reaches these standard errors where the model is
    linear over their width; no unbiased estimate does better.

    Args:
        jacobian: derivative of what is measured with respect to the parameters, `(5, n, p)` or
            `(rows, p)`. Poses that are not finite count for nothing.
        noise: standard deviation of what is measured: `(5,)` in the order of
            `kneejax.geometry.FREE_COORDINATES` (`noise_of`), or `(rows,)`, or one for all.
        names: of the parameters, `LIGAMENT.quantity`.
        values: of the parameters, `(p,)`.
        scale: `(p,)`; `prior_scales` by default.
        at_bound: parameters that are held on a bound, `(p,)`.
        flexion_deg: of the poses, `(n,)`; with `slack`, it serves the reasons.
        slack: ligament or group -> where it is slack, `(n,)` (`slack_poses`).

    Returns:
        The `Information`.

    Raises:
        UnsuitableData: shapes that do not fit, noise or a scale that is not positive.

    Example:
        >>> found = information([[1.0, 1.0], [1.0, 1.0]], 0.1, ["ACL.stiffness", "PCL.stiffness"],
        ...                     [10.0, 10.0])
        >>> found.standard_error.tolist(), found.determined.tolist()
        ([inf, inf], [False, False])
    """
    jacobian, values = np.asarray(jacobian, float), np.asarray(values, float)
    names, size = tuple(names), len(names)
    scale = prior_scales(Selection(names, ()), values) if scale is None else scale
    scale = np.asarray(scale, float)
    held = np.zeros(size, bool) if at_bound is None else np.asarray(at_bound, bool)
    _check_sizes(jacobian, names, values, scale, held)
    rows, lost = _rows(jacobian, noise)
    weighted = rows * scale
    free = np.flatnonzero(~held)
    roots, vectors, part = propagated(weighted[:, free], _ROUNDING)
    eigenvectors, covariance = np.zeros((size, len(free))), np.full((size, size), np.nan)
    eigenvectors[free], covariance[np.ix_(free, free)] = vectors, part
    # Signs are free: the largest component counts as positive.
    largest = np.abs(eigenvectors).argmax(axis=0)
    eigenvectors *= np.sign(eigenvectors[largest, np.arange(len(free))])
    spread, eigenvalues = np.sqrt(np.diag(covariance)), roots**2
    error = np.where(np.isnan(spread) & ~held, np.inf, spread)
    worst = eigenvalues.min(initial=np.inf)
    condition = float(eigenvalues.max(initial=0.0) / worst) if worst > 0 else np.inf
    return Information(
        names=names, values=values, scale=scale, at_bound=held, matrix=weighted.T @ weighted,
        eigenvalues=eigenvalues, eigenvectors=eigenvectors, standard_error=error * scale,
        correlation=covariance / np.outer(spread, spread), condition_number=condition,
        weighted=weighted, lost=lost,
        flexion_deg=None if flexion_deg is None else np.asarray(flexion_deg, float),
        slack=dict(slack or {}),
    )  # fmt: skip


def fit_information(
    knee: Knee, selection: Selection, data: Observations, fit: Slopes, *,
    at_bound: np.ndarray | None = None, scale: np.ndarray | None = None,
) -> Information:  # fmt: skip
    """Fisher information of a motion's data at a fit, and where ligaments are slack.

    Args:
        knee: gives everything that is not free.
        selection: the parameters.
        data: the motion. Constant frame offsets take the information that they need; the rest is
            what is told of the parameters.
        fit: balances and derivatives at the fit, one variant (`balance_with_slopes`).
        at_bound: parameters on a bound, `(p,)`.
        scale: see `information`.

    Returns:
        The `Information`.
    """
    counted = data.used & fit.converged[0]
    _, rows = dataclasses.replace(data, used=counted).residual(fit)
    slack = slack_at(knee, selection, data, fit)
    flexion_deg = np.rad2deg(np.asarray(data.load_cases.flexion))[counted]
    answer = information(
        rows[0], 1.0, selection.names, fit.values[0], scale=scale, at_bound=at_bound,
        flexion_deg=flexion_deg, slack={name: where[counted] for name, where in slack.items()},
    )  # fmt: skip
    return dataclasses.replace(answer, lost=int(data.used.sum() - counted.sum()))


def noise_of(noise_mm: float, noise_deg: float) -> np.ndarray:
    """Standard deviations of the five free coordinates, `(5,)`, mm and degrees.

    Raises:
        UnsuitableData: one is not a positive number.

    Example:
        >>> noise_of(0.3, 0.2).tolist()
        [0.2, 0.2, 0.3, 0.3, 0.3]
    """
    return Noise.of(noise_mm, noise_deg).stated


def _check_sizes(jacobian, names, values, scale, held) -> None:
    size = len(names)
    if jacobian.ndim not in (2, 3) or jacobian.shape[-1] != size or not size:
        raise UnsuitableData(
            f"a Jacobian of shape {jacobian.shape} for {size} parameters: expected "
            f"(5, poses, {size}) or (rows, {size})"
        )
    for what, array in (("values", values), ("scale", scale), ("at_bound", held)):
        if array.shape != (size,):
            raise UnsuitableData(f"{what} of shape {array.shape}: expected ({size},)")
    for name, width in zip(names, scale, strict=True):
        if not (np.isfinite(width) and width > 0):
            raise UnsuitableData(f"{name}: scale {width:g}: expected a number above 0")


def _rows(jacobian: np.ndarray, noise: np.ndarray | float) -> tuple[np.ndarray, int]:
    """Rows in units of their noise without what is not finite; how many poses that was."""
    deviation = np.asarray(noise, float)
    if not (np.isfinite(deviation) & (deviation > 0)).all():
        raise UnsuitableData(f"noise {deviation}: expected standard deviations above 0")
    expected = len(jacobian)
    if deviation.shape not in ((), (1,), (expected,)):
        raise UnsuitableData(f"noise of shape {deviation.shape}: expected ({expected},)")
    deviation = np.broadcast_to(deviation, expected)
    rows = jacobian / deviation.reshape(-1, *(1,) * (jacobian.ndim - 1))
    by_pose = rows.ndim == 3
    known = np.isfinite(rows).all(axis=(0, 2) if by_pose else 1)
    rows = rows[:, known] if by_pose else rows[known]
    return rows.reshape(-1, rows.shape[-1]), int((~known).sum())
