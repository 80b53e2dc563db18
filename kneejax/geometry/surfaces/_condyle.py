"""Femoral condyles: radius over angle and width about a transverse axis; several side by side."""

from __future__ import annotations

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
from jax import Array

from kneejax.geometry._pose import Frame, framed, numbers
from kneejax.geometry._vectors import AXES, Component, Matrix, Vector, minus, times
from kneejax.geometry.surfaces._bases import (
    CUBIC_SPLINE,
    POWER,
    SplineTables,
    checked_basis,
    table_partials,
)
from kneejax.geometry.surfaces._surface import Jet, Surface, continued, excess, from_anterior
from kneejax.numerics import safe_sqrt

# How far a radius is continued beyond the region before it stays as it is, mm, by basis. The outer
# cells of a spline may be as steep as 15 mm a mm: far continued they would be bars of bone.
_REACH_MM = {POWER: 2.0, CUBIC_SPLINE: 0.5}
# The same along the angle, by the radius of a knee, mm.
_USUAL_RADIUS = 25.0
# Over how much width, mm, a spline's border turns into its fall of 45 degrees.
_TURNS_MM = 1.0


class Condyle(Surface):
    """Radius over angle and width about a transverse axis (the frame's Z).

    The angle runs from anterior (0) through distal (90 degrees) to posterior (180 degrees).

    Attributes:
        coefficients: mm. Basis `power`: shape `(m + 1, n + 1, ...)`, powers of the angle and of
            the width, both scaled to -1..1 over the region. Basis `cubic_spline`: shape
            `(m + 3, n + 3, ...)`, control values of `m x n` equal cells over the region.
        angle: lower and upper end of the region, rad, shape `(2, ...)`.
        width: lower and upper end of the region along the axis, mm, shape `(2, ...)`.
        frame: placement in the femur.
        basis: `power` or `cubic_spline`.

    Source: paper 3, section 2 (fourth-order polynomials in cylindrical coordinates).

    Example:
        >>> from kneejax.geometry import area_element
        >>> round_one = Condyle([[20.0]], angle=(0.0, 3.0), width=(-10.0, 10.0))
        >>> round(float(area_element(round_one, 1.5, 0.0)), 6)
        20.0
    """

    coefficients: Array = numbers()
    angle: Array = numbers()
    width: Array = numbers()
    frame: Frame = framed()
    basis: str = eqx.field(static=True, default=POWER)

    def __check_init__(self):
        checked_basis(self.basis, self.coefficients.shape, "Condyle")

    def radius(self, angle: Array, width: Array) -> Array:
        """Distance of the surface from the axis, mm."""
        return jnp.asarray(self._table(angle, width, 0)[0][0])

    def point(self, a: Array, b: Array) -> Vector:
        radius = self.radius(a, b)
        return Vector(radius * jnp.cos(a), -radius * jnp.sin(a), b)

    def jet(self, a: Array, b: Array, order: int = 2) -> Jet:
        d = self._table(a, b, order)
        c, s = jnp.cos(a), -jnp.sin(a)
        (radius, r_b, r_bb, *_), (r_a, r_ab, *_), (r_aa, *_) = d[:3]
        return Jet(
            basis=Matrix(Vector(c, s, 0.0), Vector(s, -c, 0.0), AXES.z),
            point=Vector(radius, 0.0, b),
            a=Vector(r_a, radius, 0.0),
            b=Vector(r_b, 0.0, 1.0),
            aa=Vector(minus(r_aa, radius), times(2.0, r_a), 0.0),
            ab=Vector(r_ab, r_b, 0.0),
            bb=Vector(r_bb, 0.0, 0.0),
            third=None if order < 3 else (
                Vector(minus(d[3][0], times(3.0, r_a)), minus(times(3.0, r_aa), radius), 0.0),
                Vector(minus(d[2][1], r_b), times(2.0, r_ab), 0.0),
                Vector(d[1][2], r_bb, 0.0),
                Vector(d[0][3], 0.0, 0.0),
            ),
        )

    def level(self, point: Vector) -> Array:
        x, y, z = point
        distance = safe_sqrt(x * x + y * y)
        radius, by_angle, by_width = self._beyond(from_anterior(x, y), z, 1)[0]
        steep = (by_angle / jnp.where(radius > 1.0, radius, 1.0)) ** 2 + by_width**2
        return (distance - radius) / jnp.sqrt(1.0 + steep)

    def level_and_slope(self, point: Vector) -> tuple[Array, Vector]:
        level, slope, *_ = self._from_axis(point, 1)
        return level, slope

    def level_slope_and_bend(self, point: Vector) -> tuple[Array, Vector, Matrix]:
        level, slope, (c, s), per_distance, (by_aa, by_ab, by_bb) = self._from_axis(point, 2)
        # In directions outwards (c, s), around the axis (s, -c) and along it.
        around = (1.0 - by_aa * per_distance) * per_distance
        outwards_around = (c * slope[1] - s * slope[0]) * per_distance
        around_along = -by_ab * per_distance
        xx = s * s * around + 2.0 * c * s * outwards_around
        yy = c * c * around - 2.0 * c * s * outwards_around
        xy = (s * s - c * c) * outwards_around - c * s * around
        xz, yz = s * around_along, -c * around_along
        bend = Matrix(Vector(xx, xy, xz), Vector(xy, yy, yz), Vector(xz, yz, -by_bb))
        return level, slope, bend

    def _from_axis(
        self, point: Vector, order: int
    ) -> tuple[Array, Vector, tuple[Array, Array], Array, tuple[Array, ...]]:
        """Distance from the axis less the radius, its slope, the direction of the ray, one over
        the distance, and the second derivatives of the radius (mm, rad) if they were asked for."""
        x, y, z = point
        distance = safe_sqrt(x * x + y * y)
        radii, second = self._beyond(from_anterior(x, y), z, order)
        radius, by_angle, by_width = radii
        per_distance = 1.0 / jnp.where(distance > 0, distance, 1.0)
        c, s, turn = x * per_distance, y * per_distance, by_angle * per_distance
        slope = Vector(c - turn * s, s + turn * c, -by_width)
        return distance - radius, slope, (c, s), per_distance, second

    def _table(self, angle: Array, width: Array, order: int) -> tuple[tuple[Component, ...], ...]:
        region = self.angle, self.width
        return table_partials(self.basis, self.coefficients, (angle, width), region, order)

    def _beyond(
        self, angle: Array, width: Array, order: int
    ) -> tuple[tuple[Array, Array, Array], tuple[Array, ...]]:
        """Radius and its slopes anywhere, in mm and rad; and its second derivatives by angle, by
        both, by width, if the order is 2."""
        reach = _REACH_MM[self.basis]
        s, s_slope, s_bend = continued(angle, self.angle, reach / _USUAL_RADIUS)
        t, t_slope, t_bend = continued(width, self.width, reach)
        d = self._table(s, t, order)
        radius, by_angle, by_width = d[0][0], d[1][0] * s_slope, d[0][1] * t_slope
        falls = self.basis == CUBIC_SPLINE
        if falls:
            # A spline reaches to the cartilage's borders, where it falls off towards the notch and
            # the epicondyle: an edge value held would be a bar of bone across the notch.
            away = width - jnp.clip(width, self.width[0], self.width[1])
            fall, fall_slope, fall_bend = _fall(away)
            radius, by_width = radius - fall, by_width - fall_slope
        if order == 1:
            return (radius, by_angle, by_width), ()
        by_aa = d[2][0] * s_slope * s_slope + d[1][0] * s_bend
        by_bb = d[0][2] * t_slope * t_slope + d[0][1] * t_bend
        if falls:
            by_bb = by_bb - fall_bend
        return (radius, by_angle, by_width), (by_aa, d[1][1] * s_slope * t_slope, by_bb)

    def core(self) -> Vector:
        return Vector(0.0, 0.0, 0.5 * (self.width[0] + self.width[1]))

    def beyond(self, point: Vector) -> Array:
        x, y, z = point
        around = excess(from_anterior(x, y), self.angle) * safe_sqrt(x * x + y * y)
        return safe_sqrt(around**2 + excess(z, self.width) ** 2)

    def start(self, direction: Vector) -> tuple[Array, Array]:
        angle = jnp.clip(from_anterior(direction[0], direction[1]), self.angle[0], self.angle[1])
        middle = 0.5 * (self.width[0] + self.width[1])
        return angle, middle + jnp.zeros_like(angle)

    def bounds(self) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        return (self.angle[0], self.angle[1]), (self.width[0], self.width[1])


