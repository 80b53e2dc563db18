"""The best tunnels and tension under constraints, by exact derivatives."""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.optimize import minimize

from kneejax.planning._surgery import CHOICES, Near, Outcome, Surgery
from kneejax.statics import converged

#: Evaluations in all, and how many starts are looked at before the best of them are followed.
MOST_EVALUATIONS, STARTS = 60, 8
#: How many of the starts are followed.
_FOLLOWED = 3
#: By how much a constraint may be missed, as a part of its limit.
_TOLERANCE = 1e-6
#: What counts as one step of each choice: 1 mm, 10 N.
_STEP = np.array([1.0, 1.0, 1.0, 1.0, 10.0])
#: Farthest that a balance is predicted from that of other choices, in such steps.
_NEAR = 3.0


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
        ends: strain distance where each of these ended; infinite where no limit was kept.
    """

    outcome: Outcome
    feasible: bool
    missed: float
    evaluations: int
    starts: np.ndarray
    start_totals: np.ndarray
    followed: np.ndarray
    ends: np.ndarray


def missed(surgery: Surgery, outcome: Outcome) -> np.ndarray:
    """By how much each variant misses its worst limit, as a part of that, `(v,)`.

    Args:
        surgery: with its limits.
        outcome: of any choices.

    Returns:
        0 where all limits are kept; infinite where the knee has no balance somewhere.
    """
    return np.maximum(excess(surgery, outcome), 0.0)


def excess(surgery: Surgery, outcome: Outcome) -> np.ndarray:
    """As `missed`, but negative where all limits are kept: by how much there is room, `(v,)`."""
    worst = -_room(surgery, outcome).min(axis=1)
    known = np.isfinite(outcome.total) & converged(outcome.status) & np.isfinite(worst)
    return np.where(known, worst, np.inf)


def best_of(surgery: Surgery, outcome: Outcome) -> int:
    """The variant of the least strain distance among those that keep all limits; where none does,
    the one that misses them least."""
    far = missed(surgery, outcome)
    kept = far <= _TOLERANCE
    score = np.where(kept, outcome.total, np.inf) if kept.any() else far
    return int(np.argmin(score))


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
    begin = _spread(surgery, search.base, search.free, starts, seed)
    first = surgery.try_out(begin, slopes=True)
    search.note(first)
    far = missed(surgery, first)
    order = np.lexsort((np.nan_to_num(first.total, nan=np.inf), np.round(far, 3)))
    followed = order[: min(_FOLLOWED, len(order))]
    ends = np.array([search.follow(begin[row], len(followed) - k)
                     for k, row in enumerate(followed)])  # fmt: skip
    best = search.best()
    return Optimum(
        best, bool(missed(surgery, best)[0] <= _TOLERANCE), float(missed(surgery, best)[0]),
        search.count, begin, first.total, followed, ends,
    )  # fmt: skip


def _spread(
    surgery: Surgery, base: np.ndarray, free: np.ndarray, count: int, seed: int
) -> np.ndarray:
    """Choices over the footprints and the tensions, the base first."""
    lower, upper = _bounds(surgery, len(base))
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


def _bounds(surgery: Surgery, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Smallest and largest of each choice."""
    wide = np.r_[surgery.tibia.semi_axes_mm, surgery.femur.semi_axes_mm]
    low, high = surgery.limits.tension_N
    bundles = size // len(CHOICES)
    return np.tile(np.r_[-wide, low], bundles), np.tile(np.r_[wide, high], bundles)


def _room(surgery: Surgery, outcome: Outcome) -> np.ndarray:
    """What is left of each limit, as a part of it, `(v, limits)`: negative where it is missed."""
    count = len(outcome.choices)
    each = outcome.choices.reshape(count, -1, len(CHOICES))
    inside = [
        1.0 - footprint.outside(each[..., columns]) ** 2
        for footprint, columns in _tunnels(surgery)
    ]
    limits = surgery.limits
    graft = 1.0 - outcome.graft_N.reshape(count, -1) / limits.graft_N
    off = (outcome.laxity_mm - surgery.laxity(surgery.before)[0]) / limits.band_mm
    return np.hstack([*inside, graft, 1.0 - off, 1.0 + off])


def _room_slope(surgery: Surgery, outcome: Outcome) -> np.ndarray:
    """Derivative of `_room` of one variant by the choices, `(limits, choices)`."""
    assert outcome.slopes is not None
    size, limits = outcome.choices.shape[1], surgery.limits
    each = outcome.choices.reshape(-1, len(CHOICES))
    rows = []
    for footprint, columns in _tunnels(surgery):
        for bundle, choice in enumerate(each):
            row = np.zeros((len(each), len(CHOICES)))
            row[bundle, columns] = -2.0 * choice[columns] / np.array(footprint.semi_axes_mm) ** 2
            rows.append(row.ravel())
    graft = -outcome.slopes["graft_N"][0].reshape(-1, size) / limits.graft_N
    off = outcome.slopes["laxity_mm"][0] / limits.band_mm
    return np.vstack([*rows, graft, -off, off])


