"""Fibres that wrap around convex obstacles fixed to a bone: spheres, cylinders and ellipsoids, the
shortest paths and their derivatives."""

__all__ = [
    "SIDES", "Obstacle", "TautPath", "WrapCylinder", "WrapEllipsoid", "WrapSphere", "path_points",
    "taut",
]

from abc import abstractmethod
from collections.abc import Callable
from functools import partial
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array, lax
from jax.typing import ArrayLike

from kneejax.geometry._pose import Frame, framed, numbers
from kneejax.geometry._vectors import AXES, Vector, plus
from kneejax.geometry._wrap_ellipsoid import Aim, around_ellipsoid, search, trace
from kneejax.geometry._wrap_round import (
    Section,
    Wrapped,
    around_cylinder,
    around_sphere,
    changed,
    choose,
    differentiate,
    inverse_of,
    section,
    unit,
)
from kneejax.numerics import as_known, none_of, ruled

#: Name of a side of a cylinder -> where it is in the cylinder's frame.
SIDES: dict[str, Vector] = {"+x": AXES.x, "-x": -AXES.x, "+y": AXES.y, "-y": -AXES.y}
#: Wrap angle over which a free path turns into a wrapped one, rad.
HANDOVER_WIDTH = 0.02
#: An end with a squared distance this much below the surface's (scaled to one) is inside.
_INSIDE = 1e-9
#: Ends, scaled, of a path that wraps gently: what those that do not wrap compute with.
_HARMLESS = Vector(1.2, -0.5, 0.1), Vector(-1.2, -0.5, -0.1)


class Obstacle(eqx.Module):
    """A convex body that fibres cannot pass through, fixed to a bone."""

    around: ClassVar[Callable[..., Wrapped]]  # winds a path around this kind

    @property
    @abstractmethod
    def frame(self) -> Frame:
        """The obstacle's frame in the bone's: a field, `frame: Frame = framed()`."""

    @property
    @abstractmethod
    def semi_axes_along_frame(self) -> Vector:
        """Semi-axes along the frame's X, Y, Z, mm; infinite along a cylinder."""

    @property
    def passes(self) -> Vector | None:
        """The side on which paths pass, however far that leads around; None where they take the
        shorter way."""
        return None


class WrapSphere(Obstacle):
    """A sphere.

    Attributes:
        radius: mm, a number or shape `(...)`.
        frame: its frame in the bone's; only the origin matters.

    Example:
        >>> ball = WrapSphere(20.0)
        >>> float(ball.radius), float(ball.frame.origin[0])
        (20.0, 0.0)
    """

    radius: Array = numbers()
    frame: Frame = framed()
    around = staticmethod(around_sphere)

    @property
    def semi_axes_along_frame(self) -> Vector:
        """Three times the radius, mm."""
        return Vector(self.radius, self.radius, self.radius)


class WrapCylinder(Obstacle):
    """A cylinder about the Z axis of its frame, treated as endless.

    Attributes:
        radius: mm, a number or shape `(...)`.
        length: mm; a path that touches beyond half of it is flagged, not changed.
        frame: its frame in the bone's.
        side: on which paths pass, of `SIDES`, however far that leads around; empty where they take
            the shorter way.

    Example:
        >>> rod = WrapCylinder(10.0, 60.0, side="+x")
        >>> float(rod.radius), rod.side
        (10.0, '+x')
    """

    radius: Array = numbers()
    length: Array = numbers()
    frame: Frame = framed()
    side: str = eqx.field(static=True, default="")

    def __check_init__(self):
        if self.side and self.side not in SIDES:
            raise ValueError(f"WrapCylinder: side is {self.side!r}, not one of {', '.join(SIDES)}")

    @property
    def semi_axes_along_frame(self) -> Vector:
        """The radius twice, then infinity, mm."""
        return Vector(self.radius, self.radius, jnp.full_like(self.radius, jnp.inf))

    @property
    def around(self) -> Callable[..., Wrapped]:
        return partial(around_cylinder, side=self.passes)

    @property
    def passes(self) -> Vector | None:
        return SIDES.get(self.side)


