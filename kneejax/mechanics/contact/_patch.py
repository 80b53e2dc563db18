"""Where two smooth surfaces meet: the point, the depth and the size of the elliptical patch.

The gap is the height of a point of the femoral surface over the tibial one. It is smallest where
both surfaces share a normal (paper 3, Eqs 1 and 2), and near there it is a paraboloid whose
curvature is the relative curvature of the two; the patch is where it is negative. Only the
product of the two relative radii enters force and energy, so the determinant of the gap's second
derivative in the metric of the surface is all that is needed: nothing divides by the difference
of two curvatures, which vanishes for a sphere on a plane.
"""

__all__ = ["Gap"]

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array, lax

from kneejax.geometry import ZERO, Height, Jet, Matrix, Placement, Surface, Vector
from kneejax.numerics import jvp_of_moved, ruled, safe_sqrt

# Steps of a search at most; the length of the last, mm, when it has found the point, and when it
# has all but found it.
_SEARCH_STEPS, _FOUND, _NEARLY_FOUND = 12, 1e-9, 3e-4
# Part of the step before that a step near the point is at most: with a half some poses of knees
# with a lax MCL are lost, with a tenth others (docs/performance.md).
_CONVERGES = 0.25
# A search step, mm; the least relative curvature, 1/mm, that it believes, and what it reckons with
# where there is less or none.
_LONGEST_STEP, _FLATTEST, _LEAST_CURVATURE = 6.0, 1e-5, 0.003
# Parameters may leave the surface's region by this part of its size before they are held.
_OVERSHOOT = 0.15
# Product of the relative curvatures, 1/mm^2, below which it is raised smoothly: mean radii of 141
# mm are the largest that enter as they are, and 200 mm the largest of all.
_NEARLY_FLAT = 5e-5
_NOTHING = Matrix(ZERO, ZERO, ZERO)


class Gap(eqx.Module):
    """The gap at a point of the femoral surface, and its derivatives in that point's parameters.

    Attributes:
        value: height over the tibial surface, in the unit of `Height`.
        slope: first derivatives with respect to the two parameters.
        aa: second derivative; likewise `ab`, `bb`.
        steepness: squared gradient of the height in space.
        mixed: scalar product of the point's derivatives with respect to the two parameters, mm^2.
        metric: square of the area that a unit square of parameters covers, mm^4.
        stretch: mm covered by a unit of each parameter.
        point: in the tibial surface's frame, mm.
        along: derivatives of the point with respect to the two parameters, mm.
    """

    value: Array
    slope: tuple[Array, Array]
    aa: Array
    ab: Array
    bb: Array
    steepness: Array
    mixed: Array
    metric: Array
    stretch: tuple[Array, Array]
    point: Vector
    along: tuple[Vector, Vector]

    @property
    def determinant(self) -> Array:
        """Of the second derivatives."""
        return self.aa * self.bb - self.ab * self.ab

    @property
    def convex(self) -> Array:
        """Whether the gap has a smallest value near here."""
        return (self.determinant > 0) & (self.aa > 0)

    @property
    def curvature(self) -> Array:
        """Product of the relative curvatures, 1/mm^2; not positive where no ellipse fits."""
        return self.determinant / (self.metric * self.steepness)

    @property
    def depth(self) -> Array:
        """Overlap, mm; negative when apart."""
        return -self.value / jnp.sqrt(self.steepness)

    @property
    def has_ellipse(self) -> Array:
        """Whether the closed form holds: the gap is convex, with a mean radius below 141 mm."""
        return self.convex & (self.curvature >= _NEARLY_FLAT)

    @property
    def raised_curvature(self) -> tuple[Array, Array]:
        """The curvature that is reckoned with, and its slope by the gap's own.

        Their product vanishes as one of the two relative curvatures does, and there is no ellipse
        any more; energy and force must not jump there. It is the curvature itself where that is
        enough, and half of `_NEARLY_FLAT` where the gap is not convex.
        """
        curvature = jnp.where(self.convex, self.curvature, 0.0)
        return _raised(curvature), _raising(curvature)

    @property
    def mean_radius(self) -> Array:
        """Geometric mean of the two relative radii of curvature, mm."""
        return self.raised_curvature[0] ** -0.5

    @property
    def semi_axes(self) -> tuple[Array, Array]:
        """Of the patch, mm, the larger first; 0 when apart, infinite along a line of contact."""
        along_a, along_b = self.stretch
        steep = jnp.sqrt(self.steepness) * self.metric
        twice = self.aa * along_b**2 - 2.0 * self.ab * self.mixed + self.bb * along_a**2
        mean = 0.5 * twice / steep
        spread = safe_sqrt(mean * mean - self.curvature)
        depth = jnp.maximum(self.depth, 0.0)
        return tuple(
            jnp.where(k > 0, safe_sqrt(2.0 * depth / jnp.where(k > 0, k, 1.0)), jnp.inf)
            for k in (mean - spread, mean + spread)
        )

    def reach(self, by_a: Array | float, by_b: Array | float) -> Array:
        """How far the patch reaches from its middle in a quantity that changes by so much with each
        parameter; 0 when apart, or where there is no ellipse."""
        square = by_a * by_a * self.bb - 2.0 * by_a * by_b * self.ab + by_b * by_b * self.aa
        rise = 2.0 * jnp.maximum(self.depth, 0.0) * jnp.sqrt(self.steepness)
        inverse = jnp.where(self.convex, 1.0 / jnp.where(self.convex, self.determinant, 1.0), 0.0)
        return safe_sqrt(rise * inverse * square)

    @property
    def tilt(self) -> Array:
        """Slope of the gap along the surface, mm per mm; zero where the surfaces meet."""
        a, b = self.slope[0] / self.stretch[0], self.slope[1] / self.stretch[1]
        return jnp.abs(a) + jnp.abs(b)

    def newton(self, a: Array, b: Array) -> tuple[Array, Array]:
        """Minus the solution of a system with the second derivatives; zero where they are not
        positive definite."""
        inverse = jnp.where(self.convex, -1.0 / jnp.where(self.convex, self.determinant, 1.0), 0.0)
        return (self.bb * a - self.ab * b) * inverse, (self.aa * b - self.ab * a) * inverse


