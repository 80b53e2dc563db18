"""A leg held against gravity, and what the quadriceps pulls for it.

A balance that is known tells with its stiffness how it moves with the pull, and how fast the moment
about the flexion axis grows. So paths lead to each angle once, and from there all angles go on side
by side, each from where it is expected.
"""

__all__ = ["Extensor", "at_rest", "isometric_extension", "leg_raise", "patellar_tracking"]

import dataclasses
import functools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from kneejax.experiments._evaluate import Mechanics, evaluate
from kneejax.experiments._extensor_mechanism import (
    TENDON,
    Shank,
    by_pull,
    needs_patella,
    pulls,
    tendon_of,
    tendon_rows,
    weight_of,
)
from kneejax.experiments._motion import Motion, again, apart_mm, expected, followed
from kneejax.geometry import FEMUR, FEMUR_AND_TIBIA, OTHER_COLUMNS, PATELLA, TIBIA, State
from kneejax.mechanics import QUADRICEPS, Knee, Load, add_lane_axis, pull_of
from kneejax.numerics import Named, compiled, numpy_for, traced
from kneejax.statics import LoadCases, converged

#: No quadriceps pulls more, N.
STRONGEST_N = 12000.0
#: Moment that counts as none, N mm; pulls that are tried at most; and the first arm, mm.
_ENOUGH_NMM, _MOST_TRIES, _ARM_MM = 1e-6, 12, 40.0
#: A pose at which the first pull holds no patella is tried under so much more, up to so many times.
_MORE, _MOST = 1.5, 2.0
#: How far from where it was expected a balance may lie, mm (rotations at 30 mm): one branch is
#: smooth. What lies farther gets a path of its own.
_MISSED_MM = 1.0


def at_rest(knee: Knee) -> Array:
    """Pull of all heads of the quadriceps at rest, N."""
    assert knee.muscles is not None
    heads = np.array(knee.muscles.quadriceps)
    return jnp.asarray(numpy_for(knee).asarray(knee.muscles.tension)[heads].sum())


def pulled_at(knee: Knee, flexion: Array, pull: Array, loads: tuple[Load, ...]) -> LoadCases:
    """Load cases at flexions, degrees, at which the quadriceps pulls as much, N, besides loads."""
    return LoadCases.at(flexion, [pull_of(QUADRICEPS, pull - at_rest(knee)), *loads])


def held_leg(knee: Knee, flexion: Array, weight: Load) -> tuple[Motion, Array, np.ndarray]:
    """A leg that the quadriceps holds at flexions, degrees: its balances, the pull of all heads, N,
    at rest where the leg would not sink, and where a balance lay elsewhere than expected, so that
    a path of its own led to it under the new pull, `(poses,)`."""
    still = jax.lax.stop_gradient((knee, flexion, weight))
    if traced(still):
        raise TypeError(
            "leg_raise inside jax.jit or jax.vmap: expected outside of them; jax.jvp, jax.jacfwd "
            "and jax.grad take it"
        )
    motion, pull, continued = _searched(*still)
    if not traced(knee, flexion, weight):
        return motion, pull, continued
    # The pull makes the moment vanish, and the pose balances under it. From the root a step by the
    # slope there has the root's first derivative, and two have the second as well.
    equilibrium, reached = motion.equilibrium, motion.reached
    arm = by_pull(motion.knee, motion.load_cases, equilibrium).arm
    rest = at_rest(knee)
    moves = (pull > jax.lax.stop_gradient(rest)) & (pull < STRONGEST_N)
    limit = jnp.where(pull < STRONGEST_N, rest, STRONGEST_N)
    for _ in range(2):
        held = again(knee, pulled_at(knee, flexion, pull, (weight,)), equilibrium, reached)
        pull = jnp.where(moves, pull - held.reaction("flexion") / arm, limit)
    motion = again(knee, pulled_at(knee, flexion, pull, (weight,)), equilibrium, reached)
    return motion, pull, continued


