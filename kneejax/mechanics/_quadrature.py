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
    scaled,
    subtract,
)

_RAY_STEPS = 3
_GRAZING = 0.2


class Points(eqx.Module):
    """Gauss points of a tibial surface, along the axis before the lanes.

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


def gauss_points(surface: Surface, count: tuple[int, int], trailing: int) -> Points:
    """Gauss points over the whole region of a surface.

    Args:
        surface: the tibial surface.
        count: number along each parameter.
        trailing: number of axes that the lanes take.
    """
    ones = (1,) * trailing
    (lower_a, upper_a), (lower_b, upper_b) = surface.bounds()
    node_a, weight_a = _gauss(count[0], ones)
    node_b, weight_b = _gauss(count[1], ones)
    half_a, half_b = 0.5 * (upper_a - lower_a), 0.5 * (upper_b - lower_b)
    a = (lower_a + half_a * (1.0 + node_a))[:, None] + 0.0 * node_b[None]
    b = (lower_b + half_b * (1.0 + node_b))[None] + 0.0 * node_a[:, None]
    weight = (half_a * weight_a)[:, None] * (half_b * weight_b)[None]
    size = count[0] * count[1]
    a, b, weight = (x.reshape(size, *x.shape[2:]) for x in jnp.broadcast_arrays(a, b, weight))
    point, normal, area = surface.oriented(a, b)
    across = (
        scaled(a, jnp.stack([lower_a, upper_a]))[0], scaled(b, jnp.stack([lower_b, upper_b]))[0]
    )
    return Points(point, normal, weight * area, across)


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
    gradient, steep = _look(femoral, depth, start, along)[1:]
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
        return depth + level / steep

    # A loop, though it is short: looks that follow each other in one kernel are computed anew for
    # each use of what they found, and three of them took minutes to compile.
    shape = jnp.broadcast_shapes(start[0].shape, along[0].shape)
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


def _gauss(count: int, trailing: tuple[int, ...]) -> tuple[Array, Array]:
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return jnp.asarray(nodes.reshape(-1, *trailing)), jnp.asarray(weights.reshape(-1, *trailing))
