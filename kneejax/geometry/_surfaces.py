"""Analytic articular surfaces.

A surface lives in its own frame, which is placed in a bone. It is given twice: as a map from two
parameters to a point (`point`), and as a level function that is zero on it, positive outside the
solid, with unit gradient on the surface (`level`). Contact reads the femoral side by its points
and the tibial side by its level, or the other way round; any pair of surfaces can meet.
"""

from __future__ import annotations

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array, lax
from jax.typing import ArrayLike

from kneejax.geometry import _vectors as v
from kneejax.geometry._polynomials import partials
from kneejax.geometry._pose import Frame
from kneejax.geometry._safe import safe_sqrt
from kneejax.geometry._vectors import Vector


class Jet(eqx.Module):
    """A surface's point and its partial derivatives by the parameters, up to the second.

    Each is given by its three coefficients along vectors that turn with the surface (for a
    condyle: the ray, its derivative by the angle, the axis), so that a rigid motion has to turn
    three vectors instead of six.

    Attributes:
        basis: the three vectors, in mm per unit of their coefficient.
        point: coefficients of the point; likewise the first derivatives `a` and `b` and the
            second derivatives `aa`, `ab` and `bb`.
    """

    basis: tuple[Vector, Vector, Vector]
    point: Vector
    a: Vector
    b: Vector
    aa: Vector
    ab: Vector
    bb: Vector

    def vector(self, coefficients: Vector) -> Vector:
        """The vector with these coefficients."""
        x, y, z = (v.scale(c, e) for c, e in zip(coefficients, self.basis, strict=True))
        return v.add(v.add(x, y), z)


class Height(eqx.Module):
    """A function that vanishes on a surface and grows outwards, with its derivatives in space.

    Attributes:
        value: in a unit of its own: only `value / |gradient|` is a distance.
        gradient: by x, y, z.
        hessian: rows by x, y, z; None where it vanishes.
    """

    value: Array
    gradient: Vector
    hessian: tuple[Vector, Vector, Vector] | None


class Surface(eqx.Module):
    """What contact needs to know of a surface.

    Attributes:
        frame: placement of the surface in its bone.
    """

    frame: eqx.AbstractVar[Frame]

    @abc.abstractmethod
    def point(self, a: Array, b: Array) -> Vector:
        """Point at the parameters `(a, b)`, in mm, in the surface's frame."""

    @abc.abstractmethod
    def level(self, point: Vector) -> Array:
        """Signed distance to first order, mm: zero on the surface, positive outside the solid."""

    @abc.abstractmethod
    def start(self, direction: Vector) -> tuple[Array, Array]:
        """Parameters near the point whose outward normal is `direction`: a first guess."""

    @abc.abstractmethod
    def bounds(self) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """Lower and upper limits of both parameters: the region in which the surface is known."""

    def jet(self, a: Array, b: Array) -> Jet:
        """Point and partial derivatives at the parameters `(a, b)`."""
        one = jnp.ones_like(a)

        def along_a(a_: Array, b_: Array) -> tuple[Vector, Vector]:
            return jax.jvp(lambda s: self.point(s, b_), (a_,), (one,))

        def along_b(b_: Array) -> tuple[Vector, Vector]:
            return jax.jvp(lambda s: self.point(a, s), (b_,), (one,))

        (point, da), (_, daa) = jax.jvp(lambda s: along_a(s, b), (a,), (one,))
        (_, db), (_, dbb) = jax.jvp(along_b, (b,), (one,))
        _, (_, dab) = jax.jvp(lambda s: along_a(a, s), (b,), (one,))
        basis = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
        return Jet(basis, point, da, db, daa, dab, dbb)

    def height(self, point: Vector) -> Height:
        """The level, or a function with the same zeros that is cheaper, with its derivatives."""

        def slope(p: Vector) -> Vector:
            return jax.grad(lambda q: jnp.sum(self.level(q)))(p)

        point = v.full(point)
        one, zero = jnp.ones_like(point[0]), jnp.zeros_like(point[0])
        gradient, x = jax.jvp(slope, (point,), ((one, zero, zero),))
        _, y = jax.jvp(slope, (point,), ((zero, one, zero),))
        _, z = jax.jvp(slope, (point,), ((zero, zero, one),))
        return Height(self.level(point), gradient, (x, y, z))

    def outwards(self, point: Vector) -> Vector:
        """Direction that leads away from the solid at a point; need not have unit length."""
        return jax.grad(lambda p: jnp.sum(self.level(p)))(v.full(point))

    def knows(self, point: Vector) -> Array:
        """Whether a point on (or near) the surface lies in the region in which it is known."""
        return jnp.asarray(True)


