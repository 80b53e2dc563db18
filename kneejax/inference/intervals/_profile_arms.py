"""How profiles walk: from a fit, each parameter down and up, until the misfit has risen enough."""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Iterator, Sequence

import numpy as np

from kneejax.statics import Slopes

#: From a point so near the limit (in parts of the root of the rise) on, a line will do.
NEAR = 0.05
#: A step beyond which there is no balance is halved so often.
_HALVINGS = 3

#: Better by more than this than the fit: the fit was not the best there is.
BETTER = 0.01

#: Value of the arm's parameter, rise of chi squared, all parameters.
Point = tuple[float, float, np.ndarray]


@dataclasses.dataclass(frozen=True)
class Narrow:
    """An arm whose limit is too narrow.

    Attributes:
        arm: its row.
        point: beyond the limit, as likely as what lies inside.
        donor: row of the arm that has been there.
    """

    arm: int
    point: Point
    donor: int


@dataclasses.dataclass(frozen=True)
class _Steps:
    """How an arm walks.

    Attributes:
        stride: of the root of the likelihood ratio between points; infinite goes for the limit.
        beyond: the walk ends at so many times the limit; NaN ends it near the limit.
        most: points of an arm.
        longest: step, as a part of the bounds' width.
        near: the root of the rise so near the limit, in parts of it, is at the limit.
        within: rise of chi squared that is left to a point's fit.
    """

    stride: float
    beyond: float
    most: int
    longest: float
    near: float
    within: float


class Pace(enum.Enum):
    """Whether a profile is wanted as a curve, or its limits only."""

    FINE = _Steps(0.4, 1.3, 40, 1.0 / 8.0, NEAR, 1e-7)
    LIMITS = _Steps(np.inf, np.nan, 14, 1.0 / 4.0, NEAR, 0.02)



