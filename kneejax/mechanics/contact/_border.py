"""How far a contact reaches beyond the regions in which its surfaces are known."""

__all__ = ["OFF_SURFACE_MM", "Border"]

from collections.abc import Callable
from typing import TYPE_CHECKING

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.geometry import Placement, Surface, Vector, excess
from kneejax.mechanics.contact import _cartilage_law as law
from kneejax.mechanics.contact._patch import Gap
from kneejax.numerics import safe_sqrt

if TYPE_CHECKING:
    from kneejax.mechanics.contact._contact import Contact
    from kneejax.mechanics.contact._points import Sampled

#: Contact that reaches farther beyond the fitted regions is in doubt, mm. Surfaces are continued
#: smoothly beyond their border (`kneejax.geometry`), and meshes of cartilage have edges of
#: a millimetre: where it ends is not known more closely. A rim of that width carries a newton or
#: two (layer of 6 mm and 5 MPa, radii of 20 to 60 mm): 1 % of 100 N, less of more.
OFF_SURFACE_MM = 1.0
# Rings of equal area that a patch is cut into, and places on each.
_RINGS, _PLACES = 12, 32


class Border(eqx.Module):
    """What of a contact lies where a surface is not known.

    Attributes:
        beyond_mm: how far the contact reaches beyond the border at most; 0 inside.
        share: of the force that is carried there, 0 to 1.

    Example:
        >>> import jax.numpy as jnp
        >>> edge = Border(jnp.array([0.0, 1.4]), jnp.array([0.0, 0.02]))
        >>> edge.beyond_mm.tolist()
        [0.0, 1.4]
    """

    beyond_mm: Array
    share: Array


def of_points(
    femoral: Surface, sampled: "Sampled", motion: Placement, of_each: Callable[..., Array]
) -> Border:
    """Border of contacts summed over points.

    All points lie on tibial cartilage; only the femoral region can be left.
    """
    points = sampled.points
    away = femoral.beyond(points.in_femoral(motion, sampled.hit))
    force = points.pressure(sampled.depth) * points.area
    carried = jnp.where((sampled.depth > 0) & (points.area > 0), away, 0.0)
    total = of_each(jnp.sum, force)
    # Far apart nothing is carried, not even what the rounded onset leaves.
    outside = of_each(jnp.sum, jnp.where(carried > 0, force, 0.0))
    share = outside / jnp.where(total == 0.0, 1.0, total)
    return Border(of_each(jnp.max, carried), share)


def of_patch(contact: "Contact", gap: Gap, contact_point: Array, off: Array) -> Border:
    """Border of an elliptical patch: how far its rim reaches, and what is carried there."""
    inner = (np.arange(_RINGS) + 0.5) / _RINGS
    around = 2.0 * np.pi * (np.arange(_PLACES) + 0.5) / _PLACES
    square, angle = np.meshgrid(inner, around, indexing="ij")
    poses = (1,) * jnp.ndim(gap.depth)
    square, angle = (x.reshape(-1, *poses) for x in (square, angle))
    away = _away(contact, gap, contact_point, np.sqrt(square), angle)
    depth = jnp.maximum(gap.depth, 0.0)
    relative = jnp.minimum(depth * (1.0 - square) / contact.layer_thickness, 0.99)
    pressure = law.relative_pressure(contact.law, relative)
    total = jnp.sum(pressure, axis=0)
    outside = jnp.sum(jnp.where(away > 0, pressure, 0.0), axis=0)
    touches = gap.depth > 0
    share = jnp.where(touches, outside / jnp.where(total > 0, total, 1.0), 0.0)
    return Border(jnp.where(touches, off, 0.0), share)


def rim_off(femoral: Surface, tibial: Surface, gap: Gap, contact_point: Array) -> Array:
    """How far the rim of a patch, or its middle while the surfaces are apart, lies beyond either
    region, mm."""
    half = gap.reach(1.0, 0.0), gap.reach(0.0, 1.0)
    reach = Vector(*(gap.reach(p, q) for p, q in zip(*gap.along, strict=True)))
    off = jnp.zeros(())
    for way in (1.0, -1.0):
        every = zip(contact_point, half, femoral.bounds(), gap.stretch, strict=True)
        for middle, by, ends, mm in every:
            off = jnp.maximum(off, mm * excess(middle + way * by, ends))
        off = jnp.maximum(off, tibial.beyond(gap.point + way * reach))
    return off


def _away(contact: "Contact", gap: Gap, contact_point: Array, part, angle) -> Array:
    """How far places of the patch lie beyond either region, mm."""
    # A gap that is not convex has no ellipse: its middle alone is asked then.
    convex = gap.convex
    aa = jnp.where(convex, gap.aa, 1.0)
    first = jnp.sqrt(aa)
    second = jnp.sqrt(jnp.where(convex, gap.determinant, 1.0) / aa)
    size = jnp.where(convex, safe_sqrt(2.0 * gap.depth * jnp.sqrt(gap.steepness)), 0.0) * part
    by_b = size * jnp.sin(angle) / second
    by_a = (size * jnp.cos(angle) - jnp.where(convex, gap.ab, 0.0) / first * by_b) / first
    (limits_a, limits_b), (stretch_a, stretch_b) = contact.femoral.bounds(), gap.stretch
    femoral = safe_sqrt(
        (stretch_a * excess(contact_point[0] + by_a, limits_a)) ** 2
        + (stretch_b * excess(contact_point[1] + by_b, limits_b)) ** 2
    )
    shift = by_a * gap.along[0] + by_b * gap.along[1]
    return jnp.maximum(femoral, contact.tibial.beyond(gap.point + shift))
