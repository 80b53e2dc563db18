"""The best tunnels and tension under constraints, by exact derivatives."""

__all__ = ["MOST_EVALUATIONS", "STARTS", "Optimum", "optimise"]

import dataclasses

import numpy as np
from scipy.optimize import linprog

from kneejax.planning._footprints import offsets
from kneejax.planning._surgery import (
    CHOICES,
    TOLERANCE,
    Near,
    Outcome,
    Surgery,
    bounds,
    limits_room,
    missed,
    polygons,
    ranked,
)
from kneejax.statics import converged

#: Evaluations in all, and how many starts are looked at before the best of them are followed.
MOST_EVALUATIONS, STARTS = 60, 8
#: Starts are followed, the best first, until a step promises less than this part of the strain
#: distance; the evaluations kept for the best of them, and how many of all are found again.
_ROUGHLY, _TO_POLISH, _FOUND_AGAIN = 0.05, 20, 3
#: What counts as one step of each choice: 1 mm, 10 N.
STEP = np.array([1.0, 1.0, 1.0, 1.0, 10.0])
#: Farthest that a balance is predicted from that of other choices, and that a linear model is
#: believed at first, in such steps; where it is believed no more.
_NEAR, _BELIEVED, _NOTHING = 3.0, 2.0, 1e-4
#: What missing a limit by all of it costs, as strain distance.
_PRICE = 20.0
#: Of strain distance, below which a step is not worth an evaluation.
_GAINED = 1e-6
#: Part of what the linear model promised below which a step is not taken, is shortened, and above
#: which the next one may be longer.
_TAKEN, _SHORTER, _LONGER = 0.05, 0.25, 0.7


@dataclasses.dataclass(frozen=True)
class Optimum:
    """What was found.

    Attributes:
        outcome: of one variant, with derivatives.
        feasible: whether it keeps all limits.
        missed: by how much the worst limit is missed, as a part of it; 0 where all are kept.
        evaluations: knees that were put through the protocol.
        starts: choices that were looked at first, `(starts, choices)`.
        start_totals: their strain distances.
        followed: rows of the starts that were followed.
        ends: strain distance where each of these ended, roughly; infinite where no limit was kept.
    """

    outcome: Outcome
    feasible: bool
    missed: float
    evaluations: int
    starts: np.ndarray
    start_totals: np.ndarray
    followed: np.ndarray
    ends: np.ndarray


def optimise(
    surgery: Surgery, base: np.ndarray, free: np.ndarray, *, most: int = MOST_EVALUATIONS,
    starts: int = STARTS, seed: int = 0,
) -> Optimum:  # fmt: skip
    """Find the choices whose strain curves are nearest to the intact knee's.

    Args:
        surgery: with its limits, which are constraints.
        base: choices where the search begins, and values of what is not free.
        free: which of them are free, `(choices,)`, true or false.
        most: evaluations in all.
        starts: of them, spread over the footprints, looked at first; the first one is `base`.
        seed: of the spread.

    Returns:
        The best of all evaluations.
    """
    search = _Search(surgery, np.asarray(base, float), np.asarray(free, bool), most)
    begin = spread_over(surgery, search.base, search.free, starts, seed)
    first = surgery.try_out(begin, slopes=True)
    search.note(first)
    far = missed(surgery, first)
    order = np.lexsort((np.nan_to_num(first.total, nan=np.inf), np.round(far, 3)))
    ends, lasts, finish = [], [], min(_TO_POLISH, search.left // 2)
    for row in order[:-1] if len(order) > 1 else order:
        if search.left <= finish:
            break
        least, last = search.follow(begin[row], search.left - finish, _ROUGHLY)
        ends.append(least)
        lasts.append(last)
    followed, ends = order[: len(ends)], np.array(ends)
    for row in np.argsort(ends):
        if search.left:
            search.follow(lasts[row], search.left, 0.0)
    best = search.best()
    far = float(missed(surgery, best)[0])
    return Optimum(best, far <= TOLERANCE, far, search.count, begin, first.total, followed, ends)


def spread_over(
    surgery: Surgery, base: np.ndarray, free: np.ndarray, count: int, seed: int
) -> np.ndarray:
    """Choices over the footprints and the tensions, the base first."""
    lower, upper = bounds(surgery)
    draw = np.random.default_rng(seed)
    # A Latin hypercube: of each choice every part of its range once.
    parts = draw.permuted(np.tile(np.arange(count), (len(base), 1)), axis=1).T
    cube = (parts + draw.random(parts.shape)) / count
    # Within the inscribed square of an ellipse every corner is inside.
    within = np.where(np.arange(len(base)) % len(CHOICES) < 4, np.sqrt(0.5), 1.0)
    middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower) * within
    spread = np.where(free, middle + (2.0 * cube - 1.0) * half, base)
    spread[0] = base
    return spread


