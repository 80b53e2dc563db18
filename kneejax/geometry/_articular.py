"""Articular surfaces, each a table of values over a rectangle of two variables: femoral condyles,
one or several side by side, and tibial plateaus."""

__all__ = ["Condyle", "Condyles", "Plateau"]

from abc import abstractmethod
from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
from jax import Array

from kneejax.geometry._bases import BASES, CUBIC_SPLINE, POWER, SplineTables, table_partials
from kneejax.geometry._pose import Frame, framed, numbers
from kneejax.geometry._surface import Height, Jet, Surface, continued, excess, from_anterior
from kneejax.geometry._vectors import AXES, ZERO, Component, Matrix, Vector, minus, times
from kneejax.numerics import safe_sqrt

# How far values are continued beyond the region before they stay as they are, mm, by basis. The
# outer cells of a spline may be as steep as 15 mm a mm: far continued they would be bars of bone.
_REACH_MM = {POWER: 2.0, CUBIC_SPLINE: 0.5}
# The same along the angle of a condyle, by the radius of a knee, mm.
_USUAL_RADIUS = 25.0
# Over how much width, mm, a spline's border turns into its fall of 45 degrees.
_TURNS_MM = 1.0
# How deep under its middle the solid of a plateau is surely bone.
_DEEP_MM = 20.0
# A share that is but rounding: half a rectangle off, none of it counts, whatever the compiler.
_NOTHING = 1e-9


class _Tabulated(Surface):
    """A table of values over a region of two variables; the table's rows follow the first."""

    coefficients: Array = numbers()

    @property
    @abstractmethod
    def basis(self) -> str:
        """One of `BASES`: a field."""

    @property
    @abstractmethod
    def region(self) -> tuple[Array, Array]:
        """Lower and upper end of both variables, each `(2, ...)`."""

    def __check_init__(self):
        what, shape = type(self).__name__, self.coefficients.shape
        if self.basis not in BASES:
            raise ValueError(f"{what}.basis is {self.basis!r}; expected one of {BASES}")
        if self.basis == CUBIC_SPLINE and min(shape[:2]) < 4:
            raise ValueError(
                f"{what}: a cubic spline has at least 4 x 4 control values, not {shape}"
            )

    def _table(self, a: Array, b: Array, order: int) -> tuple[tuple[Component, ...], ...]:
        return table_partials(self.basis, self.coefficients, (a, b), self.region, order)

    def bounds(self) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        first, second = self.region
        return (first[0], first[1]), (second[0], second[1])


class Condyle(_Tabulated):
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

    angle: Array = numbers()
    width: Array = numbers()
    frame: Frame = framed()
    basis: str = eqx.field(static=True, default=POWER)

    @property
    def region(self) -> tuple[Array, Array]:
        return self.angle, self.width

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
        radius, by_angle, by_width = self._beyond(from_anterior(x, y), z, 1)
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
    ) -> tuple[Array, Vector, tuple[Array, Array], Array, list[Array]]:
        """Distance from the axis less the radius, its slope, the direction of the ray, one over
        the distance, and the second derivatives of the radius (mm, rad) if they were asked for."""
        x, y, z = point
        distance = safe_sqrt(x * x + y * y)
        radius, by_angle, by_width, *second = self._beyond(from_anterior(x, y), z, order)
        per_distance = 1.0 / jnp.where(distance > 0, distance, 1.0)
        c, s, turn = x * per_distance, y * per_distance, by_angle * per_distance
        slope = Vector(c - turn * s, s + turn * c, -by_width)
        return distance - radius, slope, (c, s), per_distance, second

    def _beyond(self, angle: Array, width: Array, order: int) -> tuple[Array, ...]:
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
            return radius, by_angle, by_width
        by_aa = d[2][0] * s_slope * s_slope + d[1][0] * s_bend
        by_bb = d[0][2] * t_slope * t_slope + d[0][1] * t_bend
        if falls:
            by_bb = by_bb - fall_bend
        return radius, by_angle, by_width, by_aa, d[1][1] * s_slope * t_slope, by_bb

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
    def of(cls, condyles: Sequence[Condyle]) -> "Condyles":
        """Condyles in a row; their numbers have the same axes, and their frames are left out."""

        regions = zip(*(one.region for one in condyles), strict=True)
        beside = (jnp.stack(jnp.broadcast_arrays(*limits), axis=1) for limits in regions)
        return cls(SplineTables.of([one.coefficients for one in condyles]), *beside)

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


