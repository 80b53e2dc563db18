"""What contact needs to know of an analytic articular surface.

A surface lives in its own frame, which is placed in a bone. It is given twice: as a map from two
parameters to a point (`point`), and as a level function that is zero on it, positive outside the
solid, with unit gradient on the surface (`level`). Contact reads the femoral side by its points
and the tibial side by its level, or the other way round; any pair of surfaces can meet.
"""

__all__ = [
    "Height", "Jet", "Surface", "area_element", "excess", "inside", "jet", "normal",
    "principal_curvatures",
]

import abc
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array, lax
from jax.typing import ArrayLike

from kneejax.geometry._pose import Frame
from kneejax.geometry._vectors import AXES, ZERO, Matrix, Vector
from kneejax.numerics import arctan2, safe_sqrt


class Jet(eqx.Module):
    """A surface's point and its partial derivatives with respect to the parameters.

    Each is given by its three coefficients along vectors that turn with the surface (for a
    condyle: the ray, its derivative in the angle, the axis), so that a rigid motion has to turn
    three vectors instead of six.

    Attributes:
        basis: the three vectors, in mm per unit of their coefficient.
        point: coefficients of the point; likewise the first derivatives `a` and `b` and the
            second derivatives `aa`, `ab` and `bb`.
        third: the third derivatives `aaa`, `aab`, `abb` and `bbb`, if they were asked for.
    """

    basis: Matrix
    point: Vector
    a: Vector
    b: Vector
    aa: Vector
    ab: Vector
    bb: Vector
    third: tuple[Vector, Vector, Vector, Vector] | None = None

    def vector(self, coefficients: Vector) -> Vector:
        """The vector with these coefficients."""
        x, y, z = (c * e for c, e in zip(coefficients, self.basis, strict=True))
        return x + y + z


class Height(eqx.Module):
    """A function that vanishes on a surface and grows outwards, with its derivatives in space.

    Attributes:
        value: in a unit of its own: only `value / |gradient|` is a distance.
        gradient: by x, y, z.
        hessian: rows by x, y, z; None where it vanishes.
        third: derivatives of the hessian along x, y, z, if they were asked for and do not vanish.
    """

    value: Array
    gradient: Vector
    hessian: Matrix | None
    third: tuple[Matrix, Matrix, Matrix] | None = None


class Surface(eqx.Module):
    """What contact needs to know of a surface."""

    @property
    @abc.abstractmethod
    def frame(self) -> Frame:
        """Placement of the surface in its bone: a field, `frame: Frame = framed()`."""

    @abc.abstractmethod
    def point(self, a: Array, b: Array) -> Vector:
        """Point at the parameters `(a, b)`, in mm, in the surface's frame."""

    @abc.abstractmethod
    def level(self, point: Vector) -> Array:
        """Signed distance to first order, mm: zero on the surface, positive outside the solid."""

    def contains(self, point: Vector) -> Array:
        """Whether a point lies in the solid, wherever it is."""
        return self.level(point) < 0.0

    @abc.abstractmethod
    def start(self, direction: Vector) -> tuple[Array, Array]:
        """Parameters near the point whose outward normal is `direction`: a first guess."""

    @abc.abstractmethod
    def bounds(self) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """Lower and upper limits of both parameters: the region in which the surface is known."""

    def jet(self, a: Array, b: Array, order: int = 2) -> Jet:
        """Point and partial derivatives at the parameters `(a, b)`, up to the second or third."""
        d = _partials(self.point, a, b, order)
        third = (d[3, 0], d[2, 1], d[1, 2], d[0, 3]) if order == 3 else None
        return Jet(AXES, d[0, 0], d[1, 0], d[0, 1], d[2, 0], d[1, 1], d[0, 2], third)

    def height(self, point: Vector, order: int = 2) -> Height:
        """The level, or a function with the same zeros that is cheaper, with its derivatives."""
        point = point.full()
        value, gradient = self.level(point), _gradient(self.level)
        hessian = _rows(gradient)
        third = _rows(hessian)(point) if order == 3 else None
        return Height(value, gradient(point), hessian(point), third)

    def oriented(self, a: Array, b: Array) -> tuple[Vector, Vector, Array]:
        """Point, outward unit normal, and area that a unit square of the parameters covers."""
        return self.point(a, b), normal(self, a, b), area_element(self, a, b)

    def level_and_slope(self, point: Vector) -> tuple[Array, Vector]:
        """The level, or a function with the same zeros that is cheaper, and its gradient."""
        point = point.full()
        return self.level(point), _gradient(self.level)(point)

    def level_slope_and_bend(self, point: Vector) -> tuple[Array, Vector, Matrix]:
        """As `level_and_slope`, with the rows of its second derivative in space."""
        point = point.full()
        return *self.level_and_slope(point), _rows(lambda p: self.level_and_slope(p)[1])(point)

    def outwards(self, point: Vector) -> Vector:
        """Direction that leads away from the solid at a point; need not have unit length."""
        return _gradient(self.level)(point.full())

    def covered(self, a: Array, b: Array, spacing: tuple[Array, Array]) -> Array | float:
        """Share of small rectangles of parameters around `(a, b)` that carries cartilage, 0 to 1.

        Args:
            a: first parameter of their centres.
            b: second parameter.
            spacing: their sizes along both parameters.
        """
        return 1.0

    def core(self) -> Vector:
        """A point well inside the solid, which no other surface reaches in a sane pose, mm."""
        return ZERO

    def beyond(self, point: Vector) -> Array:
        """How far a point on (or near) the surface lies beyond the region in which it is known,
        mm; zero inside."""
        return jnp.zeros(())


