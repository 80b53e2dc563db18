"""Activities: a recorded motion, its external loads and muscles, balanced instant by instant.

A path of its own leads to some instants, the others lie between them. An instant lies near its
neighbours in time, so only a few are followed from the reference pose, each by itself. The others
are sought where their neighbours in time say, half-way first; what is not found there gets a path
of its own. It bends the knee without the movement's loads first. A loose knee can be lost there, or
come to a balance far from the intact knee's though one is near it: a knee that was cut is sought
also where the intact one balances, cut while the loads act.
"""

__all__ = ["Activity", "activity"]

import dataclasses
from collections.abc import Iterable

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.experiments._branches import GUESSED, SecondBalances, changed_in_steps, guesses
from kneejax.experiments._evaluate import Mechanics, evaluate
from kneejax.experiments._extensor import at_rest
from kneejax.experiments._extensor_mechanism import TENDON
from kneejax.experiments._motion import Motion, apart_mm, balanced_near, in_rows, motion_of
from kneejax.geometry import FEMUR_AND_TIBIA, PATELLA, TIBIA, Pose, State
from kneejax.mechanics import (
    QUADRICEPS,
    ConstantTensionLine,
    Knee,
    LegRecord,
    Load,
    Muscles,
    Pull,
    Wrench,
    add_lane_axis,
    pull_of,
)
from kneejax.numerics import Named, compiled
from kneejax.parameters import cut
from kneejax.statics import LoadCases, Status, balance_one, converged, sound

#: Flexion, degrees, and tension of the patellar tendon by pull of the quadriceps there: passive
#: flexion of the model lenhart2015 of OpenSim JAM, recorded (Lenhart et al., Annals of Biomedical
#: Engineering 43, 2015; Apache-2.0); constant beyond.
FLEXION_DEG = np.arange(0.0, 91.0, 10.0)
TENDON_BY_QUADRICEPS = np.array([1.13, 1.04, 0.86, 0.77, 0.68, 0.59, 0.50, 0.52, 0.55, 0.60])


@dataclasses.dataclass(frozen=True)
class Activity(Named):
    """Balances of a knee over a recorded movement.

    Attributes:
        record: what was recorded.
        motion: the balances, one an instant; NaN with its status where there is none.
        mechanics: ligaments and contacts there.
        acting: what acts on the tibia by name, about its origin along its axes, `(n, 6)` each, N
            and N mm: record and muscles, without what the knee's own parts do.
        other: where a second stable balance is known, its pose, degrees and mm, `(n, 6)`; NaN
            elsewhere.
    """

    record: LegRecord
    motion: Motion
    mechanics: Mechanics
    acting: dict[str, np.ndarray]
    other: np.ndarray

    def _named(self) -> dict[str, tuple]:
        knee, record = self.motion.knee, self.record
        return self.motion._named() | self.mechanics._named() | {
            "time_s": ("pose", record.time_s), "quadriceps_N": ("pose", record.quadriceps_N),
            "ligament": ("ligament", knee.ligaments.names),
            "contact": ("contact", knee.contact_names),
        }  # fmt: skip

    @property
    def holds(self) -> np.ndarray:
        """Where there is a balance, `(n,)`."""
        return np.asarray(converged(self.motion.status))

    @property
    def total(self) -> np.ndarray:
        """All that acts together, `(n, 6)`."""
        return sum(self.acting.values(), np.zeros((len(self.record.time_s), 6)))

    @property
    def held(self) -> dict[str, np.ndarray]:
        """What the knee's own parts do to the tibia along its axes, `(n, 6)` each, as `acting`:
        the ligaments together, the contacts by name."""
        motion, found = self.motion, self.mechanics
        ligaments = np.asarray(_of_ligaments(motion.knee, motion.equilibrium.state)).T
        answer = {"ligaments": np.where(self.holds[:, None], ligaments, np.nan)}
        for k, name in enumerate(motion.knee.contact_names):
            if motion.knee.contacts[k].bodies == FEMUR_AND_TIBIA:
                both = found.contact_force, found.contact_moment
                answer[name] = np.concatenate([np.asarray(x)[:, k] for x in both], axis=1)
        return answer

    @property
    def left_over(self) -> np.ndarray:
        """What all together leaves over, `(n, 6)`: no force, and the moment that flexion is held
        against."""
        return self.total + sum(self.held.values(), np.zeros(self.total.shape))

    @property
    def residual_Nm(self) -> np.ndarray:
        """Moment that holds flexion, `(n,)`: nothing where record and knee agree.

        Positive where the knee would extend under what the record says, so that something must
        bend it.
        """
        return np.asarray(self.motion.reaction("flexion")) / 1000.0


