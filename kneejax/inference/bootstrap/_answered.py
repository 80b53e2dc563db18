"""A problem with its answer, from which fits to other data begin."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from kneejax.experiments import MeasuredTest
from kneejax.inference.calibration import CalibrationProblem
from kneejax.inference.fit import Observations, fit_lanes
from kneejax.parameters import UnsuitableData
from kneejax.statics import Slopes

#: Draws that are fitted at once: bounds memory.
_AT_ONCE = 100
_MOST_EVALUATIONS = 100


@dataclasses.dataclass(frozen=True, eq=False)
class Answered:
    """A problem, and balances of its answer.

    Attributes:
        own: the problem.
        cases: load cases that count: those at which the answer balances.
        first: balances of the answer.
    """

    own: CalibrationProblem
    cases: Observations
    first: Slopes

    @classmethod
    def of(cls, problem: CalibrationProblem, answer: Sequence[float]) -> Answered:
        """Balance an answer.

        Args:
            problem: that was solved.
            answer: values of its parameters, then of constants between frames, `(p,)`.

        Raises:
            UnsuitableData: forces were read beside poses, which are not drawn again, or the answer
                has no balance.
        """
        check_redrawn(problem.fitted.tests)
        fitted = problem.fitted
        first = fitted.begin(np.asarray(answer, float)[None])
        if not first.converged[0].any():
            raise UnsuitableData("bootstrap: the answer has no balance")
        return cls(problem, fitted.with_used(first.converged[0] & fitted.used).cases, first)

    def fitted(
        self, draws: Sequence[int], data: Callable[[Sequence[int]], Observations]
    ) -> np.ndarray:
        """Fit data of each draw, with all parameters free, from the answer.

        Args:
            draws: their numbers.
            data: load cases of some draws, a set of data each.

        Returns:
            Values of each draw, `(draws, p)`; NaN where its fit did not converge.
        """
        found = [np.empty((0, len(self.own.start)))]
        for place in range(0, len(draws), _AT_ONCE):
            some = draws[place : place + _AT_ONCE]
            count = len(some)
            begin = self.first.take(np.zeros(count, int))
            box = [np.tile(bound, (count, 1)) for bound in (self.own.lower, self.own.upper)]
            fits = fit_lanes(
                self.own.fitted.balance, data(some), begin, begin.values, *box,
                most=_MOST_EVALUATIONS,
            )  # fmt: skip
            found.append(np.where(fits.converged[:, None], fits.values, np.nan))
        return np.concatenate(found)


def check_redrawn(tests: Sequence[MeasuredTest]) -> None:
    """Refuse tests whose data are not drawn again.

    Args:
        tests: that were made.

    Raises:
        UnsuitableData: forces, strains or the patella were read in one of them.
    """
    for test in tests:
        if test.readings:
            words = ", ".join(test.readings)
            raise UnsuitableData(f"bootstrap: {test.name}: {words}: expected poses alone")