class WrapEllipsoid(Obstacle):
    """An ellipsoid.

    Attributes:
        semi_axes: shape `(3, ...)`, mm, along its frame's X, Y, Z.
        frame: its frame in the bone's.

    Example:
        >>> [float(x) for x in WrapEllipsoid((30.0, 18.0, 12.0)).semi_axes]
        [30.0, 18.0, 12.0]
    """

    semi_axes: Array = numbers()
    frame: Frame = framed()
    around = staticmethod(around_ellipsoid)

    @property
    def semi_axes_along_frame(self) -> Vector:
        """The semi-axes, mm."""
        return Vector.of(self.semi_axes)


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
    line = end - start
    straight, ahead, inverse = line.norm(), unit(line), inverse_of(shape)
    p, q = inverse * start, inverse * end
    inside = jnp.minimum(p @ p, q @ q) < 1.0 - _INSIDE
    outside = ~inside & (straight > 0.0)
    ends, scaled = _outside(outside, start, end, shape)
    s = section(*scaled, obstacle.passes)
    # Of the wrapped path only length and directions have a derivative.
    around = obstacle.around
    w = around(*lax.stop_gradient((*ends, shape, s)))
    w = ruled(partial(_winding, around), w, *ends, shape)
    share, slope, by_start, by_end = _blend(s, *scaled, inverse, width)
    share, slope = jnp.where(outside, share, 0.0), jnp.where(outside, slope, 0.0)
    detour = jnp.where(share > 0.0, w.length - straight, 0.0)
    pull_start = (share - 1.0) * ahead - share * w.leave + detour * slope * by_start
    pull_end = (1.0 - share) * ahead + share * w.reach + detour * slope * by_end
    excess = detour * share

    # Nothing of what follows carries a derivative.
    start, line, p, q, turn, w = lax.stop_gradient((start, line, p, q, s.turn, w))
    angle = jnp.where(outside, turn, -jnp.pi)
    wraps = (share > 0.0) & (angle > 0.0)
    ahead_scaled = q - p
    square = ahead_scaled @ ahead_scaled
    part = jnp.clip(-(p @ ahead_scaled) / jnp.where(square > 0.0, square, 1.0), 0.0, 1.0)
    leaves, arrives = (choose(wraps, point, start + part * line) for point in w.contacts)
    # Of an arc of more than half a turn the middle lies across from that of its ends.
    middle = jnp.where(angle > jnp.pi, -1.0, 1.0) * (leaves + arrives)
    beyond_ends = jnp.zeros_like(wraps)
    if isinstance(obstacle, WrapCylinder):
        middle = Vector(middle.x, middle.y, 0.0 * middle.z)
        height = jnp.maximum(jnp.abs(leaves.z), jnp.abs(arrives.z))
        beyond_ends = wraps & (height > 0.5 * obstacle.length)
    other = jnp.where(wraps, w.opposite - w.length, jnp.inf)
    return TautPath(
        straight + excess, excess, pull_start, pull_end, angle, leaves, arrives,
        side=unit(middle), detour_other_side=other, inside=inside, beyond_ends=beyond_ends,
    )  # fmt: skip


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
    ends, (p, q) = _outside(wraps, start, end, shape)
    s = section(p, q, obstacle.passes)
    aim = Aim(jnp.ones_like(s.turn), jnp.zeros_like(s.turn), s.turn)
    if isinstance(obstacle, WrapEllipsoid):
        aim, _ = search(ends[1], p, q, s, shape)
    touching = trace(p, s, shape, aim, n - 2)
    if isinstance(obstacle, WrapCylinder):
        along = jnp.linspace(0.0, 1.0, n - 2).reshape(-1, *(1,) * s.turn.ndim)
        height = path.leaves.z + along * (path.arrives.z - path.leaves.z)
        touching = Vector(touching.x, touching.y, height)
    fractions = jnp.linspace(0.0, 1.0, n).reshape(-1, *(1,) * s.turn.ndim)
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


def _outside(
    condition: Array, start: Vector, end: Vector, shape: Vector
) -> tuple[tuple[Vector, Vector], tuple[Vector, Vector]]:
    """Ends where a condition holds, harmless ones elsewhere: in mm, and scaled."""
    size, inverse = Vector(*(jnp.where(jnp.isinf(a), 1.0, a) for a in shape)), inverse_of(shape)
    first, last = (
        choose(condition, point, size * far)
        for point, far in zip((start, end), _HARMLESS, strict=True)
    )
    return (first, last), (inverse * first, inverse * last)


def _blend(
    s: Section, p: Vector, q: Vector, inverse: Vector, width: ArrayLike
) -> tuple[Array, Array, Vector, Vector]:
    """Share of the wrapped path, its slope by the angle over the width, that ratio's gradients."""
    span, soft = jnp.asarray(width, float), 4.0 * jnp.square(jnp.asarray(width, float))
    # Less where an end is so near that its tangent is shorter than the width.
    for tangent in s.tangents:
        span = span * tangent / jnp.sqrt(tangent * tangent + soft)
    ratio = s.turn / span
    x = jnp.clip(0.5 * (ratio + 1.0), 0.0, 1.0)
    share = x * x * x * (10.0 + x * (6.0 * x - 15.0))
    slope = 15.0 * jnp.square(x * (1.0 - x))
    gradients = []
    for point, contact, tangent in zip((p, q), s.contacts, s.tangents, strict=True):
        square = tangent * tangent
        turn = -1.0 / (tangent * span) * contact
        narrowing = -ratio * soft / (square * (square + soft)) * point
        gradients.append(inverse * (turn + narrowing))
    return share, slope, gradients[0], gradients[1]


def _winding(around, w, primals, tangents):
    """The rule of a wrapped path's derivative."""
    start, end, shape = primals
    # Its normals and the rest change with the ends as the search for the path does.
    known = as_known(around, w, start, end, shape)
    by_start, by_end, by_shape = map(changed, tangents)
    length, leave, reach = differentiate(w, known, by_start, by_end)
    if not all(isinstance(x, float) for x in by_shape):
        # For a fixed aim one step of Newton's rule is left in the path, so its derivative is that
        # of the taut path.
        reshaped = Vector(*(jnp.zeros_like(x) + t for x, t in zip(shape, by_shape, strict=True)))
        _, more = jax.jvp(lambda x: around(start, end, x, None, known.aim), (shape,), (reshaped,))
        length, leave, reach = plus(length, more.length), leave + more.leave, reach + more.reach
    return w, none_of(w)._replace(length=length, leave=leave, reach=reach)
