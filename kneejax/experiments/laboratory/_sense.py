"""Whether a measured curve can be a knee's: a load does work on the tibia that it moves."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kneejax.experiments.laboratory._measured_test import MeasuredTest
from kneejax.geometry import COORDINATES, FREE_COORDINATES
from kneejax.mechanics import NAMED_LOADS

#: Rows whose flexion differs by less are of one curve, degrees.
_SAME_DEG = 1.0
#: Of the work over that of a curve in which load and displacement are in proportion; below minus
#: this a curve falls, whatever its noise.
_FALLS = 0.7
#: Along a curve a coordinate changes by more than this, mm or degrees, or it tells no sense; and by
#: so many of its standard deviations.
_LEAST, _DEVIATIONS = 1.0, 4.0
#: Part of the largest change of load below which another one counts as constant.
_CONSTANT = 0.1
#: N that count as much as one N m, for that comparison.
_ARM = 20.0


class AgainstLoad(NamedTuple):
    """A curve along which the tibia moves against the load.

    Attributes:
        load: name of the load.
        coordinate: on which it does work.
        flexion_deg: of the curve.
        loads: the least and the largest load of the curve, N or N m.
        values: of the coordinate there, mm or degrees.
    """

    load: str
    coordinate: str
    flexion_deg: float
    loads: tuple[float, float]
    values: tuple[float, float]


def against_load(test: MeasuredTest) -> AgainstLoad | None:
    """The first curve of a test along which the tibia moves against its load; None without any.

    A knee in stable balance gives way to a load: the coordinate on which the load does work rises
    with it. A curve that falls would give energy away: a column has the other sense.

    Args:
        test: as it was measured. Knees in motion, forces at another point than the tibia's origin
            and muscles whose pull changes are not judged.
    """
    changing = any(np.ptp(pull) > 0 for pull in test.tensions.values())
    if test.frames is not None or changing or not test.loads:
        return None
    left = np.argsort(test.flexion_deg, kind="stable")
    while len(left):
        near = test.flexion_deg[left] - test.flexion_deg[left[0]] <= _SAME_DEG
        found = _falls(test, left[near])
        if found is not None:
            return found
        left = left[~near]
    return None


def _falls(test: MeasuredTest, rows: np.ndarray) -> AgainstLoad | None:
    """Whether one curve falls under the load that changes along it, if it is only one."""
    # What is counted from the unloaded pose is nothing there.
    zero = np.zeros(int(test.counted_from == "unloaded"))
    loads = {name: np.r_[zero, sizes[rows]] for name, sizes in test.loads.items()}
    arm = {name: _ARM if name.endswith("_Nm") else 1.0 for name in loads}
    change = {name: arm[name] * np.ptp(sizes) for name, sizes in loads.items()}
    acting = [name for name in loads if change[name] > _CONSTANT * max(change.values())]
    if len(acting) != 1 or (any(test.point_mm) and acting[0].endswith("_N")):
        return None
    name = acting[0]
    column = next(x for x in NAMED_LOADS[name].also_called if x in COORDINATES)
    values = np.r_[zero, test.observed[rows, FREE_COORDINATES.index(column)]]
    load, values = loads[name][np.isfinite(values)], values[np.isfinite(values)]
    if not len(load) or not np.ptp(load) > 0:
        return None
    force, moved = load - load.mean(), values - values.mean()
    work, full = float(force @ moved), float(np.linalg.norm(force) * np.linalg.norm(moved))
    along = abs(work) / float(force @ force) * np.ptp(load)
    sd = test.sd_deg if COORDINATES[column].unit == "deg" else test.sd_mm
    if work >= -_FALLS * full or along <= max(_LEAST, _DEVIATIONS * (sd or 0.0)):
        return None
    ends = [int(np.argmin(load)), int(np.argmax(load))]
    low, high = load[ends].tolist()
    flexion = float(test.flexion_deg[rows[0]])
    return AgainstLoad(name, column, flexion, (low, high), tuple(values[ends].tolist()))