def jet(surface: Surface, a: ArrayLike, b: ArrayLike) -> Jet:
    """Point and partial derivatives of a surface.

    Args:
        surface: any surface.
        a: first parameter, any shape.
        b: second parameter, same shape.

    Returns:
        The jet, each vector with components of that shape.

    Example:
        >>> from kneejax.geometry import Plane
        >>> found = jet(Plane(), 3.0, 4.0)
        >>> [float(x) for x in found.point]
        [3.0, 0.0, 4.0]
    """
    return surface.jet(*jnp.broadcast_arrays(jnp.asarray(a, float), jnp.asarray(b, float)))


def normal(surface: Surface, a: ArrayLike, b: ArrayLike) -> Vector:
    """Outward unit normal at the parameters `(a, b)`, in the surface's frame.

    Example:
        >>> from kneejax.geometry import Plane
        >>> [float(x) for x in normal(Plane(), 3.0, 4.0)]
        [-0.0, 1.0, -0.0]
    """
    return _normal(surface, jet(surface, a, b))


def _normal(surface: Surface, local: Jet) -> Vector:
    raw = local.vector(local.a).cross(local.vector(local.b))
    unit = raw / raw.norm()
    # A parametrisation may be right-handed outwards or inwards: ask the level function.
    probe = surface.level(local.vector(local.point) + 1e-3 * unit)
    return lax.stop_gradient(jnp.sign(probe)) * unit


def area_element(surface: Surface, a: ArrayLike, b: ArrayLike) -> Array:
    """Area covered by a unit square of the parameters, mm^2 per unit.

    Example:
        >>> from kneejax.geometry import Plane
        >>> float(area_element(Plane(), 3.0, 4.0))
        1.0
    """
    local = jet(surface, a, b)
    return local.vector(local.a).cross(local.vector(local.b)).norm()


def principal_curvatures(surface: Surface, a: ArrayLike, b: ArrayLike) -> tuple[Array, Array]:
    """Principal curvatures, the larger first, positive where the solid is convex.

    Args:
        surface: any surface.
        a: first parameter.
        b: second parameter.

    Returns:
        Two curvatures in 1/mm.

    Example:
        >>> from kneejax.geometry import Sphere
        >>> k1, k2 = principal_curvatures(Sphere(radius=25.0), 1.5, 0.1)
        >>> round(float(k1), 9), round(float(k2), 9)
        (0.04, 0.04)
    """
    local = jet(surface, a, b)
    n = _normal(surface, local)
    along_a, along_b = local.vector(local.a), local.vector(local.b)
    e, f, g = along_a @ along_a, along_a @ along_b, along_b @ along_b
    ll, mm, nn = (-(local.vector(x) @ n) for x in (local.aa, local.ab, local.bb))
    area = e * g - f * f
    gauss = (ll * nn - mm * mm) / area
    mean = (e * nn - 2 * f * mm + g * ll) / (2 * area)
    spread = safe_sqrt(mean * mean - gauss)
    return mean + spread, mean - spread


