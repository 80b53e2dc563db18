"""A recorded movement as a row of balances: at each instant the knee holds what acts on it."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.experiments._evaluate import Mechanics, evaluate
from kneejax.experiments._motion import Motion
from kneejax.experiments.activity._instants import Instants
from kneejax.experiments.activity._tendon import tendon_of_quadriceps
from kneejax.geometry import FEMUR_AND_TIBIA, PATELLA, TIBIA, Pose, State
from kneejax.mechanics import (
    QUADRICEPS,
    ConstantTensionLine,
    Knee,
    LegRecord,
    Load,
    Wrench,
    add_lane_axis,
    pull_of,
)
from kneejax.numerics import compiled, filled
from kneejax.statics import Stations, converged

#: What pulls on the tibia for the quadriceps, among what acts.
TENDON = "patellar tendon"


@dataclasses.dataclass(frozen=True)
class Activity:
    """Balances of a knee over a recorded movement.

    Attributes:
        record: what was recorded.
        motion: the balances, one an instant; NaN with its status where there is none.
        mechanics: ligaments and contacts there.
        acting: what acts on the tibia by name, about its origin along its axes, `(n, 6)` each, N
            and N mm: record and muscles, without what the knee's own parts do.
        rounds: how often balances were found anew, for muscles whose lines move with the tibia.
        moved_N: by how much what acts differs from what a balance was found under, `(n,)`, N
            (moments at 30 mm); infinite where there is none.
    """

    record: LegRecord
    motion: Motion
    mechanics: Mechanics
    acting: dict[str, np.ndarray]
    rounds: int
    moved_N: np.ndarray

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
        ligaments = np.asarray(_of_ligaments(motion.knee, motion.settled.state)).T
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


def activity(knee: Knee, record: LegRecord) -> Activity:
    """Balance a knee at each instant of a recorded movement.

    Flexion is the record's; the other coordinates balance under what acts on the leg below the
    knee, quasi-statically: weight, inertia and ground as a wrench that follows the tibia, whose
    place in space was recorded, and muscles along their lines. In a knee of two bones the
    quadriceps pulls by its line `patellar_tendon` (`tendon_of_quadriceps`); in one of three, on
    the patella.

    Args:
        knee: of two bones, or of three (`KneeFile.with_patella`).
        record: from `kneejax.files.read_activity`.

    Returns:
        The balances. Derivatives of its motion by the knee hold the loads.

    Raises:
        ValueError: the quadriceps pulls on a patella and the knee has neither a patella nor a
            line for its tendon.
    """
    if PATELLA in knee.bodies:
        record = record.with_heads_on_patella()
    tendon, body = _without_tendon(knee, bool(np.any(record.quadriceps_N > 0)))
    still = jax.lax.stop_gradient(body)

    def acting(rows: np.ndarray, tibia: np.ndarray) -> np.ndarray:
        parts = _acting(record, tendon, rows, tibia).values()
        return sum(parts, np.zeros((len(rows), 6)))

    def at(rows: np.ndarray, total: np.ndarray) -> Stations:
        return _stations(still, record, rows, total)

    found = Instants.of(still, record.pose[:, 0], acting, at, record.pose)
    motion = found.motion(body)
    every = np.arange(len(record.time_s))
    tibia = np.where(np.isnan(found.poses), record.pose, found.poses)
    parts = _acting(record, tendon, every, tibia)
    mechanics = evaluate(motion.knee, motion.settled.state)
    return Activity(record, motion, mechanics, parts, found.rounds, found.moved)


def _without_tendon(knee: Knee, needed: bool) -> tuple[ConstantTensionLine | None, Knee]:
    """The line of the patellar tendon, and the knee without its pull."""
    if PATELLA in knee.bodies:
        return None, knee
    if not knee.lines:
        if needed:
            expected = "a knee with a line patellar_tendon, or read with its patella"
            raise ValueError(f"{knee.name} has nothing for the quadriceps to pull on: {expected}")
        return None, knee
    slack = tuple(dataclasses.replace(x, tension=0.0 * x.tension) for x in knee.lines)
    line = dataclasses.replace(knee.lines[0], tension=jnp.ones(()))
    return line, dataclasses.replace(knee, lines=slack)


def _acting(
    record: LegRecord, tendon: ConstantTensionLine | None, rows: np.ndarray, tibia: np.ndarray
) -> dict[str, np.ndarray]:
    """What acts on the tibia by name at some instants, `(rows, 6)` each."""
    acting = {name: wrench[rows] for name, wrench in record.acting.items()}
    for name, wrench in zip(record.lines.names, record.lines.on_tibia(rows, tibia), strict=True):
        acting[name] = wrench
    if tendon is not None and np.any(record.quadriceps_N > 0):
        pull = tendon_of_quadriceps(record.quadriceps_N[rows], record.pose[rows, 0])
        unit = np.asarray(_of_line(tendon, filled(tibia.T).T))[:, : len(rows)]
        acting[TENDON] = pull[:, None] * unit.T
    return acting


@compiled()
def _of_line(line: ConstantTensionLine, table: Array) -> Array:
    state = State({TIBIA: Pose.from_table(table)})
    wrench, tibia = add_lane_axis(line).wrench(state), state.tibia.placement
    parts = tibia.turn_back(wrench.force), tibia.turn_back(wrench.moment)
    return jnp.stack(jnp.broadcast_arrays(*parts[0], *parts[1]))


@compiled()
def _of_ligaments(knee: Knee, state: State):
    total = jnp.zeros((6, *state.shape))
    for pair, parts in add_lane_axis(knee).ligaments.pull(state)[0].between.items():
        if pair[1] == TIBIA:
            there, whole = state.between(pair), Wrench.total(parts)
            force, moment = there.turn_back(whole.force), there.turn_back(whole.moment)
            total = total + jnp.stack(jnp.broadcast_arrays(*force, *moment))
    return total


def _stations(knee: Knee, record: LegRecord, rows: np.ndarray, total: np.ndarray) -> Stations:
    loads = [Load(total[:, :3], total[:, 3:], np.zeros((len(rows), 3)), axes=TIBIA, name="leg")]
    if PATELLA in knee.bodies:
        assert knee.muscles is not None
        rest = float(jnp.sum(knee.muscles.tension[np.array(knee.muscles.quadriceps)]))
        loads.insert(0, pull_of(QUADRICEPS, record.quadriceps_N[rows] - rest))
    return Stations.at(record.pose[rows, 0], loads)
