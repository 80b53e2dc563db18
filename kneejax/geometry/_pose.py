"""The pose of a body in the femur, and rigid placements."""

__all__ = ["Frame", "Placement", "Pose", "angles_from_rotation", "numbers", "rotation_from_angles"]

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from kneejax.geometry._vectors import Matrix, Vector
from kneejax.numerics import numpy_for


class Placement(eqx.Module):
    """A rigid motion `x -> rotation x + translation`.

    Attributes:
        rotation: three rows of a rotation matrix; None where nothing turns.
        translation: image of the origin, mm.

    Example:
        >>> moved = Placement(None, Vector(1.0, 2.0, 3.0))
        >>> [float(x) for x in moved.apply(Vector(1.0, 1.0, 1.0))]
        [2.0, 3.0, 4.0]
    """

    rotation: Matrix | None
    translation: Vector

    def turn(self, direction: Vector) -> Vector:
        """Image of a direction."""
        direction = Vector(*direction)
        return direction if self.rotation is None else self.rotation @ direction

    def turn_back(self, direction: Vector) -> Vector:
        """The direction whose image is `direction`."""
        direction = Vector(*direction)
        return direction if self.rotation is None else self.rotation.T @ direction

    def apply(self, point: Vector) -> Vector:
        """Image of a point."""
        return self.turn(point) + self.translation

    def apply_inverse(self, point: Vector) -> Vector:
        """The point whose image is `point`."""
        return self.turn_back(Vector(*point) - self.translation)

    def inverse(self) -> "Placement":
        """The motion that undoes this one."""
        back = None if self.rotation is None else self.rotation.T
        return Placement(back, -self.turn_back(self.translation))

    def after(self, first: "Placement") -> "Placement":
        """This motion after `first`."""
        if self.rotation is None or first.rotation is None:
            rotation = self.rotation if first.rotation is None else first.rotation
        else:
            rotation = self.rotation @ first.rotation
        return Placement(rotation, self.apply(first.translation))


def numbers(**default: Any) -> Any:
    """A field of a module, of numbers, which it has as an array; None where that is its default."""
    optional = default.get("default", 0.0) is None
    return eqx.field(converter=lambda x: x if optional and x is None else _floats(x), **default)


class Frame(eqx.Module):
    """A frame fixed to a body: origin and, if it is turned, rotations about X, Y, Z in turn.

    Attributes:
        origin: shape `(3, ...)`, mm, in body axes.
        rotation: shape `(3, ...)`, rad; the frame is `Rx(r0) Ry(r1) Rz(r2)`. None leaves its axes
            along the body's, which also spares every pose the products.

    Example:
        >>> from kneejax.geometry import Vector
        >>> placed = Frame((0.0, 10.0, 0.0)).placement
        >>> [round(float(x), 6) for x in placed.apply(Vector(1.0, 0.0, 0.0))]
        [1.0, 10.0, 0.0]
    """

    origin: Array = numbers(default=(0.0, 0.0, 0.0))
    rotation: Array | None = numbers(default=None)

    @property
    def placement(self) -> Placement:
        """The motion from this frame's coordinates to the body's."""
        if self.rotation is None:
            return Placement(None, Vector.of(self.origin))
        rx, ry, rz = Vector.of(self.rotation)
        turned = Matrix.about_x(rx) @ (Matrix.about_y(ry) @ Matrix.about_z(rz))
        return Placement(turned, Vector.of(self.origin))


def framed() -> Any:
    """A field of a module: its frame in a bone, the bone's own by default."""
    return eqx.field(default=None, converter=lambda frame: Frame() if frame is None else frame)