def _tunnels(surgery: Surgery):
    """Footprints, each with the columns of its coordinates among a bundle's choices."""
    return (surgery.tibia, slice(0, 2)), (surgery.femur, slice(2, 4))


class _Search:
    """Evaluations of one search, each made once."""

    def __init__(self, surgery: Surgery, base: np.ndarray, free: np.ndarray, most: int):
        self.surgery, self.base, self.free, self.most = surgery, base, free, most
        self.count, self.known = 0, {}
        self.step = np.tile(_STEP, len(base) // len(CHOICES))[free]

    def note(self, outcome: Outcome) -> None:
        """Keep the outcomes of some choices, one by one."""
        for row in range(len(outcome.choices)):
            self.known[outcome.choices[row].tobytes()] = _row(outcome, row)
            self.count += 1

    def at(self, unknowns: np.ndarray) -> Outcome:
        """The outcome of the free choices, in steps."""
        choices = self.base.copy()
        choices[self.free] = unknowns * self.step
        key = choices.tobytes()
        if key not in self.known:
            if self.count >= self.most:
                raise _Spent
            self.note(self.surgery.try_out(choices, slopes=True, near=self._near(choices)))
        return self.known[key]

    def _near(self, choices: np.ndarray) -> Near | None:
        """Balances of the nearest choices that are known, if they are near enough."""
        step = np.tile(_STEP, len(choices) // len(CHOICES))
        every = [one for one in self.known.values() if converged(one.followed.status).all()]
        away = [np.abs((one.choices[0] - choices) / step).max() for one in every]
        if not away or min(away) > _NEAR:
            return None
        return every[int(np.argmin(away))].near

    def follow(self, start: np.ndarray, shares: int) -> float:
        """Descend from a start with its share of the evaluations that are left."""
        before, most = len(self.known), self.most
        self.most = self.count + (most - self.count) // shares
        lower, upper = _bounds(self.surgery, len(self.base))
        bounds = np.stack([lower[self.free], upper[self.free]], axis=1) / self.step[:, None]
        try:
            minimize(
                lambda x: float(self.at(x).total[0]),
                start[self.free] / self.step,
                jac=lambda x: self._slope(x)[0],
                bounds=bounds,
                constraints={
                    "type": "ineq",
                    "fun": lambda x: _room(self.surgery, self.at(x))[0],
                    "jac": lambda x: self._slope(x)[1],
                },
                method="SLSQP",
                options={"maxiter": 100, "ftol": 1e-7},
            )  # fmt: skip
        except (_Spent, _Lost):
            pass
        self.most = most
        own = [self.known[start.tobytes()], *list(self.known.values())[before:]]
        kept = [one.total[0] for one in own if missed(self.surgery, one)[0] <= _TOLERANCE]
        return float(min(kept, default=np.inf))

    def _slope(self, unknowns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        outcome = self.at(unknowns)
        if not np.isfinite(missed(self.surgery, outcome)[0]):
            raise _Lost
        assert outcome.slopes is not None
        by = outcome.slopes["total"][0], _room_slope(self.surgery, outcome)
        return by[0][self.free] * self.step, by[1][:, self.free] * self.step

    def best(self) -> Outcome:
        """The best of all that is known, found again by the way that a test takes."""
        every = list(self.known.values())
        far = np.array([missed(self.surgery, one)[0] for one in every])
        total = np.array([one.total[0] for one in every])
        kept = far <= _TOLERANCE
        order = np.argsort(np.where(kept, total, np.inf) if kept.any() else far)
        for row in order[:_FOLLOWED]:
            again = self.surgery.try_out(every[row].choices, slopes=True)
            same = np.allclose(again.followed.anterior_mm, every[row].followed.anterior_mm,
                               atol=1e-4, equal_nan=True)  # fmt: skip
            if same:
                return again
        return again  # pyright: ignore[reportPossiblyUnboundVariable]


class _Spent(Exception):
    """No evaluations are left."""


class _Lost(Exception):
    """A knee has no balance where a derivative is wanted."""


def _row(outcome: Outcome, row: int) -> Outcome:
    """One variant of many."""
    some = slice(row, row + 1)
    fields = {
        name: getattr(outcome, name)[some]
        for name in ("choices", "slack_mm", "distance", "laxity_mm", "graft_N", "isometry_mm",
                     "status")
    }  # fmt: skip
    near, slopes = outcome.near, outcome.slopes
    assert near is not None and slopes is not None
    followed = outcome.followed
    read = {
        name: getattr(followed, name)[some]
        for name in ("length_mm", "strain", "tension_N", "anterior_mm", "status")
    }
    followed = dataclasses.replace(followed, **read, slopes=None, near=None)
    return Outcome(
        **fields, followed=followed, slopes={name: x[some] for name, x in slopes.items()},
        near=Near(near.fixed.take(some), near.followed.take(some)),
    )  # fmt: skip
