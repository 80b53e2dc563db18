"""Whether a fit is any good: poses and tests beside the start, the noise, and what a knee does."""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Mapping

import numpy as np

from kneejax.experiments import MeasuredTest
from kneejax.geometry import COLUMNS, COORDINATES, FREE_COORDINATES
from kneejax.inference.fit import Problem
from kneejax.statics import Slopes

#: Times a stated noise beyond which a root mean square error of many poses is more than noise.
_BEYOND_NOISE = 1.5
#: Errors of a motion without noise, mm and degrees.
_ROUNDING = 1e-4
#: Root mean square errors that no measurement of a knee has, mm and degrees.
_LARGE = {"mm": 3.0, "deg": 5.0}


class Fault(enum.Enum):
    """Why a coordinate is poorly fitted.

    Example:
        >>> [one.name for one in Fault][:2]
        ['WORSE_THAN_START', 'BEYOND_NOISE']
    """

    WORSE_THAN_START = "worse than at the start"
    BEYOND_NOISE = "more than the stated noise"
    LARGE = "large"


@dataclasses.dataclass(frozen=True)
class Misfit:
    """A coordinate in which a fit is poor.

    Attributes:
        coordinate: which.
        fault: why.
        rmse: root mean square error of the fit, mm or degrees.
        against: what that is compared with: the start's error, the noise, or what is large.
        test: whose curves they are; empty for the poses.

    Example:
        >>> Misfit("anterior", list(Fault)[0], rmse=0.9, against=0.3).coordinate
        'anterior'
    """

    coordinate: str
    fault: Fault
    rmse: float
    against: float
    test: str = ""


def misfits(
    rmse: Mapping[str, float],
    start_rmse: Mapping[str, float],
    stated: np.ndarray,
    counted: np.ndarray,
    poses: int,
) -> tuple[Misfit, ...]:
    """Coordinates in which a fit of `poses` is poor, by its root mean square error and the start's.

    `stated` are standard deviations, NaN where none is stated, and `counted` says which coordinates
    are fitted, `(5,)` each.
    """
    # A root mean square of so few scatters by 1 / sqrt(2 n); twice that is more than luck.
    scatter = 1.0 + float(np.sqrt(2.0 / max(poses, 1)))
    beyond = more_than_luck(poses)
    found = []
    for row, name in enumerate(FREE_COORDINATES):
        own, before, noise = rmse[name], start_rmse[name], float(stated[row])
        if not (counted[row] and np.isfinite(own)):
            continue
        unit = COLUMNS[row + 1].rsplit("_", 1)[1]
        # Below a noise that is known, the start was near by luck.
        worse = own > scatter * before + _ROUNDING and not own <= noise
        if worse:
            found.append(Misfit(name, Fault.WORSE_THAN_START, own, before))
        elif own > beyond * noise:
            found.append(Misfit(name, Fault.BEYOND_NOISE, own, noise))
        elif own > max(_LARGE[unit], np.nan_to_num(noise)):
            found.append(Misfit(name, Fault.LARGE, own, _LARGE[unit]))
    return tuple(found)


def more_than_luck(numbers: int) -> float:
    """Times the noise beyond which a root mean square error of so many numbers is more than noise.

    What so few errors leave by luck once in a thousand is no misfit either.
    """
    # `scipy.special` at the top would be part of every start.
    from scipy.special import chdtri

    count = max(numbers, 1)
    return max(_BEYOND_NOISE, float(np.sqrt(chdtri(count, 1e-3) / count)))


@dataclasses.dataclass(frozen=True, eq=False)
class FittedTest:
    """A measured test beside the same test on a knee.

    Attributes:
        test: as it was measured.
        measured: of each row what was compared, counted as the test says, `(n, 5)`; NaN where
            nothing was.
        fitted: the same of the knee; the best of unknown constants is added.
        status: of the knee's balances, one `Status` value a row.
        readings: the knee's in the place of each of `test.readings`, `(n,)`, in its unit, the best
            of unknown constants added; NaN where nothing was compared.
        restless: of a motion that repeats itself, how far it is from where it was a period before,
            mm or degrees; 0 of all others.
    """

    test: MeasuredTest
    measured: np.ndarray
    fitted: np.ndarray
    status: np.ndarray
    readings: Mapping[str, np.ndarray] = dataclasses.field(default_factory=dict)
    restless: float = 0.0

    @property
    def compared(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Coordinate, or name of what was read of a part -> its measured and fitted numbers, `(n,)`
        each, degrees, mm, N or strain; NaN where nothing was compared."""
        places = [(name, FREE_COORDINATES.index(name)) for name in self.test.coordinates]
        pairs = {name: (self.measured[:, k], self.fitted[:, k]) for name, k in places}
        return pairs | {
            name: (np.where(np.isfinite(own), self.test.readings[name], np.nan), own)
            for name, own in self.readings.items()
        }

    def rmse(self, name: str, flexion_deg: float | None = None) -> float:
        """Root mean square error in its own unit; NaN where nothing was measured.

        Args:
            name: one of `compared`, or a free coordinate.
            flexion_deg: of the curve whose rows count (`MeasuredTest.curve_deg`); all by default.
        """
        if name not in self.compared:
            return np.nan
        measured, fitted = self.compared[name]
        own = fitted - measured
        if flexion_deg is not None:
            own = own[self.test.curve_deg == flexion_deg]
        known = own[np.isfinite(own)]
        return float(np.sqrt(np.mean(known**2))) if len(known) else np.nan


def fitted_tests(problem: Problem, found: Slopes) -> tuple[FittedTest, ...]:
    """Every test of a problem beside what one fit gives."""
    cases, data = problem.cases, problem.cases.readings
    read: dict[str, np.ndarray] = {}
    if data is not None:
        error = data.error(cases, found)[0][0]
        value = np.where(data.counted(cases), data.target + error, np.nan)
        for place, name in enumerate(data.names):
            own = data.name == place
            read[name] = np.full(len(cases.load_cases), np.nan)
            read[name][data.case[own]] = value[own]
    seen, target = cases.seen, cases.target
    error = np.where(seen, cases.error(found)[0][0], np.nan)
    return tuple(
        FittedTest(
            test,
            np.where(seen[rows], target[rows], np.nan),
            target[rows] + error[rows],
            found.status[0][rows],
            {name: read[name][rows] for name in test.readings},
        )
        for test, rows in zip(problem.tests, problem.rows_of_tests(), strict=True)
    )


def misfits_of_test(
    own: FittedTest, before: FittedTest, stated: np.ndarray, counted: np.ndarray
) -> tuple[Misfit, ...]:
    """Coordinates of a test in which a fit is poor, by the rules of poses (`misfits`); `before` is
    the test at the start."""
    for row, name in enumerate(FREE_COORDINATES):
        sd = own.test.sd_mm if COORDINATES[name].unit == "mm" else own.test.sd_deg
        stated = np.where(np.arange(5) == row, sd, stated) if sd is not None else stated
    fitted, start = ({x: one.rmse(x) for x in FREE_COORDINATES} for one in (own, before))
    found = misfits(fitted, start, stated, counted, len(own.test.flexion_deg))
    beyond = []
    for name in own.test.readings:
        rmse, noise = own.rmse(name), float(own.test.sd_of(name))
        if rmse > more_than_luck(len(own.test.flexion_deg)) * noise:
            beyond.append(Misfit(name, Fault.BEYOND_NOISE, rmse, noise))
    return tuple(dataclasses.replace(one, test=own.test.name) for one in (*found, *beyond))
