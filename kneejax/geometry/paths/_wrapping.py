"""Straight fibres that wrap around convex obstacles: shortest paths and their derivatives."""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax
from jax.custom_derivatives import SymbolicZero
from jax.typing import ArrayLike

from kneejax.geometry._vectors import Vector
from kneejax.geometry.paths._ellipsoid import search, trace
from kneejax.geometry.paths._obstacles import (
    Around,
    Obstacle,
    WrapCylinder,
    WrapEllipsoid,
)
from kneejax.geometry.paths._round import Section, Wrapped, choose, differentiate, unit
from kneejax.numerics import as_known, none_of, ruled

#: Wrap angle over which a free path turns into a wrapped one, rad.
HANDOVER_WIDTH = 0.02
#: An end with a squared distance this much below the surface's (scaled to one) is inside.
_INSIDE = 1e-9
#: Ends, scaled, of a path that wraps gently: what those that do not wrap compute with.
_HARMLESS = Vector(1.2, -0.5, 0.1), Vector(-1.2, -0.5, -0.1)


class TautPath(NamedTuple):
    """The shortest path of a fibre past an obstacle; vectors in the obstacle's frame.

    Attributes:
        length: mm.
        excess: length minus the distance of the ends, mm; 0 where the path is free.
        pull_start: derivative of the length with respect to the start, a direction wherever it
            wraps.
        pull_end: derivative of the length with respect to the end.
        angle: rad; positive where the path wraps. The angle that it turns by, in the plane of
            its ends and the centre, where the obstacle is scaled to a sphere; minus the angle by
            which it is free.
        leaves: where it meets the obstacle, mm; where it is free, its point nearest the centre.
        arrives: where it parts from the obstacle, mm.
        side: direction from the centre (a cylinder's axis) to the path's middle. Between two
            successive poses it turns by much where the path has flipped to another side.
        detour_other_side: by how much the path round another side is longer, mm; infinite where
            it is free or has to keep its side. Small values announce a flip. For an ellipsoid it is
            taken from the best plane section at least a right angle away.
        inside: an end lies inside the obstacle; the path is then the straight line.
        beyond_ends: it touches a cylinder beyond its length.
    """

    length: Array
    excess: Array
    pull_start: Vector
    pull_end: Vector
    angle: Array
    leaves: Vector
    arrives: Vector
    side: Vector
    detour_other_side: Array
    inside: Array
    beyond_ends: Array


def taut(
    obstacle: Obstacle, start: Vector, end: Vector, width: ArrayLike = HANDOVER_WIDTH
) -> TautPath:
    """Shortest path between two points that an obstacle may be in the way of.

    Args:
        obstacle: what is in the way.
        start: components of any shape that broadcasts with the end's and with the obstacle's
            leaves, mm, in the obstacle's frame.
        end: the same.
        width: wrap angle from which the exact length holds, rad. Between minus and plus the width
            the detour is blended in by a quintic, which makes the length twice continuously
            differentiable.

    Returns:
        The path. `pull_start` and `pull_end` are exact derivatives of `length` and can be
        differentiated further, with respect to the ends and the shape; contact points, side and
        flags carry no derivative. An end inside the obstacle leaves the path straight.

    Example:
        >>> from kneejax.geometry import WrapSphere
        >>> path = taut(WrapSphere(10.0), (-20.0, 0.0, 5.0), (20.0, 0.0, 5.0))
        >>> round(float(path.excess), 4), bool(path.angle > 0)
        (1.2848, True)
    """
    start, end, shape = _common(obstacle, start, end)
    inverse = Vector(*(1.0 / a for a in shape))
    p, q = inverse * start, inverse * end
    line = end - start
    straight = line.norm()
    ahead = unit(line)
    inside = jnp.minimum(p @ p, q @ q) < 1.0 - _INSIDE
    free = jax.lax.stop_gradient(obstacle.section(p, q))
    near = (free.turn > -_width(free, width)) & ~inside & (straight > 0.0)

    far = [jnp.ones_like(straight) * point for point in _HARMLESS]
    p, q = choose(near, p, far[0]), choose(near, q, far[1])
    held = Vector(*(jnp.where(jnp.isinf(a), 1.0, a) for a in shape))
    start_near = choose(near, start, held * far[0])
    end_near = choose(near, end, held * far[1])
    length, leave, reach, rest = _wound(obstacle.around, start_near, end_near, shape)

    s = obstacle.section(p, q)
    share, slope, by_start, by_end = _blend(s, p, q, inverse, width)
    share, slope = jnp.where(near, share, 0.0), jnp.where(near, slope, 0.0)
    detour = jnp.where(near, length - straight, 0.0)
    pull_start = (share - 1.0) * ahead - share * leave + detour * slope * by_start
    pull_end = (1.0 - share) * ahead + share * reach + detour * slope * by_end
    excess = detour * share
    return TautPath(
        straight + excess,
        excess,
        pull_start,
        pull_end,
        *_report(obstacle, start, end, near, inside, free, rest),
    )