class Plateau(_Tabulated):
    """Height over a plane: `y = eta(x, z)`; the solid lies below.

    Attributes:
        coefficients: mm. Basis `power`: shape `(m + 1, n + 1, ...)`, powers of x and z, both
            scaled to -1..1 over the region. Basis `cubic_spline`: shape `(m + 3, n + 3, ...)`,
            control values of `m x n` equal cells over the region.
        x: lower and upper end of the region, mm, shape `(2, ...)`.
        z: likewise.
        frame: placement in the tibia.
        basis: `power` or `cubic_spline`.
        outline: border of the cartilage, corners `(x, z)` in order, shape `(k, 2, ...)`, mm; None
            where the whole region is covered.

    Example:
        >>> from kneejax.geometry import normal
        >>> flat = Plateau([[2.0]], x=(-20.0, 20.0), z=(-15.0, 15.0))
        >>> [float(x) for x in normal(flat, 5.0, 5.0)]
        [-0.0, 1.0, -0.0]
    """

    x: Array = numbers()
    z: Array = numbers()
    frame: Frame = framed()
    basis: str = eqx.field(static=True, default=POWER)
    outline: Array | None = numbers(default=None)

    @property
    def region(self) -> tuple[Array, Array]:
        return self.x, self.z

    def point(self, a: Array, b: Array) -> Vector:
        return Vector(a, self._table(a, b, 0)[0][0], b)

    def oriented(self, a: Array, b: Array) -> tuple[Vector, Vector, Array]:
        (height, along_z), (along_x,) = self._table(a, b, 1)
        area = jnp.sqrt(1.0 + along_x**2 + along_z**2)
        upwards = Vector(-along_x / area, 1.0 / area, -along_z / area)
        return Vector(a, height, b), upwards, area

    def height(self, point: Vector, order: int = 2) -> Height:
        x, y, z = point
        d = self._table(x, z, order)

        def lower(i: int, j: int) -> Component:
            return minus(0.0, d[i][j])

        def bent(i: int, j: int) -> Matrix:
            xx, xz, zz = lower(i + 2, j), lower(i + 1, j + 1), lower(i, j + 2)
            return Matrix(Vector(xx, 0.0, xz), ZERO, Vector(xz, 0.0, zz))

        flat = Matrix(ZERO, ZERO, ZERO)
        return Height(
            value=y - d[0][0],
            gradient=Vector(lower(1, 0), 1.0, lower(0, 1)),
            hessian=bent(0, 0),
            third=None if order < 3 else (bent(1, 0), flat, bent(0, 1)),
        )

    def level(self, point: Vector) -> Array:
        x, y, z = point
        x, by_x, _ = continued(x, self.x, _REACH_MM[self.basis])
        z, by_z, _ = continued(z, self.z, _REACH_MM[self.basis])
        (height, slope_z), (slope_x,) = self._table(x, z, 1)
        steep = (slope_x * by_x) ** 2 + (slope_z * by_z) ** 2
        return (y - height) / jnp.sqrt(1.0 + steep)

    def contains(self, point: Vector) -> Array:
        x, z = jnp.clip(point[0], *self.x), jnp.clip(point[2], *self.z)
        return point[1] < self._table(x, z, 0)[0][0]

    def outwards(self, point: Vector) -> Vector:
        return AXES.y

    def core(self) -> Vector:
        middle = 0.5 * (self.x[0] + self.x[1]), 0.5 * (self.z[0] + self.z[1])
        x, y, z = self.point(*middle)
        return Vector(x, y - _DEEP_MM, z)

    def beyond(self, point: Vector) -> Array:
        return safe_sqrt(excess(point[0], self.x) ** 2 + excess(point[2], self.z) ** 2)

    def covered(self, a: Array, b: Array, spacing: tuple[Array, Array]) -> Array | float:
        """As of any surface, to first order: a rectangle counts by the distance of its centre from
        the outline, in units of its own size: 0.5 on it, 0 or 1 from half a rectangle on."""
        if self.outline is None:
            return 1.0
        corner = jnp.expand_dims(
            self.outline, tuple(range(2, 2 + jnp.ndim(a) - (self.outline.ndim - 2)))
        )
        (x0, z0), (x1, z1) = ((c[:, 0], c[:, 1]) for c in (corner, jnp.roll(corner, -1, axis=0)))
        dx, dz = x1 - x0, z1 - z0
        length = dx * dx + dz * dz
        along = jnp.clip(
            ((a - x0) * dx + (b - z0) * dz) / jnp.where(length > 0, length, 1.0), 0.0, 1.0
        )
        away_a, away_b = (x0 + along * dx - a) / spacing[0], (z0 + along * dz - b) / spacing[1]
        nearest = safe_sqrt(jnp.min(away_a * away_a + away_b * away_b, axis=0))
        # A ray along the first parameter leaves the outline an odd number of times from inside.
        spans = (z0 > b) != (z1 > b)
        crosses = spans & (a < x0 + (b - z0) * dx / jnp.where(spans, dz, 1.0))
        inside = jnp.sum(crosses, axis=0) % 2 == 1
        share = jnp.clip(0.5 + jnp.where(inside, nearest, -nearest), 0.0, 1.0)
        return jnp.where(share > _NOTHING, share, 0.0)

    def start(self, direction: Vector) -> tuple[Array, Array]:
        zero = jnp.zeros_like(direction[0])
        return 0.5 * (self.x[0] + self.x[1]) + zero, 0.5 * (self.z[0] + self.z[1]) + zero
