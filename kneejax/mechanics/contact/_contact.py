"""Two articular surfaces pressed together: an elastic layer between rigid bones.

The same contact can be computed in two ways. `ELLIPTICAL_PATCH` uses the closed form over the
patch that two smooth surfaces share: fast, and exact as the patch becomes small against the
radii. `QUADRATURE` sums the pressure law over points of the tibial surface: for any surfaces and
depths, at a cost in proportion to its points.
"""

__all__ = ["ELLIPTICAL_PATCH", "FORMS", "QUADRATURE", "Contact"]

import dataclasses

import equinox as eqx
import jax.numpy as jnp
from jax import Array

from kneejax.geometry import FEMUR_AND_TIBIA, Pair, Placement, Surface, numbers, partials
from kneejax.mechanics._loads import Wrench
from kneejax.mechanics.contact import _border, _patch
from kneejax.mechanics.contact import _cartilage_law as law
from kneejax.mechanics.contact._border import Border
from kneejax.mechanics.contact._cartilage_law import ContactDamper
from kneejax.mechanics.contact._foundation import Foundation, foundations_of
from kneejax.mechanics.contact._patch import Gap
from kneejax.mechanics.contact._patch_force import Pressed, press
from kneejax.mechanics.contact._points import Sampled
from kneejax.mechanics.contact._rays import faded
from kneejax.mechanics.contact._ring import Ring
from kneejax.numerics import positive_part

#: The two ways to compute a contact.
ELLIPTICAL_PATCH, QUADRATURE = "elliptical_patch", "quadrature"
FORMS = (ELLIPTICAL_PATCH, QUADRATURE)
#: Surfaces this far apart, mm, have next to no force, wherever they are nearest.
_APART = 1.0