def jet(surface: Surface, a: ArrayLike, b: ArrayLike) -> Jet:
    """Point and partial derivatives of a surface.

    Args:
        surface: any surface.
        a: first parameter, any shape.
        b: second parameter, same shape.

    Returns:
        The jet, each vector with components of that shape.
    """
    return surface.jet(*jnp.broadcast_arrays(jnp.asarray(a, float), jnp.asarray(b, float)))


def normal(surface: Surface, a: ArrayLike, b: ArrayLike) -> Vector:
    """Outward unit normal at the parameters `(a, b)`, in the surface's frame."""
    return _normal(surface, jet(surface, a, b))


def _normal(surface: Surface, local: Jet) -> Vector:
    raw = v.cross(local.vector(local.a), local.vector(local.b))
    unit = v.scale(1.0 / v.norm(raw), raw)
    # A parametrisation may be right-handed outwards or inwards: ask the level function.
    probe = surface.level(v.add(local.vector(local.point), v.scale(1e-3, unit)))
    return v.scale(lax.stop_gradient(jnp.sign(probe)), unit)


def area_element(surface: Surface, a: ArrayLike, b: ArrayLike) -> Array:
    """Area covered by a unit square of the parameters, mm^2 per unit."""
    local = jet(surface, a, b)
    return v.norm(v.cross(local.vector(local.a), local.vector(local.b)))


def principal_curvatures(surface: Surface, a: ArrayLike, b: ArrayLike) -> tuple[Array, Array]:
    """Principal curvatures, the larger first, positive where the solid is convex.

    Args:
        surface: any surface.
        a: first parameter.
        b: second parameter.

    Returns:
        Two curvatures in 1/mm.

    Example:
        >>> k1, k2 = principal_curvatures(Sphere(radius=25.0), 1.5, 0.1)
        >>> round(float(k1), 9), round(float(k2), 9)
        (0.04, 0.04)
    """
    local = jet(surface, a, b)
    n = _normal(surface, local)
    along_a, along_b = local.vector(local.a), local.vector(local.b)
    e, f, g = v.dot(along_a, along_a), v.dot(along_a, along_b), v.dot(along_b, along_b)
    ll, mm, nn = (-v.dot(local.vector(x), n) for x in (local.aa, local.ab, local.bb))
    area = e * g - f * f
    gauss = (ll * nn - mm * mm) / area
    mean = (e * nn - 2 * f * mm + g * ll) / (2 * area)
    spread = safe_sqrt(mean * mean - gauss)
    return mean + spread, mean - spread


class Plane(Surface):
    """The plane `y = 0` of its frame; the solid lies below.

    Attributes:
        frame: placement in the bone; its Y axis is the outward normal.
        half_extent: half the size of the known region along X and Z, mm, shape `(2, ...)`.
    """

    frame: Frame
    half_extent: Array

    def __init__(self, frame: Frame | None = None, half_extent: ArrayLike = (1e3, 1e3)):
        self.frame = Frame() if frame is None else frame
        self.half_extent = jnp.asarray(half_extent, float)

    def point(self, a: Array, b: Array) -> Vector:
        return a, 0.0, b

    def level(self, point: Vector) -> Array:
        return point[1]

    def height(self, point: Vector) -> Height:
        return Height(point[1], self.outwards(point), None)

    def outwards(self, point: Vector) -> Vector:
        return 0.0, 1.0, 0.0

    def knows(self, point: Vector) -> Array:
        return inside(self, point[0], point[2])

    def start(self, direction: Vector) -> tuple[Array, Array]:
        return jnp.zeros_like(direction[0]), jnp.zeros_like(direction[0])

    def bounds(self) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        x, z = self.half_extent
        return (-x, x), (-z, z)


class Sphere(Surface):
    """A sphere about the origin of its frame, parametrised by angle about Z and latitude.

    Attributes:
        radius: mm.
        frame: placement in the bone.
    """

    radius: Array
    frame: Frame

    def __init__(self, radius: ArrayLike, frame: Frame | None = None):
        self.radius = jnp.asarray(radius, float)
        self.frame = Frame() if frame is None else frame

    def point(self, a: Array, b: Array) -> Vector:
        return v.scale(self.radius, _direction(a, b))

    def level(self, point: Vector) -> Array:
        return v.norm(point) - self.radius

    def start(self, direction: Vector) -> tuple[Array, Array]:
        x, y, z = direction
        return _from_anterior(x, y), jnp.arctan2(z, safe_sqrt(x * x + y * y))

    def bounds(self) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        return _full_turn(self.radius)