class Linear:
    """What one variant, an outcome with derivatives, does as a linear model of a step of its free
    choices, in units of `STEP`.

    Its strain distance has corners where curves cross, and its limits have others, so the best step
    is a linear programme. `by` and `room_by` are the derivatives of `offset`, of all strain curves
    along their alignments, and of `room`, of graft forces and laxity; polygons stand for the
    footprints, `sides @ step <= inside`.
    """

    def __init__(self, surgery: Surgery, outcome: Outcome, free: np.ndarray):
        assert outcome.slopes is not None
        here, limits = outcome.choices[0], surgery.limits
        self.free, self.scale = free, np.tile(STEP, len(free) // len(CHOICES))[free]
        strain, by_strain = surgery.strain(outcome.followed)[0], outcome.slopes["strain"][0]
        self.offset, by = offsets(strain, by_strain, surgery.intact_strain, surgery.window)
        sides, inside = polygons(surgery)
        graft = outcome.slopes["graft_N"][0].reshape(-1, len(free)) / limits.graft_N
        off = outcome.slopes["laxity_mm"][0] / limits.band_mm
        self.by, self.room_by, self.sides = (
            x[:, free] * self.scale for x in (by, np.vstack([-graft, -off, off]), sides)
        )
        self.room = limits_room(surgery, outcome)[0]
        self.inside = np.maximum(inside - sides @ here, 0.0)
        self.ends = [(x - here)[free] / self.scale for x in bounds(surgery)]

    def best_step(
        self, radius: float, costs: np.ndarray, above: np.ndarray, limits: np.ndarray, more: list
    ) -> tuple[np.ndarray, float | None]:
        """The step within a radius that costs least, `(choices,)`, and what it costs; no step and
        None where there is none.

        Columns of `above`, whose products are at most `limits`, are those of the step and of the
        further unknowns that have costs, between the pairs of `more`.
        """
        low, high = np.maximum(self.ends[0], -radius), np.minimum(self.ends[1], radius)
        own = [*zip(np.minimum(low, 0.0), np.maximum(high, 0.0), strict=True)]
        every = np.r_[np.zeros(len(own)), costs]
        found = linprog(every, A_ub=above, b_ub=limits, bounds=[*own, *more])
        step = np.zeros(len(self.free))
        if found.x is None:
            return step, None
        step[self.free] = found.x[: len(own)] * self.scale
        return step, float(found.fun)


class _Search:
    """Evaluations of one search, each made once."""

    def __init__(self, surgery: Surgery, base: np.ndarray, free: np.ndarray, most: int):
        self.surgery, self.base, self.free, self.most = surgery, base, free, most
        self.count, self.known = 0, {}
        self.step = np.tile(STEP, len(base) // len(CHOICES))

    def note(self, outcome: Outcome) -> None:
        """Keep the outcomes of some choices, one by one."""
        for row, choices in enumerate(outcome.choices):
            self.known[choices.tobytes()] = outcome.taken([row])
        self.count += len(outcome.choices)

    def at(self, choices: np.ndarray) -> Outcome:
        """The outcome of some choices."""
        key = choices.tobytes()
        if key not in self.known:
            self.note(self.surgery.try_out(choices, slopes=True, near=self._near(choices)))
        return self.known[key]

    def _near(self, choices: np.ndarray) -> Near | None:
        """Balances of the nearest choices that are known, if they are near enough."""
        every = [one for one in self.known.values() if converged(one.followed.status).all()]
        away = [np.abs((one.choices[0] - choices) / self.step).max() for one in every]
        if not away or min(away) > _NEAR:
            return None
        return every[int(np.argmin(away))].near

    @property
    def left(self) -> int:
        """Evaluations."""
        return self.most - self.count

    def follow(self, start: np.ndarray, most: int, roughly: float) -> tuple[float, np.ndarray]:
        """The least strain distance with all limits kept (infinite without) on the way down from a
        start, by so many evaluations at `most`, and the last choices.

        The strain distance is a sum of absolute offsets, which has corners where curves cross:
        quasi-Newton methods crawl there. With exact derivatives of every offset and limit the best
        step of the linear model is a linear programme, solved within a trust region; one that
        betters less than the part `roughly` of the distance is not worth it.
        """
        most = self.count + most
        here, radius = self.at(start), _BELIEVED
        least = here.total[0] if missed(self.surgery, here)[0] <= TOLERANCE else np.inf
        while self.count < most and radius > _NOTHING and np.isfinite(self._merit(here)):
            step, promised = self._step(here, radius)
            if promised < max(_GAINED, roughly * here.total[0]):
                break
            there = self.at(here.choices[0] + step)
            gained = (self._merit(here) - self._merit(there)) / promised
            size = float(np.abs(step / self.step).max())
            if not gained > _SHORTER:
                radius = 0.4 * size
            elif gained > _LONGER:
                radius = max(radius, 2.0 * size)
            if gained > _TAKEN:
                here = there
                if missed(self.surgery, here)[0] <= TOLERANCE:
                    least = min(least, here.total[0])
        return float(least), here.choices[0]

    def _merit(self, outcome: Outcome) -> float:
        return float(outcome.total[0] + _PRICE * missed(self.surgery, outcome)[0])

    def _step(self, outcome: Outcome, radius: float) -> tuple[np.ndarray, float]:
        """The best step of the linear model `(choices,)`, and how much it promises."""
        model = Linear(self.surgery, outcome, self.free)
        (rows, _), room = model.by.shape, len(model.room)
        above = np.block([
            [model.by, -np.eye(rows), np.zeros((rows, 1))],
            [-model.by, -np.eye(rows), np.zeros((rows, 1))],
            [-model.room_by, np.zeros((room, rows)), -np.ones((room, 1))],
            [model.sides, np.zeros((len(model.sides), rows + 1))],
        ])  # fmt: skip
        limits = np.r_[-model.offset, model.offset, model.room, model.inside]
        costs = np.r_[np.ones(rows), _PRICE]
        step, cost = model.best_step(radius, costs, above, limits, [(0.0, None)] * (rows + 1))
        return step, 0.0 if cost is None else self._merit(outcome) - cost

    def best(self) -> Outcome:
        """The best of all that is known, found again by the way that a test takes."""
        every = [*self.known.values()]
        far, total = np.array([(missed(self.surgery, x)[0], x.total[0]) for x in every]).T
        for row in ranked(far, total)[:_FOUND_AGAIN]:
            again = self.surgery.try_out(every[row].choices, slopes=True)
            own, its = every[row].followed.anterior_mm, again.followed.anterior_mm
            if np.allclose(its, own, atol=1e-4, equal_nan=True):
                return again
        return again  # pyright: ignore[reportPossiblyUnboundVariable]
