"""How profiles are followed: from a fit, each parameter down and up to where the misfit allows it.

The limit of a profile is the farthest value of a parameter at which the others can still keep chi
squared low enough (D. J. Venzon and S. H. Moolgavkar, Appl. Statist. 37, 87, 1988). An arm goes for
the farthest value at which chi squared has risen by no more than a level: what a linear model at
its last point says is looked at, and the model there says more. No other fit is made on the way. A
step that the knee contradicts is tried again, shorter and with what the arm has seen of curvature,
then without again, in turns: eight knees with 22 parameters take 1,437 looks instead of 2,205, and
none of their 352 arms gives up after 60 (8 did). Whether an arm has arrived is left to the linear
model, which promises too much rather than too little.

Where a valley of the misfit bends, the others cannot make up for a step as the derivatives at one
point say, and an arm that believes them crawls. What it saw of the derivatives elsewhere is kept as
a second-order part of the sum of squares, as NL2SOL does (J. E. Dennis, D. M. Gay and R. E. Welsch,
ACM Trans. Math. Softw. 7, 348, 1981). It costs no evaluation. Of kinks, where a fibre goes slack
or a contact begins, nothing is learned: believed, they end arms early.
"""

__all__ = ["Pace"]

import dataclasses
import enum
from typing import NamedTuple

import numpy as np

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
#: The last step, as a part of the whole way, which is not looked at any more.
_LAST = 0.02
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
    spare: float  # what the other parameters may still take back there, as a part of the rise


class Pace(enum.Enum):
    """Whether a profile is wanted as a curve, or its limits only."""

    FINE = _Steps((0.2, 0.4, 0.6, 0.8, 1.0, 1.15, 1.3), 1.0 / 8.0, 0.003)
    LIMITS = _Steps((1.0,), 1.0 / 4.0, 0.05)