def path_points(obstacle: Obstacle, start: Vector, end: Vector, n: int = 33) -> Array:
    """Points along the shortest path, for drawing.

    Args:
        obstacle: what is in the way.
        start: mm, in the obstacle's frame.
        end: mm, in the obstacle's frame.
        n: how many points, at least 4: both ends, and between them the part along the obstacle
            (the whole line where the path is free).

    Returns:
        Shape `(n, 3, ...)`, mm, in the obstacle's frame.

    Example:
        >>> from kneejax.geometry import WrapSphere
        >>> path_points(WrapSphere(10.0), (-20.0, 0.0, 5.0), (20.0, 0.0, 5.0), 9).shape
        (9, 3)
    """
    start, end, shape = _common(obstacle, start, end)
    path = taut(obstacle, start, end)
    wraps = path.angle > 0.0
    one = jnp.ones_like(path.length)
    held = Vector(*(jnp.where(jnp.isinf(a), 1.0, a) for a in shape))
    far = [held * (one * x) for x in _HARMLESS]
    begin, finish = choose(wraps, start, far[0]), choose(wraps, end, far[1])
    along = jnp.linspace(0.0, 1.0, n - 2).reshape(-1, *(1,) * one.ndim)
    if isinstance(obstacle, WrapEllipsoid):
        touching = trace(begin, finish, shape, search(begin, finish, shape)[0], n - 2)
    else:
        inverse = Vector(*(1.0 / a for a in shape))
        s = obstacle.section(inverse * begin, inverse * finish)
        cosine, sine = jnp.cos(along * s.turn), jnp.sin(along * s.turn)
        quarter = s.pole.cross(s.contacts[0])
        x, y, z = cosine * s.contacts[0] + sine * quarter
        if isinstance(obstacle, WrapCylinder):
            z = path.leaves[2] + along * (path.arrives[2] - path.leaves[2])
        touching = held * Vector(x, y, z)
    fractions = jnp.linspace(0.0, 1.0, n).reshape(-1, *(1,) * one.ndim)
    points = []
    for a, b, middle in zip(start, end, touching, strict=True):
        bent = jnp.concatenate([jnp.expand_dims(a, 0), middle, jnp.expand_dims(b, 0)])
        points.append(jnp.where(wraps, bent, a + fractions * (b - a)))
    return jnp.stack(points, 1)


def _common(obstacle: Obstacle, start: Vector, end: Vector) -> tuple[Vector, Vector, Vector]:
    """Ends and semi-axes as arrays of one shape."""
    arrays = (*start, *end, *obstacle.semi_axes_along_frame)
    every = jnp.broadcast_arrays(*(jnp.asarray(a, float) for a in arrays))
    return Vector(*every[:3]), Vector(*every[3:6]), Vector(*every[6:])


def _width(s: Section, width: ArrayLike) -> Array:
    """The hand-over's width, less where an end is so near that its tangent is shorter than it."""
    full, soft = jnp.asarray(width, float), 4.0 * jnp.square(jnp.asarray(width, float))
    for tangent in s.tangents:
        full = full * tangent / jnp.sqrt(tangent * tangent + soft)
    return full