def activity(knee: Knee, record: LegRecord, near: Activity | None = None) -> Activity:
    """Balance a knee at each instant of a recorded movement.

    Flexion is the record's; the other coordinates balance under what acts on the leg below the
    knee, quasi-statically: weight, inertia and ground as a wrench that follows the tibia, whose
    place in space was recorded, and muscles of the recorded tension along their paths, which move
    with the balance. In a knee of two bones the quadriceps pulls by its line `patellar_tendon`
    (`TENDON_BY_QUADRICEPS`); in one of three, on the patella.

    Args:
        knee: of two bones, or of three (`KneeFile.with_patella`).
        record: from `kneejax.files.read_activity`.
        near: of a like knee under the same record, as the intact one of a knee that was cut. A
            loose knee may have two stable balances: that is reported to which the intact knee comes
            when it is cut while the loads act, and the other one named. Where the search for an
            instant finds nothing, it begins at that knee's balance too. Without it that is reported
            to which the knee comes from its unloaded balance when the loads grow.

    Returns:
        The balances. Its motion is differentiable by every number of the knee; the record holds.

    Raises:
        ValueError: the quadriceps pulls on a patella and the knee has neither a patella nor a
            line for its tendon; or a muscle of the knee is called as one of the record.
    """
    if PATELLA in knee.bodies:
        record = record.with_heads_on_patella()
    muscles, pulls, every = muscles_over(knee, record), [], knee.muscles
    if PATELLA in knee.bodies:
        pulls.append(pull_of(QUADRICEPS, record.quadriceps_N - at_rest(knee)))
    if muscles.names:
        # In the knee they are at rest; each instant pulls.
        slack = jax.tree.map(lambda x: x[..., 0], muscles)
        slack = dataclasses.replace(slack, tension=0.0 * slack.tension)
        every = slack if every is None else every.with_more(slack)
        ends = jnp.stack([muscles.femoral_attachment, muscles.tibial_attachment], axis=1)
        pulls.append(Pull(muscles.tension.T, muscles.names, jnp.moveaxis(ends, -1, 0)))
    nothing = np.zeros((len(record.time_s), 6))
    total = sum(record.acting.values(), nothing)
    leg = Load(total[:, :3], total[:, 3:], nothing[:, :3], axes=TIBIA, name="leg")
    load_cases = LoadCases.at(record.pose[:, 0], [*pulls, leg])
    # What the record pulls by name, as a band from the pelvis, follows the hip there.
    body = cut(knee, [name for name in muscles.names if name in knee.ligaments.names])
    body = dataclasses.replace(body, lines=(), muscles=every)
    given = body, load_cases, near.motion if near is not None else None
    found, second = Instants.of(*jax.lax.stop_gradient(given))
    motion = motion_of(body, load_cases, found.nodes)
    table = np.asarray(jax.lax.stop_gradient(motion.to_table()))
    tibia = np.where(np.isnan(table), record.pose, table)
    pulls = np.asarray(_on_tibia(jax.lax.stop_gradient(muscles), tibia))
    acting = record.acting | dict(zip(muscles.names, np.moveaxis(pulls, -1, 1), strict=True))
    mechanics = evaluate(motion.knee, motion.equilibrium.state, motion.equilibrium.contact_points)
    return Activity(record, motion, mechanics, acting, second.poses(record.pose[:, 0]))