class Arm:
    """One parameter of a fit on its way down or up."""

    def __init__(
        self, values: np.ndarray, index: int, way: float, chi2: float, model: np.ndarray,
        lower: np.ndarray, upper: np.ndarray, level: float, steps: _Steps,
    ):  # fmt: skip
        """Begin at a fit's values `(p,)`, with the linear model there; `way` is 1 or -1."""
        self.values, self.index, self.way, self.best = values, index, way, chi2
        self.lower, self.upper, self.width = lower, upper, upper - lower
        self.level, self.steps, self.part = level, steps, 0
        self.points = [Point(float(values[index]), 0.0, values, 0.0)]
        self.limit, self.end = np.nan, ""
        self._begin(model)
        if self._room() <= 1e-9 * self.width[index]:
            self._stop(BOUND)
        else:
            self._aim()

    def _begin(self, model: np.ndarray) -> None:
        self.active, self.looks, self.shortened = True, 0, 0
        # Curvature is learned all the time, and believed after a step without it has failed.
        self.model, self.linear = model.copy(), model[:-1, :-1].copy()
        self.curvature, self.bent = np.zeros_like(self.linear), False
        self.reach = self.steps.longest

    @property
    def ahead(self) -> np.ndarray:
        """Where the arm looks next, all values `(p,)`."""
        return np.clip(self.values + self.step * self.width, self.lower, self.upper)

    def lost(self) -> None:
        """Note that nothing balances where the arm looked."""
        self.looks += 1
        self.shortened += 1
        if self.shortened > _SHORTENINGS:
            self._stop("no balance beyond")
        else:
            self._shorten(2.0 * _TO * self._half_a_step())

    def look(self, values: np.ndarray, chi2: float, model: np.ndarray) -> bool:
        """Note what was found at values `(p,)`; whether the arm goes there, where it may end."""
        self.looks += 1
        promised = squares(self.model, self.step)
        worth = self._gain(chi2) >= _WORTH * self._gain(promised)
        self._learn(values, model, worth)
        if not worth:
            self._shorten(self._half_a_step())
            return False
        rise, wrong = chi2 - self.best, abs(chi2 - promised)
        if wrong < _AGREES * self._height**2:
            self.reach = min(2.0 * self.reach, self.steps.longest)
        elif wrong > _CONTRADICTS * self._height**2:
            self.reach = self._half_a_step()
        self.values = values
        spare = self._aim()
        self.points.append(Point(float(values[self.index]), float(rise), values, spare))
        self._judge()
        return True

    def reopen(self, end: Point, model: np.ndarray | None) -> None:
        """Walk on from a point beyond the limit; end there where there is no model."""
        before = [p for p in self.points if self.way * (end.value - p.value) > 0]
        self.points = [*(p for p in before if p.rise < self.level**2), end]
        self.limit = np.nan
        if model is None:
            self._stop("another valley goes farther")
            return
        self._begin(model)
        self.values, self.part = end.parameters, self.steps.parts.index(1.0)
        self._aim()

    def curve(self) -> list[Point]:
        """Points of the profile, nearest the fit first."""
        first, spare = self.points[0].value, self.steps.spare * self.level**2
        good = {p.value: p for p in self.points if p.spare <= spare or p.rise < -BETTER}
        return sorted(good.values(), key=lambda point: abs(point.value - first))

    def _learn(self, values: np.ndarray, there: np.ndarray, worth: bool) -> None:
        """Learn from a look, and move the model there if it was worth going."""
        change = there[:-1, -1] - self.model[:-1, -1]
        if worth:
            self.model, self.linear = there.copy(), there[:-1, :-1]
        self.bent = not worth and not self.bent
        went = (values - self.values) / self.width
        self.curvature = learned(self.curvature, self.linear, went, change)
        hessian = self.linear
        if self.bent:
            hessian = self.linear + self.curvature
            if not is_convex(hessian, self.linear):
                hessian, self.curvature = self.linear, np.zeros_like(self.linear)
        self.model[:-1, :-1] = hessian

    def _gain(self, chi2: float) -> float:
        """What a step is worth that leads to a chi squared: how far, less what it is too high."""
        allowed, here = self.best + self._height**2, self.model[-1, -1]
        if self.descends:
            return here - chi2
        along = self.way * self.step[self.index]
        worse = max(chi2 - allowed, 0.0) - max(here - allowed, 0.0)
        return self.price * along - _PENALTY * worse

    def _half_a_step(self) -> float:
        """Half of how far the last step led, or was allowed to."""
        return 0.5 * min(float(np.max(np.abs(self.step))), self.reach)

    @property
    def _height(self) -> float:
        """Root of the rise that the arm goes for."""
        return self.steps.parts[self.part] * self.level

    def _aim(self) -> float:
        """Choose the next step; what the other parameters can take back of the rise here."""
        i, reach, height = self.index, self.reach, self._height
        low, high = ((bound - self.values) / self.width for bound in (self.lower, self.upper))
        low[i], high[i] = max(low[i], -reach), min(high[i], reach)
        most, chi2 = self.best + height**2, self.model[-1, -1]
        damping = (_DAMPING * height / reach) ** 2
        ahead = farthest(self.model, i, self.way, most, low, high, damping)
        # Where the model promises a better fit than where the arm began, that is looked for.
        lower = len(self.points) > 1 and chi2 - ahead.spare < self.best - BETTER
        self.descends = lower or (chi2 <= most and self._at_bound)
        # Steps are in parts of the bounds' width.
        self.step = ahead.refit if self.descends else ahead.step
        self.price = ahead.price
        return ahead.spare

    def _judge(self) -> None:
        """Whether the arm is at its level, at its bound, or given up."""
        point = self.points[-1]
        while self.active and self._arrives():
            if self.steps.parts[self.part] == 1.0:
                self.limit = self.ahead[self.index]
            self.looks = 0
            self.active = self.part + 1 < len(self.steps.parts)
            if self.active:
                self.part += 1
                self._aim()
        open_ = self._at_bound and point.rise <= self._height**2
        spare = self.steps.spare * self.level**2
        if open_ and point.spare <= spare and point.rise - point.spare >= -BETTER:
            self._stop(BOUND)
        elif self.looks > _MOST:
            self._stop(f"given up after {_MOST} steps")

    def _arrives(self) -> bool:
        """Whether the level is a short step away, and not behind a bound."""
        height, point, i = self._height, self.points[-1], self.index
        there = squares(self.model, self.step) - self.best
        step = self.step[i] * self.width[i]
        short = abs(step) <= _LAST * abs(point.value + step - self.points[0].value)
        # A short reach hides how far the others are from where they should be.
        level = abs(there - height**2) <= self.steps.spare * height**2
        spare = point.spare <= self.steps.spare * height**2 and self.reach > _FREE
        return bool(short and level and spare and not self.descends)

    def _shorten(self, reach: float) -> None:
        self.reach = reach
        if self.looks > _MOST:
            self._stop(f"given up after {_MOST} steps")
        elif self.reach < _SHORTEST:
            self._stop("no step leads on")
        else:
            self._aim()

    def _room(self) -> float:
        """How far the parameter is from the bound."""
        i, value = self.index, self.values[self.index]
        return float(self.upper[i] - value if self.way > 0 else value - self.lower[i])

    @property
    def _at_bound(self) -> bool:
        return bool(self._room() <= 1e-12 * self.width[self.index])

    def _stop(self, why: str) -> None:
        self.active = False
        if np.isnan(self.limit):
            self.end = why


