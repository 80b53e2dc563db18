"""How profiles are followed: from a fit, each parameter down and up to where the misfit allows it.

An arm goes for the farthest value at which chi squared has risen by no more than a level: what a
linear model at its last point says is looked at, and the model there says more. No other fit is
made on the way. A step that the knee contradicts is tried again, shorter and with what the arm has
seen of curvature, then without again, in turns: eight knees with 22 parameters take 1,437 looks
instead of 2,205, and none of their 352 arms gives up after 60 (8 did). Whether an arm has arrived
is left to the linear model, which promises too much rather than too little.
"""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from kneejax.inference.intervals._farthest import farthest, is_convex, learned, products, squares
from kneejax.statics import Slopes

#: Part of the limit's distance, and of the root of the rise, by which points beyond it count.
NEAR = 0.05
#: Why an arm ends without a limit that is no failure: it has come to its bound.
BOUND = "its bound"
#: Better by more than this than the fit: the fit was not the best there is.
BETTER = 0.01
#: A step beyond which there is no balance is shortened so often, each time to this part: a search
#: that finds none costs tens of times what one costs that does.
_SHORTENINGS, _TO = 3, 0.25
#: Points of an arm from one level to the next before it is given up.
_MOST = 60
#: Model and knee agree, and contradict each other: differences of chi squared in parts of its rise.
_AGREES, _CONTRADICTS = 0.25, 0.5
#: A shorter step, as a part of the bounds' width, tells nothing: at a kink, or in a search's own
#: errors, steps become ever shorter, by their square where the model is damped most.
_SHORTEST = 1e-6
#: A step of other parameters as long as the reach counts like such a part of the level.
_DAMPING = 0.03
#: With a longer reach than this, parts of the bounds' width, the others go where they want to.
_FREE = 1.0 / 256.0
#: Part of what the model promises that a step must be worth.
_WORTH = 0.05
#: Weight of a chi squared that is too high; above one, what is worth most is the limit.
_PENALTY = 1.25


class Point(NamedTuple):
    """Where an arm has been."""

    value: float  # of the arm's parameter
    rise: float  # of chi squared above that of the fit
    parameters: np.ndarray  # all of them, `(p,)`
    spare: float  # what the others could still take back of the rise


@dataclasses.dataclass(frozen=True)
class _Steps:
    """How an arm walks."""

    # Levels one after the other, in parts of the root of the rise at the limit.
    parts: tuple[float, ...]
    longest: float  # step of any parameter, as a part of the bounds' width
    equilibrium: float  # the last step, as a part of the whole way, which is not looked at any more
    spare: float  # what the other parameters may still take back there, as a part of the rise


class Pace(enum.Enum):
    """Whether a profile is wanted as a curve, or its limits only."""

    FINE = _Steps((0.2, 0.4, 0.6, 0.8, 1.0, 1.15, 1.3), 1.0 / 8.0, 0.02, 0.003)
    LIMITS = _Steps((1.0,), 1.0 / 4.0, 0.02, 0.05)


