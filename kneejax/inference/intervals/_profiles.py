"""Curvature at a fit, and profiles: how far each value goes while others make up for it."""

__all__ = ["Profile", "Uncertainty", "profiles", "propagated", "uncertainty"]

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np

from kneejax.inference.fit import (
    PATIENT,
    Balance,
    ManyFits,
    Observations,
    balances_of,
    fit_lanes,
    named,
)
from kneejax.inference.intervals._profile_arms import BETTER, NEAR, Arm, Pace, Point, products
from kneejax.mechanics import Knee
from kneejax.parameters import Selection
from kneejax.statics import Slopes

#: Singular values below this part of the largest are rounding.
_ROUNDING = 1e-7


@dataclasses.dataclass(frozen=True, eq=False)
class Uncertainty:
    """Linear error propagation at a fit."""

    covariance: np.ndarray  # `(p, p)`; NaN for values held or of which nothing is known
    standard_error: np.ndarray  # `(p,)`
    correlation: np.ndarray  # `(p, p)`


def uncertainty(slope: np.ndarray, held: np.ndarray | None = None) -> Uncertainty:
    """Propagate the scatter of residuals, one each, to the values that minimise their squares.

    Args:
        slope: derivatives of residuals in units of their noise by the values, `(r, p)`; rows that
            are not finite count for nothing.
        held: values that do not move (on a bound), `(p,)`; none by default.

    Returns:
        The `Uncertainty`: the inverse of `slope^T slope`.

    Example:
        >>> uncertainty(np.array([[3.0, 0.0], [4.0, 0.0], [0.0, 0.5]])).standard_error.tolist()
        [0.2, 2.0]
    """
    slope, size = slope[np.isfinite(slope).all(axis=1)], slope.shape[1]
    free = np.arange(size) if held is None else np.flatnonzero(~held)
    columns = slope[:, free]
    scale = np.linalg.norm(columns, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    part = propagated(columns / scale, _ROUNDING)[2] / np.outer(scale, scale)
    covariance = np.full((size, size), np.nan)
    covariance[np.ix_(free, free)] = part
    error = np.sqrt(np.diag(covariance))
    return Uncertainty(covariance, error, covariance / np.outer(error, error))


def propagated(slope: np.ndarray, rounding: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Singular values of derivatives `(r, p)`, zero below a part of the largest, `(p,)`; their
    directions, columns `(p, p)`; and the covariance `(p, p)`, NaN where they say nothing."""
    _, singular, right = np.linalg.svd(slope, full_matrices=True)
    roots = np.zeros(slope.shape[1])
    roots[: len(singular)] = singular
    roots[roots <= rounding * roots.max(initial=0.0)] = 0.0
    known, vectors = roots > 0, right.T
    half = vectors[:, known] / roots[known]
    covariance = half @ half.T
    unknown = (vectors[:, ~known] ** 2).sum(axis=1) > 1e-12
    covariance[unknown], covariance[:, unknown] = np.nan, np.nan
    return roots, vectors, covariance


#: How often a lower valley that a profile finds is followed.
_RESTARTS = 10
#: How often arms walk on from where others have shown that their limits were too narrow.
_ROUNDS = 4


@dataclasses.dataclass(frozen=True)
class Profile:
    """How the best chi squared grows as one parameter is led away from its estimate.

    Attributes:
        name: of the parameter.
        unit: its unit; empty for strains.
        estimate: its value at the fit.
        standard_error: by the curvature at the fit; NaN if it has none.
        values: along the profile, ascending, the estimate among them, `(points,)`.
        rise: of chi squared above that of the fit, `(points,)`.
        parameters: all of them along the profile, `(points, p)`.
        low: lower confidence limit; the lower bound if open.
        high: upper confidence limit; the upper bound if open.
        low_open: why there is no lower limit; empty if there is one.
        high_open: likewise.
        threshold: rise of chi squared at the limits.
    """

    name: str
    unit: str
    estimate: float
    standard_error: float
    values: np.ndarray
    rise: np.ndarray
    parameters: np.ndarray
    low: float
    high: float
    low_open: str
    high_open: str
    threshold: float

    @property
    def closed(self) -> bool:
        """Whether the data limit the parameter from both sides."""
        return not (self.low_open or self.high_open)

    @property
    def better(self) -> float:
        """How much lower than at the fit chi squared has been found; zero as it should be."""
        lowest = -float(np.min(self.rise))
        return lowest if lowest > BETTER else 0.0


def profiles(
    knee: Knee, selection: Selection, data: Observations, fit: Slopes, lower: np.ndarray,
    upper: np.ndarray, threshold: float,
) -> tuple[Profile, ...]:  # fmt: skip
    """Follow every parameter in both directions, the others making up for it as well as they can.

    Args:
        knee: gives everything else.
        selection: the parameters.
        data: measured motion, one for all.
        fit: balances and derivatives at the best fit, one variant.
        lower: bounds, `(p,)`.
        upper: bounds.
        threshold: rise of chi squared at the confidence limits: 3.84 for 95 % and a noise that is
            known.

    Returns:
        One profile per parameter.
    """
    balance, names = balances_of(knee, selection, data), named(selection)
    return follow(balance, data, fit, lower, upper, threshold, names)[0][0]


def follow(
    balance: Balance, data: Observations, fits: Slopes, lower: np.ndarray, upper: np.ndarray,
    threshold: float, names: Sequence[tuple[str, str]], pace: Pace = Pace.FINE, leave: bool = False,
) -> tuple[list[tuple[Profile, ...]], Slopes]:  # fmt: skip
    """Profiles of many fits at once and balances at the lowest last point of each fit's arms, which
    advance together, an evaluation each. Where one has been beyond another's limit at a likelihood
    that the limit excludes, that one walks on from there. With `leave` a fit is left as soon as an
    arm finds a better one."""
    residual, slope = data.residual(fits)
    (count, size), width, level = fits.values.shape, upper - lower, np.sqrt(threshold)
    chi2, models = np.sum(residual**2, axis=1), products(residual, slope * width)
    arms = [
        Arm(fits.values[fit], i, way, chi2[fit], models[fit], lower, upper, level, pace.value)
        for fit in range(count)
        for i in range(size)
        for way in (-1.0, 1.0)
    ]
    of_fits = np.arange(len(arms)).reshape(count, -1)
    fit_of = np.repeat(np.arange(count), 2 * size)
    near, of_arms = fits.take(fit_of), data.take(fit_of)
    for last in [*[False] * _ROUNDS, True]:
        while walking := [row for row, arm in enumerate(arms) if arm.active]:
            rows = np.array(walking)
            found = balance(np.array([arms[row].ahead for row in rows]), near.take(rows))
            went = _look([arms[row] for row in rows], found, of_arms.take(rows), width)
            near.put(rows[went], found.take(went))
            better = [row for row in rows if leave and arms[row].points[-1].rise < -BETTER]
            for row in of_fits[np.isin(of_fits, better).any(axis=1)].ravel():
                arms[row].active = False
        narrow = [each for rows in of_fits for each in _too_narrow(arms, rows)]
        if not narrow:
            break
        rows, donors, points = zip(*narrow, strict=True)
        rows, ends = np.array(rows), np.array([point.parameters for point in points])
        there = _led(balance, near.take(np.array(donors)), ends)
        residual, slopes = of_arms.take(rows).residual(there)
        models = products(residual, slopes * width)
        goes_on = np.isfinite(there.q).all(axis=(1, 2)) & (not last)
        for row, point, model, on in zip(rows, points, models, goes_on, strict=True):
            arms[row].reopen(point, model if on else None)
        near.put(rows[goes_on], there.take(goes_on))
    lowest = [rows[np.argmin([arms[row].points[-1].rise for row in rows])] for rows in of_fits]
    found = []
    for rows, own in zip(of_fits, slope, strict=True):
        error, pairs = uncertainty(own).standard_error, rows.reshape(-1, 2)
        found.append(tuple(
            _profile(arms[down], arms[up], *names[i], error[i], threshold)
            for i, (down, up) in enumerate(pairs)
        ))  # fmt: skip
    return found, near.take(lowest)


def _look(arms: Sequence[Arm], found: Slopes, data: Observations, width: np.ndarray) -> np.ndarray:
    """Tell each arm what was found where it looked; which of them went there."""
    residual, slope = data.residual(found)
    chi2 = np.sum(residual**2, axis=1)
    good = np.isfinite(chi2) & np.isfinite(slope).all(axis=(1, 2))
    residual[~good], slope[~good] = 0.0, 0.0
    models, went = products(residual, slope * width), np.zeros(len(arms), bool)
    for k, arm in enumerate(arms):
        if good[k]:
            went[k] = arm.look(found.values[k], chi2[k], models[k])
        else:
            arm.lost()
    return went


def _too_narrow(arms: Sequence[Arm], rows: np.ndarray) -> Iterator[tuple[int, int, Point]]:
    """Arms whose limits leave out points of others that are likely: rows, others', points."""
    highest = ((1.0 - NEAR) * arms[0].level) ** 2
    inside = [(row, p) for row in rows for p in arms[row].points if p.rise < highest]
    if any(point.rise < -BETTER for _, point in inside):
        return  # The fit itself has to move first.
    values = np.array([point.parameters for _, point in inside])
    for row in rows:
        arm = arms[row]
        if arm.end or not np.isfinite(arm.limit):
            continue
        donor, point = inside[int(np.argmax(arm.way * values[:, arm.index]))]
        value = float(point.parameters[arm.index])
        if arm.way * (value - arm.limit) > NEAR * abs(arm.limit - arm.points[0].value):
            yield row, donor, point._replace(value=value)


def _led(balance: Balance, near: Slopes, values: np.ndarray) -> Slopes:
    """Balances at values, in ever shorter strides where one was too long; NaN where none does."""
    there = balance(values, near)
    for parts in (4, 16):
        lost = np.flatnonzero(np.isnan(there.q).any(axis=(1, 2)))
        if not len(lost):
            break
        here = near.take(lost)
        for stop in np.linspace(near.values[lost], values[lost], parts + 1)[1:]:
            here = balance(stop, here)
        there.put(lost, here)
    return there


def follow_to_the_lowest(
    balance: Balance, data: Observations, fits: ManyFits, lower: np.ndarray, upper: np.ndarray,
    threshold: float, names: Sequence[tuple[str, str]], pace: Pace = Pace.FINE,
) -> tuple[Slopes, list[tuple[Profile, ...]]]:  # fmt: skip
    """Where fits are in the end, and their profiles; one moves, ten times at most, to a
    lower valley that a profile has found."""
    rows = np.arange(len(fits.values))
    here = fits.slopes.take(rows)
    found: list[tuple[Profile, ...]] = [()] * len(rows)
    for left in reversed(range(_RESTARTS + 1)):
        own = data.take(rows)
        again, lowest = follow(
            balance, own, here.take(rows), lower, upper, threshold, names, pace, leave=left > 0
        )
        for row, profiles_ in zip(rows, again, strict=True):
            found[row] = profiles_
        which = np.array([any(one.better for one in profiles_) for profiles_ in again])
        if not which.any() or not left:
            break
        rows, lowest = rows[which], lowest.take(which)
        moved = fit_lanes(
            balance, data.take(rows), lowest, lowest.values, lower, upper, most=PATIENT, far=True
        )
        here.put(rows, moved.slopes)
    return here, found


def _profile(
    down: Arm, up: Arm, name: str, unit: str, error: float, threshold: float
) -> Profile:
    points = [*reversed(down.curve()[1:]), *up.curve()]
    values, rise, parameters, _ = map(np.array, zip(*points, strict=True))
    low = down.lower[down.index] if down.end else down.limit
    high = up.upper[up.index] if up.end else up.limit
    return Profile(
        name, unit, up.points[0].value, float(error), values, rise, parameters, float(low),
        float(high), down.end, up.end, threshold,
    )  # fmt: skip