class Ellipsoid(Surface):
    """An ellipsoid about the origin of its frame, parametrised like the sphere.

    Attributes:
        semi_axes: shape `(3, ...)`, mm, along the frame's axes.
        frame: placement in the bone.
    """

    semi_axes: Array
    frame: Frame

    def __init__(self, semi_axes: ArrayLike, frame: Frame | None = None):
        self.semi_axes = jnp.asarray(semi_axes, float)
        self.frame = Frame() if frame is None else frame

    def point(self, a: Array, b: Array) -> Vector:
        return v.stretch(v.vector(self.semi_axes), _direction(a, b))

    def level(self, point: Vector) -> Array:
        inverse = v.vector(1.0 / self.semi_axes)
        scaled = v.stretch(inverse, point)
        size = v.norm(scaled)
        return (size - 1.0) * size / v.norm(v.stretch(inverse, scaled))

    def start(self, direction: Vector) -> tuple[Array, Array]:
        x, y, z = v.stretch(v.vector(self.semi_axes), direction)
        return _from_anterior(x, y), jnp.arctan2(z, safe_sqrt(x * x + y * y))

    def bounds(self) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        return _full_turn(self.semi_axes[0])


class Condyle(Surface):
    """Radius as a polynomial of angle and width about a transverse axis (the frame's Z).

    The angle runs from anterior (0) through distal (90 degrees) to posterior (180 degrees).

    Attributes:
        coefficients: shape `(m + 1, n + 1, ...)`, mm: powers of the angle and of the width,
            both scaled to -1..1 over the region.
        angle: lower and upper end of the region, rad, shape `(2, ...)`.
        width: lower and upper end of the region along the axis, mm, shape `(2, ...)`.
        frame: placement in the femur.

    Source: paper 3, section 2 (fourth-order polynomials in cylindrical coordinates).
    """

    coefficients: Array
    angle: Array
    width: Array
    frame: Frame

    def __init__(
        self,
        coefficients: ArrayLike,
        angle: ArrayLike,
        width: ArrayLike,
        frame: Frame | None = None,
    ):
        self.coefficients = jnp.asarray(coefficients, float)
        self.angle = jnp.asarray(angle, float)
        self.width = jnp.asarray(width, float)
        self.frame = Frame() if frame is None else frame

    def radius(self, angle: Array, width: Array) -> Array:
        """Distance of the surface from the axis, mm."""
        s, _ = _scaled(angle, self.angle)
        t, _ = _scaled(width, self.width)
        return partials(self.coefficients, s, t, 0)[0][0]

    def point(self, a: Array, b: Array) -> Vector:
        radius = self.radius(a, b)
        return radius * jnp.cos(a), -radius * jnp.sin(a), b

    def jet(self, a: Array, b: Array) -> Jet:
        s, by_a = _scaled(a, self.angle)
        t, by_b = _scaled(b, self.width)
        (r, r_t, r_tt), (r_s, r_st), (r_ss,) = partials(self.coefficients, s, t, 2)
        r_a, r_b = r_s * by_a, r_t * by_b
        r_aa, r_ab, r_bb = r_ss * by_a**2, r_st * by_a * by_b, r_tt * by_b**2
        c, d = jnp.cos(a), -jnp.sin(a)
        return Jet(
            basis=((c, d, 0.0), (d, -c, 0.0), (0.0, 0.0, 1.0)),
            point=(r, 0.0, b),
            a=(r_a, r, 0.0),
            b=(r_b, 0.0, 1.0),
            aa=(r_aa - r, 2.0 * r_a, 0.0),
            ab=(r_ab, r_b, 0.0),
            bb=(r_bb, 0.0, 0.0),
        )

    def level(self, point: Vector) -> Array:
        x, y, z = point
        angle = _from_anterior(x, y)
        distance = safe_sqrt(x * x + y * y)
        # Beyond its region a polynomial says nothing: hold its edge value there.
        s, by_angle = _scaled(jnp.clip(angle, self.angle[0], self.angle[1]), self.angle)
        t, by_width = _scaled(jnp.clip(z, self.width[0], self.width[1]), self.width)
        (radius, slope_t), (slope_s,) = partials(self.coefficients, s, t, 1)
        steep = (slope_s * by_angle / radius) ** 2 + (slope_t * by_width) ** 2
        return (distance - radius) / jnp.sqrt(1.0 + steep)

    def start(self, direction: Vector) -> tuple[Array, Array]:
        angle = jnp.clip(_from_anterior(direction[0], direction[1]), self.angle[0], self.angle[1])
        middle = 0.5 * (self.width[0] + self.width[1])
        return angle, middle + jnp.zeros_like(angle)

    def bounds(self) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        return (self.angle[0], self.angle[1]), (self.width[0], self.width[1])


