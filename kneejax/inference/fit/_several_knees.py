"""Questions of one form about several knees, fitted side by side in lanes of one program."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Sequence

import jax
import numpy as np

from kneejax.inference.fit._cut import balances_of
from kneejax.inference.fit._observed import Balance, Observations, add_offsets, with_offsets
from kneejax.inference.fit._problem import Problem
from kneejax.statics import Own, Slopes

#: Of load cases what knees that stand side by side must have in common, beside what is observed.
_ALIKE = ("noise", "used", "clinical", "neutral", "group", "spread")


@dataclasses.dataclass(frozen=True, eq=False)
class SeveralKnees:
    """Problems of one form, each of a knee of its own; a single one is the plainest case.

    Attributes:
        problems: one a knee, alike (`form_of`).
        own: numbers in which the knees differ; None where they do not.
        cases: what was observed of all of them, a fit each.
    """

    problems: tuple[Problem, ...]
    own: Own | None
    cases: Observations

    @classmethod
    def of(cls, problems: Sequence[Problem]) -> SeveralKnees:
        """Problems of one form."""
        first = problems[0]
        if len(problems) == 1:
            return cls(tuple(problems), None, first.cases)
        leaves = [jax.tree.leaves(one.knee) for one in problems]
        stacks = (np.stack([np.asarray(x) for x in each]) for each in zip(*leaves, strict=True))
        own = {place: x for place, x in enumerate(stacks) if (x != x[:1]).any()}
        target = np.stack([one.cases.target for one in problems])
        prior = first.cases.prior
        if prior is not None:
            prior = np.stack([one.cases.prior[0] for one in problems if one.cases.prior]), prior[1]
        cases = dataclasses.replace(first.cases, target=target, prior=prior)
        return cls(tuple(problems), own or None, cases)

    def __len__(self) -> int:
        return len(self.problems)

    @property
    def balance(self) -> Balance:
        """Balances at values, from near ones, which say whose they are."""
        first, posed = self.problems[0], self.cases.posed
        of_parameters = balances_of(first.knee, first.selection, self.cases, self.own)
        return with_offsets(of_parameters, first.offsets, posed)

    def begin(self, values: np.ndarray) -> Slopes:
        """Balances of each knee at its values `(knees, p)`, followed from its reference pose."""
        first, posed = self.problems[0], self.cases.posed
        parameters, shifts = np.split(np.asarray(values, float), [len(first.selection)], axis=1)
        found = balances_of(first.knee, first.selection, self.cases, self.own)(parameters)
        return add_offsets(found, shifts, first.offsets, posed)

    def take(self, rows: Sequence[int]) -> SeveralKnees:
        """Some of the knees. Balances of all go on saying whose they are."""
        problems = tuple(self.problems[row] for row in rows)
        return dataclasses.replace(self, problems=problems, cases=self.cases.take(list(rows)))

    def with_used(self, rows: np.ndarray) -> SeveralKnees:
        """The same with only some load cases that count, `(cases,)`."""
        return self._with([one.with_used(rows) for one in self.problems])

    def weighing(self, problems: Sequence[Problem]) -> SeveralKnees:
        """The same with the noise that problems have now, each its own."""
        noise = np.stack([one.cases.noise for one in problems])
        cases = dataclasses.replace(self.cases, noise=noise if len(noise) > 1 else noise[0])
        return dataclasses.replace(self, problems=tuple(problems), cases=cases)

    def with_data(self, names: Sequence[str]) -> SeveralKnees:
        """The same with some of the data alone (`Problem.with_data`)."""
        return self._with([one.with_data(names) for one in self.problems])

    def _with(self, problems: Sequence[Problem]) -> SeveralKnees:
        cases = dataclasses.replace(self.cases, used=problems[0].cases.used)
        return dataclasses.replace(self, problems=tuple(problems), cases=cases)


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
