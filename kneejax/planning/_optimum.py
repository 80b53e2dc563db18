"""The best tunnels and tension under constraints, by exact derivatives."""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.optimize import linprog

from kneejax.planning._footprints import alignment
from kneejax.planning._limits import (
    TOLERANCE,
    bounds,
    limits_room,
    missed,
    polygons,
    room_slopes,
)
from kneejax.planning._surgery import CHOICES, Near, Outcome, Surgery
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
    surgery: Surgery,
    base: np.ndarray,
    free: np.ndarray,
    *,
    most: int = MOST_EVALUATIONS,
    starts: int = STARTS,
    seed: int = 0,
) -> Optimum:
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
    return Optimum(
        best, bool(missed(surgery, best)[0] <= TOLERANCE), float(missed(surgery, best)[0]),
        search.count, begin, first.total, followed, ends,
    )  # fmt: skip


def spread_over(
    surgery: Surgery, base: np.ndarray, free: np.ndarray, count: int, seed: int
) -> np.ndarray:
    """Choices over the footprints and the tensions, the base first."""
    lower, upper = bounds(surgery, len(base))
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


class _Search:
    """Evaluations of one search, each made once."""

    def __init__(self, surgery: Surgery, base: np.ndarray, free: np.ndarray, most: int):
        self.surgery, self.base, self.free, self.most = surgery, base, free, most
        self.count, self.known = 0, {}
        self.step = np.tile(STEP, len(base) // len(CHOICES))

    def note(self, outcome: Outcome) -> None:
        """Keep the outcomes of some choices, one by one."""
        for row in range(len(outcome.choices)):
            self.known[outcome.choices[row].tobytes()] = outcome.taken([row])
            self.count += 1

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

    def follow(
        self, start: np.ndarray, most: int, roughly: float
    ) -> tuple[float, np.ndarray]:
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
        offset, by = offsets_of(self.surgery, outcome)
        room, room_by = limits_room(self.surgery, outcome)[0], room_slopes(self.surgery, outcome)
        sides, inside = polygons(self.surgery, len(self.base))
        inside = inside - sides @ outcome.choices[0]
        scale = self.step[self.free]
        by, room_by, sides = (x[:, self.free] * scale for x in (by, room_by, sides))
        rows, size = by.shape
        above = np.block([
            [by, -np.eye(rows), np.zeros((rows, 1))],
            [-by, -np.eye(rows), np.zeros((rows, 1))],
            [-room_by, np.zeros((len(room), rows)), -np.ones((len(room), 1))],
            [sides, np.zeros((len(sides), rows + 1))],
        ])  # fmt: skip
        lower, upper = (
            (x - outcome.choices[0])[self.free] / scale
            for x in bounds(self.surgery, len(self.base))
        )
        low, high = np.maximum(lower, -radius), np.minimum(upper, radius)
        limits = [*zip(np.minimum(low, 0.0), np.maximum(high, 0.0), strict=True)]
        found = linprog(
            np.r_[np.zeros(size), np.ones(rows), _PRICE],
            A_ub=above, b_ub=np.r_[-offset, offset, room, np.maximum(inside, 0.0)],
            bounds=[*limits, *[(0.0, None)] * (rows + 1)],
        )  # fmt: skip
        if found.x is None:
            return np.zeros(len(self.base)), 0.0
        step = np.zeros(len(self.base))
        step[self.free] = found.x[:size] * scale
        return step, self._merit(outcome) - float(found.fun)

    def best(self) -> Outcome:
        """The best of all that is known, found again by the way that a test takes."""
        every = list(self.known.values())
        far = np.array([missed(self.surgery, one)[0] for one in every])
        total = np.array([one.total[0] for one in every])
        kept = far <= TOLERANCE
        order = np.argsort(np.where(kept, total, np.inf) if kept.any() else far)
        for row in order[:_FOUND_AGAIN]:
            again = self.surgery.try_out(every[row].choices, slopes=True)
            same = np.allclose(again.followed.anterior_mm, every[row].followed.anterior_mm,
                               atol=1e-4, equal_nan=True)  # fmt: skip
            if same:
                return again
        return again  # pyright: ignore[reportPossiblyUnboundVariable]


def offsets_of(surgery: Surgery, outcome: Outcome) -> tuple[np.ndarray, np.ndarray]:
    """Offsets of all strain curves of one variant along their alignments `(pairs,)`, and their
    derivative by the choices, `(pairs, choices)`."""
    assert outcome.slopes is not None
    strain, intact = surgery.strain(outcome.followed)[0], surgery.intact_strain
    offsets, slopes = [], []
    for k in range(strain.shape[1]):
        path = alignment(strain[:, k], intact[:, k], surgery.window)
        offsets.append(strain[path[:, 0], k] - intact[path[:, 1], k])
        slopes.append(outcome.slopes["strain"][0, path[:, 0], k])
    return np.concatenate(offsets), np.concatenate(slopes)