def muscles_over(knee: Knee, record: LegRecord) -> Muscles:
    """The muscles of a record, arrays end in instants; with the patellar tendon where the
    quadriceps pulls by it."""
    if PATELLA in knee.bodies or not record.quadriceps_N.any():
        return record.muscles
    lines = [line for line in knee.lines if isinstance(line, ConstantTensionLine)]
    if not lines:
        expected = "a knee with a line patellar_tendon, or read with its patella"
        raise ValueError(f"{knee.name} has nothing for the quadriceps to pull on: {expected}")
    line, flexion = add_lane_axis(lines[0]), record.pose[:, 0]
    # Where the line's upper end is at an instant is known: the patella's path, which does no work.
    begins = line.upper_end(jnp.deg2rad(flexion))
    ends = jnp.broadcast_to(line.insertion, begins.shape)
    tension = record.quadriceps_N * np.interp(flexion, FLEXION_DEG, TENDON_BY_QUADRICEPS)
    return record.muscles.with_more(Muscles(begins[None], ends[None], tension[None], (TENDON,)))


@compiled()
def _on_tibia(muscles: Muscles, table: Array) -> Array:
    return muscles.on_tibia(State({TIBIA: Pose.from_table(table)}))


@compiled()
def _of_ligaments(knee: Knee, state: State):
    total = jnp.zeros((6, *state.shape))
    for pair, parts in add_lane_axis(knee).ligaments.pull(state)[0].between.items():
        if pair[1] == TIBIA:
            there, whole = state.between(pair), Wrench.total(parts)
            force, moment = there.turn_back(whole.force), there.turn_back(whole.moment)
            total = total + jnp.stack(jnp.broadcast_arrays(*force, *moment))
    return total


#: Instants with a path of their own. That costs as much as eighty instants that are found between
#: others; of a recorded step 25, 9, 5 and 3 led to the same balances.
_ANCHORS = 5
#: A balance farther from the one before is sought from there, mm (rotations at 30 mm).
_MISSED_MM = 2.0


