"""Vectors and 3 x 3 matrices whose entries are arrays of their own.

A component is an array of any broadcastable shape: a number for one knee in one pose, more for a
batch. Everything stays elementwise, and a reverse derivative consists of products and sums; with
components along an axis of one array it is full of slices and their transposes (2,300 operations
in a contact force instead of 4,700).

A component that is known to be zero or one is the Python number `0.0` or `1.0`, and costs nothing:
XLA must not drop a product with a zero array, this module may.
"""

__all__ = ["AXES", "ZERO", "Matrix", "Vector", "plus", "times"]

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeAlias, overload

import jax
import jax.numpy as jnp
from jax import Array

from kneejax.numerics import safe_sqrt

Component: TypeAlias = Array | float


def times(a: Component, b: Component) -> Component:
    """Product of two components.

    Example:
        >>> times(1.0, 2.5), times(0.0, 2.5)
        (2.5, 0.0)
    """
    for x, y in ((a, b), (b, a)):
        if isinstance(x, float) and x in (0.0, 1.0):
            return y if x == 1.0 else 0.0
    return a * b


def plus(a: Component, b: Component) -> Component:
    """Sum of two components.

    Example:
        >>> plus(0.0, 2.5), plus(1.0, 2.5)
        (2.5, 3.5)
    """
    for x, y in ((a, b), (b, a)):
        if isinstance(x, float) and x == 0.0:
            return y
    return a + b


def minus(a: Component, b: Component) -> Component:
    """Difference of two components."""
    if isinstance(b, float) and b == 0.0:
        return a
    return -b if isinstance(a, float) and a == 0.0 else a - b


class _Three:
    """What has the entries `x`, `y` and `z`, in this order."""

    __slots__ = ()
    __array_ufunc__ = None  # an array times a vector is the vector's affair
    x: Any
    y: Any
    z: Any

    def __iter__(self) -> Iterator[Any]:
        return iter((self.x, self.y, self.z))

    def __len__(self) -> int:
        return 3

    def __getitem__(self, index: int) -> Any:
        return (self.x, self.y, self.z)[index]


@partial(jax.tree_util.register_dataclass, data_fields=["x", "y", "z"], meta_fields=[])
@dataclass(frozen=True, slots=True, eq=False)
class Vector(_Three):
    """A vector: `a + b`, `a - b`, `s * a`, `a / s`, scalar product `a @ b`, `a.cross(b)`.

    `a * b` is taken component by component, as NumPy does.

    Attributes:
        x: first component; this and the others have any shapes that broadcast.
        y: second component.
        z: third component.

    Example:
        >>> a, b = Vector(1.0, 2.0, 3.0), Vector(0.0, 1.0, 0.0)
        >>> a @ b, [*(2.0 * a + b)], [*a.cross(b)]
        (2.0, [2.0, 5.0, 6.0], [-3.0, 0.0, 1.0])
    """

    x: Component
    y: Component
    z: Component

    @classmethod
    def of(cls, components: Array) -> "Vector":
        """The vector whose components stand along axis 0 of an array."""
        return cls(components[0], components[1], components[2])

    def __add__(self, other: "Vector") -> "Vector":
        return Vector(plus(self.x, other.x), plus(self.y, other.y), plus(self.z, other.z))

    def __sub__(self, other: "Vector") -> "Vector":
        return Vector(minus(self.x, other.x), minus(self.y, other.y), minus(self.z, other.z))

    def __neg__(self) -> "Vector":
        return Vector(minus(0.0, self.x), minus(0.0, self.y), minus(0.0, self.z))

    def __mul__(self, factor: "Component | Vector") -> "Vector":
        fx, fy, fz = factor if isinstance(factor, Vector) else (factor,) * 3
        return Vector(times(fx, self.x), times(fy, self.y), times(fz, self.z))

    __rmul__ = __mul__

    def __truediv__(self, divisor: Component) -> "Vector":
        return (1.0 / divisor) * self

    def __matmul__(self, other: "Vector") -> Any:
        x, y, z = times(self.x, other.x), times(self.y, other.y), times(self.z, other.z)
        return plus(plus(x, y), z)

    def cross(self, other: "Vector") -> "Vector":
        """Vector product, right-handed."""
        return Vector(
            minus(times(self.y, other.z), times(self.z, other.y)),
            minus(times(self.z, other.x), times(self.x, other.z)),
            minus(times(self.x, other.y), times(self.y, other.x)),
        )

    def norm(self) -> Array:
        """Length, with derivative zero (not NaN) at the zero vector."""
        return safe_sqrt(self @ self)

    def full(self) -> "Vector":
        """The same with an array for every component, all of one shape."""
        return Vector(*jnp.broadcast_arrays(*(jnp.asarray(c, float) for c in self)))


ZERO = Vector(0.0, 0.0, 0.0)


@partial(jax.tree_util.register_dataclass, data_fields=["x", "y", "z"], meta_fields=[])
@dataclass(frozen=True, slots=True, eq=False)
class Matrix(_Three):
    """Three rows: `m @ a` of a vector, `m @ n` of a matrix, `m.T`; a rotation's inverse is `m.T`.

    Attributes:
        x: first row.
        y: second row.
        z: third row.

    Example:
        >>> import math
        >>> turn = Matrix.about_z(math.pi / 2.0)
        >>> [round(float(c), 9) for c in turn @ Vector(1.0, 0.0, 0.0)]
        [0.0, 1.0, 0.0]
    """

    x: Vector
    y: Vector
    z: Vector

    @overload
    def __matmul__(self, other: Vector) -> Vector: ...
    @overload
    def __matmul__(self, other: "Matrix") -> "Matrix": ...
    def __matmul__(self, other: "Vector | Matrix") -> "Vector | Matrix":
        if isinstance(other, Matrix):
            return Matrix(*(self @ column for column in other.T)).T
        return Vector(self.x @ other, self.y @ other, self.z @ other)

    def __sub__(self, other: "Matrix") -> "Matrix":
        return Matrix(self.x - other.x, self.y - other.y, self.z - other.z)

    @property
    def T(self) -> "Matrix":
        """The transpose."""
        return Matrix(*(Vector(*column) for column in zip(self.x, self.y, self.z, strict=True)))

    @classmethod
    def about_x(cls, angle: Array | float) -> "Matrix":
        """Rotation about X by an angle in rad."""
        c, s = jnp.cos(angle), jnp.sin(angle)
        return cls(Vector(1.0, 0.0, 0.0), Vector(0.0, c, -s), Vector(0.0, s, c))

    @classmethod
    def about_y(cls, angle: Array | float) -> "Matrix":
        """Rotation about Y by an angle in rad."""
        c, s = jnp.cos(angle), jnp.sin(angle)
        return cls(Vector(c, 0.0, s), Vector(0.0, 1.0, 0.0), Vector(-s, 0.0, c))

    @classmethod
    def about_z(cls, angle: Array | float) -> "Matrix":
        """Rotation about Z by an angle in rad."""
        c, s = jnp.cos(angle), jnp.sin(angle)
        return cls(Vector(c, -s, 0.0), Vector(s, c, 0.0), Vector(0.0, 0.0, 1.0))


AXES = Matrix(Vector(1.0, 0.0, 0.0), Vector(0.0, 1.0, 0.0), Vector(0.0, 0.0, 1.0))
