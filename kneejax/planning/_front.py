"""Several criteria at once: the choices that none is better than in everything.

NSGA-III (pymoo) finds them roughly, a population being the lanes of one search for balances; exact
derivatives then lead each of them on, for as long as some criteria become better and none worse.
"""

__all__ = ["GENERATIONS", "POPULATION", "Front", "pareto_front", "undominated"]

import dataclasses
import itertools
from collections.abc import Callable

import numpy as np

from kneejax.numerics import Named, imported
from kneejax.planning._optimum import STEP, Linear, spread_over
from kneejax.planning._surgery import (
    CHOICES,
    TOLERANCE,
    Outcome,
    Surgery,
    bounds,
    criteria_names,
    criteria_of,
    excess,
    missed,
)
from kneejax.statics import Progress

#: Choices that live at a time, and how often they are renewed.
POPULATION, GENERATIONS = 40, 16
#: What stands for a criterion, and for a limit that is missed, where a knee has no balance.
_LOST, _LOST_BY = 1e6, 1e3
#: Of polishing: most steps, and how far one may lead at first and must lead at least, in steps of
#: the choices.
_STEPS, _BELIEVED, _NOTHING = 12, 2.0, 1e-3
#: Part of the front's extent that a step must promise, part of the promise below which it is not
#: taken, and above which the next one may be longer.
_GAINED, _TAKEN, _LONGER = 1e-5, 0.1, 0.7
#: Weight of what each criterion gains beside what all of them gain: where one can gain no more the
#: others go on.
_BESIDE = 0.05
#: Part of a criterion that is rounding.
_ROUNDED = 1e-9


@dataclasses.dataclass(frozen=True)
class Front(Named):
    """Choices of which none is better than another in all criteria.

    Attributes:
        names: of the criteria: laxity at each test, mm, largest graft force, N, strain distance.
        outcome: of the choices, `(n, choices)`, followed as a test is made; of none where no
            choice was found that keeps all limits.
        criteria: `(n, criteria)`; the smaller the better.
        rough: those of the choices that each was polished from.
        evaluations: knees that were put through the protocol.
    """

    names: tuple[str, ...]
    outcome: Outcome
    criteria: np.ndarray
    rough: np.ndarray
    evaluations: int

    OVER = {"variant criterion": {"criteria": ""}}

    def _named(self) -> dict[str, tuple]:
        names = {"criterion": ("criterion", self.names)}
        return self.outcome._named() | super()._named() | names

    @property
    def compromise(self) -> int:
        """Row of the choices that are nearest to the best of all criteria, each counted in parts
        of its extent."""
        extent = np.ptp(self.criteria, axis=0)
        part = (self.criteria - self.criteria.min(axis=0)) / np.where(extent > 0.0, extent, 1.0)
        return int(np.argmin(np.sum(part**2, axis=1)))


def undominated(criteria: np.ndarray) -> np.ndarray:
    """Which rows no other row is better than, `(n,)`; of equal ones the first.

    Args:
        criteria: `(n, criteria)`; the smaller the better.

    Example:
        >>> undominated(np.array([[1.0, 2.0], [2.0, 1.0], [2.0, 2.0], [1.0, 2.0]])).tolist()
        [True, True, False, False]
    """
    no_worse = (criteria[:, None] <= criteria).all(axis=2)
    better = no_worse & (criteria[:, None] < criteria).any(axis=2)
    equal = no_worse & no_worse.T & np.tri(len(criteria), k=-1, dtype=bool).T
    return ~(better | equal).any(axis=0)


