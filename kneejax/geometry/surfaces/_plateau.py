"""A tibial plateau: height over a plane, within an outline."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jax import Array

from kneejax.geometry._pose import Frame, framed, numbers
from kneejax.geometry._vectors import AXES, ZERO, Component, Matrix, Vector, minus
from kneejax.geometry.surfaces._bases import CUBIC_SPLINE, POWER, checked_basis, table_partials
from kneejax.geometry.surfaces._surface import Height, Surface, continued, excess
from kneejax.numerics import safe_sqrt

#: A share that is but rounding: half a rectangle off, none of it counts, whatever the compiler.
_NOTHING = 1e-9


def covered(outline: Array, a: Array, b: Array, spacing: tuple[Array, Array]) -> Array:
    """Share of small rectangles that lies within a closed outline, to first order.

    A rectangle counts by the distance of its centre from the border, in units of its own size: 0.5
    on the border, 0 or 1 from half a rectangle on.

    Args:
        outline: corners in order, shape `(k, 2, ...)`; the last is joined to the first.
        a: centres, first parameter, shape `(n, ...)`.
        b: second parameter, same shape.
        spacing: sizes of the rectangles along both parameters.

    Returns:
        Shares, 0 to 1.

    Example:
        >>> square = jnp.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]])
        >>> a, b = jnp.array([2.0, 4.0, 3.75, 5.0]), jnp.array([2.0, 1.0, 1.0, 1.0])
        >>> covered(square, a, b, (1.0, 1.0)).tolist()
        [1.0, 0.5, 0.75, 0.0]
    """
    corner = jnp.expand_dims(outline, tuple(range(2, 2 + jnp.ndim(a) - (outline.ndim - 2))))
    (x0, z0), (x1, z1) = (
        (c[:, 0], c[:, 1]) for c in (corner, jnp.roll(corner, -1, axis=0))
    )
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


# How far heights are continued beyond the region before they stay as they are, mm, by basis.
_REACH_MM = {POWER: 2.0, CUBIC_SPLINE: 0.5}
# How deep under its middle the solid of a plateau is surely bone.
_DEEP_MM = 20.0


class Plateau(Surface):
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

    coefficients: Array = numbers()
    x: Array = numbers()
    z: Array = numbers()
    frame: Frame = framed()
    basis: str = eqx.field(static=True, default=POWER)
    outline: Array | None = numbers(default=None)

    def __check_init__(self):
        checked_basis(self.basis, self.coefficients.shape, "Plateau")

    def _table(self, x: Array, z: Array, order: int) -> tuple[tuple[Component, ...], ...]:
        return table_partials(self.basis, self.coefficients, (x, z), (self.x, self.z), order)

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
        if self.outline is None:
            return 1.0
        return covered(self.outline, a, b, spacing)

    def start(self, direction: Vector) -> tuple[Array, Array]:
        zero = jnp.zeros_like(direction[0])
        return 0.5 * (self.x[0] + self.x[1]) + zero, 0.5 * (self.z[0] + self.z[1]) + zero

    def bounds(self) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        return (self.x[0], self.x[1]), (self.z[0], self.z[1])