class Pose(eqx.Module):
    """Pose of a body in the femur: `R = Rz(-flexion) Rx(adduction) Ry(internal_rotation)`.

    The body is the tibia where none is named. The translation is that of its origin, in femur axes:
    X anterior, Y superior, Z lateral on a right knee. Fields may be numbers or arrays of one shape
    (a batch of poses).

    Attributes:
        flexion: rad, positive in flexion.
        adduction: rad, positive in varus.
        internal_rotation: rad, positive when the tibia turns inwards.
        anterior: mm.
        superior: mm.
        lateral: mm.

    Example:
        >>> pose = Pose.from_table([[30.0, 0.0, 5.0, 1.0, 0.0, 0.0]])
        >>> pose.to_table().round(6).tolist()
        [[30.0, 0.0, 5.0, 1.0, 0.0, 0.0]]
    """

    flexion: Array
    adduction: Array
    internal_rotation: Array
    anterior: Array
    superior: Array
    lateral: Array

    @classmethod
    def from_table(cls, table: ArrayLike) -> "Pose":
        """Make poses from rows of degrees and mm.

        Args:
            table: shape `(..., 6)` in the order of `COLUMNS`.

        Returns:
            A pose whose fields have shape `(...)`.
        """
        xp = numpy_for(table)
        columns = xp.moveaxis(xp.asarray(table, float), -1, 0)
        return cls(*map(_floats, (*xp.deg2rad(columns[:3]), *columns[3:])))

    def to_table(self) -> Array:
        """Rows of degrees and mm, shape `(..., 6)`, in the order of `COLUMNS`."""
        xp = numpy_for(self)
        angles = xp.stack([self.flexion, self.adduction, self.internal_rotation], -1)
        shifts = xp.stack([self.anterior, self.superior, self.lateral], -1)
        return _floats(xp.concatenate([xp.rad2deg(angles), shifts], -1))

    @property
    def drawer(self) -> Array:
        """Translation forwards in axes turned by flexion, mm: anterior of Grood and Suntay."""
        return jnp.cos(self.flexion) * self.anterior - jnp.sin(self.flexion) * self.superior

    @property
    def lift(self) -> Array:
        """Translation upwards in axes turned by flexion, mm."""
        return jnp.sin(self.flexion) * self.anterior + jnp.cos(self.flexion) * self.superior

    @property
    def placement(self) -> Placement:
        """The motion from the body's to femur coordinates."""
        return Placement(
            rotation_from_angles(self.flexion, self.adduction, self.internal_rotation),
            Vector(self.anterior, self.superior, self.lateral),
        )


def _floats(x: ArrayLike) -> Array:
    # Of a stated type, since without one JAX compiles a program for every shape.
    return jnp.asarray(numpy_for(x).asarray(x, float), float)


def rotation_from_angles(flexion: Array, adduction: Array, internal_rotation: Array) -> Matrix:
    """`Rz(-flexion) Rx(adduction) Ry(internal_rotation)`, written out.

    Args:
        flexion: rad.
        adduction: rad.
        internal_rotation: rad.

    Returns:
        Rows of the rotation from tibia to femur axes.

    Example:
        >>> rows = rotation_from_angles(jnp.deg2rad(90.0), jnp.array(0.0), jnp.array(0.0))
        >>> [[round(float(x)) for x in row] for row in rows]
        [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]
    """
    cf, sf = jnp.cos(flexion), jnp.sin(flexion)
    ca, sa = jnp.cos(adduction), jnp.sin(adduction)
    ci, si = jnp.cos(internal_rotation), jnp.sin(internal_rotation)
    return Matrix(
        Vector(cf * ci + sf * sa * si, sf * ca, cf * si - sf * sa * ci),
        Vector(cf * sa * si - sf * ci, cf * ca, -sf * si - cf * sa * ci),
        Vector(-ca * si, sa, ca * ci),
    )


def angles_from_rotation(rotation: Matrix) -> tuple[Array, Array, Array]:
    """Flexion, adduction and internal rotation (rad) of a rotation, exact at extension.

    `arctan2` of two entries each: no arccosine whose derivative fails at zero. Singular only at
    90 degrees of adduction, where flexion and rotation share an axis.

    Args:
        rotation: rows of a rotation matrix.

    Returns:
        Flexion, adduction, internal rotation.

    Example:
        >>> rows = rotation_from_angles(*jnp.deg2rad(jnp.array([60.0, 3.0, -5.0])))
        >>> [round(float(x), 6) for x in jnp.rad2deg(jnp.array(angles_from_rotation(rows)))]
        [60.0, 3.0, -5.0]
    """
    (_, r01, _), (_, r11, _), (r20, r21, r22) = rotation
    cosine = jnp.sqrt(r20 * r20 + r22 * r22)
    return jnp.arctan2(r01, r11), jnp.arctan2(r21, cosine), jnp.arctan2(-r20, r22)