def _searched(knee: Knee, flexion: Array, weight: Load) -> tuple[Motion, Array, np.ndarray]:
    rest = float(at_rest(knee))
    # A leg that hangs from a slack quadriceps may have no balance: begin where it carries, as if
    # the tibia only bent.
    bent = dataclasses.replace(knee.reference_pose, flexion=jnp.deg2rad(flexion))
    bending = np.asarray(weight.work(State({TIBIA: bent}), ("flexion",))[0])
    first = np.clip(bending / _ARM_MM, rest, STRONGEST_N)
    pull, good, continued = first, np.full(first.shape, np.nan), np.zeros(first.shape, bool)
    motion = followed(knee, pulled_at(knee, flexion, pull, (weight,)))
    for _ in range(_MOST_TRIES):
        grows = by_pull(knee, motion.load_cases, motion.equilibrium)
        moment, slope = np.asarray(grows.moment), np.asarray(grows.arm)
        lost = ~np.isfinite(moment)
        good = np.where(lost, good, pull)
        slope = np.where(np.isfinite(slope) & (slope > 0.0), slope, _ARM_MM)
        more = np.minimum(_MORE * pull, _MOST * first)
        back = np.where(np.isfinite(good), 0.5 * (pull + good), more)
        further = np.clip(np.where(lost, back, pull - moment / slope), rest, STRONGEST_N)
        goes_on = (lost | (np.abs(moment) > _ENOUGH_NMM)) & (np.abs(further - pull) > 1e-12 * pull)
        if not goes_on.any():
            break
        step = np.where(goes_on, further - pull, 0.0)
        pull = pull + step
        load_cases, last = pulled_at(knee, flexion, pull, (weight,)).of(knee), motion.equilibrium
        q = np.asarray(last.q + grows.q * step)
        motion = expected(knee, load_cases, q, last.contact_points)
        away = apart_mm(load_cases.free, np.asarray(motion.equilibrium.q).T, q.T)
        off_branch = (step != 0.0) & ~(away <= _MISSED_MM)
        if off_branch.any():
            # A path of its own leads there.
            new, old = ((x.equilibrium, x.reached) for x in (followed(knee, load_cases), motion))
            found = jax.tree.map(lambda x, y, off=off_branch: jnp.where(off, x, y), new, old)
            motion = again(knee, load_cases, *found)
            continued |= off_branch
    return motion, jnp.asarray(pull), continued