def _blend(
    s: Section, p: Vector, q: Vector, inverse: Vector, width: ArrayLike
) -> tuple[Array, Array, Vector, Vector]:
    """Share of the wrapped path, its slope by the angle over the width, that ratio's gradients."""
    span = _width(s, width)
    ratio = s.turn / span
    x = jnp.clip(0.5 * (ratio + 1.0), 0.0, 1.0)
    share = x * x * x * (10.0 + x * (6.0 * x - 15.0))
    slope = 15.0 * jnp.square(x * (1.0 - x))
    soft = 4.0 * jnp.square(jnp.asarray(width, float))
    gradients = []
    for point, contact, tangent in zip((p, q), s.contacts, s.tangents, strict=True):
        square = tangent * tangent
        turn = -1.0 / (tangent * span) * contact
        narrowing = -ratio * soft / (square * (square + soft)) * point
        gradients.append(inverse * (turn + narrowing))
    return share, slope, gradients[0], gradients[1]


def _wound(
    around: Around, start: Vector, end: Vector, shape: Vector
) -> tuple[Array, Vector, Vector, Wrapped]:
    """Length and directions of the wrapped path, and the rest of it, which has no derivative."""
    w = around(*lax.stop_gradient((start, end, shape)))
    return ruled(partial(_winding, around), (w.length, w.leave, w.reach, w), start, end, shape)


def _winding(around, out, primals, tangents):
    start, end, shape = primals
    # Its normals and the rest change with the ends as the search for the path does.
    known = as_known(around, out[3], start, end, shape)
    moved = [Vector(*map(_change, d)) for d in tangents[:2]]
    length, leave, reach = differentiate(known, out[1], out[2], *moved)
    if not all(isinstance(t, SymbolicZero) for t in tangents[2]):
        # For a fixed aim one step of Newton's rule is left in the path, so its derivative is that
        # of the taut path.
        reshaped = Vector(*map(_change, tangents[2]))

        def again(shape: Vector) -> tuple[Array, Vector, Vector]:
            w = around(start, end, shape, known.aim)
            return w.length, w.leave, w.reach

        _, more = jax.jvp(again, (shape,), (reshaped,))
        length = length + more[0]
        leave, reach = leave + more[1], reach + more[2]
    return out, (length, leave, reach, none_of(out[3]))


def _change(tangent: Any) -> Array:
    """The tangent as an array."""
    if isinstance(tangent, SymbolicZero):
        return jnp.zeros(tangent.shape, tangent.dtype)
    return tangent


def _report(
    obstacle: Obstacle,
    start: Vector,
    end: Vector,
    near: Array,
    inside: Array,
    free: Section,
    w: Wrapped,
) -> tuple[Any, ...]:
    """What a path reports besides its length: nothing here carries a derivative."""
    start, end, free, w = jax.lax.stop_gradient((start, end, free, w))
    axes = obstacle.semi_axes_along_frame
    angle = jnp.where(inside, -jnp.pi, free.turn)
    wraps = near & (angle > 0.0)
    inverse = Vector(*(1.0 / jax.lax.stop_gradient(a) for a in axes))
    p, line = inverse * start, inverse * (end - start)
    square = line @ line
    part = jnp.clip(-(p @ line) / jnp.where(square > 0.0, square, 1.0), 0.0, 1.0)
    nearest = start + part * (end - start)
    leaves, arrives = choose(wraps, w.contacts[0], nearest), choose(wraps, w.contacts[1], nearest)
    # Of an arc of more than half a turn the middle lies across from that of its ends.
    middle = jnp.where(angle > jnp.pi, -1.0, 1.0) * (leaves + arrives)
    if isinstance(obstacle, WrapCylinder):
        middle = Vector(middle.x, middle.y, 0.0 * middle.z)
        height = jnp.maximum(jnp.abs(leaves[2]), jnp.abs(arrives[2]))
        beyond = wraps & (height > 0.5 * obstacle.length)
    else:
        beyond = jnp.zeros_like(wraps)
    detour = jnp.where(wraps & (not obstacle.keeps_side), w.opposite - w.length, jnp.inf)
    return angle, leaves, arrives, unit(middle), detour, inside, beyond
