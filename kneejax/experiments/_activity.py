"""Activities: a recorded motion, its external loads and muscles, balanced instant by instant."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.experiments._evaluate import Mechanics, evaluate
from kneejax.experiments._extensor import at_rest
from kneejax.experiments._extensor_mechanism import TENDON
from kneejax.experiments._instants import Instants
from kneejax.experiments._motion import Motion
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
from kneejax.statics import LoadCases, converged

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
    other = None if near is None else jax.lax.stop_gradient(near.motion.equilibrium)
    before = None if near is None else jax.lax.stop_gradient(near.motion.knee)
    found, second = Instants.of(*jax.lax.stop_gradient((body, load_cases)), other, before)
    motion = found.motion(body, load_cases)
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
