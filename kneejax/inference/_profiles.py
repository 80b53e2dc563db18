"""Profile likelihoods: how far each parameter can go while all the others make up for it."""

from __future__ import annotations

import dataclasses

import numpy as np

from kneejax.inference._many_fits import MotionData, fit_many
from kneejax.inference._parameters import QUANTITIES, Selection
from kneejax.mechanics import Knee
from kneejax.statics import Slopes

#: Confidence that is asked for.
CONFIDENCE = 0.95
#: Points are this far apart in the root of the likelihood ratio, and go so far beyond the limit.
_STRIDE, _BEYOND = 0.4, 1.3
#: A step is at most this part of the bounds' width, and an arm has at most so many.
_LONGEST, _MOST = 1.0 / 8.0, 40
#: Better by more than this than the fit: the fit was not the best there is.
_BETTER = 0.01


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
    def lowest(self) -> np.ndarray:
        """All parameters where chi squared is lowest, `(p,)`."""
        return self.parameters[np.argmin(self.rise)]

    @property
    def better(self) -> float:
        """How much lower than at the fit chi squared has been found; zero as it should be."""
        lowest = -float(np.min(self.rise))
        return lowest if lowest > _BETTER else 0.0


def profiles(
    knee: Knee,
    selection: Selection,
    data: MotionData,
    fit: Slopes,
    lower: np.ndarray,
    upper: np.ndarray,
    threshold: float,
) -> tuple[Profile, ...]:
    """Follow every parameter in both directions, fitting the others anew at each value.

    All arms advance together; each fit begins where the curvature at its neighbour says that the
    others will go.

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
        One profile a parameter.
    """
    size = len(selection)
    residual, slope = data.residual(fit)
    best, error = float(residual[0] @ residual[0]), _curvature_errors(slope[0])
    arms = _Arms(fit, slope[0], lower, upper, error, np.sqrt(threshold))
    while arms.active.any():
        rows = np.flatnonzero(arms.active)
        starts, low, high = arms.next_fits(rows)
        found = fit_many(knee, selection, data, arms.near, starts, low, high)
        _, slopes = data.residual(found.slopes)
        arms.advance(rows, found, np.maximum(found.chi2 - best, -np.inf), slopes)
    return tuple(
        _profile(selection, i, arms, size, float(error[i]), threshold) for i in range(size)
    )


def _curvature_errors(slope: np.ndarray) -> np.ndarray:
    """Standard errors by the curvature; NaN where the data say nothing at all."""
    normal = slope.T @ slope
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    values, vectors = np.linalg.eigh(normal / np.outer(scale, scale))
    safe = np.where(values > 1e-13, values, np.nan)
    return np.sqrt(((vectors / scale[:, None]) ** 2 / safe).sum(axis=1))


