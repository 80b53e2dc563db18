"""The quadriceps pulls: tracking of the patella, isometric extension, the leg that is raised."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from kneejax.experiments._evaluate import Mechanics, evaluate
from kneejax.experiments._motion import Motion, followed
from kneejax.experiments.extensor._gravity import Shank, weight_of
from kneejax.experiments.extensor._held_leg import STRONGEST_N, held_leg, pulled_at
from kneejax.experiments.extensor._mechanism import (
    by_pull,
    forces_on_tibia,
    tendon_of,
)
from kneejax.geometry import FEMUR, PATELLA, State
from kneejax.mechanics import Knee, Load, add_lane_axis
from kneejax.numerics import compiled, numpy_for
from kneejax.statics import converged


@dataclasses.dataclass(frozen=True)
class Extensor:
    """A knee of three bones under the pull of its quadriceps.

    Attributes:
        motion: the balances, one a pose.
        mechanics: ligaments and contact there.
        quadriceps_N: pull of all heads together, `(poses,)`.
        tendon_N: of the patellar tendon, `(poses,)`: the size of what it does to the tibia.
        contact_N: between patella and femur, `(poses,)`.
        extension_Nm: moment about the flexion axis with which the knee, its weight included, would
            extend, `(poses,)`: a machine that holds it there exerts as much towards flexion.
        weight_Nm: how much the weight of the leg bends the knee, `(poses,)`.
        walked: where a pull was found by a path of its own, since the balance under it lay farther
            than 1 mm from where it was expected, `(poses,)`.
    """

    motion: Motion
    mechanics: Mechanics
    quadriceps_N: Array
    tendon_N: Array
    contact_N: Array
    extension_Nm: Array
    weight_Nm: Array
    walked: np.ndarray

    @functools.cached_property
    def arm_mm(self) -> Array:
        """Effective moment arm by virtual work, `(poses,)`: how much shorter the quadriceps becomes
        per rad of flexion, all other coordinates staying balanced; NaN where the search failed."""
        arm = by_pull(self.motion.knee, self.motion.load_cases, self.motion.equilibrium).arm
        return jnp.where(converged(self.motion.status), arm, jnp.nan)

    @property
    def flexion_deg(self) -> Array:
        """Of the tibia, `(poses,)`."""
        return self.motion.flexion_deg

    @property
    def quadriceps_mm(self) -> Array:
        """Length of the quadriceps: mean of its heads by their shares of the pull, `(poses,)`."""
        muscles = add_lane_axis(self.motion.knee.muscles)
        return muscles.quadriceps_length(self.motion.equilibrium.state)

    @property
    def patella(self) -> Array:
        """Poses of the patella, degrees and mm, `(poses, 6)`, in the order of its columns."""
        return self.motion.equilibrium.state.poses[PATELLA].to_table()

    @property
    def forces_on_tibia(self) -> dict[str, np.ndarray]:
        """Part -> what it does to the tibia along the tibia's own axes, `(poses, 3)`, N.

        Ligaments by name, the patellar tendon as one, contacts, muscles, weights: they sum to
        zero where the knee balances.
        """
        return forces_on_tibia(self.motion, self.mechanics)


def needs_patella(knee: Knee) -> None:
    """Refuse a knee that has no patella.

    Raises:
        ValueError: it has none, or no quadriceps.
    """
    if PATELLA not in knee.bodies or knee.muscles is None or not knee.muscles.quadriceps:
        raise ValueError(
            f"{knee.name} has no patella with a quadriceps: expected a knee read with its patella"
        )


def patellar_tracking(
    knee: Knee, flexion_deg: ArrayLike, quadriceps_N: ArrayLike, loads: Sequence[Load] = ()
) -> Extensor:
    """Bend a knee while the quadriceps pulls: at each angle both bones balance.

    Args:
        knee: of three bones (`KneeFile.with_patella`).
        flexion_deg: prescribed, `(poses,)`.
        quadriceps_N: pull of all heads, shared as at rest, one or `(poses,)`.
        loads: on the tibia besides.

    Returns:
        The poses of both bones and the forces; NaN where a search failed, with its status.

    Raises:
        ValueError: the knee has no patella, or the quadriceps pushes.

    Example:
        >>> import kneejax as kj
        >>> knee = kj.load_knee("lenhart2015_reduced", patella=True)
        >>> kj.patellar_tracking(knee, [30.0, 60.0], -100.0)
        Traceback (most recent call last):
        ValueError: the quadriceps pulls with -100 N: expected above 0 and up to 12000 N
    """
    needs_patella(knee)
    flexion, pull = np.broadcast_arrays(np.asarray(flexion_deg, float), quadriceps_N)
    _check_pull(pull)
    weightless = weight_of(np.zeros(3), np.zeros(3))
    motion = followed(knee, pulled_at(knee, flexion, pull, (weightless, *loads)))
    nowhere = np.zeros(len(motion.status), bool)
    return described(motion, jnp.asarray(pull, float), nowhere, weightless)


def isometric_extension(
    knee: Knee, flexion_deg: ArrayLike, quadriceps_N: ArrayLike, loads: Sequence[Load] = ()
) -> Extensor:
    """Pull at held flexions with a quadriceps that grows.

    Args:
        knee: as in `patellar_tracking`.
        flexion_deg: held angles, `(angles,)`.
        quadriceps_N: pulls, `(pulls,)`.
        loads: on the tibia besides.

    Returns:
        Poses in rows of angles, for each all pulls in their order.
    """
    angles, pulls = (np.atleast_1d(np.asarray(x, float)) for x in (flexion_deg, quadriceps_N))
    every = np.repeat(angles, len(pulls)), np.tile(pulls, len(angles))
    return patellar_tracking(knee, *every, loads)


def leg_raise(knee: Knee, flexion_deg: ArrayLike, shank: Shank | Load) -> Extensor:
    """Hold shank and foot against gravity at each flexion: the quadriceps pulls as much as it must.

    Args:
        knee: as in `patellar_tracking`.
        flexion_deg: `(poses,)`.
        shank: what is held, or its weight as a load.

    Returns:
        Poses, the quadriceps' pull and all forces. Where the leg would not sink, the quadriceps is
        left at rest, and `extension_Nm` says what is left over.

    Example:
        >>> import kneejax as kj
        >>> knee = kj.load_knee("four_ligament")
        >>> kj.leg_raise(knee, [30.0, 60.0], kj.Shank.of_person(75.0, 1.75))
        Traceback (most recent call last):
        ValueError: four_ligament has no patella with a quadriceps: expected a knee read with its
        patella
    """
    needs_patella(knee)
    weight = shank.load() if isinstance(shank, Shank) else shank
    flexion = jnp.atleast_1d(jnp.asarray(flexion_deg, float))
    return described(*held_leg(knee, flexion, weight), weight)


def _check_pull(pull: np.ndarray) -> None:
    wrong = pull[~((pull > 0.0) & (pull <= STRONGEST_N))]
    if wrong.size:
        expected = f"above 0 and up to {STRONGEST_N:g} N"
        raise ValueError(f"the quadriceps pulls with {wrong[0]:g} N: expected {expected}")


def described(motion: Motion, pull: Array, walked: np.ndarray, weight: Load) -> Extensor:
    """All that is told of balances of a knee of three bones.

    Args:
        motion: the balances.
        pull: of the quadriceps, `(poses,)`, N.
        walked: `Extensor.walked`, as its searches found it.
        weight: that bends the knee; weightless where none does.
    """
    mechanics = evaluate(motion.knee, motion.equilibrium.state, motion.equilibrium.contact_points)
    xp = numpy_for(motion, weight)
    forces = xp.linalg.norm(mechanics.contact_force, axis=-1)
    on_patella = [k for k, c in enumerate(motion.knee.contacts) if c.bodies == (FEMUR, PATELLA)]
    moment, holds = motion.reaction("flexion"), converged(motion.status)

    def where(x: Array) -> Array:
        return jnp.asarray(xp.where(holds, x, np.nan))

    return Extensor(
        motion,
        mechanics,
        pull,
        where(tendon_of(motion.knee, mechanics)),
        where(forces[:, np.array(on_patella, int)].sum(axis=1)),
        where(xp.asarray(moment) / 1000.0),
        where(xp.asarray(_moment(weight, motion.equilibrium.state)) / 1000.0),
        walked,
    )


@compiled(optimised=False)
def _moment(weight: Load, state: State) -> Array:
    """How much a weight bends the knee about the flexion axis, N mm."""
    return weight.work(state, ("flexion",))[0]