class Arms:
    """From each fit, each parameter down (even rows) and up (odd rows)."""

    def __init__(
        self,
        fits: Slopes,
        slope: np.ndarray,
        lower: np.ndarray,
        upper: np.ndarray,
        error: np.ndarray,
        level: float,
        pace: Pace,
    ):
        count, self.size = fits.values.shape
        arms = 2 * self.size
        self.fit_of = np.repeat(np.arange(count), arms)
        self.index = np.tile(np.repeat(np.arange(self.size), 2), count)
        self.way = np.tile([-1.0, 1.0], count * self.size)
        self.near, self.slope = fits.take(self.fit_of), slope[self.fit_of]
        self.lower, self.upper, self.level, self.error = lower, upper, level, error
        self.steps = pace.value
        width = (upper - lower)[self.index]
        rate = error[self.fit_of, self.index]
        self.rate = np.minimum(np.where(np.isfinite(rate), rate, width), width)
        self.longest = pace.value.longest * width
        self.points: list[list[Point]] = [
            [(float(fits.values[fit, i]), 0.0, fits.values[fit])]
            for fit, i in zip(self.fit_of, self.index, strict=True)
        ]
        self.end = [""] * (count * arms)
        self.active = np.ones(count * arms, bool)
        self.halved = np.zeros(count * arms, int)
        for row in range(count * arms):
            if self._room(row) <= 1e-9 * width[row]:
                self._stop(row, "its bound")

    def next_fits(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Starts and bounds of the next fit of every arm that walks."""
        values = self.near.values.copy()
        low, high = (np.tile(b, (len(values), 1)) for b in (self.lower, self.upper))
        for row in np.flatnonzero(self.active):
            i = self.index[row]
            step = self._target(row) - self.near.values[row, i]
            values[row] = self._predicted(row, step)
            low[row, i] = high[row, i] = values[row, i]
        return values, low, high

    def advance(self, rows: np.ndarray, found, rise: np.ndarray, slopes: np.ndarray) -> None:
        """Note the new points; end arms that have gone far enough, or can go no farther."""
        for row in rows:
            if not np.isfinite(rise[row]):
                self.halved[row] += 1
                if self.halved[row] > _HALVINGS:
                    self._stop(row, "no balance beyond")
                continue
            self._note(row, found.values[row], float(rise[row]))
        good = np.isfinite(rise[rows])
        self.near.put(rows[good], found.slopes.take(rows[good]))
        self.slope[rows[good]] = slopes[good]

    def leave(self, fits: np.ndarray) -> None:
        """End all arms of some fits where they are."""
        self.active[np.isin(self.fit_of, fits)] = False

    def lowest(self) -> np.ndarray:
        """Of each fit, the arm whose last point is lowest, `(fits,)`."""
        last = np.array([points[-1][1] for points in self.points]).reshape(-1, 2 * self.size)
        return np.argmin(last, axis=1) + 2 * self.size * np.arange(len(last))

    def too_narrow(self) -> list[Narrow]:
        """Arms whose limits leave out what other arms of the same fit have seen."""
        every = np.arange(len(self.active)).reshape(-1, 2 * self.size)
        return [narrow for rows in every for narrow in self._too_narrow(rows)]

    def _too_narrow(self, rows: np.ndarray) -> Iterator[Narrow]:
        seen = [(row, point) for row in rows for point in self.points[row]]
        inside = [(row, p) for row, p in seen if _root(p[1]) < (1.0 - NEAR) * self.level]
        if any(point[1] < -BETTER for _, point in inside):
            return  # The fit itself has to move first.
        values = np.array([point[2] for _, point in inside])
        for row in rows:
            arm = self.sorted_points(row)
            if self.end[row] or max(_root(p[1]) for p in arm) < (1.0 - NEAR) * self.level:
                continue
            limit, i, way = crossing(arm, self.level), self.index[row], self.way[row]
            farthest = int(np.argmax(way * values[:, i]))
            if way * (values[farthest, i] - limit) > NEAR * abs(limit - arm[0][0]):
                donor, point = inside[farthest]
                yield Narrow(row, (float(point[2][i]), *point[1:]), donor)

    def reopen(
        self, narrow: Sequence[Narrow], there: Slopes, slopes: np.ndarray, close: bool
    ) -> None:
        """Walk on from points beyond the limits.

        Args:
            narrow: arms and points.
            there: balances at the points.
            slopes: of the residual there.
            close: whether the arms end there instead, without a limit; so do those that find no
                balance there.
        """
        good = np.isfinite(there.q).all(axis=(1, 2))
        for (row, point), on in zip(((n.arm, n.point) for n in narrow), good, strict=True):
            nearer = [
                p for p in self.points[row]
                if self.way[row] * (point[0] - p[0]) > 0 and _root(p[1]) < self.level
            ]
            self.points[row] = [*nearer, point]
            self.active[row], self.halved[row] = on and not close, 0
            if not self.active[row]:
                self._stop(row, "another valley goes farther")
        rows = np.array([n.arm for n in narrow])[good]
        self.near.put(rows, there.take(good))
        self.slope[rows] = slopes[good]

    def sorted_points(self, row: int) -> list[Point]:
        """Points of an arm, nearest the fit first."""
        first = self.points[row][0][0]
        return sorted(self.points[row], key=lambda point: abs(point[0] - first))

    def _note(self, row: int, values: np.ndarray, rise: float) -> None:
        i, level = self.index[row], self.level
        before = self.points[row][-1]
        value, root = float(values[i]), _root(rise)
        self.points[row].append((value, rise, values))
        gained = max(abs(root - _root(before[1])), 1e-3)
        self.rate[row] = min(abs(value - before[0]) / gained, 4.0 * self.rate[row])
        whole_curve = np.isfinite(self.steps.beyond)
        if whole_curve:
            arrived = root > self.steps.beyond * level
        else:
            arrived = abs(root - level) < self.steps.near * level
        at_bound = self._room(row) <= 1e-12 * (self.upper[i] - self.lower[i])
        if arrived:
            self.active[row] = False
        elif at_bound and (whole_curve or root < level):
            self._stop(row, "its bound")
        elif len(self.points[row]) > self.steps.most:
            self._stop(row, f"given up after {self.steps.most} steps")

    def _target(self, row: int) -> float:
        """The value of the next point."""
        points = self.sorted_points(row)
        outside = next((k for k, p in enumerate(points) if _root(p[1]) > self.level), None)
        if outside is not None and not np.isfinite(self.steps.beyond):
            return self._between(points[outside - 1], points[outside])
        here, root = points[-1][0], _root(points[-1][1])
        stride = min(self.steps.stride, max(self.level - root, 0.1 * self.level))
        if np.isfinite(self.steps.beyond):
            stride = self.steps.stride
        step = min(stride * self.rate[row], self.longest[row]) / 2.0 ** self.halved[row]
        return here + self.way[row] * min(step, self._room(row))

    def _between(self, inside: Point, outside: Point) -> float:
        """Where a line through two points crosses the level, not at either of them."""
        first, last = _root(inside[1]), _root(outside[1])
        part = float(np.clip((self.level - first) / max(last - first, 1e-12), 0.1, 0.9))
        return inside[0] + part * (outside[0] - inside[0])

    def _room(self, row: int) -> float:
        """How far the farthest point is from the bound."""
        i = self.index[row]
        values = [point[0] for point in self.points[row]]
        return float(
            self.upper[i] - max(values) if self.way[row] > 0 else min(values) - self.lower[i]
        )

    def _stop(self, row: int, why: str) -> None:
        self.active[row] = False
        if _root(self.sorted_points(row)[-1][1]) < self.level:
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


def _root(rise: float) -> float:
    return float(np.sqrt(max(rise, 0.0)))


def crossing(arm: list[tuple[float, float, np.ndarray]], level: float) -> float:
    """The outermost place where the root of the rise passes the level, by a monotone cubic, or by a
    line if one of the points is all but there.

    Args:
        arm: value, rise and parameters of points, the estimate first.
        level: of the root of the rise.
    """
    values = np.array([p[0] for p in arm])
    roots = np.sqrt(np.maximum([p[1] for p in arm], 0.0))
    along = np.abs(values - values[0])
    inside = int(np.flatnonzero(roots < level)[-1])
    outside = np.flatnonzero(roots >= level)
    if inside == len(arm) - 1 and roots[-1] < (1.0 - NEAR) * level and len(outside):
        inside = int(outside[0]) - 1
    if inside == len(arm) - 1:
        # The last point is all but there.
        place = along[-1] * level / max(roots[-1], (1.0 - NEAR) * level)
    elif np.abs(roots[inside : inside + 2] - level).min() < NEAR * level:
        place = np.interp(level, roots[inside : inside + 2], along[inside : inside + 2])
    else:
        place = _by_cubic(along, roots, level, inside)
    return float(values[0] + np.sign(values[-1] - values[0]) * place)


def _by_cubic(along: np.ndarray, roots: np.ndarray, level: float, inside: int) -> float:
    from scipy.interpolate import PchipInterpolator
    from scipy.optimize import brentq

    curve = PchipInterpolator(along, roots)
    return float(brentq(lambda x: float(curve(x)) - level, along[inside], along[inside + 1]))
