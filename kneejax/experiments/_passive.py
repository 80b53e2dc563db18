"""Passive flexion, and the mechanics of given poses."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jax import Array
from jax.core import Tracer
from jax.typing import ArrayLike

from kneejax.geometry import Pose, safe_sqrt
from kneejax.mechanics import Contact, Knee, add_lane_axis
from kneejax.statics import (
    Settled,
    Status,
    compiled,
    first_guess,
    poses_on_the_way,
    settle,
    with_meeting,
)


class Mechanics(eqx.Module):
    """Ligaments and contact at poses; arrays begin with the pose.

    The onset of contact is rounded, in pressures and areas as in forces: near first touch they
    are small, not zero. `max_depth` is exact.

    Attributes:
        length: `(poses, ligaments)`, mm.
        strain: `(poses, ligaments)`.
        tension: `(poses, ligaments)`, N.
        contact_force: on the tibia in tibia axes, `(poses, contacts, 3)`, N.
        area: `(poses, contacts)`, mm^2.
        max_pressure: `(poses, contacts)`, MPa.
        mean_pressure: `(poses, contacts)`, MPa.
        max_depth: `(poses, contacts)`, mm.
        center: in the tibia frame, `(poses, contacts, 3)`, mm.
        known: whether the surfaces meet in their fitted regions, `(poses, contacts)`.
    """

    length: Array
    strain: Array
    tension: Array
    contact_force: Array
    area: Array
    max_pressure: Array
    mean_pressure: Array
    max_depth: Array
    center: Array
    known: Array


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
    flexion = jnp.deg2rad(jnp.atleast_1d(jnp.asarray(flexion_deg, float)))
    start = knee.reference_pose.flexion
    span = 30 if isinstance(flexion, Tracer) else poses_on_the_way(0.0, flexion)
    return _passive_flexion(knee, flexion, jnp.broadcast_to(start, flexion.shape), span)


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


def evaluate(knee: Knee, poses: Pose, meeting: Array | None = None) -> Mechanics:
    """Ligaments and contact at given poses; nothing is solved.

    Args:
        knee: any knee.
        poses: fields of shape `(poses,)`.
        meeting: meeting points if they are known, `(n, 2, poses)`; searched by default.

    Returns:
        The mechanics of each pose. Depth beyond the layer gives NaN pressure by the log and ratio
        laws; `max_depth` says so.
    """
    return _evaluate(knee, poses, meeting)


@compiled()
def _evaluate(knee: Knee, poses: Pose, meeting: Array | None) -> Mechanics:
    lanes, tibia = add_lane_axis(knee), poses.placement
    if meeting is None:
        meeting = with_meeting(lanes, poses.flexion, poses.state).meeting
    ligaments = lanes.ligaments
    row, contacts = 0, []
    for contact in lanes.contacts:
        if contact.has_patch:
            contacts.append(_over_patch(contact, poses, meeting[row]))
            row += 1
        else:
            contacts.append(_over_points(contact, poses))
    stacked = [jnp.stack(x, axis=-1) for x in zip(*contacts, strict=True)] or [
        jnp.zeros(shape + poses.flexion.shape + (0,))
        for shape in ((3,), (), (), (), (), (3,), ())
    ]
    force, area, peak, mean, depth, center, known = stacked
    return Mechanics(
        ligaments.length(tibia).T,
        ligaments.strain(tibia).T,
        ligaments.tension(tibia).T,
        jnp.moveaxis(force, 0, -1),
        area,
        peak,
        mean,
        depth,
        jnp.moveaxis(center, 0, -1),
        known,
    )


def _over_patch(contact: Contact, poses: Pose, meeting: Array):
    tibia = poses.placement
    pressed = contact.press(tibia, meeting)
    gap = pressed.gap
    area = 2.0 * jnp.pi * contact.rounded(gap.depth) * gap.mean_radius
    force = jnp.stack(tibia.turn_back(pressed.wrench.force))
    mean = safe_sqrt(jnp.sum(force**2, axis=0)) / area
    center = jnp.stack(jnp.broadcast_arrays(*contact.tibial.frame.placement.apply(gap.point)))
    known = contact.knows(gap.point, meeting) | (gap.depth <= 0)
    return force, area, contact.pressure(gap.depth), mean, gap.depth, center, known


def _over_points(contact: Contact, poses: Pose):
    tibia = poses.placement
    sampled = contact.sample(tibia)
    pressure = contact.pressure(sampled.depth)
    share = pressure * sampled.area
    area = jnp.sum(contact.touching(sampled.depth) * sampled.area, axis=0)
    frame = contact.tibial.frame.placement
    force = -jnp.stack([jnp.sum(share * n, axis=0) for n in frame.turn(sampled.normal)])
    weight = share / jnp.sum(share, axis=0)
    center = jnp.stack([jnp.sum(weight * x, axis=0) for x in frame.apply(sampled.point)])
    mean = safe_sqrt(jnp.sum(force**2, axis=0)) / area
    depth = jnp.max(sampled.depth, axis=0)
    return force, area, jnp.max(pressure, axis=0), mean, depth, center, jnp.ones_like(area) > 0


def status_of(poses: Mechanics, knee: Knee) -> Array:
    """`Status` values of evaluated poses, which say nothing of balance: depth and region only."""
    thickness = jnp.stack([contact.layer_thickness for contact in knee.contacts])
    deep = jnp.any(poses.max_depth >= thickness, axis=-1)
    outside = jnp.any(~poses.known, axis=-1)
    return jnp.where(
        deep, Status.TOO_DEEP, jnp.where(outside, Status.OUTSIDE_REGION, Status.BALANCED)
    )