class Contact(eqx.Module):
    """One compartment.

    Attributes:
        femoral: surface placed in the femur, or in the first of two other bones.
        tibial: surface placed in the tibia, or in the second of them.
        youngs_modulus: MPa.
        poisson_ratio: below 0.5.
        layer_thickness: both cartilages together, mm.
        layer_variation: what is added to it over the tibial surface, `(m + 1, n + 1, ...)`, mm:
            powers of both parameters, scaled to -1..1 over the region; None where it is the same
            everywhere. Read by `QUADRATURE` only.
        onset_width: rounding of the depth's corner at first touch, mm.
        law: pressure law, one of `linear`, `log`, `ratio`.
        form: `elliptical_patch` or `quadrature`.
        points: quadrature points along the two parameters of the tibial surface; of a ring, along
            its arc, as many in each section, and across its width.
        bodies: the two bones. Methods ask where the second is in the first: `tibia`.
        damper: what resists compression during a step through time; None at rest.
        ring: what holds a meniscus from horn to horn; None where the surface stands still. Read by
            `QUADRATURE` only.

    Example:
        >>> from kneejax.geometry import Plane, Sphere
        >>> touch = Contact(Sphere(20.0), Plane(), youngs_modulus=5.0, layer_thickness=4.0)
        >>> touch.form, touch.law, float(touch.layer_thickness)
        ('elliptical_patch', 'log', 4.0)
    """

    femoral: Surface
    tibial: Surface
    youngs_modulus: Array = numbers(default=5.0)
    poisson_ratio: Array = numbers(default=0.45)
    layer_thickness: Array = numbers(default=6.0)
    onset_width: Array = numbers(default=0.02)
    law: str = eqx.field(static=True, default="log")
    form: str = eqx.field(static=True, default=ELLIPTICAL_PATCH)
    points: tuple[int, int] = eqx.field(static=True, default=(24, 24))
    layer_variation: Array | None = numbers(default=None)
    bodies: Pair = eqx.field(static=True, default=FEMUR_AND_TIBIA)
    damper: ContactDamper | None = None
    ring: Ring | None = None

    def __check_init__(self):
        if self.law not in law.LAWS:
            raise ValueError(f"Contact.law is {self.law!r}; expected one of {law.LAWS}")
        if self.form not in FORMS:
            raise ValueError(f"Contact.form is {self.form!r}; expected one of {FORMS}")
        if self.ring is not None and self.form != QUADRATURE:
            raise ValueError(f"Contact.ring: expected form {QUADRATURE}, not {self.form!r}")
        if self.ring is not None and getattr(self.tibial, "outline", None) is None:
            raise ValueError("Contact.ring: expected a plateau with the outline of a meniscus")

    @property
    def modulus(self) -> Array:
        """Confined modulus of the layer, MPa."""
        return law.confined_modulus(self.youngs_modulus, self.poisson_ratio)

    def femur_to_plateau(self, tibia: Placement) -> Placement:
        """The motion from the femoral to the tibial surface's frame."""
        to_tibia = tibia.inverse().after(self.femoral.frame.placement)
        return self.tibial.frame.placement.inverse().after(to_tibia)

    @property
    def has_patch(self) -> bool:
        """Whether the contact is computed over an elliptical patch, around a contact point."""
        return self.form == ELLIPTICAL_PATCH

    def contact_point(self, tibia: Placement, near: Array | None = None) -> tuple[Array, Array]:
        """The two parameters of the femoral point where the surfaces meet; see `press`."""
        motion = self.femur_to_plateau(tibia)
        return _patch.contact_point(self.femoral, self.tibial, motion, near)[0]

    def gap(self, tibia: Placement, contact_point: Array | tuple[Array, Array]) -> Gap:
        """Gap of the surfaces at a femoral point."""
        return _patch.gap_at(self.femoral, self.tibial, self.femur_to_plateau(tibia), contact_point)

    @property
    def foundation(self) -> Foundation:
        """The contact as springs at its points."""
        return foundations_of((self,))[0]

    def layer(self, across: tuple[Array, Array]) -> Array:
        """Thickness of both cartilages at points of the tibial surface, mm.

        Args:
            across: both parameters there, scaled to -1..1 over the region, `(points, ...)`.
        """
        if self.layer_variation is None:
            return self.layer_thickness[None]
        return self.layer_thickness + partials(self.layer_variation, *across, 0)[0][0]

    def overlap(self, tibia: Placement, near: Array | None = None) -> tuple[Array, Array]:
        """What a damper must know: depths, mm, and elastic forces, N.

        Args:
            tibia: where the tibia is.
            near: as in `press`.

        Returns:
            Of the patch, `(...)`, or at each point, `(points, ...)`.
        """
        if self.has_patch:
            gap = self.gap(tibia, self.contact_point(tibia, near))
            pressing = self._energy_per_radius(gap.depth)[1] * gap.mean_radius
            return gap.depth, pressing

        def seen(sampled: Sampled) -> tuple[Array, Array]:
            points, depth = sampled.points, sampled.depth
            return faded(depth)[0], points.pressure(depth) * points.area

        return self.foundation.over_points(tibia, seen)

    def has_no_patch(self, gap: Gap) -> Array:
        """Whether surfaces that overlap have no elliptical patch: the gap is nearly flat or not
        convex, as between two contact points. Its force is a guess; the form `quadrature` knows."""
        return (gap.depth > 0) & ~gap.has_ellipse

    def passed_through(self, tibia: Placement) -> Array:
        """Whether the middle of the femoral solid lies inside the tibial one: a pose that no
        bones have, though no point of their surfaces need touch any more."""
        core = self.femur_to_plateau(tibia).apply(self.femoral.core())
        return self.tibial.contains(core)

    def border(self, gap: Gap, contact_point: Array, off: Array) -> Border:
        """How far a patch reaches beyond the fitted regions, and what force is carried there.

        Args:
            gap: at its contact point.
            contact_point: parameters of that point, `(2, ...)`.
            off: how far its rim lies beyond, mm; see `rim_off`.
        """
        return _border.of_patch(self, gap, contact_point, off)

    def rim_off(self, gap: Gap, contact_point: Array) -> Array:
        """How far the rim of a patch lies beyond the fitted regions, mm.

        Args:
            gap: at its contact point.
            contact_point: parameters of that point, `(2, ...)`.
        """
        return _border.rim_off(self.femoral, self.tibial, gap, contact_point)

    def patch_energy(self, gap: Gap) -> Array:
        """Energy of the layer if the patch were centred at a point with this gap, N mm."""
        elastic = self._energy_per_radius(gap.depth)[0] * gap.mean_radius
        return elastic if self.damper is None else elastic + self._damping(gap.depth)[0]

    def _damping(self, depth: Array) -> tuple[Array, Array]:
        """Potential of the damper of a patch, N mm, and its slope by depth, N."""
        assert self.damper is not None
        return self.damper.energy(depth), self.damper.force(depth)

    def _energy_per_radius(self, depth: Array) -> tuple[Array, Array]:
        """Energy of a patch over its mean radius, N, and the slope of that by depth, N/mm."""
        thick, factor = self.layer_thickness, 2.0 * jnp.pi * self.modulus * self.layer_thickness
        relative = self.rounded(depth) / thick
        # The mean over 0..depth times the depth: its slope is the density itself.
        by_depth = law.touching(depth, self.onset_width) * law.relative_energy(self.law, relative)
        return factor * thick * law.patch_energy(self.law, relative), factor * by_depth

    def press(self, tibia: Placement, near: Array | None = None) -> Pressed:
        """Energy and wrench of a patch.

        Args:
            tibia: where the tibia is.
            near: parameters of a point near that where the surfaces meet, `(2, ...)`; where it is
                NaN, or without one, it is searched from scratch.

        Returns:
            The patch, its wrench on the tibia about the tibia's origin in femur axes; the energy is
            infinite where surfaces are near each other and their contact point is not found.
        """
        motion = self.femur_to_plateau(tibia)
        contact_point, lost = _patch.contact_point(self.femoral, self.tibial, motion, near)
        damping = None if self.damper is None else self._damping
        laws = self._energy_per_radius, damping
        pressed = press(self.femoral, self.tibial, motion, contact_point, *laws)
        lost = lost & (pressed.gap.depth > -_APART)
        pressed = dataclasses.replace(pressed, energy=jnp.where(lost, jnp.inf, pressed.energy))
        return pressed.carried(self.tibial.frame.placement, tibia)

    def wrench(self, tibia: Placement) -> Wrench:
        """Of the layer on the tibia, about the tibia's origin in femur axes."""
        if self.has_patch:
            return self.press(tibia).wrench
        return self.foundation.press(tibia)[1]

    def energy(self, tibia: Placement) -> Array:
        """Elastic energy of the layer, N mm."""
        if self.has_patch:
            return self.patch_energy(self.gap(tibia, self.contact_point(tibia)))
        return self.foundation.energy(tibia)

    def pressure(self, depth: Array) -> Array:
        """Pressure at a depth, MPa, with the rounded onset."""
        relative = self.rounded(depth) / self.layer_thickness
        return self.modulus * law.relative_pressure(self.law, relative)

    def rounded(self, depth: Array) -> Array:
        """Depth with the rounded onset, mm: positive, and far less than `onset_width` apart."""
        return positive_part(depth, self.onset_width)
