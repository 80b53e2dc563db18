"""Depth of overlap at points of tibial surfaces."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import jax.numpy as jnp
from jax import Array, lax

from kneejax.geometry import (
    Condyles,
    Placement,
    Rotation,
    Surface,
    Vector,
    add,
    cross,
    dot,
    scale,
    subtract,
)
from kneejax.mechanics.contact import _rays as rays
from kneejax.mechanics.contact._points import Points, Sampled, asked_at
from kneejax.mechanics.contact._unusual_rays import (
    of_usual_rows,
    over_unusual_rows,
    row_after_row,
)

Answer = TypeVar("Answer")


def over_rays(
    femoral: Surface | Condyles,
    points: Points,
    motion: Placement,
    answer: Callable[[Sampled], Answer],
) -> Answer:
    """What a function makes of the depths at points of tibial surfaces.

    The usual rays take a short search; if one of them is not usual, the row of points that it is
    one of is searched thoroughly.

    Args:
        femoral: what presses.
        points: of tibial surfaces.
        motion: from femoral to tibial axes.
        answer: returns arrays.
    """
    surface = asked_at(femoral, points)
    quick, sound = quick_depths(surface, points, motion)
    usual = quickly(surface, points, motion, quick)

    def again() -> Answer:
        def of_row(own: Points, known: Array, is_known: Array) -> tuple[Array, ...]:
            return _numbers(thoroughly(asked_at(femoral, own), own, motion, known, is_known))

        def nothing(known: Array) -> tuple[Array, ...]:
            return (jnp.zeros_like(known),) * 7 + (jnp.zeros(known.shape, bool),)

        rows = over_unusual_rows(points, quick, sound, of_row, nothing)
        kept = of_usual_rows(sound)
        both = zip(_numbers(usual), map(row_after_row, rows), strict=True)
        depth, *six, lost = (jnp.where(kept, x, y[: len(quick)]) for x, y in both)
        return answer(Sampled(points, depth, tuple(six[:3]), tuple(six[3:]), lost))

    return lax.cond(jnp.all(sound), lambda: answer(usual), again)


def _numbers(sampled: Sampled) -> tuple[Array, ...]:
    """Depth, slope, twist and what is lost, each `(points, ...)`."""
    numbers = sampled.depth, *sampled.slope, *sampled.twist, sampled.lost
    shape = jnp.broadcast_shapes(*map(jnp.shape, numbers))
    return tuple(jnp.broadcast_to(x, shape) for x in numbers)


def quick_depths(
    femoral: Surface, points: Points, motion: Placement
) -> tuple[Array, Array]:
    """Depths of the usual rays, mm, and whose are sound.

    Off the cartilage a fitted surface goes on where no tibia is: a condyle that hangs over the rim
    may be as deep in it as it likes. A point there counts as apart, farther than anything.

    Args:
        femoral: the surface whose solid presses.
        points: of tibial surfaces.
        motion: from femoral to tibial axes.
    """
    quick, sound = rays.quick_exit(femoral, *points.lines(motion))
    bare = points.area <= 0.0
    return jnp.where(bare, -rays.FARTHEST, quick), sound | bare


def quickly(femoral: Surface, points: Points, motion: Placement, quick: Array) -> Sampled:
    """What the points see where their rays are the usual ones.

    Args:
        femoral: the surface whose solid presses.
        points: of tibial surfaces.
        motion: from femoral to tibial axes.
        quick: depths of the short search, mm.
    """
    lines = points.lines(motion)
    own = rays.follow(femoral, *lines, quick)
    level, gradient, steep = rays.look(femoral, own, *lines)
    return _usual(points, motion, own, level, gradient, steep)


def quickly_with_bend(
    femoral: Surface, points: Points, motion: Placement, quick: Array
) -> tuple[Sampled, Vector, Rotation]:
    """As `quickly`, with gradient and bend of the femoral level where the rays end.

    The surface is asked once for all of it, where the last step is taken: 3e-8 mm from the end at
    most over the motion of a knee with splines, 2e-13 mm at most points.
    """
    start, along = points.lines(motion)
    own = rays.follow(femoral, start, along, quick)
    level, gradient, bend = femoral.level_slope_and_bend(subtract(start, scale(own, along)))
    usual = _usual(points, motion, own, level, gradient, dot(gradient, along))
    return usual, gradient, bend


def _usual(
    points: Points, motion: Placement, own: Array, level: Array, gradient: Vector, steep: Array
) -> Sampled:
    """What points see along usual rays that have been looked at near their ends."""
    per_steep = 1.0 / jnp.minimum(steep, -rays.LEVEL)
    depth = own + jnp.clip(level * per_steep, -rays.LAST_STEP, rays.LAST_STEP)
    lost = jnp.zeros(jnp.shape(depth), bool)
    slope = points.turned(motion, scale(per_steep, gradient))
    return Sampled(points, depth, slope, (0.0, 0.0, 0.0), lost)


def thoroughly(
    femoral: Surface, points: Points, motion: Placement, known: Array, is_known: Array
) -> Sampled:
    """What the points see, whatever their rays.

    Args:
        femoral: the surface whose solid presses.
        points: of tibial surfaces.
        motion: from femoral to tibial axes.
        known: depths that have been found, mm.
        is_known: where they have.
    """
    lines = points.lines(motion)
    found = rays.thorough_exit(femoral, *lines, known, is_known)
    depth, by_point, by_normal = rays.any_depth(femoral, *lines, found)
    depth = jnp.where(is_known & (known <= -rays.APART), lax.stop_gradient(known), depth)
    slope = points.turned(motion, by_point)
    # A ray's own depth changes by a turn of the normal as if its far end were held: no twist.
    swing = add(points.turned(motion, by_normal), scale(depth, slope))
    return Sampled(points, depth, slope, cross(points.normal, swing), found.lost)
