"""What was recorded: the cycle of an activity, rounds of its search, the sense of a test."""

__all__ = ["Cycle", "Round", "against_load", "cycle_of", "weights"]

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from kneejax.experiments._measured_test import MeasuredTest, change_of
from kneejax.geometry import COORDINATES, FREE_COORDINATES
from kneejax.mechanics import NAMED_LOADS, LegRecord

#: Upward force of the ground from which a foot stands on it, N, if no other component is larger.
STANDS_N = 20.0
#: No foot that stands is off the ground for less, s.
_SHORTEST_S = 0.05


class Cycle(NamedTuple):
    """Instants as parts of a cycle.

    Attributes:
        percent: `(n,)`; negative before the first heel strike.
        toe_off: percent at which the foot leaves the ground; NaN where it is not recorded.
        words: what 0 and 100 are.
        is_gait: whether that is a cycle of gait, from one heel strike to the next.
    """

    percent: np.ndarray
    toe_off: float
    words: str
    is_gait: bool = False

    @property
    def axis_label(self) -> str:
        """What an axis of `percent` is called."""
        return "Gait cycle, %" if self.is_gait else "Record, %"


def cycle_of(record: LegRecord) -> Cycle:
    """Count a record from heel strike to heel strike, as the force of the ground tells.

    Args:
        record: of a gait, or of something else: without a foot that comes down and bears weight,
            as in a squat or a drawer, 0 and 100 are the ends of the record.

    Example:
        >>> import types
        >>> ground = np.array([0, 0, 300, 300, 300, 0, 0, 0, 300.0])[:, None] * [0, 1, 0]
        >>> record = types.SimpleNamespace(time_s=np.arange(9) / 10, ground_N=ground)
        >>> cycle = cycle_of(record)
        >>> cycle.words, *(round(float(x), 6) for x in (*cycle.percent[[2, 8]], cycle.toe_off))
        ('from heel strike to heel strike', 0.0, 100.0, 50.0)
    """
    time = np.asarray(record.time_s, float)
    # A device that draws the tibia forwards is no ground: that presses upwards, along Y.
    upwards = np.asarray(record.ground_N)[:, 1]
    stands = (upwards > STANDS_N) & (upwards >= np.abs(record.ground_N).max(axis=1))
    change = np.diff(stands.astype(int))
    strikes, lifts = time[1:][change > 0], time[1:][change < 0]
    strikes = strikes[np.diff(strikes, prepend=-np.inf) > _SHORTEST_S]
    begin, end, words = time[0], time[-1], "the whole record"
    if len(strikes) > 1:
        (begin, end), words = strikes[:2], "from heel strike to heel strike"
    elif len(strikes):
        begin, words = strikes[0], "from heel strike to the end of the record"
    percent = 100.0 * (time - begin) / (end - begin)
    after = lifts[(lifts > begin) & (lifts < end)]
    toe_off = 100.0 * (after[-1] - begin) / (end - begin) if len(after) else np.nan
    return Cycle(percent, float(toe_off), words, len(strikes) > 1)


#: How much of the first change goes back, and between which limits that stays.
_FIRST = 0.5
_WITHIN = 0.1, 1.0


@dataclasses.dataclass(frozen=True)
class Round:
    """What a whole body moved with, and what the knee made of its forces.

    Attributes:
        number: 0 for the model as it was.
        flexion_deg: at which both motions are compared, `(k,)`.
        before: secondary motion that the whole body's knee had, degrees and mm, `(k, 5)`, in the
            order of `kneejax.geometry.FREE_COORDINATES`.
        after: that of the knee in balance with the whole body's forces, likewise.
        left: what splines of flexion leave of the balanced poses, rms, `(5,)`.
        holds: at how many of the instants there is a balance, and how many there are.
        moment_Nm: that holds flexion, rms.
        reaction_N: by how much the knee's reaction as the whole-body program states it differs from
            what was read of its forces, rms; NaN where it cannot be compared.
    """

    number: int
    flexion_deg: np.ndarray
    before: np.ndarray
    after: np.ndarray
    left: np.ndarray
    holds: tuple[int, int]
    moment_Nm: float
    reaction_N: float

    @property
    def residual(self) -> np.ndarray:
        """Of the fixed point: by how much the motion changed, rms and largest, `(2, 5)`."""
        change = self.change
        return np.stack([np.sqrt(np.mean(change**2, axis=0)), np.abs(change).max(axis=0)])

    @property
    def change(self) -> np.ndarray:
        """From one motion to the other, `(k, 5)`."""
        return self.after - self.before


def weights(rounds: Sequence[Round]) -> list[float]:
    """How much of each round's change goes back into the model, by Aitken's rule.

    The whole change would be put back where the forces did not answer to the motion. They do: with
    two rounds a secant tells how much, and the next change is shortened or lengthened by that.

    Args:
        rounds: in their order.

    Returns:
        One number a round, from 0.1 to 1; the first is one half.

    Source: Irons and Tuck, Int J Numer Methods Eng 1 (1969).

    Example:
        >>> def made(number, before):
        ...     at = np.full((1, 5), before)
        ...     return Round(number, np.zeros(1), at, -at, np.zeros(5), (1, 1), 0.0, 0.0)
        >>> weights([made(0, 1.0), made(1, 0.0)])
        [0.5, 0.5]
    """
    found = [_FIRST]
    for last, this in zip(rounds, rounds[1:], strict=False):
        turn = this.change - last.change
        size = float(np.sum(turn * turn))
        secant = -found[-1] * float(np.sum(last.change * turn)) / size if size else found[-1]
        found.append(float(np.clip(secant, *_WITHIN)))
    return found[: len(rounds)]


#: Of the work over that of a curve in which load and displacement are in proportion; below minus
#: this a curve falls, whatever its noise.
_FALLS = 0.7
#: Along a curve a coordinate changes by more than this, mm or degrees, or it tells no sense; and by
#: so many of its standard deviations.
_LEAST, _DEVIATIONS = 1.0, 4.0
#: Part of the largest change of load below which another one counts as constant.
_CONSTANT = 0.1


class AgainstLoad(NamedTuple):
    """A curve along which the tibia moves against the load."""

    load: str  # its name
    coordinate: str  # on which it does work
    flexion_deg: float  # of the curve
    loads: tuple[float, float]  # the least and the largest of the curve, N or N m
    values: tuple[float, float]  # of the coordinate there, mm or degrees


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
    curve = test.curve
    order = np.argsort(test.flexion_deg, kind="stable")
    every = (_falls(test, order[curve[order] == number]) for number in np.unique(curve))
    return next(filter(None, every), None)


def _falls(test: MeasuredTest, rows: np.ndarray) -> AgainstLoad | None:
    """Whether one curve falls under the load that changes along it, if it is only one."""
    # What is counted from the unloaded pose is nothing there.
    zero = np.zeros(int(test.counted_from == "unloaded"))
    loads = {name: np.r_[zero, sizes[rows]] for name, sizes in test.loads.items()}
    change = {name: change_of(name, sizes) for name, sizes in loads.items()}
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
    pair, moved = (tuple(x[ends].tolist()) for x in (load, values))
    return AgainstLoad(name, column, float(test.flexion_deg[rows[0]]), pair, moved)