def pareto_front(
    surgery: Surgery, base: np.ndarray, free: np.ndarray, *, known: np.ndarray | None = None,
    population: int = POPULATION, generations: int = GENERATIONS, seed: int = 0,
    progress: Progress | None = None,
) -> Front:  # fmt: skip
    """Find the choices that keep all limits and are best in some balance of the criteria.

    Args:
        surgery: with its limits.
        base: choices where the search begins, and values of what is not free.
        free: which of them are free, `(choices,)`, true or false.
        known: choices that are near the front, such as an optimum, `(n, choices)`.
        population: choices that live at a time; so many points, beside the known ones, at most
            has the front.
        generations: how often they are renewed.
        seed: of all that is drawn.
        progress: called now and then with knees done and asked for.

    Raises:
        MissingPackage: pymoo is not installed.
    """
    base, free = np.asarray(base, float), np.asarray(free, bool)
    begin = spread_over(surgery, base, free, population, seed)
    if known is not None:
        begin[1 : 1 + len(known)] = known
    asked, done = population * (generations + _STEPS + 3), 0

    def told(outcome: Outcome) -> Outcome:
        nonlocal done
        done += len(outcome.choices)
        if progress is not None:
            progress(done, asked)
        return outcome

    rough = _evolved(surgery, begin, free, generations, seed, told)
    if known is not None:
        # A corner of the front may be lost among its many neighbours.
        rough = np.vstack([rough, known])
    polished = _polished(surgery, rough, free, told)
    # As a test finds them: a balance that only prediction finds is no answer.
    again = told(surgery.try_out(np.vstack([polished, rough])))
    criteria, count = criteria_of(again), len(rough)
    own, before = criteria[:count], criteria[count:]
    kept = missed(surgery, again) <= TOLERANCE
    better = kept[:count] & (own <= before + _ROUNDED * np.abs(before)).all(axis=1)
    rows = np.arange(count) + np.where(better, 0, count)
    best = np.flatnonzero(kept[rows])
    best = best[undominated(criteria[rows[best]])]
    best = best[np.argsort(criteria[rows[best], -1])]
    best, before = rows[best], before[best]
    return Front(criteria_names(surgery), again.taken(best), criteria[best], before, done)


def _evolved(
    surgery: Surgery, begin: np.ndarray, free: np.ndarray, generations: int, seed: int,
    told: Callable[[Outcome], Outcome],
) -> np.ndarray:
    """Choices that keep the limits, none of which is better than another, by NSGA-III."""
    nsga3, problems, directions, static, evaluator = (
        imported(f"pymoo.{part}", "pymoo", "planning")
        for part in ("algorithms.moo.nsga3", "core.problem", "util.ref_dirs", "problems.static",
                     "core.evaluator")
    )  # fmt: skip
    count = len(surgery.protocol.lachman_deg) + 2
    lower, upper = (x[free] for x in bounds(surgery))
    sizes = {"n_var": int(free.sum()), "n_obj": count, "n_ieq_constr": 1}
    problem = problems.Problem(**sizes, xl=lower, xu=upper)
    search = nsga3.NSGA3(
        directions.get_reference_directions("energy", count, len(begin), seed=seed),
        pop_size=len(begin), sampling=np.clip(begin[:, free], lower, upper),
    )  # fmt: skip
    search.setup(problem, termination=("n_gen", generations), seed=seed, verbose=False)
    while search.has_next():
        asked = search.ask()
        living = np.tile(begin[0], (len(begin), 1))
        living[: len(asked), free] = asked.get("X")
        found = told(surgery.try_out(living)).taken(np.arange(len(asked)))
        criteria, over = criteria_of(found), excess(surgery, found)
        lost = ~np.isfinite(criteria).all(axis=1) | ~np.isfinite(over)
        criteria = np.where(lost[:, None], _LOST, criteria)
        over = np.where(lost, _LOST_BY, over - TOLERANCE)
        values = static.StaticProblem(problem, F=criteria, G=over[:, None])
        evaluator.Evaluator().eval(values, asked)
        search.tell(infills=asked)
    over, best, criteria = (search.pop.get(x) for x in ("G", "X", "F"))
    kept = over[:, 0] <= max(over.min(), 0.0)
    chosen = np.tile(begin[0], (int(kept.sum()), 1))
    chosen[:, free] = best[kept]
    return chosen[undominated(criteria[kept])]


