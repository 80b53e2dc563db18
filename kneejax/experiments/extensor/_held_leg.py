"""How hard the quadriceps pulls to hold a leg: Newton's method on its force.

A balance that is known tells with its stiffness how it moves with the pull, and how fast the moment
about the flexion axis grows. So paths lead to each angle once, and from there all angles go on side
by side, each from where it is expected.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.experiments._motion import Motion, again, expected, followed
from kneejax.experiments.extensor._mechanism import ByPull, by_pull
from kneejax.geometry import TIBIA, State, scales
from kneejax.mechanics import QUADRICEPS, Knee, Load, pull_of
from kneejax.numerics import numpy_for, traced
from kneejax.statics import LoadCases

#: No quadriceps pulls more, N.
STRONGEST_N = 12000.0
#: Moment that counts as none, N mm; pulls that are tried at most; and the first arm, mm.
_ENOUGH_NMM, _MOST_TRIES, _ARM_MM = 1e-6, 12, 40.0
#: A pose at which the first pull holds no patella is tried under so much more, up to so many times.
_MORE, _MOST = 1.5, 2.0
#: How far from where it was expected a balance may lie, mm (rotations at 30 mm): one branch is
#: smooth. What lies farther gets a path of its own.
_MISSED_MM = 1.0


class Held(NamedTuple):
    """A leg that the quadriceps holds.

    Attributes:
        motion: its balances.
        pull: of all heads together, `(poses,)`, N.
        walked: where the balance lay elsewhere than expected, so that a path of its own led to it
            under the new pull, `(poses,)`.
    """

    motion: Motion
    pull: Array
    walked: np.ndarray


def at_rest(knee: Knee) -> Array:
    """Pull of all heads of the quadriceps at rest, N."""
    assert knee.muscles is not None
    heads = np.array(knee.muscles.quadriceps)
    return jnp.asarray(numpy_for(knee).asarray(knee.muscles.tension)[heads].sum())


def pulled_at(knee: Knee, flexion: Array, pull: Array, loads: tuple[Load, ...]) -> LoadCases:
    """Load cases at flexions, degrees, at which the quadriceps pulls as much, N, besides loads."""
    return LoadCases.at(flexion, [pull_of(QUADRICEPS, pull - at_rest(knee)), *loads])


def held_leg(knee: Knee, flexion: Array, weight: Load) -> Held:
    """Find the pull of the quadriceps that holds a leg at each flexion.

    Args:
        knee: of three bones.
        flexion: degrees, `(poses,)`.
        weight: of the leg.

    Returns:
        What was found. Where the leg would not sink, the quadriceps is at rest.

    Raises:
        TypeError: JAX traces the call, so that no number is known.
    """
    still = jax.lax.stop_gradient((knee, flexion, weight))
    if traced(still):
        raise TypeError(
            "leg_raise inside jax.jit or jax.vmap: expected outside of them; jax.jvp, jax.jacfwd "
            "and jax.grad take it"
        )
    found = _searched(*still)
    if traced(knee, flexion, weight):
        found = _differentiable(knee, flexion, weight, found)
    return found


def _searched(knee: Knee, flexion: Array, weight: Load) -> Held:
    rest = float(at_rest(knee))
    # A leg that hangs from a slack quadriceps may have no balance: begin where it carries.
    first = np.clip(_bending(knee, flexion, weight) / _ARM_MM, rest, STRONGEST_N)
    pull, good, walked = first, np.full(first.shape, np.nan), np.zeros(first.shape, bool)
    motion = followed(knee, pulled_at(knee, flexion, pull, (weight,)))
    for _ in range(_MOST_TRIES):
        grows = by_pull(knee, motion.load_cases, motion.equilibrium)
        moment, slope = np.asarray(grows.moment), np.asarray(grows.arm)
        lost = ~np.isfinite(moment)
        good = np.where(lost, good, pull)
        slope = np.where(np.isfinite(slope) & (slope > 0.0), slope, _ARM_MM)
        back = np.where(
            np.isfinite(good), 0.5 * (pull + good), np.minimum(_MORE * pull, _MOST * first)
        )
        further = np.clip(np.where(lost, back, pull - moment / slope), rest, STRONGEST_N)
        goes_on = (lost | (np.abs(moment) > _ENOUGH_NMM)) & (np.abs(further - pull) > 1e-12 * pull)
        if not goes_on.any():
            break
        step = np.where(goes_on, further - pull, 0.0)
        pull = pull + step
        motion, astray = _moved(motion, pulled_at(knee, flexion, pull, (weight,)), step, grows)
        walked |= astray
    return Held(motion, jnp.asarray(pull), walked)


def _moved(
    before: Motion, load_cases: LoadCases, step: np.ndarray, grows: ByPull
) -> tuple[Motion, np.ndarray]:
    """A motion under another pull, and where a path of its own led there."""
    equilibrium = before.equilibrium
    q = equilibrium.q + grows.q * step
    motion = expected(before.knee, load_cases, q, equilibrium.contact_points)
    units = np.array(scales(load_cases.of(before.knee).free))[:, None]
    away = np.abs(np.asarray(motion.equilibrium.q - q) / units).max(axis=0)
    astray = (step != 0.0) & ~(away <= _MISSED_MM)
    if astray.any():
        walked = followed(before.knee, load_cases)
        equilibrium, reached = jax.tree.map(
            lambda new, old: jnp.where(astray, new, old),
            (walked.equilibrium, walked.reached),
            (motion.equilibrium, motion.reached),
        )
        motion = again(before.knee, load_cases, equilibrium, reached)
    return motion, astray


def _bending(knee: Knee, flexion: Array, weight: Load) -> np.ndarray:
    """Moment of a weight about the flexion axis of a tibia that only bends, N mm."""
    reference, turned = knee.reference_pose, jnp.deg2rad(flexion)
    bent = State({TIBIA: dataclasses.replace(reference, flexion=turned)})
    return np.asarray(weight.work(bent, ("flexion",))[0])


def _differentiable(knee: Knee, flexion: Array, weight: Load, found: Held) -> Held:
    """The same leg as a function of all numbers: the pull makes the moment vanish, the pose
    balances under it. From the root a step by the slope there has the root's first derivative, and
    two have the second as well."""
    equilibrium, reached = found.motion.equilibrium, found.motion.reached
    arm = by_pull(found.motion.knee, found.motion.load_cases, equilibrium).arm
    rest = at_rest(knee)
    moves = (found.pull > jax.lax.stop_gradient(rest)) & (found.pull < STRONGEST_N)
    limit = jnp.where(found.pull < STRONGEST_N, rest, STRONGEST_N)
    pull = found.pull
    for _ in range(2):
        held = again(knee, pulled_at(knee, flexion, pull, (weight,)), equilibrium, reached)
        pull = jnp.where(moves, pull - held.reaction("flexion") / arm, limit)
    motion = again(knee, pulled_at(knee, flexion, pull, (weight,)), equilibrium, reached)
    return found._replace(motion=motion, pull=pull)
