"""Whether a fit is any good: its errors against the start's, the noise, and what a knee does."""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Mapping

import numpy as np

from kneejax.geometry import COLUMNS, FREE_COORDINATES

#: Times a stated noise beyond which a root mean square error of many poses is more than noise.
_BEYOND_NOISE = 1.5
#: Errors of a motion without noise, mm and degrees.
_ROUNDING = 1e-4
#: Root mean square errors that no measurement of a knee has, mm and degrees.
_LARGE = {"mm": 3.0, "deg": 5.0}


class Fault(enum.Enum):
    """Why a coordinate is poorly fitted."""

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
    """Coordinates in which a fit is poor.

    Args:
        rmse: coordinate -> root mean square error of the fit.
        start_rmse: likewise of the start.
        stated: standard deviation of each coordinate, NaN where none is stated, `(5,)`.
        counted: which coordinates are fitted, `(5,)`.
        poses: how many the errors are of.

    Returns:
        One a coordinate at most.
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