def _fall(away: Array) -> tuple[Array, Array, Array]:
    """How far a radius falls off beyond the width, mm, and its first two derivatives: none of
    them jumps at the border, and further out it is 45 degrees."""
    square, turns = away * away, _TURNS_MM**2
    whole = 1.0 / (square + turns)
    part = square * whole
    fall = jnp.abs(away) * part
    slope = jnp.sign(away) * part * (part + 3.0 * turns * whole)
    bend = 2.0 * turns * jnp.abs(away) * (3.0 * turns - square) * whole**3
    return fall, slope, bend


class Condyles(eqx.Module):
    """Condyles given by splines, which points of all of them are asked of at once.

    Attributes:
        tables: control values of all.
        angle: as in `Condyle`, `(2, condyles, ...)`.
        width: likewise.
    """

    tables: SplineTables
    angle: Array
    width: Array

    @staticmethod
    def can_hold(surface: Surface) -> bool:
        """Whether a surface can stand among others here.

        A spline reads a few values of a table wherever that begins; powers would need all of
        their coefficients at every point.
        """
        return isinstance(surface, Condyle) and surface.basis == CUBIC_SPLINE

    @classmethod
    def of(cls, condyles: Sequence[Condyle]) -> Condyles:
        """Condyles in a row; their numbers have the same axes, and their frames are left out."""

        def beside(limits: list[Array]) -> Array:
            return jnp.stack(jnp.broadcast_arrays(*limits), axis=1)

        tables = SplineTables.of([one.coefficients for one in condyles])
        return cls(tables, beside([x.angle for x in condyles]), beside([x.width for x in condyles]))

    def at(self, which: Array) -> Condyle:
        """One condyle, in its own frame, whose numbers are those of each point's own.

        Args:
            which: number of each point's condyle, `(points, ...)`, one for all poses.
        """
        own, every = jnp.ravel(which), self.tables
        numbers = (x[own] for x in (every.begins, every.rows, every.columns))
        # Not gathered: see `_by_all` of splines.
        limits = (
            sum(
                jnp.where((own == k).reshape(-1, *(1,) * (x.ndim - 2)), x[:, k, None], 0.0)
                for k in range(x.shape[1])
            )
            for x in (self.angle, self.width)
        )
        empty = Condyle(jnp.zeros((4, 4)), *limits, basis=CUBIC_SPLINE)
        tables = SplineTables(every.values, *numbers)
        return eqx.tree_at(lambda one: one.coefficients, empty, tables)
