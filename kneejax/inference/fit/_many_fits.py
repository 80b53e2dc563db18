"""The one fit: bounded least squares in lanes, each with load cases of its own, some values held.

Each fit is a Levenberg-Marquardt search of its own, with its own bounds, damping and end; the
balances of all fits that still search are one batch. Constant offsets between frames enter
linearly, so the best ones are taken out of every residual in closed form.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Callable, Sequence

import jax
import numpy as np

from kneejax.inference.fit._bounded import BoundedLevenbergMarquardt
from kneejax.inference.fit._cut import balances_of
from kneejax.inference.fit._observed import Balance, Observations, best_offsets
from kneejax.inference.fit._problem import Problem
from kneejax.statics import Slopes

#: Evaluations of each of several starts.
_STEPS_OF_STARTS = 40

#: Evaluations of a fit that is to reach the end of a long flat valley.
PATIENT = 200
#: Relative decrease of an objective, and relative step, that end a fit.
_RTOL, _ATOL = 1e-9, 1e-8
#: Called with fits, what a trial of each gave, its best sum of squares so far, and whether the
#: trial was taken; says which of them end.
Watch = Callable[[np.ndarray, Slopes, np.ndarray, np.ndarray], np.ndarray]


@dataclasses.dataclass(frozen=True)
class ManyFits:
    """Where fits ended."""

    slopes: Slopes  # balances and derivatives there
    chi2: np.ndarray  # sum of squared errors over their variances, `(fits,)`
    converged: np.ndarray  # whether a fit ended by itself, `(fits,)`
    evaluations: int  # of all poses of one fit, summed over fits

    @property
    def values(self) -> np.ndarray:
        """Parameters, `(fits, p)`."""
        return self.slopes.values


def fit_lanes(
    balance: Balance,
    data: Observations,
    begin: Slopes,
    starts: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    *,
    most: int = 60,
    far: bool = False,
    rtol: float = _RTOL,
    atol: float = _ATOL,
    watch: Watch | None = None,
) -> ManyFits:
    """Fit whatever can be balanced to motion, many times at once.

    Args:
        balance: of the values that are fitted; see `balances_of`.
        data: measured motion, one for all or one per fit.
        begin: known balances, one variant per fit, from which the starts are predicted.
        starts: `(fits, p)`.
        lower: bounds, `(p,)` or `(fits, p)`; equal to `upper` holds a parameter.
        upper: bounds.
        most: evaluations of a fit before it is given up.
        far: whether the answers may be far from the starts; first steps are short then.
        rtol: relative decrease of the sum of squares that ends a fit.
        atol: relative step, of the width of the bounds, that ends a fit.
        watch: called after every evaluation; may end fits, which does not count as an end by
            itself.

    Returns:
        The `ManyFits`. A fit whose start has no balance at some pose that counts ends at once,
        with an infinite `chi2`.
    """
    here, evaluations = np.arange(len(starts)), 0
    known = begin.take(here)
    fit = BoundedLevenbergMarquardt(
        starts, lower, upper, rtol=rtol, atol=atol, first_damping=1.0 if far else 1e-3
    )
    for _ in range(most):
        if not len(here):
            break
        found = balance(fit.trial[here], known.take(here))
        evaluations += len(here)
        residual, slope = data.take(here).residual(found)
        # A step into the void is refused for its infinite squares; no NaN may spread from there.
        residual[~(np.isfinite(residual) & np.isfinite(slope).all(axis=2))] = np.inf
        slope[np.isinf(residual).any(axis=1)] = 0.0
        fit.tell(here, residual, slope)
        better, chi2 = fit.accepted[here], fit.chi2[here]
        known.put(here[better], found.take(better))
        through = fit.ended[here] | ~np.isfinite(chi2)
        if watch is not None:
            through |= watch(here, found, chi2, better)
        here = here[~through]
    return ManyFits(known, fit.chi2, fit.ended, evaluations)


def several_starts(
    problem: Problem, starts: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """End points `(s, p)` of procedure III from several starts `(s, p)` at once, and their
    objectives `(s,)`, infinite where a start found no balance."""
    size = len(problem.selection)
    # The best constants between frames are known at every step; they need no start.
    prior = problem.cases.prior and tuple(part[:size] for part in problem.cases.prior)
    data = dataclasses.replace(problem.cases, offsets=problem.offsets, prior=prior)
    balance = balances_of(problem.knee, problem.selection, data)
    values, *box = (x[..., :size] for x in (starts, lower, upper))
    found = fit_lanes(balance, data, balance(values), values, *box, most=_STEPS_OF_STARTS, far=True)
    shifts = [best_offsets(data, found.slopes.take([row])) for row in range(len(starts))]
    return np.hstack([found.values, np.reshape(shifts, (len(starts), -1))]), found.chi2


#: Of load cases what knees that stand side by side must have in common, beside what is observed.
_ALIKE = ("noise", "used", "clinical", "neutral", "group", "spread")


@dataclasses.dataclass(frozen=True, eq=False)
class SeveralKnees:
    """Problems of one form, each of a knee of its own; a single one is the plainest case."""

    problems: tuple[Problem, ...]  # one a knee, alike (`form_of`)
    whole: Problem  # all of them, with what was observed a fit each

    @classmethod
    def of(cls, problems: Sequence[Problem]) -> SeveralKnees:
        """Problems of one form."""
        first = problems[0]
        if len(problems) == 1:
            return cls(tuple(problems), first)
        leaves = [jax.tree.leaves(one.knee) for one in problems]
        stacks = (np.stack([np.asarray(x) for x in each]) for each in zip(*leaves, strict=True))
        own = {place: x for place, x in enumerate(stacks) if (x != x[:1]).any()}
        target = np.stack([one.cases.target for one in problems])
        prior = first.cases.prior
        if prior is not None:
            prior = np.stack([one.cases.prior[0] for one in problems if one.cases.prior]), prior[1]
        cases = dataclasses.replace(first.cases, target=target, prior=prior)
        return cls(tuple(problems), dataclasses.replace(first, cases=cases, own=own or None))

    def __len__(self) -> int:
        return len(self.problems)

    def take(self, rows: Sequence[int]) -> SeveralKnees:
        """Some of the knees. Balances of all go on saying whose they are."""
        whole = dataclasses.replace(self.whole, cases=self.whole.cases.take(list(rows)))
        return SeveralKnees(tuple(self.problems[row] for row in rows), whole)

    def with_used(self, rows: np.ndarray) -> SeveralKnees:
        """The same with only some load cases that count, `(cases,)`."""
        return self._each(lambda one: one.with_used(rows))

    def with_data(self, names: Sequence[str]) -> SeveralKnees:
        """The same with some of the data alone (`Problem.with_data`)."""
        return self._each(lambda one: one.with_data(names))

    def _each(self, change: Callable[[Problem], Problem]) -> SeveralKnees:
        return SeveralKnees(tuple(map(change, self.problems)), change(self.whole))

    def weighing(self, noise: Sequence[np.ndarray]) -> SeveralKnees:
        """The same with a noise each, `(5,)`, where it is known."""
        every = zip(self.problems, noise, strict=True)
        problems = [one if np.isnan(own).any() else one.weighing(own) for one, own in every]
        now = np.stack([one.cases.noise for one in problems])
        return SeveralKnees(tuple(problems), self.whole.weighing(now if len(now) > 1 else now[0]))


def form_of(problem: Problem) -> bytes | None:
    """What problems have in common that may stand side by side; None for one that may not: where
    ligaments were cut, forces were read, or the knee moved."""
    cases = problem.cases
    if any(cases.cuts) or cases.readings is not None or cases.passages:
        return None
    plain = dataclasses.replace(problem.knee, name="", side="right")
    leaves, tree = jax.tree.flatten(plain)
    load_cases, kinds = jax.tree.flatten(cases.load_cases)
    known = None if cases.prior is None else cases.prior[1]
    arrays = [
        *jax.tree.leaves(problem.knee.reference_pose), *load_cases, ~np.isnan(cases.target), known,
        *(getattr(cases, name) for name in _ALIKE),
    ]  # fmt: skip
    words = [
        str(tree), [np.shape(leaf) for leaf in leaves], str(kinds), problem.selection.names,
        problem.offsets, [test.name for test in problem.tests],
        [None if x is None else [np.shape(x), str(np.asarray(x).dtype)] for x in arrays],
    ]  # fmt: skip
    found = hashlib.sha256(json.dumps(words).encode())
    for x in arrays:
        found.update(b"" if x is None else np.ascontiguousarray(x).tobytes())
    return found.digest()
