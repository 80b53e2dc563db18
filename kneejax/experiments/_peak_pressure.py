"""Peak contact pressure as paper 4 takes it: the mean of the highest tenth, and its place."""

from __future__ import annotations

import dataclasses

import equinox as eqx
import jax.numpy as jnp
from jax import Array

from kneejax.geometry import Pose
from kneejax.mechanics import Contact, Knee, add_lane_axis
from kneejax.numerics import compiled

#: Rings of an elliptical patch, and how much finer than its own a contact's points are.
_RINGS, _FINER = 200, 3


class PeakPressure(eqx.Module):
    """Peak contact pressure at poses.

    Attributes:
        pressure: mean over the part of the touching area where it is highest, MPa,
            `(poses, contacts)`; 0 without contact.
        center: mean place of that part in the tibia's frame, mm, `(poses, contacts, 3)`; NaN
            without contact.
    """

    pressure: Array
    center: Array


def peak_pressure(
    knee: Knee, poses: Pose, contact_points: Array, share: float = 0.1
) -> PeakPressure:
    """Mean pressure over the highest tenth of each touching area, and where that is.

    A finite element model averages the tenth of its faces with the highest pressure. Here a tenth
    of the area counts, to a part of an element, so that nothing jumps when elements are few. An
    elliptical patch is cut into rings of equal area; of a contact that sums over points the
    tibial surface is sampled three times as finely along both parameters.

    Args:
        knee: any knee.
        poses: fields of shape `(poses,)`.
        contact_points: contact points of the patches, `(n, 2, poses)`, as a balance gives them.
        share: of the touching area.

    Returns:
        One row per pose, one column per contact.

    Source: paper 4, section 2.4.1.
    """
    return _peak_pressure(knee, poses, contact_points, jnp.asarray(share))


@compiled()
def _peak_pressure(knee: Knee, poses: Pose, contact_points: Array, share: Array) -> PeakPressure:
    lanes, row, peaks = add_lane_axis(knee), 0, []
    for contact in lanes.contacts:
        if contact.has_patch:
            elements = _rings(contact, poses, contact_points[row])
            row += 1
        else:
            elements = _points(contact, poses)
        peaks.append(_highest(*elements, share))
    if not peaks:
        nothing = jnp.zeros((*jnp.shape(poses.flexion), 0))
        return PeakPressure(nothing, nothing[..., None] * jnp.ones(3))
    pressure, center = (jnp.stack(x, axis=-1) for x in zip(*peaks, strict=True))
    return PeakPressure(pressure, jnp.moveaxis(center, 0, -1))


def _rings(contact: Contact, poses: Pose, contact_points: Array) -> tuple[Array, Array, Array]:
    """Pressure, area and centre of the rings of a patch, along an axis before the poses."""
    gap = contact.gap(poses.placement, contact_points)
    # Depth falls as the square of the radius, and so, linearly, with the area inside.
    inside = (jnp.arange(_RINGS)[:, None] + 0.5) / _RINGS
    depth = gap.depth * (1.0 - inside)
    pressure = jnp.where(depth > 0, contact.pressure(depth), 0.0)
    center = contact.tibial.frame.placement.apply(gap.point)
    return _spread(pressure, jnp.ones_like(inside), center)


def _points(contact: Contact, poses: Pose) -> tuple[Array, Array, Array]:
    """Pressure, area and place of points on the tibial surface, likewise."""
    first, second = contact.points
    fine = dataclasses.replace(contact, points=(_FINER * first, _FINER * second))
    sampled = fine.foundation.sample(poses.placement)
    points, depth = sampled.points, sampled.depth
    pressure = jnp.where(depth > 0, points.pressure(depth), 0.0)
    return _spread(pressure, points.area, points.point)


def _spread(pressure: Array, area: Array, place) -> tuple[Array, Array, Array]:
    places = jnp.stack([jnp.broadcast_to(x, pressure.shape) for x in place])
    return pressure, jnp.broadcast_to(area, pressure.shape), places


def _highest(pressure: Array, area: Array, place: Array, share: Array) -> tuple[Array, Array]:
    """Mean pressure and place over the part of the area where pressure is highest.

    Args:
        pressure: `(elements, poses)`.
        area: likewise.
        place: `(3, elements, poses)`.
        share: of the area under pressure.
    """
    order = jnp.argsort(-pressure, axis=0)
    area = jnp.where(pressure > 0, area, 0.0)
    pressure, area = (jnp.take_along_axis(x, order, axis=0) for x in (pressure, area))
    place = jnp.take_along_axis(place, order[None], axis=1)
    before = jnp.cumsum(area, axis=0) - area
    counted = jnp.clip(share * jnp.sum(area, axis=0) - before, 0.0, area)
    total = jnp.sum(counted, axis=0)
    touches = total > 0
    weight = counted / jnp.where(touches, total, 1.0)
    center = jnp.where(touches, jnp.sum(weight * place, axis=1), jnp.nan)
    return jnp.sum(weight * pressure, axis=0), center
