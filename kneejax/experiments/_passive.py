"""Passive flexion: at each angle the five other coordinates balance."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from kneejax.geometry import Pose, filled, traced
from kneejax.mechanics import Knee, add_lane_axis
from kneejax.statics import (
    Guess,
    Settled,
    compiled,
    first_guess,
    poses_on_the_way,
    settle,
)


class PassiveFlexion(eqx.Module):
    """Balanced poses over flexion.

    Attributes:
        flexion_deg: `(poses,)`.
        pose: fields of shape `(poses,)`; NaN where the search failed.
        status: `Status` value of each pose.
        residual_force: largest unbalanced force, `(poses,)`, N.
        residual_moment: largest unbalanced moment, `(poses,)`, N mm.
        stable: `(poses,)`.
        settled: the solution in full, for further derivatives.
    """

    flexion_deg: Array
    pose: Pose
    status: Array
    residual_force: Array
    residual_moment: Array
    stable: Array
    settled: Settled

    def to_table(self) -> Array:
        """Degrees and mm, `(poses, 6)`, in the order of `kneejax.geometry.COLUMNS`."""
        return self.pose.to_table()


def passive_flexion(knee: Knee, flexion_deg: ArrayLike) -> PassiveFlexion:
    """Move a knee through flexion: at each angle the five other coordinates balance.

    Every angle is reached from the reference pose in steps of 5 degrees, so no angle depends on
    which others were asked for.

    Args:
        knee: any knee.
        flexion_deg: prescribed angles, `(poses,)`.

    Returns:
        The motion, differentiable by every number of the knee. Poses that fail are NaN in their
        own row and say so in `status`.

    Example:
        >>> import kneejax as kj
        >>> knee = kj.load_knee("four_ligament")
        >>> motion = kj.passive_flexion(knee, [0.0, 30.0])
        >>> bool(motion.stable.all())
        True
    """
    start = knee.reference_pose.flexion
    if traced(knee, flexion_deg):
        flexion = jnp.deg2rad(jnp.atleast_1d(jnp.asarray(flexion_deg, float)))
        span = 30 if traced(flexion) else poses_on_the_way(0.0, flexion)
        return _whole_motion(knee, flexion, jnp.broadcast_to(start, flexion.shape), span)
    flexion = np.deg2rad(np.atleast_1d(np.asarray(flexion_deg, float)))
    angles, span = filled(flexion), poses_on_the_way(0.0, flexion)
    motion = _motion(knee, angles, np.full(len(angles), float(start)), span)
    return jax.tree.map(lambda x: jnp.asarray(np.asarray(x)[..., : len(flexion)]), motion)


def _motion(knee: Knee, flexion: Array, start: Array, count: int) -> PassiveFlexion:
    lanes, guess = _begin(knee, start)
    return _described(settle(lanes, jnp.asarray(flexion), guess, jnp.asarray(start), count))


#: Under a trace: one program. Outside one, a derivative would compile each of its operations.
_whole_motion = compiled()(_motion)


@jax.jit
def _begin(knee: Knee, start: Array) -> tuple[Knee, Guess]:
    lanes = add_lane_axis(knee)
    return lanes, first_guess(lanes, start)


@jax.jit
def _described(settled: Settled) -> PassiveFlexion:
    moment, force = jnp.abs(settled.residual[:2]), jnp.abs(settled.residual[2:])
    return PassiveFlexion(
        jnp.rad2deg(settled.flexion),
        settled.pose,
        settled.status,
        jnp.max(force, axis=0),
        jnp.max(moment, axis=0),
        settled.stable,
        settled,
    )
