"""Laxity from curves of load over displacement, and second balances along them."""

from __future__ import annotations

import dataclasses

import numpy as np

from kneejax.experiments._branches import GUESSED, SecondBalances, changed_in_steps, guesses
from kneejax.experiments._curves import Curves
from kneejax.experiments._motion import balanced_near
from kneejax.geometry import COLUMNS, coordinate
from kneejax.mechanics import Knee, load_called
from kneejax.numerics import Named, needs_numbers
from kneejax.statics import Status, balance_one, converged


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
    test, status = curves.test, curves.searched if status is None else status
    reached = np.asarray(curves.motion.reached)[curves.nodes]
    moved, neutral = np.asarray(curves.displacement_by_load), np.asarray(curves.neutral)
    load = np.asarray(curves.driving_load)
    order = np.argsort(test.size * curves.part)  # a test may begin with the negative sense
    zero = int(np.argmin(np.abs(curves.part[order])))
    ways = order[zero:], order[zero::-1]
    works = load_called(test.observed) == test.driven_by
    answer = []
    for row, flexion in enumerate(test.flexion_deg):
        ends, held, first, last = [], [], [], []
        for way in ways:
            if len(way) < 2:
                ends.append(np.nan)
                held.append(np.nan)
                continue
            good = converged(status[row, way])
            count = len(way) if good.all() else int(np.argmin(good))
            known = way[:count]
            with np.errstate(divide="ignore", invalid="ignore"):
                slope = np.diff(load[row, known]) / np.diff(moved[row, known])
            if works and len(slope):
                first.append(slope[0])
                last.append(slope[-1])
            ends.append(moved[row, way[-1]] if count == len(way) else np.nan)
            held.append(load[row, known[-1]] if count else np.nan)
            if test.displacement is None and count < len(way):
                held[-1] = load[row, way[count]] * reached[row, way[count]]
        both = [end for end, way in zip(ends, ways, strict=True) if len(way) > 1]
        span = both[0] - both[1] if len(both) == 2 else abs(both[0]) if both else np.nan
        answer.append(Laxity(
            test.name, float(flexion), test.observed, float(span), float(ends[0]), float(ends[1]),
            float(neutral[row]), _mean(first), _mean(last), coordinate(test.observed).unit,
            float(held[0]), float(held[1]), curves.counted_from,
            Status(int(status[row].max())),
        ))  # fmt: skip
    return tuple(answer)


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
    if curves.test.machine:
        return np.full((*nodes.shape, len(COLUMNS)), np.nan)
    part, lines = curves.part, np.arange(nodes.size).reshape(nodes.shape)
    zero = int(np.abs(part).argmin())
    ends = sorted({int(part.argmin()), zero, int(part.argmax())})
    load_cases = motion.load_cases.of(before).take(nodes.ravel())
    main = guesses(motion.equilibrium) | {"status": np.asarray(motion.status)}
    main = {name: values[nodes.ravel()] for name, values in main.items()}
    second = SecondBalances(motion.knee, load_cases, main)
    rows = lines[:, ends].ravel()
    at = load_cases.take(rows)
    whole = balance_one(before, at).in_nodes()
    good = np.asarray(converged(whole["status"]))
    # A loose knee snaps over on the way to its load: then what it snaps to from its neutral pose.
    rest = np.repeat(np.arange(len(nodes)) * len(ends) + ends.index(zero), len(ends))
    lost = np.flatnonzero(~good & good[rest])
    if len(lost):
        begin = [whole[name][rest[lost]] for name in GUESSED]
        snapped = balanced_near(before, at.take(lost), begin).in_nodes()
        for name in (*GUESSED, "status"):
            whole[name] = np.array(whole[name])
            whole[name][lost] = snapped[name]
        good = np.asarray(converged(whole["status"]))
    if good.any():
        begin = [whole[name][good] for name in GUESSED]
        found = changed_in_steps(before, motion.knee, at.take(good), begin)
        if found is not None:
            second.add(rows[good], found)
    second.follow(lines)
    flexion = np.repeat(curves.test.flexion_deg, nodes.shape[1])
    return second.poses(flexion).reshape(*nodes.shape, len(COLUMNS))
