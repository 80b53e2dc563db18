"""Force and moment of an elliptical patch: the derivatives of its energy, written out.

The energy `W(depth, curvature)` depends on the motion of the bones and on the contact point `s`.
With `G` the gap, `x` the femoral point, `c_i` its derivatives by `s`, `g`, `H` and `T` the first
three derivatives of the height at `x`, a small motion of the femur (`dx` at the point, `w` of
rotation) changes

    G by       g . dx
    G_i by     (H c_i) . dx + w . (c_i x g)
    G_ij by    (H c_ij + T c_i c_j) . dx + w . (c_ij x g + c_i x H c_j + c_j x H c_i)

and with them depth, curvature and energy. The contact point follows; a multiplier on the slopes
`G_i` makes the energy blind to that. Reverse differentiation of the energy gives the same numbers
with three times the operations, and its derivative, which every step of a search takes, with four
times (tests/mechanics/contact/test_patch_force.py holds the two against each other).
"""

__all__ = ["Pressed"]

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array

from kneejax.geometry import (
    Placement,
    Surface,
    Vector,
)
from kneejax.mechanics._loads import Wrench
from kneejax.mechanics.contact._border import rim_off
from kneejax.mechanics.contact._patch import _NOTHING, Gap, Nearby, nearby


class Pressed(eqx.Module):
    """A patch under load.

    Attributes:
        energy: N mm.
        wrench: on the second bone.
        gap: at the contact point.
        contact_point: the two parameters of that point.
        off: how far the patch reaches beyond the regions in which both surfaces are known, mm.
    """

    energy: Array
    wrench: Wrench
    gap: Gap
    contact_point: tuple[Array, Array]
    off: Array

    def of(self, rows: tuple[int, ...]) -> "Pressed":
        """Some of several patches along a first axis, in their order."""
        if rows == tuple(range(len(self.energy))):
            return self
        return jax.tree.map(lambda x: x[jnp.array(rows)], self)

    def carried(self, frame: Placement, there: Placement) -> "Pressed":
        """Wrenches from the tibial surface's frame to the first bone's axes, about the second's
        origin."""
        wrench = self.wrench.moved(frame).turned(there)
        return Pressed(self.energy, wrench, self.gap, self.contact_point, self.off)


def press(
    femoral: Surface,
    tibial: Surface,
    motion: Placement,
    contact_point: tuple[Array, Array],
    energy_per_radius: Callable[[Array], tuple[Array, Array]],
    damping: Callable[[Array], tuple[Array, Array]] | None = None,
) -> Pressed:
    """Energy, force and moment of a patch, in the tibial surface's frame.

    Args:
        femoral: the surface that carries the contact point.
        tibial: the surface over which the gap is measured.
        motion: from the femoral to the tibial surface's frame.
        contact_point: the two parameters of the contact point.
        energy_per_radius: of a depth, energy per mm of the mean radius, N, and its slope, N/mm.
        damping: of a depth, a potential whatever the radius, N mm, and its slope, N.

    Returns:
        The patch; its wrench is the exact derivative of the energy where the slopes vanish.
    """
    near = nearby(femoral, tibial, motion, contact_point, order=3)
    gap = near.gap
    curvature, raised = gap.raised_curvature
    energy, by_depth = (x / jnp.sqrt(curvature) for x in energy_per_radius(gap.depth))
    by_curvature = -0.5 * energy * raised / curvature
    if damping is not None:
        more, by_more = damping(gap.depth)
        energy, by_depth = energy + more, by_depth + by_more
    force, couple = _at_fixed_point(near, gap, by_depth, by_curvature)
    shift_a, shift_b = gap.newton(*_by_point(near, gap, by_curvature, force))

    (along_a, along_b), (bent_a, bent_b) = near.along, near.bent
    gradient = near.height.gradient
    force = force + shift_a * bent_a + shift_b * bent_b
    shifted = shift_a * along_a + shift_b * along_b
    couple = couple + shifted.cross(gradient)
    # Blind to first order to what is left of the search for the contact point.
    energy = energy + shift_a * gap.slope[0] + shift_b * gap.slope[1]
    wrench = Wrench.at(near.point, force, couple)
    off = rim_off(femoral, tibial, gap, contact_point)
    return Pressed(energy, wrench, gap, contact_point, off)


