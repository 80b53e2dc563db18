"""Passive flexion: at each angle the five other coordinates balance."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.core import Tracer
from jax.typing import ArrayLike

from kneejax.geometry import Pose
from kneejax.mechanics import Knee, add_lane_axis
from kneejax.statics import (
    Settled,
    compiled,
    first_guess,
    lanes_for,
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
    if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves((knee, flexion_deg))):
        flexion = jnp.deg2rad(jnp.atleast_1d(jnp.asarray(flexion_deg, float)))
        span = 30 if isinstance(flexion, Tracer) else poses_on_the_way(0.0, flexion)
        return _passive_flexion(knee, flexion, jnp.broadcast_to(start, flexion.shape), span)
    flexion = np.deg2rad(np.atleast_1d(np.asarray(flexion_deg, float)))
    count, lanes = len(flexion), lanes_for(len(flexion))
    # Filled up with the last angle: one shape, one compilation.
    filled = np.pad(flexion, (0, lanes - count), "edge")
    start, span = np.full(lanes, float(start)), poses_on_the_way(0.0, flexion)
    motion = _passive_flexion(knee, filled, start, span)
    return jax.tree.map(lambda x: jnp.asarray(np.asarray(x)[..., :count]), motion)


@compiled()
def _passive_flexion(knee: Knee, flexion: Array, start: Array, count: Array) -> PassiveFlexion:
    lanes = add_lane_axis(knee)
    settled = settle(lanes, flexion, first_guess(lanes, start), start, count)
    moment, force = jnp.abs(settled.residual[:2]), jnp.abs(settled.residual[2:])
    return PassiveFlexion(
        jnp.rad2deg(flexion),
        settled.pose,
        settled.status,
        jnp.max(force, axis=0),
        jnp.max(moment, axis=0),
        settled.stable,
        settled,
    )