class Farthest(NamedTuple):
    """What a linear model says."""

    step: np.ndarray  # of all values, to where the one is farthest, `(p,)`
    # By how much the sum of squares grows there with the value, however well the others make up for
    # it; zero where the sum is too large everywhere.
    price: float
    refit: np.ndarray  # of the others where the one stays, `(p,)`
    spare: float  # by how much that lowers the sum of squares


def products(residual: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Products of slopes `(points, r, p)` and, last, residuals: `(points, p + 1, p + 1)`."""
    columns = np.concatenate([slope, residual[..., None]], axis=-1)
    return np.swapaxes(columns, 1, 2) @ columns


def squares(model: np.ndarray, step: np.ndarray) -> float:
    """Sum of squares that a model promises after a step `(p,)`."""
    ahead = np.append(step, 1.0)
    return float(ahead @ model @ ahead)


def farthest(
    model: np.ndarray, i: int, way: float, most: float, low: np.ndarray, high: np.ndarray,
    damping: float,
) -> Farthest:  # fmt: skip
    """Lead value `i` up or down (`way` is 1 or -1) until a model of `products` reaches `most`, the
    others making up for it, by steps between `low` and `high`, `(p,)`. `damping` counts for the
    square of a step: values that change nothing stay."""
    damped = model.copy()
    damped[np.diag_indices(len(low))] += damping
    here = np.arange(len(low)) == i
    step, price = _led(damped, i, way, most, low, high)
    stays = np.where(here, 0.0, low), np.where(here, 0.0, high)
    refit, _ = _led(damped, i, way, most, *stays)
    return Farthest(step, price, refit, float(model[-1, -1] - squares(model, refit)))


def _led(
    model: np.ndarray, i: int, way: float, most: float, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, float]:
    """The step, and the price. Values that would leave the box are stopped one by one."""
    size = len(low)
    step, held, freed, price = np.zeros(size), low >= high, np.zeros(size, bool), 0.0
    held[i] = False
    for _ in range(3 * size):
        others = ~held
        others[i] = False
        moved = np.append(np.where(held, step, 0.0), 1.0)
        # What is held is part of the residual.
        left = model[:size] @ moved
        made_up = np.linalg.solve(
            model[np.ix_(others, others)], np.stack([model[:size][others, i], left[others]], 1)
        )
        steep, half = np.array([model[i, i], left[i]]) - model[i, :size][others] @ made_up
        rest = moved @ model @ moved - left[others] @ made_up[:, 1]
        root = np.sqrt(max(half**2 - steep * (rest - most), 0.0))
        price = 2.0 * root
        step[i] = np.clip((way * root - half) / steep, low[i], high[i])
        step[others] = -made_up @ np.array([step[i], 1.0])
        beyond = np.maximum(low - step, step - high) / np.maximum(high - low, 1e-300)
        beyond[held], beyond[i] = 0.0, 0.0
        worst = int(np.argmax(beyond))
        if beyond[worst] > 0.0:
            step[worst] = np.clip(step[worst], low[worst], high[worst])
            held[worst] = True
            continue
        # What was stopped and would lower the sum on its way back is let go, once.
        uphill = model[:size] @ np.append(step, 1.0)
        wrong = held & ~freed & (low < high) & np.where(step >= high, uphill > 0, uphill < 0)
        if not wrong.any():
            break
        held, freed = held & ~wrong, freed | wrong
    return np.clip(step, low, high), price


#: A change of the gradient along a step below this says nothing of curvature.
_SILENT = 1e-12
#: A sum of squares that is flatter than this part of the linear model's has no farthest point.
_FLAT = 1e-9
#: More curvature than so many times the linear model's is no curvature but a kink that was passed.
_KINK = 3.0


def learned(
    curvature: np.ndarray, linear: np.ndarray, step: np.ndarray, change: np.ndarray
) -> np.ndarray:
    """Second-order part of half a Hessian, `(p, p)`, changed least, in the metric of what was seen,
    to explain how half the gradient changed along a step, `(p,)`, beside the `linear` products; the
    old one where that falls, or a kink was passed."""
    along = float(step @ change)
    if along <= _SILENT:
        return curvature
    wanted = change - linear @ step
    if abs(step @ wanted) > _KINK * float(step @ linear @ step):
        return curvature
    had = step @ curvature @ step
    # An old part that is too large for what is seen now would outlive it.
    kept = curvature * (min(1.0, abs(step @ wanted) / abs(had)) if had else 1.0)
    missing = wanted - kept @ step
    outer = np.outer(missing, change) / along
    return kept + outer + outer.T - (missing @ step) * np.outer(change, change) / along**2


def is_convex(hessian: np.ndarray, linear: np.ndarray) -> bool:
    """Whether a Hessian is positive, in the scale of the linear model's, both `(p, p)`."""
    scale = np.sqrt(np.diag(linear))
    return bool(np.linalg.eigvalsh(hessian / np.outer(scale, scale))[0] > _FLAT)