# Slopes are stated: traced, values and slopes would share every power, and be a kernel for each.
@jax.custom_jvp
def _raised(curvature: Array) -> Array:
    t = _part(curvature)
    return _NEARLY_FLAT * (0.5 + t**4 * (2.5 + t * (t - 3.0)) - t) + jnp.maximum(curvature, 0.0)


@jax.custom_jvp
def _raising(curvature: Array) -> Array:
    t = _part(curvature)
    return t**3 * (10.0 + t * (6.0 * t - 15.0))


_raised.defjvps(lambda rate, _, curvature: _raising(curvature) * rate)
_raising.defjvps(
    lambda rate, _, curvature: (
        30.0 / _NEARLY_FLAT * (_part(curvature) * (1.0 - _part(curvature))) ** 2 * rate
    )
)


def _part(curvature: Array) -> Array:
    """Of the curvature that is reckoned with as it is."""
    return jnp.clip(curvature / _NEARLY_FLAT, 0.0, 1.0)


class Nearby(eqx.Module):
    """Both surfaces around a femoral point, in the tibial surface's frame.

    Attributes:
        jet: of the femoral surface, its basis turned into that frame.
        height: of the femoral point over the tibial surface.
        point: mm.
        pulled: components of the height's gradient along the jet's basis.
        along: derivatives of the point with respect to its two parameters.
        bent: the height's hessian applied to those.
    """

    jet: Jet
    height: Height
    point: Vector
    pulled: Vector
    along: tuple[Vector, Vector]
    bent: tuple[Vector, Vector]

    def components(self, direction: Vector) -> Vector:
        """Components of a direction along the jet's basis."""
        x, y, z = self.jet.basis
        return Vector(direction @ x, direction @ y, direction @ z)

    @property
    def gap(self) -> Gap:
        """The gap at the femoral point."""
        jet, gradient = self.jet, self.height.gradient
        (along_a, along_b), (bent_a, bent_b) = self.along, self.bent
        square_a, square_b = jet.a @ jet.a, jet.b @ jet.b
        return Gap(
            value=self.height.value,
            slope=(self.pulled @ jet.a, self.pulled @ jet.b),
            aa=self.pulled @ jet.aa + bent_a @ along_a,
            ab=self.pulled @ jet.ab + bent_a @ along_b,
            bb=self.pulled @ jet.bb + bent_b @ along_b,
            steepness=gradient @ gradient,
            mixed=jet.a @ jet.b,
            metric=square_a * square_b - (jet.a @ jet.b) ** 2,
            stretch=(jnp.sqrt(square_a), jnp.sqrt(square_b)),
            point=self.point,
            along=self.along,
        )


def nearby(
    femoral: Surface,
    tibial: Surface,
    motion: Placement,
    contact_point: Array | tuple[Array, Array],
    order: int = 2,
) -> Nearby:
    """Both surfaces around a femoral point, with derivatives to an order; else as `gap_at`."""
    jet = femoral.jet(contact_point[0], contact_point[1], order)
    jet = eqx.tree_at(lambda j: j.basis, jet, Matrix(*map(motion.turn, jet.basis)))
    point = jet.vector(jet.point) + motion.translation
    height = tibial.height(point, order)
    along = jet.vector(jet.a), jet.vector(jet.b)
    hessian = _NOTHING if height.hessian is None else height.hessian
    bent = hessian @ along[0], hessian @ along[1]
    pulled = Vector(*(height.gradient @ e for e in jet.basis))
    return Nearby(jet, height, point, pulled, along, bent)