class Plateau(Surface):
    """Height as a polynomial over a plane: `y = eta(x, z)`; the solid lies below.

    Attributes:
        coefficients: shape `(m + 1, n + 1, ...)`, mm: powers of x and z, both scaled to -1..1
            over the region.
        x: lower and upper end of the region, mm, shape `(2, ...)`.
        z: likewise.
        frame: placement in the tibia.
    """

    coefficients: Array
    x: Array
    z: Array
    frame: Frame

    def __init__(
        self, coefficients: ArrayLike, x: ArrayLike, z: ArrayLike, frame: Frame | None = None
    ):
        self.coefficients = jnp.asarray(coefficients, float)
        self.x = jnp.asarray(x, float)
        self.z = jnp.asarray(z, float)
        self.frame = Frame() if frame is None else frame

    def point(self, a: Array, b: Array) -> Vector:
        s, _ = _scaled(a, self.x)
        t, _ = _scaled(b, self.z)
        return a, partials(self.coefficients, s, t, 0)[0][0], b

    def height(self, point: Vector) -> Height:
        x, y, z = point
        s, by_x = _scaled(x, self.x)
        t, by_z = _scaled(z, self.z)
        (h, h_t, h_tt), (h_s, h_st), (h_ss,) = partials(self.coefficients, s, t, 2)
        xx, zx, zz = -h_ss * by_x**2, -h_st * by_x * by_z, -h_tt * by_z**2
        return Height(
            y - h,
            (-h_s * by_x, 1.0, -h_t * by_z),
            ((xx, 0.0, zx), (0.0, 0.0, 0.0), (zx, 0.0, zz)),
        )

    def level(self, point: Vector) -> Array:
        x, y, z = point
        s, by_x = _scaled(jnp.clip(x, self.x[0], self.x[1]), self.x)
        t, by_z = _scaled(jnp.clip(z, self.z[0], self.z[1]), self.z)
        (height, slope_t), (slope_s,) = partials(self.coefficients, s, t, 1)
        steep = (slope_s * by_x) ** 2 + (slope_t * by_z) ** 2
        return (y - height) / jnp.sqrt(1.0 + steep)

    def outwards(self, point: Vector) -> Vector:
        return 0.0, 1.0, 0.0

    def knows(self, point: Vector) -> Array:
        return inside(self, point[0], point[2])

    def start(self, direction: Vector) -> tuple[Array, Array]:
        zero = jnp.zeros_like(direction[0])
        return 0.5 * (self.x[0] + self.x[1]) + zero, 0.5 * (self.z[0] + self.z[1]) + zero

    def bounds(self) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        return (self.x[0], self.x[1]), (self.z[0], self.z[1])


def inside(surface: Surface, a: Array, b: Array, margin: float = 0.0) -> Array:
    """Whether parameters lie in the region where a surface is known.

    Args:
        surface: any surface.
        a: first parameter.
        b: second parameter.
        margin: fraction of the region's size by which the limits are drawn in.
    """
    answer = jnp.asarray(True)
    for value, (lower, upper) in zip((a, b), surface.bounds(), strict=True):
        inset = margin * (upper - lower)
        answer = answer & (value > lower + inset) & (value < upper - inset)
    return answer


def _from_anterior(x: Array, y: Array) -> Array:
    """Angle from anterior through distal, in -90 to 270 degrees: the jump is proximal."""
    return 0.5 * jnp.pi - jnp.arctan2(x, -y)


def _direction(a: Array, b: Array) -> Vector:
    return jnp.cos(b) * jnp.cos(a), -jnp.cos(b) * jnp.sin(a), jnp.sin(b)


def _full_turn(like: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    zero = jnp.zeros_like(like)
    return (zero - 0.5 * jnp.pi, zero + 1.5 * jnp.pi), (zero - 1.5, zero + 1.5)


def _scaled(value: Array, limits: Array) -> tuple[Array, Array]:
    """A coordinate scaled to -1..1 over its limits, and the derivative of that scaling."""
    factor = 2.0 / (limits[1] - limits[0])
    return (value - limits[0]) * factor - 1.0, factor