def inside(surface: Surface, a: Array, b: Array, margin: float = 0.0) -> Array:
    """Whether parameters lie in the region where a surface is known.

    Args:
        surface: any surface.
        a: first parameter.
        b: second parameter.
        margin: fraction of the region's size by which the limits are drawn in.

    Example:
        >>> from kneejax.geometry import Plane
        >>> flat = Plane(half_extent=(10.0, 10.0))
        >>> [bool(inside(flat, jnp.array(x), jnp.array(0.0))) for x in (9.0, 11.0)]
        [True, False]
    """
    answer = jnp.asarray(True)
    for value, (lower, upper) in zip((a, b), surface.bounds(), strict=True):
        inset = margin * (upper - lower)
        answer = answer & (value > lower + inset) & (value < upper - inset)
    return answer


def from_anterior(x: Array, y: Array) -> Array:
    """Angle from anterior through distal, in -90 to 270 degrees: the jump is proximal."""
    return 0.5 * jnp.pi - arctan2(x, -y)


def excess(value: Array, limits: Array | tuple[Array, Array]) -> Array:
    """By how much a coordinate lies beyond its limits, either way.

    Example:
        >>> limits = jnp.array([0.0, 20.0])
        >>> float(excess(jnp.array(23.0), limits)), float(excess(jnp.array(5.0), limits))
        (3.0, 0.0)
    """
    return jnp.maximum(jnp.maximum(limits[0] - value, value - limits[1]), 0.0)


def continued(value: Array, limits: Array, reach: float) -> tuple[Array, Array, Array]:
    """A coordinate that soon comes to rest beyond its limits, and its first two derivatives."""
    # A table of coefficients says nothing beyond its region. Held at the border it would have a
    # kink there, and a force that jumps; so it goes on for a little, at most for `reach`, and then
    # becomes constant, twice continuously differentiable.
    nearest = jnp.clip(value, limits[0], limits[1])
    beyond = (value - nearest) / reach
    slower = 1.0 / (1.0 + beyond * beyond)
    root = jnp.sqrt(slower)
    slope = slower * root
    return nearest + reach * beyond * root, slope, -3.0 * beyond * slope * slower / reach


def _partials(point: Callable[[Array, Array], Vector], a: Array, b: Array, order: int) -> dict:
    """Partial derivatives of a point, taken `i` times by `a` and `j` times by `b`, at `(i, j)`."""
    one = jnp.ones_like(a)
    by_b: list[Callable] = [point]
    for _ in range(order):
        by_b.append(lambda x, y, f=by_b[-1]: jax.jvp(lambda t: f(x, t), (y,), (one,))[1])
    answer = {}
    for j, function in enumerate(by_b):
        by_a = [function]
        for _ in range(order - j):
            by_a.append(lambda x, y, f=by_a[-1]: jax.jvp(lambda t: f(t, y), (x,), (one,))[1])
        answer |= {(i, j): f(a, b) for i, f in enumerate(by_a)}
    return answer


def _gradient(level: Callable[[Vector], Array]) -> Callable[[Vector], Vector]:
    return jax.grad(lambda point: jnp.sum(level(point)))


def _rows(function: Callable) -> Callable:
    """Derivatives of a function of a vector by its three components."""

    def rows(point: Vector):
        one, zero = jnp.ones_like(point[0]), jnp.zeros_like(point[0])
        units = Vector(one, zero, zero), Vector(zero, one, zero), Vector(zero, zero, one)
        return Matrix(*(jax.jvp(function, (point,), (unit,))[1] for unit in units))

    return rows