class Arms:
    """From each fit, each parameter down (even rows) and up (odd rows)."""

    def __init__(
        self, fits: Slopes, residual: np.ndarray, slope: np.ndarray, lower: np.ndarray,
        upper: np.ndarray, level: float, pace: Pace,
    ):  # fmt: skip
        count, self.size = fits.values.shape
        arms = 2 * self.size
        self.fit_of = np.repeat(np.arange(count), arms)
        self.index = np.tile(np.repeat(np.arange(self.size), 2), count)
        self.way = np.tile([-1.0, 1.0], count * self.size)
        self.near = fits.take(self.fit_of)
        self.best = np.sum(residual**2, axis=1)[self.fit_of]
        self.lower, self.upper, self.width = lower, upper, upper - lower
        self.level, self.steps = level, pace.value
        self.model = products(residual, slope * self.width)[self.fit_of]
        # Curvature is learned all the time, and believed after a step without it has failed.
        self.linear = self.model[:, :-1, :-1].copy()
        self.curvature, self.bent = np.zeros_like(self.linear), np.zeros(len(self.model), bool)
        self.points = [
            [Point(float(fits.values[fit, i]), 0.0, fits.values[fit], 0.0)]
            for fit, i in zip(self.fit_of, self.index, strict=True)
        ]
        rows = count * arms
        self.limit, self.end = np.full(rows, np.nan), [""] * rows
        self.active, self.part = np.ones(rows, bool), np.zeros(rows, int)
        self.shortened, self.looks = np.zeros(rows, int), np.zeros(rows, int)
        self.reach = np.full(rows, self.steps.longest)
        # Steps are in parts of the bounds' width.
        self.step, self.price = np.zeros((rows, self.size)), np.zeros(rows)
        self.descends = np.zeros(rows, bool)
        for row in range(rows):
            if self._room(row) <= 1e-9 * self.width[self.index[row]]:
                self._stop(row, BOUND)
            else:
                self._aim(row)

    def trials(self) -> tuple[np.ndarray, np.ndarray]:
        """Arms that walk, and where they look next."""
        rows = np.flatnonzero(self.active)
        return rows, self._after(rows)

    def advance(
        self, rows: np.ndarray, found: Slopes, residual: np.ndarray, slope: np.ndarray
    ) -> None:
        """Note what was found; end arms that have gone far enough, or can go no farther."""
        chi2 = np.sum(residual**2, axis=1)
        lost = ~(np.isfinite(chi2) & np.isfinite(slope).all(axis=(1, 2)))
        good = np.flatnonzero(~lost)
        models = dict(zip(good, products(residual[good], slope[good] * self.width), strict=True))
        for k, row in enumerate(rows):
            self.looks[row] += 1
            promised = squares(self.model[row], self.step[row])
            if lost[k]:
                self._shorten(row, lost=True)
                continue
            worth = self._gain(row, chi2[k]) >= _WORTH * self._gain(row, promised)
            self._look_back(row, found.values[k], models[k], worth)
            if not worth:
                self._shorten(row, lost=False)
                continue
            rise, wrong = chi2[k] - self.best[row], abs(chi2[k] - promised)
            if wrong < _AGREES * self._height(row) ** 2:
                self.reach[row] = min(2.0 * self.reach[row], self.steps.longest)
            elif wrong > _CONTRADICTS * self._height(row) ** 2:
                self.reach[row] = self._half_a_step(row)
            self.near.put([row], found.take([k]))
            spare = self._aim(row)
            i = self.index[row]
            point = Point(float(found.values[k, i]), float(rise), found.values[k], spare)
            self.points[row].append(point)
            self._judge(row)

    def _look_back(self, row: int, values: np.ndarray, there: np.ndarray, worth: bool) -> None:
        """Learn from a look, and move the model there if it was worth going."""
        change = there[:-1, -1] - self.model[row, :-1, -1]
        if worth:
            self.model[row], self.linear[row] = there, there[:-1, :-1]
        self.model[row, :-1, :-1] = self.linear[row]
        self.bent[row] = not worth and not self.bent[row]
        went = (values - self.near.values[row]) / self.width
        self.curvature[row] = learned(self.curvature[row], self.linear[row], went, change)
        if self.bent[row]:
            hessian = self.linear[row] + self.curvature[row]
            if not is_convex(hessian, self.linear[row]):
                hessian, self.curvature[row] = self.linear[row], 0.0
            self.model[row, :-1, :-1] = hessian

    def leave(self, rows: np.ndarray) -> None:
        """End all arms of the fits to which some arms belong that have found a better one."""
        better = [row for row in rows if self.points[row][-1].rise < -BETTER]
        self.active[np.isin(self.fit_of, self.fit_of[better])] = False

    def lowest(self) -> np.ndarray:
        """Of each fit, the arm whose last point is lowest, `(fits,)`."""
        last = np.array([points[-1].rise for points in self.points]).reshape(-1, 2 * self.size)
        return np.argmin(last, axis=1) + 2 * self.size * np.arange(len(last))

    def too_narrow(self) -> Iterator[tuple[int, int, Point]]:
        """Arms whose limits leave out what other arms of the same fit have seen: their rows, those
        of the others, and points of these, as likely as what lies inside."""
        highest = ((1.0 - NEAR) * self.level) ** 2
        for rows in np.arange(len(self.active)).reshape(-1, 2 * self.size):
            inside = [(row, p) for row in rows for p in self.points[row] if p.rise < highest]
            if any(point.rise < -BETTER for _, point in inside):
                continue  # The fit itself has to move first.
            values = np.array([point.parameters for _, point in inside])
            for row in rows:
                limit, i, way = self.limit[row], self.index[row], self.way[row]
                if self.end[row] or not np.isfinite(limit):
                    continue
                donor, point = inside[int(np.argmax(way * values[:, i]))]
                value = float(point.parameters[i])
                if way * (value - limit) > NEAR * abs(limit - self.points[row][0].value):
                    yield row, donor, point._replace(value=value)

    def reopen(
        self, rows: Sequence[int], points: Sequence[Point], there: Slopes, residual: np.ndarray,
        slope: np.ndarray, close: bool,
    ) -> None:  # fmt: skip
        """Walk on from points beyond the limits, with the balances, residuals and slopes there.

        Where `close`, the arms end there instead, without a limit; so do those that find no
        balance.
        """
        lost = np.atleast_1d(~np.isfinite(there.q).all(axis=(1, 2)))
        models = products(residual, slope * self.width)
        for k, (row, end) in enumerate(zip(rows, points, strict=True)):
            self.points[row] = [
                p for p in self.points[row]
                if self.way[row] * (end.value - p.value) > 0 and p.rise < self.level**2
            ] + [end]  # fmt: skip
            self.limit[row], self.looks[row], self.shortened[row] = np.nan, 0, 0
            if lost[k] or close:
                self._stop(row, "another valley goes farther")
                continue
            self.near.put([row], there.take([k]))
            self.model[row] = models[k]
            self.linear[row] = models[k][:-1, :-1]
            self.curvature[row], self.bent[row] = 0.0, False
            self.reach[row], self.active[row] = self.steps.longest, True
            self.part[row] = self.steps.parts.index(1.0)
            self._aim(row)

    def curve(self, row: int) -> list[Point]:
        """Points of an arm's profile, nearest the fit first."""
        first, spare = self.points[row][0].value, self.steps.spare * self.level**2
        good = {p.value: p for p in self.points[row] if p.spare <= spare or p.rise < -BETTER}
        return sorted(good.values(), key=lambda point: abs(point.value - first))

    def _after(self, rows: np.ndarray) -> np.ndarray:
        """All parameters after the next step, `(rows, p)`."""
        ahead = self.near.values[rows] + self.step[rows] * self.width
        return np.clip(ahead, self.lower, self.upper)

    def _at_bound(self, row: int) -> bool:
        return bool(self._room(row) <= 1e-12 * self.width[self.index[row]])

    def _gain(self, row: int, chi2: float) -> float:
        """What a step is worth that leads to a chi squared: how far, less what it is too high."""
        allowed = self.best[row] + self._height(row) ** 2
        here = self.model[row, -1, -1]
        if self.descends[row]:
            return here - chi2
        along = self.way[row] * self.step[row, self.index[row]]
        worse = max(chi2 - allowed, 0.0) - max(here - allowed, 0.0)
        return self.price[row] * along - _PENALTY * worse

    def _half_a_step(self, row: int) -> float:
        """Half of how far the last step led, or was allowed to."""
        return 0.5 * min(float(np.max(np.abs(self.step[row]))), self.reach[row])

    def _height(self, row: int) -> float:
        """Root of the rise that the arm goes for."""
        return self.steps.parts[self.part[row]] * self.level

    def _aim(self, row: int) -> float:
        """Choose the next step; what the other parameters can take back of the rise here."""
        i, reach, height = self.index[row], self.reach[row], self._height(row)
        low, high = (
            (bound - self.near.values[row]) / self.width for bound in (self.lower, self.upper)
        )
        low[i], high[i] = max(low[i], -reach), min(high[i], reach)
        most, chi2 = self.best[row] + height**2, self.model[row, -1, -1]
        damping = (_DAMPING * height / reach) ** 2
        ahead = farthest(self.model[row], i, self.way[row], most, low, high, damping)
        # Where the model promises a better fit than where the arm began, that is looked for.
        lower = len(self.points[row]) > 1 and chi2 - ahead.spare < self.best[row] - BETTER
        self.descends[row] = lower or (chi2 <= most and self._at_bound(row))
        self.step[row] = ahead.refit if self.descends[row] else ahead.step
        self.price[row] = ahead.price
        return ahead.spare

    def _judge(self, row: int) -> None:
        """Whether an arm is at its level, at its bound, or given up."""
        point = self.points[row][-1]
        while self.active[row] and self._equilibrium_of(row):
            if self.steps.parts[self.part[row]] == 1.0:
                self.limit[row] = self._after(np.array([row]))[0, self.index[row]]
            self.looks[row] = 0
            self.active[row] = self.part[row] + 1 < len(self.steps.parts)
            self.part[row] += self.active[row]
            if self.active[row]:
                self._aim(row)
        open_ = self._at_bound(row) and point.rise <= self._height(row) ** 2
        spare = self.steps.spare * self.level**2
        if open_ and point.spare <= spare and point.rise - point.spare >= -BETTER:
            self._stop(row, BOUND)
        elif self.looks[row] > _MOST:
            self._stop(row, f"given up after {_MOST} steps")

    def _equilibrium_of(self, row: int) -> bool:
        """Whether the level is a short step away, and not behind a bound."""
        height, point, i = self._height(row), self.points[row][-1], self.index[row]
        there = squares(self.model[row], self.step[row]) - self.best[row]
        step = self.step[row, i] * self.width[i]
        whole_way = abs(point.value + step - self.points[row][0].value)
        short = abs(step) <= self.steps.equilibrium * whole_way
        # A short reach hides how far the others are from where they should be.
        level = abs(there - height**2) <= self.steps.spare * height**2
        spare = point.spare <= self.steps.spare * height**2 and self.reach[row] > _FREE
        return bool(short and level and spare and not self.descends[row])

    def _shorten(self, row: int, lost: bool) -> None:
        self.shortened[row] += lost
        if self.shortened[row] > _SHORTENINGS:
            self._stop(row, "no balance beyond")
            return
        self.reach[row] = 2.0 * _TO * self._half_a_step(row) if lost else self._half_a_step(row)
        if self.looks[row] > _MOST:
            self._stop(row, f"given up after {_MOST} steps")
        elif self.reach[row] < _SHORTEST:
            self._stop(row, "no step leads on")
        else:
            self._aim(row)

    def _room(self, row: int) -> float:
        """How far the arm's parameter is from the bound."""
        i, value = self.index[row], self.near.values[row, self.index[row]]
        return float(self.upper[i] - value if self.way[row] > 0 else value - self.lower[i])

    def _stop(self, row: int, why: str) -> None:
        self.active[row] = False
        if np.isnan(self.limit[row]):
            self.end[row] = why