def _polished(
    surgery: Surgery, choices: np.ndarray, free: np.ndarray, told: Callable[[Outcome], Outcome]
) -> np.ndarray:
    """Choices from which no step betters some criteria and worsens none, each begun at a row."""
    found = told(surgery.try_out(choices, slopes=True))
    rows = np.arange(len(choices))
    here, near = [found.taken([row]) for row in rows], found.taken(rows).near
    assert near is not None
    radius = np.full(len(choices), _BELIEVED)
    # Of a single point all criteria are to become better.
    extent = np.ptp(criteria_of(found), axis=0)
    extent = extent if extent.any() else np.ones_like(extent)
    for _ in range(_STEPS):
        steps = [
            _step(surgery, one, free, extent, r) if r > _NOTHING else (0.0 * one.choices[0], 0.0)
            for one, r in zip(here, radius, strict=True)
        ]
        away, promised = map(np.array, zip(*steps, strict=True))
        radius[promised < _GAINED] = 0.0
        if not radius.any():
            break
        away *= (radius > 0.0)[:, None]
        moved = np.vstack([one.choices for one in here]) + away
        there = told(surgery.try_out(moved, slopes=True, near=near))
        before = np.vstack([criteria_of(one) for one in here])
        gained = _gain(before, criteria_of(there), extent) / np.maximum(promised, _GAINED)
        gained[missed(surgery, there) > TOLERANCE] = -np.inf
        size = np.abs(away / np.tile(STEP, away.shape[1] // len(CHOICES))).max(axis=1)
        taken = np.flatnonzero((radius > 0.0) & (gained > _TAKEN))
        for row in taken:
            here[row] = there.taken([row])
        for mine, theirs in zip(near, there.taken(taken).near or (), strict=True):
            mine.put(taken, theirs)
        longer = np.where(gained > _LONGER, np.maximum(radius, 2.0 * size), radius)
        radius = np.where(radius == 0.0, 0.0, np.where(gained > _TAKEN, longer, 0.4 * size))
        radius[radius <= _NOTHING] = 0.0
    return np.vstack([one.choices for one in here])


def _gain(before: np.ndarray, after: np.ndarray, extent: np.ndarray) -> np.ndarray:
    """What is gained, in parts of the front's extent: by the criterion that gains least, and a
    little by all, `(v,)`; minus infinity where one is lost."""
    gain = before - after
    known = np.isfinite(gain).all(axis=1)
    loses = (gain < -_ROUNDED * (1.0 + np.abs(before))).any(axis=1)
    part = gain[:, extent > 0.0] / extent[extent > 0.0]
    return np.where(known & ~loses, part.min(axis=1) + _BESIDE * part.sum(axis=1), -np.inf)


def _step(
    surgery: Surgery, outcome: Outcome, free: np.ndarray, extent: np.ndarray, radius: float
) -> tuple[np.ndarray, float]:
    """The step that betters all criteria most by their linear models, `(choices,)`, and what it
    promises, see `_gain`."""
    assert outcome.slopes is not None
    model = Linear(surgery, outcome, free)
    laxity, graft = (
        outcome.slopes[name][0].reshape(-1, len(free))[:, free] * model.scale
        for name in ("laxity_mm", "graft_N")
    )
    slack = outcome.graft_N.ravel() - outcome.peak_N[0]
    (count, size), tests, criteria = model.by.shape, len(laxity), len(extent)
    # Columns: the step, the absolute offsets, what each criterion gains, what all of them gain.
    parts = np.cumsum([0, size, count, criteria, 1])

    def rows(*blocks: np.ndarray | float | None) -> np.ndarray:
        full = np.zeros((max(len(np.atleast_2d(x)) for x in blocks if x is not None), parts[-1]))
        for block, (first, last) in zip(blocks, itertools.pairwise(parts), strict=False):
            full[:, first:last] = 0.0 if block is None else block
        return full

    by_gain, offsets = np.diag(extent), -np.eye(count)
    above = np.vstack([
        rows(laxity, None, by_gain[:tests]), rows(graft, None, by_gain[-2]),
        rows(None, 1.0, by_gain[-1:]), rows(model.by, offsets), rows(-model.by, offsets),
        rows(None, None, -np.eye(criteria)[extent > 0.0], 1.0),
        rows(-model.room_by), rows(model.sides),
    ])  # fmt: skip
    limits = np.r_[
        np.zeros(tests), -slack, outcome.total[0], -model.offset, model.offset,
        np.zeros((extent > 0.0).sum()), np.maximum(model.room, 0.0), model.inside,
    ]  # fmt: skip
    costs = np.r_[np.zeros(count), np.full(criteria, -_BESIDE), -1.0]
    gains = [(0.0, 1e3 if wide > 0.0 else 0.0) for wide in extent]
    more = [*[(0.0, None)] * count, *gains, (0.0, 1e3)]
    step, cost = model.best_step(radius, costs, above, limits, more)
    return step, -(cost or 0.0)