@dataclasses.dataclass
class Instants:
    """Balances of instants, as far as they are known."""

    knee: Knee  # that balances
    load_cases: LoadCases  # the instants, in order of time
    near: Motion | None = None  # of a like knee at the same instants, see `activity`
    # Fields of the balances, and `reached` as in `Motion`; arrays begin with the instant.
    nodes: dict[str, np.ndarray] = dataclasses.field(default_factory=dict)

    @classmethod
    def of(
        cls, knee: Knee, load_cases: LoadCases, near: Motion | None = None
    ) -> "tuple[Instants, SecondBalances]":
        """Find them all, and second ones: of a knee without a lane axis, its numbers known."""
        count = len(load_cases)
        found = cls(knee, jax.tree.map(np.asarray, load_cases.of(knee)), near)
        anchors = np.unique(np.linspace(0, count - 1, min(count, _ANCHORS)).round().astype(int))
        found._by_own_path(anchors)
        found._between(anchors)
        found._in_time(1)
        found._in_time(-1)
        lost = np.flatnonzero(~found._known(np.arange(count)))
        if len(lost):
            found._by_own_path(lost)
        second = SecondBalances(knee, found.load_cases, found.nodes)
        if near is None:
            found._from_unloaded(anchors, second)
        else:
            found._from_before(near, second)
        return found, second

    def _known(self, rows: np.ndarray) -> np.ndarray:
        return converged(self.nodes["status"][rows])

    def _path(self, rows: np.ndarray) -> dict[str, np.ndarray]:
        """Balances of some instants, to each of which a path of its own leads."""
        return in_rows(balance_one(self.knee, self.load_cases.take(rows)))

    def _take(self, rows: np.ndarray, found: dict[str, np.ndarray]) -> None:
        """Write down what was found."""
        for name, values in found.items():
            if name not in self.nodes:
                shape, dtype = (len(self.load_cases), *values.shape[1:]), values.dtype
                self.nodes[name] = np.full(shape, 0 if dtype.kind in "biu" else np.nan, dtype)
            self.nodes[name][rows] = values

    def _near(self, rows: np.ndarray, begin: Iterable[np.ndarray]) -> None:
        """Find some near where they are expected."""
        at = self.load_cases.take(rows)
        self._take(rows, in_rows(balanced_near(self.knee, at, begin)))

    def _by_own_path(self, rows: np.ndarray) -> None:
        """Some instants, each by a path of its own; what was not found at all is sought where the
        other knee balances. Where the knee was found to give way, it does."""
        self._take(rows, self._path(rows))
        if self.near is None:
            return
        lost = self.nodes["status"][rows] == Status.NOT_CONVERGED
        rows = rows[lost & np.asarray(converged(self.near.status))[rows]]
        if len(rows):
            self._near(rows, [values[rows] for values in guesses(self.near.equilibrium).values()])

    def _from_before(self, before: Motion, second: SecondBalances) -> None:
        """Take the balances that the knee before has when it is changed in steps, where they are
        stable; what was found on the other way is a second one where it is another.

        A knee that was found to give way under its load stays lost, with the balance as second.
        """
        rows = np.flatnonzero(np.asarray(converged(before.status)))
        begin = [values[rows] for values in guesses(before.equilibrium).values()]
        at = self.load_cases.take(rows)
        found = changed_in_steps(before.knee, self.knee, at, begin) if len(rows) else None
        if found is None:
            return
        taken = second.add(rows, found) & self._known(rows)
        self._exchange(rows[taken], {x: values[taken] for x, values in found.items()}, second)
        second.follow(np.arange(len(self.load_cases))[None])

    def _from_unloaded(self, anchors: np.ndarray, second: SecondBalances) -> None:
        """Report the balances to which the path from the unloaded knee leads where two are known.

        A second one is looked for where that path leads elsewhere than the neighbours in time,
        half-way between anchors, and on both sides of each jump in time.
        """
        own = np.setdiff1d((anchors[:-1] + anchors[1:]) // 2, anchors)
        if len(own):
            second.add(own, self._path(own))
        second.follow(np.arange(len(self.load_cases))[None])
        rows = np.flatnonzero(second.known)
        if not len(rows):
            return
        path, free = self._path(rows), self.load_cases.free
        to_main, to_second = (
            apart_mm(free, path["q"], x["q"][rows]) for x in (self.nodes, second.found)
        )
        ends = converged(path["status"]) & (to_second < np.minimum(to_main, second.APART_MM))
        self._exchange(rows[ends], {x: values[ends] for x, values in path.items()}, second)

    def _exchange(
        self, rows: np.ndarray, found: dict[str, np.ndarray], second: SecondBalances
    ) -> None:
        """Report what was found at some instants; what was reported there is second if stable."""
        stable = np.asarray(sound(self.nodes["status"][rows]))
        for name, values in second.found.items():
            values[rows] = np.nan
            values[rows[stable]] = self.nodes[name][rows[stable]]
        self._take(rows, found)

    def _between(self, known: np.ndarray) -> None:
        """Find what lies between instants that are known, half-way first."""
        from scipy.interpolate import PchipInterpolator  # 0.2 s that no other command waits for

        while len(known) < len(self.load_cases):
            first, last = known[:-1], known[1:]
            apart = last - first > 1
            rows = (first[apart] + last[apart]) // 2
            good = known[self._known(known)]
            if len(good) > 1:
                along = (PchipInterpolator(good, self.nodes[x][good], axis=0) for x in GUESSED)
                self._near(rows, [at(rows) for at in along])
            else:
                self._by_own_path(rows)
            known = np.sort(np.r_[known, rows])

    def _in_time(self, way: int) -> None:
        """Where an instant lies far from the one before, or has no balance: begin at that one.

        A knee that may be in balance in two ways stays on the one that it is on. The way is 1 from
        the first on, or -1 from the last backwards, where there is no balance only.
        """
        q = self.nodes["q"]

        def is_near(row: int) -> bool:
            return apart_mm(self.load_cases.free, q[row], q[row - way]) <= _MISSED_MM

        for row in range(len(q))[::way][1:]:
            known, before = self._known(np.array([row, row - way]))
            if not before or is_near(row) or (way < 0 and known):
                continue
            kept = [x[row].copy() for x in self.nodes.values()]
            self._near(np.array([row]), [self.nodes[x][[row - way]] for x in GUESSED])
            if not is_near(row):
                for values, old in zip(self.nodes.values(), kept, strict=True):
                    values[row] = old
