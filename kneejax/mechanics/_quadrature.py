"""Depth of overlap at fixed points of the tibial surface."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.custom_derivatives import SymbolicZero

from kneejax.geometry import (
    Placement,
    Surface,
    Vector,
    dot,
    full,
    instantiate,
    scale,
    subtract,
)

_RAY_STEPS = 2
_GRAZING = 0.2
# Depths that are looked for, and the level left, mm, where a line has missed the surface.
_FARTHEST, _MISSED = 25.0, 1e-3


class Points(eqx.Module):
    """Points of a tibial surface, along the axis before the lanes.

    Attributes:
        point: mm, in the surface's frame.
        normal: outward unit normals.
        area: weight of each point, mm^2.
        across: both parameters, scaled to -1..1 over the surface's region.
    """

    point: Vector
    normal: Vector
    area: Array
    across: tuple[Array, Array]


class Sampled(eqx.Module):
    """What the points see of the femur.

    Attributes:
        points: of the tibial surface.
        depth: overlap along the normal, mm; negative where the surfaces are apart.
        hit: where the normal's line leaves the femoral solid, mm, in the tibial surface's frame.
        slope: derivative of the depth by a motion of the point.
    """

    points: Points
    depth: Array
    hit: Vector
    slope: Vector


def midpoints(surface: Surface, count: tuple[int, int], trailing: int) -> Points:
    """Middles of equal rectangles over a surface's region; they weigh nothing off its cartilage.

    What touches lies inside the region, and there the midpoint rule is the better one: Gauss
    points, dense at the edges, are half as dense in the middle (an error of area of 9.6 instead of
    5.3 per cent with 28 x 20 points on a measured knee).

    Args:
        surface: the tibial surface.
        count: number along each parameter.
        trailing: number of axes that the lanes take.
    """
    (lower_a, upper_a), (lower_b, upper_b) = surface.bounds()
    along_a, along_b = (upper_a - lower_a) / count[0], (upper_b - lower_b) / count[1]
    s, t = (x.reshape(-1, *(1,) * trailing) for x in _middles(count))
    a, b = lower_a + s * (upper_a - lower_a), lower_b + t * (upper_b - lower_b)
    a, b = jnp.broadcast_arrays(a, b)
    weight = along_a * along_b * surface.covered(a, b, (along_a, along_b))
    point, normal, area = surface.oriented(a, b)
    return Points(point, normal, weight * area, (2.0 * s - 1.0, 2.0 * t - 1.0))


def sample(femoral: Surface, points: Points, motion: Placement) -> Sampled:
    """Depth of the femoral solid at points of the tibial surface.

    Args:
        femoral: the surface whose solid presses.
        points: of the tibial surface.
        motion: from the femoral to the tibial surface's frame.

    Returns:
        Depths with their slopes.
    """
    start, along = motion.apply_inverse(points.point), motion.turn_back(points.normal)
    depth = ray_depth(femoral, full(start), full(along))
    level, gradient, steep = _look(femoral, depth, start, along)
    # A line that does not meet the solid's surface nearby sees nothing of it.
    depth = jnp.where(jnp.abs(level) < _MISSED, depth, -_FARTHEST)
    slope = motion.turn(scale(1.0 / steep, gradient))
    return Sampled(points, depth, subtract(points.point, scale(depth, points.normal)), slope)


@jax.custom_jvp
def ray_depth(femoral: Surface, start: Vector, along: Vector) -> Array:
    """How far back along a line one leaves the solid: negative where one is outside.

    Args:
        femoral: the solid.
        start: mm, in its frame.
        along: unit direction; one goes against it.

    Returns:
        mm, differentiable by the implicit function theorem.
    """

    def nearer(_, depth: Array) -> Array:
        level, _, steep = _look(femoral, depth, start, along)
        return jnp.clip(depth + level / steep, -_FARTHEST, _FARTHEST)

    # A loop, though it is short: looks that follow each other in one kernel are computed anew for
    # each use of what they found, and three of them took minutes to compile.
    shape = jnp.broadcast_shapes(jnp.shape(start[0]), jnp.shape(along[0]))
    return lax.fori_loop(0, _RAY_STEPS, nearer, jnp.zeros(shape))


def _ray_depth_jvp(primals, tangents):
    femoral, start, along = primals
    depth = ray_depth(femoral, start, along)
    moved = [not isinstance(t, SymbolicZero) for t in jax.tree.leaves(tangents[0])]
    # A surface that is not perturbed need not be differentiated.
    if any(moved):
        names, rates = (femoral, start, along), instantiate(tangents)
    else:
        names, rates = (start, along), instantiate(tangents[1:])

    def level(*where):
        solid = where if any(moved) else (femoral, *where)
        found, _, steep = _look(solid[0], depth, *solid[1:])
        return found, steep

    _, change, steep = jax.jvp(level, names, rates, has_aux=True)
    return depth, change / steep


ray_depth.defjvp(_ray_depth_jvp, symbolic_zeros=True)


def _look(femoral: Surface, depth: Array, start: Vector, along: Vector):
    """Level, its gradient, and how fast it falls along the line, at a depth."""
    level, gradient = femoral.level_and_slope(subtract(start, scale(depth, along)))
    steep = dot(gradient, along)
    # A line that nearly grazes the femur says nothing about depth: the slope is held there.
    return level, gradient, jnp.where(steep < -_GRAZING, steep, -1.0)


def _middles(count: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Middles of the rectangles of a unit square, one row of rectangles after the other."""
    first, second = ((np.arange(n) + 0.5) / n for n in count)
    a, b = np.meshgrid(first, second, indexing="ij")
    return a.ravel(), b.ravel()