def _cofactors(near: Nearby, gap: Gap) -> tuple[Vector, Vector]:
    """Derivatives of the point, mixed by the cofactors of the gap's second derivatives."""
    along_a, along_b = near.along
    return (
        gap.bb * along_a - gap.ab * along_b,
        gap.aa * along_b - gap.ab * along_a,
    )


def _at_fixed_point(
    near: Nearby, gap: Gap, by_depth: Array, by_curvature: Array
) -> tuple[Vector, Vector]:
    """Derivative of the energy by a motion of the femur: force and couple at the point."""
    gradient, hessian, third = near.height.gradient, near.height.hessian, near.height.third
    hessian = _NOTHING if hessian is None else hessian
    by_determinant = by_curvature / (gap.metric * gap.steepness)
    by_steepness = -(0.5 * by_depth * gap.depth + by_curvature * gap.curvature) / gap.steepness
    mixed_a, mixed_b = _cofactors(near, gap)
    along_a, along_b = near.along
    jet = near.jet
    second = jet.vector(_contracted(gap, jet.aa, jet.ab, jet.bb))
    inner = 2.0 * by_steepness * gradient + by_determinant * second
    force = -by_depth / jnp.sqrt(gap.steepness) * gradient + hessian @ inner
    if third is not None:
        by_third = Vector(*(
            along_a @ (t @ mixed_a) + along_b @ (t @ mixed_b) for t in third
        ))  # fmt: skip
        force = force + by_determinant * by_third
    twist = along_a.cross(hessian @ mixed_a) + along_b.cross(hessian @ mixed_b)
    couple = second.cross(gradient) + 2.0 * twist
    return force, by_determinant * couple


def _by_point(near: Nearby, gap: Gap, by_curvature: Array, force: Vector) -> tuple[Array, Array]:
    """Derivative of the energy by the two parameters of the contact point.

    A shift of the point moves it through the height as a motion of the femur would, and changes
    the derivatives of the point besides.
    """
    jet = near.jet
    by_determinant = by_curvature / (gap.metric * gap.steepness)
    hessian = _NOTHING if near.height.hessian is None else near.height.hessian
    mixed_a, mixed_b = (near.components(hessian @ m) for m in _cofactors(near, gap))
    assert jet.third is not None
    aaa, aab, abb, bbb = jet.third
    square_a, mixed, square_b = jet.a @ jet.a, jet.a @ jet.b, jet.b @ jet.b

    def by(along: Vector, of_a: Vector, of_b: Vector, of_second: Vector) -> Array:
        determinant = near.pulled @ of_second + 2.0 * (mixed_a @ of_a + mixed_b @ of_b)
        metric = 2.0 * (
            jet.a @ of_a * square_b
            + jet.b @ of_b * square_a
            - mixed * (jet.a @ of_b + jet.b @ of_a)
        )
        return (
            force @ along
            + by_determinant * determinant
            - by_curvature * gap.curvature * metric / gap.metric
        )

    along_a, along_b = near.along
    return (
        by(along_a, jet.aa, jet.ab, _contracted(gap, aaa, aab, abb)),
        by(along_b, jet.ab, jet.bb, _contracted(gap, aab, abb, bbb)),
    )


def _contracted(gap: Gap, aa: Vector, ab: Vector, bb: Vector) -> Vector:
    """Sum over second derivatives, weighted by the cofactors of the gap's."""
    return gap.bb * aa - 2.0 * gap.ab * ab + gap.aa * bb