class _Arms:
    """From the fit, each parameter down (even rows) and up (odd rows)."""

    def __init__(self, fit: Slopes, slope, lower, upper, error, level: float):
        size = len(lower)
        count = 2 * size
        self.index, self.way = np.repeat(np.arange(size), 2), np.tile([-1.0, 1.0], size)
        self.near, self.slope = fit.take(np.zeros(count, int)), np.repeat(slope[None], count, 0)
        self.lower, self.upper, self.level = lower, upper, level
        width = (upper - lower)[self.index]
        rate = np.where(np.isfinite(error), error, width[::2])[self.index]
        self.rate, self.longest = np.minimum(rate, width), _LONGEST * width
        self.root = np.zeros(count)
        self.points: list[list[tuple[float, float, np.ndarray]]] = [
            [(float(fit.values[0, i]), 0.0, fit.values[0])] for i in self.index
        ]
        self.end = [""] * count
        self.active = np.ones(count, bool)
        for row in range(count):
            if self._room(row) <= 1e-9 * width[row]:
                self._stop(row, "its bound")

    def next_fits(self, rows: np.ndarray):
        """Starts and bounds of the next fit of every arm; arms that ended repeat their last."""
        values = self.near.values.copy()
        low, high = (np.tile(b, (len(values), 1)) for b in (self.lower, self.upper))
        for row in range(len(values)):
            i = self.index[row]
            step = 0.0
            if self.active[row]:
                step = min(_STRIDE * self.rate[row], self.longest[row], self._room(row))
            values[row] = self._predicted(row, self.way[row] * step)
            low[row, i] = high[row, i] = values[row, i]
        return values, low, high

    def advance(self, rows: np.ndarray, found, rise: np.ndarray, slopes: np.ndarray) -> None:
        """Note the new points; end arms that have gone far enough, or can go no farther."""
        for row in rows:
            i, before = self.index[row], self.points[row][-1][0]
            value = float(found.values[row, i])
            if not np.isfinite(rise[row]):
                self._stop(row, "no balance beyond")
                continue
            root = float(np.sqrt(max(rise[row], 0.0)))
            self.points[row].append((value, float(rise[row]), found.values[row]))
            gained = max(root - self.root[row], 1e-3)
            self.rate[row] = min(abs(value - before) / gained, 4.0 * self.rate[row])
            self.root[row] = root
            if root > _BEYOND * self.level:
                self.active[row] = False
            elif self._room(row) <= 1e-12 * (self.upper[i] - self.lower[i]):
                self._stop(row, "its bound")
            elif len(self.points[row]) > _MOST:
                self._stop(row, f"given up after {_MOST} steps")
        self.near.put(rows, found.slopes.take(rows))
        self.slope[rows] = slopes[rows]

    def _room(self, row: int) -> float:
        i, here = self.index[row], self.points[row][-1][0]
        return float(self.upper[i] - here if self.way[row] > 0 else here - self.lower[i])

    def _stop(self, row: int, why: str) -> None:
        self.active[row] = False
        if self.root[row] < self.level:
            self.end[row] = why

    def _predicted(self, row: int, step: float) -> np.ndarray:
        """All parameters after a step of one, the others where the curvature leads them."""
        i, here = self.index[row], self.near.values[row].copy()
        others = np.arange(len(here)) != i
        scale = np.linalg.norm(self.slope[row], axis=0)
        scale = np.where(scale > 0, scale, 1.0)
        matrix = self.slope[row] / scale
        follow = -np.linalg.lstsq(matrix[:, others], matrix[:, i] * scale[i] * step, rcond=1e-9)[0]
        here[i] += step
        here[others] += follow / scale[others]
        return np.clip(here, self.lower, self.upper)


def _profile(selection: Selection, i: int, arms: _Arms, size: int, error: float, threshold: float):
    down, up = arms.points[2 * i], arms.points[2 * i + 1]
    points = [*reversed(down[1:]), *up]
    limits = []
    for row, arm in ((2 * i, down), (2 * i + 1, up)):
        crossed = arms.end[row] == "" and len(arm) > 1
        bound = arms.lower[i] if arms.way[row] < 0 else arms.upper[i]
        limits.append(_crossing(arm, np.sqrt(threshold)) if crossed else float(bound))
    return Profile(
        selection.names[i],
        QUANTITIES[selection.quantity(i)],
        up[0][0],
        error,
        np.array([p[0] for p in points]),
        np.array([p[1] for p in points]),
        np.array([p[2] for p in points]),
        limits[0],
        limits[1],
        arms.end[2 * i],
        arms.end[2 * i + 1],
        threshold,
    )


def _crossing(arm: list[tuple[float, float, np.ndarray]], level: float) -> float:
    """The outermost place where the root of the rise passes the level, by a monotone cubic."""
    from scipy.interpolate import PchipInterpolator
    from scipy.optimize import brentq

    values = np.array([p[0] for p in arm])
    roots = np.sqrt(np.maximum([p[1] for p in arm], 0.0))
    inside = int(np.flatnonzero(roots < level)[-1])
    along = np.abs(values - values[0])
    curve = PchipInterpolator(along, roots)
    place = brentq(lambda x: float(curve(x)) - level, along[inside], along[inside + 1])
    return float(values[0] + np.sign(values[-1] - values[0]) * place)
