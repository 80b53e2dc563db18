"""What a knee answers to a test under load: curves of load over displacement, and laxity."""

__all__ = ["LAXITY_COLUMNS", "Curves", "Laxity", "laxity", "load_curves", "mechanics_of"]

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.experiments._evaluate import Mechanics, evaluate
from kneejax.experiments._lab_tests import LabTest
from kneejax.experiments._motion import Motion, followed, passive_flexion, with_flips
from kneejax.geometry import CLINICAL, COLUMNS, COORDINATES, coordinate, table_units
from kneejax.mechanics import Knee, load_called
from kneejax.numerics import Named, needs_numbers, numpy_for
from kneejax.statics import LoadCases, Status, converged


@dataclasses.dataclass(frozen=True)
class Curves(Named):
    """A test's load path at each flexion, followed from the balance without its load.

    Every load is balanced once, however often the path comes by it: nothing in the knee
    dissipates, and what is connected with the unloaded knee without a turning point is one curve,
    up and down. Beyond a turning point nothing is reported but where it was.

    Attributes:
        test: that was made.
        motion: all balances, also those of tests that were made at the same time.
        nodes: rows of the motion, one for each different load, `(flexions, loads)`.
        part: of the full load or displacement at each of them, in order of size, `(loads,)`.
        steps: the place among these of each step of the path, `(steps,)`.
        intact: neutral poses of the knee before it was cut, from which displacements are counted;
            None where they are counted from the knee's own.
        intact_rows: of these, one for each flexion, `(flexions,)`.

    Example:
        `kj.load_curves` makes them; it compiles for long. What they hold:

        >>> import kneejax as kj
        >>> list(kj.Curves.__dataclass_fields__)[:2]
        ['test', 'motion']
    """

    test: LabTest
    motion: Motion
    nodes: np.ndarray
    part: np.ndarray
    steps: np.ndarray
    intact: Motion | None = None
    intact_rows: np.ndarray = dataclasses.field(default_factory=lambda: np.empty(0, int))

    def _named(self) -> dict[str, tuple]:
        over, test = ("flexion_deg", "step"), self.test
        poses = np.moveaxis(np.asarray(self.to_table()), -1, 0)[1:]
        loads = dict.fromkeys([test.driven_by, *test.full, *test.constant])
        return {
            "flexion_deg": ("flexion_deg", test.flexion_deg), "path": ("step", test.path, "1"),
            **{name: (over, x) for name, x in zip(COLUMNS[1:], poses, strict=True)},
            **{name: (over, self.load(name)) for name in loads},
            "displacement": (over, self.displacement, COORDINATES[test.observed].unit),
            "status": (over, self.searched[:, self.steps], Status),
        }  # fmt: skip

    @property
    def counted_from(self) -> str:
        """Of displacements, one of `kneejax.experiments.COUNTED_FROM`."""
        return "unloaded" if self.intact is None else "intact"

    def to_table(self, convention: str = "femoral") -> Array:
        """Poses in degrees and mm, `(flexions, steps, 6)`, in the order of pose tables."""
        return _taken(self.motion.to_table(convention), self.nodes[:, self.steps])

    @property
    def displacement(self) -> Array:
        """Change of what is observed from the pose that counts as zero, `(flexions, steps)`, mm or
        degrees: the neutral pose, or that of the intact knee."""
        return self.displacement_by_load[:, self.steps]

    @property
    def displacement_by_load(self) -> Array:
        """The same at every different load in order of its size, `(flexions, loads)`."""
        zero = self.neutral
        if self.intact is not None:
            zero = _taken(_observed(self.test, self.intact), self.intact_rows)
        return _taken(_observed(self.test, self.motion), self.nodes) - zero[:, None]

    def load(self, name: str) -> Array:
        """A load at every step, what acts throughout included, `(flexions, steps)`.

        Args:
            name: see `kneejax.mechanics.NAMED_LOADS`. A machine's is that under which the tibia is
                where it was moved to: `test.driven_by`.

        Returns:
            N or N m; NaN where a machine's force is not known since no balance was found.
        """
        grows = self.test.full.get(name, 0.0) * self.part
        own = self.driving_load if name == self.test.driven_by else grows
        own = numpy_for(own).broadcast_to(own, self.nodes.shape)
        return self.test.constant.get(name, 0.0) + own[:, self.steps]

    @property
    def driving_load(self) -> Array:
        """What grows, or the force of the machine, without what acts throughout; N or N m, at every
        different load or displacement, `(flexions, loads)`."""
        test = self.test
        if test.displacement is None:
            return np.broadcast_to(test.size * self.part, self.nodes.shape)
        unit = 1000.0 if COORDINATES[test.observed].unit == "deg" else 1.0
        return _taken(self.motion.reaction(test.machine[0]), self.nodes) / unit

    @property
    def neutral(self) -> Array:
        """What is observed without the test's load, `(flexions,)`, mm or degrees."""
        unloaded = self.nodes[:, int(np.argmin(np.abs(self.part)))]
        return _taken(_observed(self.test, self.motion), unloaded)

    @property
    def searched(self) -> np.ndarray:
        """What the search met at every load, `Status` values, `(flexions, loads)`; where the intact
        knee does not balance nothing can be counted from it, and its status is told."""
        found = np.asarray(self.motion.status)[self.nodes]
        if self.intact is None:
            return found
        before = np.asarray(self.intact.status)[self.intact_rows, None]
        return np.where(converged(before), found, np.maximum(before, found))

    def status(self, mechanics: Mechanics) -> np.ndarray:
        """What became of every load; fibres are compared along each curve.

        Args:
            mechanics: of the motion (`mechanics_of`).

        Returns:
            `Status` values, `(flexions, loads)`.
        """
        along = (jax.tree.map(lambda x, at=rows: _taken(x, at), mechanics) for rows in self.nodes)
        return np.stack([*map(with_flips, self.searched, along)])


