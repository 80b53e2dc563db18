"""A curve in a few numbers: how far the knee gives, and how stiffly."""

from __future__ import annotations

import dataclasses

import numpy as np

from kneejax.experiments.laboratory._curves import Curves
from kneejax.geometry import coordinate
from kneejax.mechanics import load_called
from kneejax.numerics import needs_numbers
from kneejax.statics import Status, converged


@dataclasses.dataclass(frozen=True)
class Laxity:
    """How far a knee gives in one test at one flexion.

    Attributes:
        test: its name.
        flexion_deg: at which it was made.
        coordinate: that was observed.
        range: between the two ends, or the size of the one end of a test one way.
        positive: displacement under the full positive load; NaN where the knee does not hold it.
        negative: under the full negative load, likewise; NaN in a test one way.
        neutral: value of the coordinate without the test's load.
        stiffness_start: mean slope of load over displacement in the first step each way; NaN where
            another coordinate is observed than that along which the load works.
        stiffness_end: the same in the last step each way that the knee held.
        unit: of the displacements, `mm` or `deg`; of stiffness N or N m per unit.
        held_positive: largest positive load that the knee held, N or N m; the force of a machine
            that moves the tibia at its last place that way.
        held_negative: the same of the negative load, negative.
        counted_from: of `positive` and `negative`, one of `kneejax.experiments.COUNTED_FROM`.
        status: the worst of all steps.
    """

    test: str
    flexion_deg: float
    coordinate: str
    range: float
    positive: float
    negative: float
    neutral: float
    stiffness_start: float
    stiffness_end: float
    unit: str
    held_positive: float
    held_negative: float
    counted_from: str
    status: Status

    @property
    def row(self) -> list:
        """The cells of laxity.csv under `LAXITY_COLUMNS`."""
        return [*(getattr(self, name) for name in LAXITY_COLUMNS[:-1]), self.status.word]


#: Columns of laxity.csv.
LAXITY_COLUMNS = tuple(field.name for field in dataclasses.fields(Laxity))


def laxity(curves: Curves, status: np.ndarray | None = None) -> tuple[Laxity, ...]:
    """The numbers of a test, one row for each flexion.

    Args:
        curves: of one test.
        status: `Status` values, `(flexions, loads)`; those of the search by default.

    Example:
        >>> import kneejax as kj
        >>> (test,) = kj.lab_tests("drawer", [30.0], force_N=50.0, both=True, steps=2)
        >>> (curves,) = kj.load_curves(kj.load_knee("four_ligament"), test)
        >>> (found,) = laxity(curves)
        >>> bool(np.isclose(found.range, found.positive - found.negative)), found.unit
        (True, 'mm')
    """
    needs_numbers("laxity", "load_curves(...).displacement", curves.motion)
    status = curves.searched if status is None else status
    reached = np.asarray(curves.motion.reached)[curves.nodes]
    moved, neutral = np.asarray(curves.displacement_by_load), np.asarray(curves.neutral)
    load = np.asarray(curves.driving_load)
    order = np.argsort(curves.test.size * curves.part)  # a test may begin with the negative sense
    rows = zip(
        curves.test.flexion_deg, load[:, order], moved[:, order], reached[:, order],
        status[:, order], neutral, strict=True,
    )  # fmt: skip
    zero = int(np.argmin(np.abs(curves.part[order])))
    return tuple(_of_flexion(curves, zero, *row) for row in rows)


def _of_flexion(curves: Curves, zero, flexion, load, moved, reached, status, neutral) -> Laxity:
    by_load = curves.test.displacement is None
    up, down = (_arm(way, zero, load, moved, reached, status, by_load) for way in (1, -1))
    ways = [arm for arm in (up, down) if arm.asked]
    span = ways[0].end - ways[1].end if len(ways) == 2 else abs(ways[0].end) if ways else np.nan
    name = curves.test.observed
    if load_called(name) != curves.test.driven_by:
        ways = []
    return Laxity(
        curves.test.name, float(flexion), name, float(span), up.end, down.end, float(neutral),
        _mean([arm.first for arm in ways]), _mean([arm.last for arm in ways]),
        coordinate(name).unit, up.held, down.held, curves.counted_from,
        Status(int(status.max())),
    )  # fmt: skip


@dataclasses.dataclass(frozen=True)
class _Arm:
    """One way of a curve: displacement at its end, slopes of its ends, the largest load held."""

    asked: bool
    end: float
    first: float
    last: float
    held: float


def _arm(way: int, zero: int, load, moved, reached, status, by_load: bool) -> _Arm:
    rows = np.arange(zero, len(load)) if way > 0 else np.arange(zero, -1, -1)
    if len(rows) < 2:
        return _Arm(False, np.nan, np.nan, np.nan, np.nan)
    good = converged(status[rows])
    count = len(rows) if good.all() else int(np.argmin(good))
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = np.diff(load[rows[:count]]) / np.diff(moved[rows[:count]])
    first, last = (float(slope[k]) if len(slope) else np.nan for k in (0, -1))
    end = float(moved[rows[-1]]) if count == len(rows) else np.nan
    held = load[rows[count - 1]] if count else np.nan
    if by_load and count < len(rows):
        held = load[rows[count]] * reached[rows[count]]
    return _Arm(True, end, first, last, float(held))


def _mean(values: list[float]) -> float:
    known = [x for x in values if np.isfinite(x)]
    return float(np.mean(known)) if known else np.nan
