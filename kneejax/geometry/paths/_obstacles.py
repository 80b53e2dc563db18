"""What fibres go around: spheres, cylinders and ellipsoids fixed to a bone."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from functools import partial

import equinox as eqx
import jax.numpy as jnp
from jax import Array

from kneejax.geometry._pose import Frame, framed, numbers
from kneejax.geometry._vectors import AXES, Vector
from kneejax.geometry.paths._ellipsoid import around_ellipsoid
from kneejax.geometry.paths._round import Wrapped, around_cylinder, around_sphere

#: Name of a side of a cylinder -> where it is in the cylinder's frame.
SIDES: dict[str, Vector] = {"+x": AXES.x, "-x": -AXES.x, "+y": AXES.y, "-y": -AXES.y}


class Obstacle(eqx.Module):
    """A convex body that fibres cannot pass through, fixed to a bone."""

    @property
    @abstractmethod
    def frame(self) -> Frame:
        """The obstacle's frame in the bone's: a field, `frame: Frame = framed()`."""

    @property
    @abstractmethod
    def semi_axes_along_frame(self) -> Vector:
        """Semi-axes along the frame's X, Y, Z, mm; infinite along a cylinder."""

    @property
    @abstractmethod
    def around(self) -> Callable[..., Wrapped]:
        """The function that winds a path around this kind."""

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

    @property
    def semi_axes_along_frame(self) -> Vector:
        """Three times the radius, mm."""
        return Vector(self.radius, self.radius, self.radius)

    @property
    def around(self) -> Callable[..., Wrapped]:
        return around_sphere


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

    @property
    def semi_axes_along_frame(self) -> Vector:
        """The semi-axes, mm."""
        return Vector.of(self.semi_axes)

    @property
    def around(self) -> Callable[..., Wrapped]:
        return around_ellipsoid
