"""What a fit makes of each test under load."""

from __future__ import annotations

import dataclasses

import numpy as np

from kneejax.experiments import MeasuredTest
from kneejax.geometry import COORDINATES, FREE_COORDINATES
from kneejax.inference.calibration._quality import Misfit, misfits
from kneejax.inference.fit import Problem
from kneejax.statics import Slopes


@dataclasses.dataclass(frozen=True, eq=False)
class FittedTest:
    """A measured test beside the same test on a knee.

    Attributes:
        test: as it was measured.
        measured: of each row what was compared, counted as the test says, `(n, 5)`; NaN where
            nothing was.
        fitted: the same of the knee; the best of unknown constants is added.
        status: of the knee's balances, one `Status` value a row.
    """

    test: MeasuredTest
    measured: np.ndarray
    fitted: np.ndarray
    status: np.ndarray

    @property
    def error(self) -> np.ndarray:
        """Knee minus measurement, `(n, 5)`, degrees and mm; NaN where nothing was compared."""
        return self.fitted - self.measured

    def rmse(self, coordinate: str, flexion_deg: float | None = None) -> float:
        """Root mean square error of a coordinate, mm or degrees; NaN where it was not measured.

        Args:
            coordinate: a free coordinate.
            flexion_deg: of the rows that count; all by default.
        """
        own = self.error[:, FREE_COORDINATES.index(coordinate)]
        if flexion_deg is not None:
            own = own[self.test.flexion_deg == flexion_deg]
        known = own[np.isfinite(own)]
        return float(np.sqrt(np.mean(known**2))) if len(known) else np.nan


def fitted_tests(problem: Problem, found: Slopes) -> tuple[FittedTest, ...]:
    """Every test of a problem beside what one fit gives."""
    error = problem.cases.error(found)[0][0]
    seen, target = problem.cases.seen, problem.cases.target
    error = np.where(seen, error, np.nan)
    return tuple(
        FittedTest(
            test,
            np.where(seen[rows], target[rows], np.nan),
            target[rows] + error[rows],
            found.status[0][rows],
        )
        for test, rows in zip(problem.tests, problem.rows_of_tests(), strict=True)
    )


def misfits_of_test(
    own: FittedTest, before: FittedTest, stated: np.ndarray, weights: np.ndarray
) -> tuple[Misfit, ...]:
    """Coordinates of a test in which a fit is poor, by the rules of poses (`misfits`).

    Args:
        own: the test as fitted.
        before: the same at the start.
        stated: standard deviation of each coordinate, NaN where none is stated, `(5,)`.
        weights: of the objective, `(5,)`.
    """
    for row, name in enumerate(FREE_COORDINATES):
        sd = own.test.sd_mm if COORDINATES[name].unit == "mm" else own.test.sd_deg
        stated = np.where(np.arange(5) == row, sd, stated) if sd is not None else stated
    fitted, start = ({x: one.rmse(x) for x in FREE_COORDINATES} for one in (own, before))
    found = misfits(fitted, start, stated, weights, len(own.test.flexion_deg))
    return tuple(dataclasses.replace(one, test=own.test.name) for one in found)
