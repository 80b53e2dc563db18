"""Plane, sphere and ellipsoid."""

__all__ = ["Ellipsoid", "Plane", "Sphere"]

import jax.numpy as jnp
from jax import Array

from kneejax.geometry._pose import Frame, framed, numbers
from kneejax.geometry._surface import Height, Surface, excess, from_anterior
from kneejax.geometry._vectors import AXES, Vector
from kneejax.numerics import safe_sqrt


class Plane(Surface):
    """The plane `y = 0` of its frame; the solid lies below.

    Attributes:
        frame: placement in the bone; its Y axis is the outward normal.
        half_extent: half the size of the known region along X and Z, mm, shape `(2, ...)`.

    Example:
        >>> from kneejax.geometry import normal
        >>> [float(x) for x in normal(Plane(), 3.0, 4.0)]
        [-0.0, 1.0, -0.0]
    """

    frame: Frame = framed()
    half_extent: Array = numbers(default=(1e3, 1e3))

    def point(self, a: Array, b: Array) -> Vector:
        return Vector(a, 0.0, b)

    def level(self, point: Vector) -> Array:
        return point[1]

    def height(self, point: Vector, order: int = 2) -> Height:
        return Height(point[1], self.outwards(point), None)

    def outwards(self, point: Vector) -> Vector:
        return AXES.y

    def core(self) -> Vector:
        return Vector(0.0, -20.0, 0.0)

    def beyond(self, point: Vector) -> Array:
        x, z = self.half_extent
        return safe_sqrt(excess(point[0], (-x, x)) ** 2 + excess(point[2], (-z, z)) ** 2)

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

    Example:
        >>> from kneejax.geometry import normal
        >>> [round(float(x), 6) for x in normal(Sphere(20.0), 0.0, 0.0)]
        [1.0, -0.0, 0.0]
    """

    radius: Array = numbers()
    frame: Frame = framed()

    def point(self, a: Array, b: Array) -> Vector:
        return self.radius * _direction(a, b)

    def level(self, point: Vector) -> Array:
        return point.norm() - self.radius

    def start(self, direction: Vector) -> tuple[Array, Array]:
        return _angles(direction)

    def bounds(self) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        return _full_turn(self.radius)


class Ellipsoid(Surface):
    """An ellipsoid about the origin of its frame, parametrised like the sphere.

    Attributes:
        semi_axes: shape `(3, ...)`, mm, along the frame's axes.
        frame: placement in the bone.

    Example:
        >>> from kneejax.geometry import area_element
        >>> round(float(area_element(Ellipsoid((30.0, 20.0, 10.0)), 0.0, 0.0)), 3)
        200.0
    """

    semi_axes: Array = numbers()
    frame: Frame = framed()

    def point(self, a: Array, b: Array) -> Vector:
        return Vector.of(self.semi_axes) * _direction(a, b)

    def level(self, point: Vector) -> Array:
        inverse = Vector.of(1.0 / self.semi_axes)
        scaled = inverse * point
        size = scaled.norm()
        return (size - 1.0) * size / (inverse * scaled).norm()

    def start(self, direction: Vector) -> tuple[Array, Array]:
        return _angles(Vector.of(self.semi_axes) * direction)

    def bounds(self) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        return _full_turn(self.semi_axes[0])


def _direction(a: Array, b: Array) -> Vector:
    return Vector(jnp.cos(b) * jnp.cos(a), -jnp.cos(b) * jnp.sin(a), jnp.sin(b))


def _angles(direction: Vector) -> tuple[Array, Array]:
    x, y, z = direction
    return from_anterior(x, y), jnp.arctan2(z, safe_sqrt(x * x + y * y))


def _full_turn(like: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    zero = jnp.zeros_like(like)
    return (zero - 0.5 * jnp.pi, zero + 1.5 * jnp.pi), (zero - 1.5, zero + 1.5)