def _observed(test: LabTest, motion: Motion) -> Array:
    """What a test observes at every row of a motion, mm or degrees."""
    column = list(COORDINATES).index(test.observed)
    return _taken(motion.to_table(CLINICAL), (slice(None), column))


def _taken(x: Array, rows: Any) -> Array:
    return numpy_for(x).asarray(x)[rows]


def mechanics_of(curves: Curves) -> Mechanics:
    """Ligaments and contact at every row of the motion of some curves.

    Args:
        curves: of any of the tests that were made at the same time.
    """
    motion = curves.motion
    return evaluate(motion.knee, motion.pose, motion.equilibrium.contact_points)


def load_curves(
    knee: Knee, tests: LabTest | Sequence[LabTest], intact: Knee | None = None
) -> tuple[Curves, ...]:
    """Load a knee as some tests say, all of them in one batch.

    At each flexion the knee is bent without a load, takes what acts throughout, and then the
    test's load grows from nothing, one way and the other (`kneejax.experiments.passive_flexion`).
    Where a machine moves or holds the tibia, it takes hold of it in the neutral pose, which is that
    under what acts throughout. No test depends on the others.

    A robot repeats the passive path of the intact knee before and after a cut, and counts from it.
    With `intact`, displacements are counted from that knee's neutral pose, and a machine takes hold
    of the tibia there.

    Args:
        knee: any knee.
        tests: what is done.
        intact: the knee before anything was cut; the knee's own neutral pose counts without it.

    Returns:
        The curves of each test, differentiable with respect to every number of the knee. Where the
        knee gives way poses are NaN, and `motion.reached` tells under which part of a load it
        still held.

    Raises:
        ValueError: no test, or tests in which a machine moves or holds different coordinates.
        RuntimeError: float64 is switched off.

    Example:
        >>> import kneejax as kj
        >>> tests = kj.lab_tests("drawer", [30.0], force_N=50.0, steps=1)
        >>> (curves,) = kj.load_curves(kj.load_knee("four_ligament"), tests)
        >>> bool(curves.displacement[0, 1] > 0)
        True
    """
    tests = (tests,) if isinstance(tests, LabTest) else tuple(tests)
    if not tests:
        raise ValueError("tests is empty; expected at least one")
    machine, *others = sorted({test.machine for test in tests})
    if others:
        kinds = "; ".join(", ".join(names) or "nothing" for names in (machine, *others))
        raise ValueError(f"tests prescribe different coordinates ({kinds}); expected one call each")
    # Rows are loads of curves; each curve, at one flexion of one test, has a neutral pose.
    flexion = np.concatenate([test.flexion_deg for test in tests])
    paths = [np.unique(np.r_[0.0, test.path], return_inverse=True) for test in tests]
    parts = [np.tile(x, (len(y.flexion_deg), 1)) for (x, _), y in zip(paths, tests, strict=True)]
    curve = np.repeat(np.arange(len(flexion)), [len(row) for each in parts for row in each])
    first = np.flatnonzero(np.diff(curve, prepend=-1))
    loads = [test.loads(each.ravel()) for test, each in zip(tests, parts, strict=True)]
    both = zip(*loads, strict=True)
    constant, grows = (jax.tree.map(lambda *x: jnp.concatenate(x), *kind) for kind in both)
    constant = [constant] if any(test.constant for test in tests) else []

    def neutral_of(some: Knee) -> Motion:
        """A knee under what acts throughout."""
        return passive_flexion(some, flexion, jax.tree.map(lambda x: x[first], constant))

    before = None if intact is None else neutral_of(intact)
    if not machine:
        motion = passive_flexion(knee, flexion[curve], [*constant, grows])
    else:
        neutral = neutral_of(knee) if before is None else before
        moved = np.zeros((len(machine), len(curve)))
        moved[0] = np.concatenate([
            (test.displacement or 0.0) * each.ravel() / table_units([test.observed])
            for test, each in zip(tests, parts, strict=True)
        ])  # fmt: skip
        taken = neutral.equilibrium.state.at(machine)[:, curve] + moved
        acting, later = (*constant, grows), 1
        if constant and all(test.displacement is not None for test in tests):
            # A machine that moves the tibia adds no load: the search of the neutral pose serves.
            acting, later = tuple(constant), 0
        prescribed = {"flexion": jnp.deg2rad(jnp.asarray(flexion, float))[curve]}
        prescribed |= zip(machine, taken, strict=True)
        motion = followed(knee, LoadCases(prescribed, acting, later=later))
    rows = np.split(np.arange(len(curve)), np.cumsum([each.size for each in parts])[:-1])
    return tuple(
        Curves(test, motion, own.reshape(each.shape), part, back[1:], before, np.unique(curve[own]))
        for test, own, each, (part, back) in zip(tests, rows, parts, paths, strict=True)
    )


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
        ends, held, first, last = [np.nan, np.nan], [np.nan, np.nan], [], []
        for k, way in enumerate(ways):
            if len(way) < 2:
                continue
            good = converged(status[row, way])
            count = len(way) if good.all() else int(np.argmin(good))
            known = way[:count]
            with np.errstate(divide="ignore", invalid="ignore"):
                slope = np.diff(load[row, known]) / np.diff(moved[row, known])
            if works and len(slope):
                first.append(slope[0])
                last.append(slope[-1])
            held[k] = load[row, known[-1]] if count else np.nan
            if count == len(way):
                ends[k] = moved[row, way[-1]]
            elif test.displacement is None:
                held[k] = load[row, way[count]] * reached[row, way[count]]
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