@dataclasses.dataclass(frozen=True)
class Extensor(Named):
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
        continued: where a pull was found by a path of its own, since the balance under it lay
            farther than 1 mm from where it was expected, `(poses,)`.
    """

    motion: Motion
    mechanics: Mechanics
    quadriceps_N: Array
    tendon_N: Array
    contact_N: Array
    extension_Nm: Array
    weight_Nm: Array
    continued: np.ndarray

    OVER = {"pose": dict.fromkeys(
        ("quadriceps_N", "tendon_N", "contact_N", "extension_Nm", "weight_Nm"), "")}  # fmt: skip

    def _named(self) -> dict[str, tuple]:
        knee = self.motion.knee
        columns = [one.column for one in OTHER_COLUMNS.values() if one.body == PATELLA]
        poses = np.moveaxis(np.asarray(self.patella), -1, 0)
        patella = {name: ("pose", x) for name, x in zip(columns, poses, strict=True)}
        return self.motion._named() | self.mechanics._named() | patella | super()._named() | {
            "ligament": ("ligament", knee.ligaments.names),
            "contact": ("contact", knee.contact_names),
        }  # fmt: skip

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
        motion, mechanics, knee = self.motion, self.mechanics, self.motion.knee
        found = pulls(knee, motion.load_cases, motion.equilibrium)
        muscles, loads = (np.moveaxis(np.asarray(x), 0, -1) for x in found)
        ligaments = np.asarray(mechanics.ligament_force).swapaxes(0, 1)
        every = (knee.ligaments, ligaments), (knee.muscles, muscles)
        answer = {
            name: force
            for parts, forces in every
            if parts is not None
            for name, pair, force in zip(parts.names, parts.bodies, forces, strict=True)
            if pair == FEMUR_AND_TIBIA
        }
        answer[TENDON] = ligaments[tendon_rows(knee)].sum(axis=0)
        for k, contact in enumerate(knee.contacts):
            if contact.bodies == FEMUR_AND_TIBIA:
                answer[knee.contact_names[k]] = np.asarray(mechanics.contact_force)[:, k]
        every_load = (*knee.loads, *motion.load_cases.loads)
        acting = [load for load in every_load if isinstance(load, Load)]
        for load, force in zip(acting, loads, strict=True):
            answer[load.name] = answer.get(load.name, 0.0) + force
        return answer


def patellar_tracking(
    knee: Knee, flexion_deg: ArrayLike, quadriceps_N: ArrayLike, loads: Sequence[Load] = ()
) -> Extensor:
    """Bend a knee while the quadriceps pulls: at each angle both bones balance.

    Args:
        knee: of three bones (`KneeFile.with_patella`).
        flexion_deg: prescribed, `(poses,)`.
        quadriceps_N: pull of all heads, shared as at rest, one or `(poses,)`.
        loads: additional ones on the tibia.

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
    wrong = pull[~((pull > 0.0) & (pull <= STRONGEST_N))]
    if wrong.size:
        expected = f"above 0 and up to {STRONGEST_N:g} N"
        raise ValueError(f"the quadriceps pulls with {wrong[0]:g} N: expected {expected}")
    weightless = weight_of()
    motion = followed(knee, pulled_at(knee, flexion, pull, (weightless, *loads)))
    return described(motion, jnp.asarray(pull, float), np.zeros(len(pull), bool), weightless)


def isometric_extension(
    knee: Knee, flexion_deg: ArrayLike, quadriceps_N: ArrayLike, loads: Sequence[Load] = ()
) -> Extensor:
    """Pull at held flexions with a quadriceps that grows.

    Args:
        knee: as in `patellar_tracking`.
        flexion_deg: held angles, `(angles,)`.
        quadriceps_N: pulls, `(pulls,)`.
        loads: additional ones on the tibia.

    Returns:
        Poses in rows of angles, for each all pulls in their order.

    Example:
        It compiles for long; the knee it needs has a patella:

        >>> import kneejax as kj
        >>> kj.load_knee_file("four_ligament").has_patella
        True
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


def described(motion: Motion, pull: Array, continued: np.ndarray, weight: Load) -> Extensor:
    """All that is told of balances of a knee of three bones, with the quadriceps' pull, `(poses,)`,
    N; a weight that bends the knee is weightless where none does."""
    mechanics = evaluate(motion.knee, motion.equilibrium.state, motion.equilibrium.contact_points)
    xp = numpy_for(motion, weight)
    forces = xp.linalg.norm(mechanics.contact_force, axis=-1)
    on_patella = [k for k, c in enumerate(motion.knee.contacts) if c.bodies == (FEMUR, PATELLA)]
    moment, holds = motion.reaction("flexion"), converged(motion.status)

    def where(x: Array) -> Array:
        return jnp.asarray(xp.where(holds, x, np.nan))

    bends = xp.asarray(_moment(weight, motion.equilibrium.state)) / 1000.0
    return Extensor(
        motion, mechanics, pull, where(tendon_of(motion.knee, mechanics)),
        where(forces[:, np.array(on_patella, int)].sum(axis=1)),
        where(xp.asarray(moment) / 1000.0), where(bends), continued,
    )  # fmt: skip


@compiled(effort="least")
def _moment(weight: Load, state: State) -> Array:
    """How much a weight bends the knee about the flexion axis, N mm."""
    return weight.work(state, ("flexion",))[0]
