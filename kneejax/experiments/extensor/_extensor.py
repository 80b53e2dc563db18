"""The quadriceps pulls: tracking of the patella, isometric extension, the leg that is raised."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from jax.typing import ArrayLike

from kneejax.experiments._evaluate import Mechanics, evaluate
from kneejax.experiments._motion import Motion, followed
from kneejax.experiments.extensor._gravity import Shank, weight_of
from kneejax.experiments.extensor._mechanism import arm_and_tendon, forces_on_tibia
from kneejax.geometry import FEMUR, PATELLA, TIBIA, State
from kneejax.mechanics import QUADRICEPS, Knee, Load, pull_of
from kneejax.statics import Stations, converged

#: What moments are balanced to, N mm; pulls that are tried at most; and the first arm, mm.
_ENOUGH_NMM, _MOST_TRIES, _ARM_MM = 1e-3, 12, 40.0
#: No quadriceps pulls more, N.
STRONGEST_N = 12000.0


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
        arm_mm: effective moment arm by virtual work, `(poses,)`: how much shorter the quadriceps
            becomes per rad of flexion, all other coordinates staying balanced.
    """

    motion: Motion
    mechanics: Mechanics
    quadriceps_N: np.ndarray
    tendon_N: np.ndarray
    contact_N: np.ndarray
    extension_Nm: np.ndarray
    weight_Nm: np.ndarray
    arm_mm: np.ndarray

    @property
    def flexion_deg(self) -> np.ndarray:
        """Of the tibia, `(poses,)`."""
        return np.asarray(self.motion.flexion_deg)

    @property
    def patella(self) -> np.ndarray:
        """Poses of the patella, degrees and mm, `(poses, 6)`, in the order of its columns."""
        return np.asarray(self.motion.settled.state.poses[PATELLA].to_table())

    @property
    def forces_on_tibia(self) -> dict[str, np.ndarray]:
        """Part -> what it does to the tibia along the tibia's own axes, `(poses, 3)`, N.

        Ligaments by name, the patellar tendon as one, contacts, muscles, weights: they sum to
        zero where the knee balances.
        """
        return forces_on_tibia(self.motion, np.asarray(self.mechanics.contact_force))


def _needs_patella(knee: Knee) -> None:
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
    _needs_patella(knee)
    flexion, pull = np.broadcast_arrays(np.asarray(flexion_deg, float), quadriceps_N)
    _check_pull(pull)
    weightless = weight_of(np.zeros(3), np.zeros(3))
    motion = _pulled(knee, flexion, pull, (weightless, *loads))
    return _described(motion, np.asarray(pull, float), weightless)


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


def leg_raise(knee: Knee, flexion_deg: ArrayLike, shank: Shank) -> Extensor:
    """Hold shank and foot against gravity at each flexion: the quadriceps pulls as much as it must.

    Args:
        knee: as in `patellar_tracking`.
        flexion_deg: `(poses,)`.
        shank: what is held.

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
    _needs_patella(knee)
    flexion = np.atleast_1d(np.asarray(flexion_deg, float))
    weight, rest = shank.load(), _at_rest(knee)

    def left(pull: np.ndarray) -> tuple[Motion, np.ndarray]:
        motion = _pulled(knee, flexion, pull, (weight,))
        return motion, np.asarray(motion.reaction("flexion"))

    # The moment is nearly proportional to the pull: a secant ends in a few walks. It begins where
    # the weight is carried, since a leg that hangs from a slack quadriceps may have no balance.
    before = np.clip(_bending(knee, flexion, weight) / _ARM_MM, rest, STRONGEST_N)
    motion, moment = left(before)
    guess = np.where(np.isfinite(moment), before - moment / _ARM_MM, 1.5 * before)
    pull = np.clip(guess, rest, STRONGEST_N)
    for _ in range(_MOST_TRIES):
        motion, now = left(pull)
        lost, away = ~np.isfinite(now), pull - before
        slope = (now - moment) / np.where(away != 0.0, away, 1.0)
        slope = np.where(np.isfinite(slope) & (slope > 0.0), slope, _ARM_MM)
        further = np.where(lost, 0.5 * (pull + before), pull - now / slope)
        further = np.clip(further, rest, STRONGEST_N)
        goes_on = (lost | (np.abs(now) > _ENOUGH_NMM)) & (further != pull)
        if not goes_on.any():
            break
        before, moment = np.where(lost, before, pull), np.where(lost, moment, now)
        pull = np.where(goes_on, further, pull)
    else:
        motion, _ = left(pull)
    return _described(motion, pull, weight)


def _bending(knee: Knee, flexion: np.ndarray, weight: Load) -> np.ndarray:
    """Moment of a weight about the flexion axis of a tibia that only bends, N mm."""
    reference, turned = knee.reference_pose, np.deg2rad(flexion)
    bent = State({TIBIA: dataclasses.replace(reference, flexion=turned)})
    return np.asarray(weight.work(bent, ("flexion",))[0])


def _at_rest(knee: Knee) -> float:
    assert knee.muscles is not None
    return float(sum(knee.muscles.tension[row] for row in knee.muscles.quadriceps))


def _check_pull(pull: np.ndarray) -> None:
    wrong = pull[~((pull > 0.0) & (pull <= STRONGEST_N))]
    if wrong.size:
        expected = f"above 0 and up to {STRONGEST_N:g} N"
        raise ValueError(f"the quadriceps pulls with {wrong[0]:g} N: expected {expected}")


def _pulled(knee: Knee, flexion: np.ndarray, pull: np.ndarray, loads: Sequence[Load]) -> Motion:
    more = pull_of(QUADRICEPS, np.asarray(pull) - _at_rest(knee))
    return followed(knee, Stations.at(flexion, [more, *loads]))


def _described(motion: Motion, pull: np.ndarray, weight: Load) -> Extensor:
    mechanics = evaluate(motion.knee, motion.settled.state)
    forces = np.linalg.norm(np.asarray(mechanics.contact_force), axis=-1)
    on_patella = [k for k, c in enumerate(motion.knee.contacts) if c.bodies == (FEMUR, PATELLA)]
    arm, tendon = arm_and_tendon(motion.knee, motion.stations, motion.settled)
    holds = converged(np.asarray(motion.status))

    def where(x) -> np.ndarray:
        return np.where(holds, np.asarray(x), np.nan)

    return Extensor(
        motion,
        mechanics,
        pull,
        where(tendon),
        where(forces[:, on_patella].sum(axis=1)),
        where(motion.reaction("flexion")) / 1000.0,
        where(_moment(motion, weight)) / 1000.0,
        where(arm),
    )


def _moment(motion: Motion, weight: Load) -> np.ndarray:
    """How much a weight bends the knee about the flexion axis, N mm."""
    return np.asarray(weight.work(motion.settled.state, ("flexion",))[0])
