"""Depth of overlap at fixed points of the tibial surface."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.geometry import Placement, Surface, Vector, area_element, scale, subtract
from kneejax.geometry import normal as outward_normal

_RAY_STEPS = 2


class Sampled(eqx.Module):
    """Quadrature points of the tibial surface, along the axis before the lanes.

    Attributes:
        point: mm, in the tibial surface's frame.
        normal: outward unit normals.
        area: weight of each point, mm^2.
        depth: overlap along the normal, mm; negative where the surfaces are apart.
    """

    point: Vector
    normal: Vector
    area: Array
    depth: Array


def sample(
    femoral: Surface, tibial: Surface, motion: Placement, points: tuple[int, int]
) -> Sampled:
    """Depth of the femoral solid at Gauss points of the tibial surface.

    Args:
        femoral: the surface whose solid presses.
        tibial: the surface that carries the points, over its whole region.
        motion: from the femoral to the tibial surface's frame.
        points: number along each parameter.

    Returns:
        Points, normals, areas and depths.
    """
    trailing = (1,) * jnp.ndim(motion.translation[0])
    (lower_a, upper_a), (lower_b, upper_b) = tibial.bounds()
    node_a, weight_a = _gauss(points[0], trailing)
    node_b, weight_b = _gauss(points[1], trailing)
    half_a, half_b = 0.5 * (upper_a - lower_a), 0.5 * (upper_b - lower_b)
    a = (lower_a + half_a * (1.0 + node_a))[:, None] + 0.0 * node_b[None]
    b = (lower_b + half_b * (1.0 + node_b))[None] + 0.0 * node_a[:, None]
    weight = (half_a * weight_a)[:, None] * (half_b * weight_b)[None]
    count = points[0] * points[1]
    a, b, weight = (x.reshape(count, *x.shape[2:]) for x in jnp.broadcast_arrays(a, b, weight))
    point, normal = tibial.point(a, b), outward_normal(tibial, a, b)
    area = weight * area_element(tibial, a, b)
    back = motion.inverse()
    depth = _depth(femoral, back.apply(point), back.turn(normal))
    return Sampled(point, normal, area, depth)


def _depth(femoral: Surface, point: Vector, normal: Vector) -> Array:
    """Distance from a point back along its normal to where it leaves the femoral solid."""

    def level(depth: Array) -> Array:
        return femoral.level(subtract(point, scale(depth, normal)))

    depth = jnp.zeros_like(point[0] + normal[0])
    for _ in range(_RAY_STEPS + 1):
        value, slope = jax.jvp(level, (depth,), (jnp.ones_like(depth),))
        # A normal that nearly grazes the femur says nothing about depth: hold the slope there.
        depth = depth - value / jnp.where(slope > 0.2, slope, 1.0)
    return depth


def _gauss(count: int, trailing: tuple[int, ...]) -> tuple[Array, Array]:
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return jnp.asarray(nodes.reshape(-1, *trailing)), jnp.asarray(weights.reshape(-1, *trailing))
