"""Laxity from curves of load over displacement, and second balances along them."""

from __future__ import annotations

import dataclasses

import jax
import numpy as np

from kneejax.experiments._branches import GUESSED, changed_in_steps, follow_second, second_of
from kneejax.experiments.laboratory._curves import Curves
from kneejax.geometry import COLUMNS, FREE_COORDINATES, coordinate, table_units
from kneejax.mechanics import Knee, load_called
from kneejax.numerics import Named, needs_numbers
from kneejax.statics import Status, balance_near, balance_one, converged, itself


@dataclasses.dataclass(frozen=True)
class Laxity(Named):
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

    Example:
        `kj.laxity` makes them of the curves of a test. By hand:

        >>> from kneejax import Laxity, Status
        >>> one = Laxity("drawer", 30.0, "anterior", 9.0, 5.0, -4.0, 0.0, 20.0, 60.0, "mm",
        ...              90.0, -90.0, "own", Status.BALANCED)
        >>> one.range, one.unit
        (9.0, 'mm')
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

    def _named(self) -> dict[str, tuple]:
        units = {name: self.unit for name in ("range", "positive", "negative", "neutral")}
        return {x: ("", y, units.get(x, "")) for x, y in zip(LAXITY_COLUMNS, self.row, strict=True)}

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


def second_balances(curves: Curves, before: Knee) -> np.ndarray:
    """Where a knee that was cut has a second stable balance under the loads of a test.

    A test finds what is connected with the unloaded knee. From the other side the intact knee is
    loaded first and cut then: at the ends of each curve and without the test's load. What is found
    there apart from the curve is followed along it, as far as it exists.

    Args:
        curves: of the knee that was cut.
        before: the knee before.

    Returns:
        Poses, degrees and mm, `(flexions, loads, 6)`; NaN where none is known, and in tests in
        which a machine moves or holds the tibia.
    """
    motion, nodes = curves.motion, curves.nodes
    answer = np.full((*nodes.shape, len(COLUMNS)), np.nan)
    if curves.test.machine:
        return answer
    part = curves.part
    ends = sorted({int(part.argmin()), int(np.abs(part).argmin()), int(part.argmax())})
    load_cases = jax.tree.map(lambda x: np.asarray(x)[nodes.ravel()], motion.load_cases.of(before))
    main = {x: np.moveaxis(np.asarray(getattr(motion.equilibrium, x)), -1, 0)[nodes.ravel()]
            for x in GUESSED}  # fmt: skip
    main["status"] = np.asarray(motion.status)[nodes.ravel()]
    second = {x: np.full_like(main[x], np.nan) for x in GUESSED}
    lines = np.arange(nodes.size).reshape(nodes.shape)
    rows = lines[:, ends].ravel()
    at = jax.tree.map(lambda x: x[rows], load_cases)
    whole = balance_one(before, at).in_nodes()
    good = np.asarray(converged(whole["status"]))
    # A loose knee snaps over on the way to its load: then what it snaps to from its neutral pose.
    rest = np.repeat(np.arange(len(nodes)) * len(ends) + ends.index(int(np.abs(part).argmin())),
                     len(ends))  # fmt: skip
    lost = np.flatnonzero(~good & good[rest])
    if len(lost):
        begin = [whole[name][rest[lost]][None] for name in GUESSED]
        there = jax.tree.map(lambda x: x[lost], at)
        snapped = balance_near(before, itself, np.zeros(1), there, *begin).in_nodes()
        for name in (*GUESSED, "status"):
            whole[name] = np.array(whole[name])
            whole[name][lost] = snapped[name]
        good = np.asarray(converged(whole["status"]))
    if good.any():
        at, rows = jax.tree.map(lambda x: x[good], at), rows[good]
        found = changed_in_steps(before, motion.knee, at, [whole[x][good] for x in GUESSED])
        if found is not None:
            here = second_of(at, {x: main[x][rows] for x in ("q", "status")}, found)
            for name, values in second.items():
                values[rows[here]] = found[name][here]
    follow_second(motion.knee, load_cases, main, second, lines)
    poses = second["q"].reshape(*nodes.shape, -1)[..., : len(FREE_COORDINATES)]
    answer[..., 1:] = poses * table_units(FREE_COORDINATES)
    flexion = np.array(curves.test.flexion_deg)[:, None]
    answer[..., 0] = np.where(np.isnan(answer[..., 1]), np.nan, flexion)
    return answer
