"""Passive flexion: at each angle the five other coordinates balance."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from kneejax.geometry import Pose
from kneejax.mechanics import Knee, Load, add_lane_axis
from kneejax.numerics import compiled, traced
from kneejax.statics import (
    Settled,
    Stations,
    first_guess,
    newton_step_left,
    own_motion,
    poses_on_the_way,
    settle,
)

#: Fields of a solution that a walk has found.
_FOUND = ("q", "meeting", "status", "fault", "steps")


class PassiveFlexion(eqx.Module):
    """Balanced poses over flexion.

    Attributes:
        flexion_deg: `(poses,)`.
        pose: fields of shape `(poses,)`; NaN where the search failed.
        status: `Status` value of each pose.
        residual_force: largest unbalanced force, `(poses,)`, N; where the search failed, what it
            left.
        residual_moment: largest unbalanced moment, `(poses,)`, N mm; likewise.
        left_mm: how far the search ended from a balance, `(poses,)`, mm (rotations at 30 mm).
        reached: part of the load under which the knee still balanced, `(poses,)`.
        stable: `(poses,)`.
        settled: the solution in full, for further derivatives.
    """

    flexion_deg: Array
    pose: Pose
    status: Array
    residual_force: Array
    residual_moment: Array
    left_mm: Array
    reached: Array
    stable: Array
    settled: Settled

    def to_table(self) -> Array:
        """Degrees and mm, `(poses, 6)`, in the order of `kneejax.geometry.COLUMNS`."""
        return self.pose.to_table()


def passive_flexion(
    knee: Knee, flexion_deg: ArrayLike, loads: tuple[Load, ...] | list[Load] = ()
) -> PassiveFlexion:
    """Move a knee through flexion: at each angle the five other coordinates balance.

    Every angle is reached from the reference pose in strides of 5 degrees, and there the loads grow
    from nothing, one after the other. So no pose depends on which others were asked for, and a load
    beyond which the knee gives way is told (`reached`).

    Args:
        knee: any knee; the loads that it carries itself act from the beginning.
        flexion_deg: prescribed angles, `(poses,)`.
        loads: further loads on the tibia, each one for all poses or one a pose.

    Returns:
        The motion, differentiable by every number of the knee. Poses that fail are NaN in their
        own row and say so in `status`. While JAX traces the knee the loads act from the beginning.

    Example:
        >>> import kneejax as kj
        >>> knee = kj.load_knee("four_ligament")
        >>> motion = kj.passive_flexion(knee, [0.0, 30.0])
        >>> bool(motion.stable.all())
        True
    """
    if traced(knee, flexion_deg, loads):
        return _whole_motion(knee, Stations.at(flexion_deg, loads))
    stations = Stations.at(flexion_deg, loads)
    found = own_motion(knee, _itself, np.zeros(()), stations).at(0)
    holding = {name: _ends_in_lanes(x) for name, x in found.holding.items()}
    left_mm, pivots = newton_step_left(holding["tangent"], holding["residual"])
    settled = Settled(
        flexion=np.asarray(stations.flexion),
        **{name: _ends_in_lanes(getattr(found, name)) for name in _FOUND},
        **holding,
        left_mm=left_mm,
        pivots=pivots,
    )
    return jax.tree.map(jnp.asarray, _described(settled, found.reached))


def _ends_in_lanes(x: np.ndarray) -> np.ndarray:
    return np.moveaxis(x, 0, -1)


def _itself(knee: Knee, _) -> Knee:
    return knee


@compiled()
def _whole_motion(knee: Knee, stations: Stations) -> PassiveFlexion:
    """Under a trace: one program. Otherwise a derivative would compile each of its operations."""
    lanes = stations.load(add_lane_axis(knee))
    start = jnp.broadcast_to(knee.reference_pose.flexion, stations.flexion.shape)
    guess = first_guess(lanes, start)
    count = poses_on_the_way(start, stations.flexion)
    settled = settle(lanes, stations.flexion, guess, start, count)
    return _described(settled, jnp.where(settled.converged, 1.0, 0.0))


def _described(settled: Settled, reached: Array) -> PassiveFlexion:
    moment, force = jnp.abs(settled.residual[:2]), jnp.abs(settled.residual[2:])
    return PassiveFlexion(
        jnp.rad2deg(settled.flexion),
        settled.pose,
        settled.status,
        jnp.max(force, axis=0),
        jnp.max(moment, axis=0),
        settled.left_mm,
        reached,
        settled.stable,
        settled,
    )