def gap_at(
    femoral: Surface, tibial: Surface, motion: Placement, contact_point: Array | tuple[Array, Array]
) -> Gap:
    """The gap at a point of the femoral surface."""
    return nearby(femoral, tibial, motion, contact_point).gap


def first_guess(
    femoral: Surface, tibial: Surface, motion: Placement
) -> tuple[Array, Array]:
    """Parameters near the smallest gap: where the normals roughly oppose."""
    away = tibial.outwards(motion.translation)
    guess = femoral.start(-motion.turn_back(away))
    a, b, _ = jnp.broadcast_arrays(*guess, motion.translation[0])
    return a, b


def improved(
    femoral: Surface, gap: Gap, contact_point: tuple[Array, Array]
) -> tuple[tuple[Array, Array], Array]:
    """A point after one guarded Newton step towards the smallest gap, and how far that leads, mm.

    Args:
        femoral: the surface that carries the point.
        gap: there.
        contact_point: the point's parameters: a pair, not stacked, since whatever the compiler
            computes into a stack it computes once for each row.
    """
    # In mm along both parameters, so that the guards below have a meaning.
    along_a, along_b = gap.stretch
    slope_a, slope_b = gap.slope[0] / along_a, gap.slope[1] / along_b
    aa, ab, bb = gap.aa / along_a**2, gap.ab / (along_a * along_b), gap.bb / along_b**2
    smallest = 0.5 * (aa + bb) - safe_sqrt(0.25 * (aa - bb) ** 2 + ab * ab)
    shift = jnp.where(smallest > _FLATTEST, 0.0, _LEAST_CURVATURE - smallest)
    aa, bb = aa + shift, bb + shift
    determinant = aa * bb - ab * ab
    step_a = (bb * slope_a - ab * slope_b) / determinant
    step_b = (aa * slope_b - ab * slope_a) / determinant
    miss = jnp.abs(step_a) + jnp.abs(step_b)
    short = jnp.minimum(1.0, _LONGEST_STEP / (miss + 1e-9))
    (lower_a, upper_a), (lower_b, upper_b) = femoral.bounds()
    more_a, more_b = _OVERSHOOT * (upper_a - lower_a), _OVERSHOOT * (upper_b - lower_b)
    a = jnp.clip(contact_point[0] - short * step_a / along_a, lower_a - more_a, upper_a + more_a)
    b = jnp.clip(contact_point[1] - short * step_b / along_b, lower_b - more_b, upper_b + more_b)
    return (a, b), miss


def contact_point(
    femoral: Surface, tibial: Surface, motion: Placement, near: Array | None = None
) -> tuple[tuple[Array, Array], Array]:
    """Where two surfaces meet: the femoral point where the gap is smallest.

    Near a known point the search goes on as long as each step is at most a quarter as long as the
    one before. So it does not leave for another smallest gap, which surfaces that are nearly flat
    against each other may have: there the point moves by millimetres as the pose moves by
    hundredths, and at some poses there is none.

    Args:
        femoral: the surface that is searched.
        tibial: the surface over which the gap is measured.
        motion: from the femoral to the tibial surface's frame.
        near: parameters of a point near it, `(2, ...)`; without one, or where that is NaN, the
            search begins where the normals roughly oppose.

    Returns:
        The point's two parameters, differentiable to any order by the motion and every number of
        the surfaces: the rule below is made of the function itself. And whether it was not found.
    """
    still = lax.stop_gradient((femoral, tibial, motion))
    begin, afresh = first_guess(*still), True
    if near is not None:
        known = lax.stop_gradient(near)
        afresh = jnp.isnan(known[0])
        begin = tuple(jnp.where(afresh, a, b) for a, b in zip(begin, known, strict=True))

    def nearer(state):
        step, point, last, goes = state
        ahead, length = improved(still[0], gap_at(*still, point), point)
        goes = goes & (afresh | (length < _CONVERGES * last))
        point = tuple(jnp.where(goes, a, b) for a, b in zip(ahead, point, strict=True))
        return step + 1, point, jnp.where(goes, length, last), goes & (length > _FOUND)

    far = jnp.full(jnp.shape(begin[0]), jnp.inf)
    state = jnp.asarray(0), begin, far, far > 0.0
    going_on = lambda s: (s[0] < _SEARCH_STEPS) & jnp.any(s[-1])  # noqa: E731
    _, point, last, _ = lax.while_loop(going_on, nearer, state)
    found = ruled(_contact_point_rule, point, femoral, tibial, motion)
    return found, ~(last <= _NEARLY_FOUND)


def _contact_point_rule(contact_point: tuple[Array, Array], primals, tangents):
    def slope(femoral: Surface, tibial: Surface, motion: Placement):
        return gap_at(femoral, tibial, motion, contact_point).slope

    (femoral, tibial, motion), moved = primals, jvp_of_moved(slope, primals, tangents)[1]
    return contact_point, gap_at(femoral, tibial, motion, contact_point).newton(*moved)
