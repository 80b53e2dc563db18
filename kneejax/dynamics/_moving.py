"""A knee whose bones have mass, and the dampers that a knee at rest does not have."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import equinox as eqx
import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from kneejax.geometry import PATELLA, TIBIA, State, coordinate, coordinates_of
from kneejax.mechanics import Contact, ContactDamper, Knee, Load, Mass, critical_damping
from kneejax.numerics import WrongValue

#: m/s^2, of a thigh that stands still in any attitude.
GRAVITY = 9.80665
#: What the weight of a bone is called among loads.
WEIGHT = "weight"


class MovingKnee(eqx.Module):
    """A knee with mass and damping; every number of it is a leaf.

    Fibres are damped by `knee.ligaments.damping` (N s, while they lengthen) and by what stands
    here. A bone without mass is in balance at every moment.

    Attributes:
        knee: its loads act throughout.
        masses: bone -> its mass.
        fibre_damping: of each fibre, N s/mm, `(n, ...)`, lengthening or shortening.
        coordinate_damping: coordinate -> N mm s per rad of a rotation, N s/mm of a translation.
        gravity_m_s2: along the femur's axes, `(3, ...)`; zeros without.
        contact_dissipation: contact -> s/mm by which its force grows with the rate of its overlap.

    Raises:
        ValueError: a mass of a bone that the knee has not, a coordinate or a contact that is none
            of its, or as many coefficients as it has no fibres.

    Example:
        >>> import numpy as np
        >>> import kneejax as kj
        >>> ball = Mass(3.5, [0.0, -250.0, 0.0], np.diag([5e4, 5e3, 5e4]))
        >>> moving = MovingKnee.of(kj.load_knee("four_ligament"), ball)
        >>> moving.critically_damped().fibre_damping.round(2).tolist()
        [1.56, 1.24, 1.22, 1.25]
    """

    knee: Knee
    masses: Mapping[str, Mass]
    fibre_damping: Array
    coordinate_damping: Mapping[str, Array]
    gravity_m_s2: Array
    contact_dissipation: Mapping[str, Array] = dataclasses.field(default_factory=dict)

    @classmethod
    def of(
        cls,
        knee: Knee,
        shank: Mass,
        *,
        patella: Mass | None = None,
        fibre_damping: ArrayLike = 0.0,
        coordinate_damping: Mapping[str, ArrayLike] | None = None,
        gravity_m_s2: ArrayLike = (0.0, 0.0, 0.0),
        contact_dissipation: Mapping[str, ArrayLike] | None = None,
    ) -> MovingKnee:
        """Make one from the mass of the shank.

        Args:
            knee: any knee.
            shank: what moves with the tibia: shank and foot.
            patella: its mass; None leaves it in balance at every moment.
            fibre_damping: N s/mm, one for all fibres or `(n,)`.
            coordinate_damping: as the attribute.
            gravity_m_s2: as the attribute; see `gravity_of`.
            contact_dissipation: as the attribute.
        """
        masses = {TIBIA: shank} if patella is None else {TIBIA: shank, PATELLA: patella}
        every = jnp.broadcast_to(jnp.asarray(fibre_damping, float), (len(knee.ligaments.names),))
        damped = {k: jnp.asarray(c, float) for k, c in (coordinate_damping or {}).items()}
        pressed = {k: jnp.asarray(c, float) for k, c in (contact_dissipation or {}).items()}
        return cls(knee, masses, every, damped, jnp.asarray(gravity_m_s2, float), pressed)

    def __check_init__(self):
        known = {"masses": self.knee.bodies, "coordinate_damping": coordinates_of(self.knee.bodies),
                 "contact_dissipation": self.knee.contact_names}  # fmt: skip
        for field, names in known.items():
            for name in getattr(self, field):
                if name not in names:
                    which = ", which move" if field == "masses" else ""
                    raise WrongValue(field, repr(name), f"of {', '.join(names)}{which}")
        count, given = len(self.knee.ligaments.names), len(self.fibre_damping)
        if given != count:
            raise WrongValue("fibre_damping", f"{given} rows", f"{count}, one a fibre")

    def critically_damped(self, part: ArrayLike = 1.0) -> MovingKnee:
        """With the damping of paper 2 in every fibre: `sqrt(4 k m)` of the tibia's mass.

        Args:
            part: of that damping.
        """
        fibres = self.knee.ligaments
        critical = critical_damping(
            fibres.stiffness, fibres.slack_length, self.masses[TIBIA].mass_kg
        )
        damping = jnp.asarray(part, float) * critical
        return dataclasses.replace(self, fibre_damping=damping)

    def damped_everywhere(self, per_mm: ArrayLike) -> MovingKnee:
        """With every coordinate damped alike, to settle.

        Args:
            per_mm: N s/mm of translations; of rotations as at an arm of 30 mm.
        """
        c = jnp.asarray(per_mm, float)
        every = coordinates_of(self.knee.bodies)
        damping = {name: c / coordinate(name).scale ** 2 for name in every}
        return dataclasses.replace(self, coordinate_damping=damping)

    def overlaps(
        self, state: State, contact_points: Array
    ) -> tuple[dict[str, Array], dict[str, Array]]:
        """What dampers of contacts must know: contact -> its overlap, mm, and elastic force, N.

        Args:
            state: where the bones are.
            contact_points: points near those where surfaces meet, `(n, 2, lanes)`.
        """
        overlap, pressing, row = {}, {}, 0
        for name, contact in zip(self.knee.contact_names, self.knee.contacts, strict=True):
            near = contact_points[row] if contact.has_patch else None
            row += contact.has_patch
            if name in self.contact_dissipation:
                there = contact.overlap(state.between(contact.bodies), near)
                overlap[name], pressing[name] = there
        return overlap, pressing

    def with_contacts_damped(
        self, before: Mapping[str, Array], pressing: Mapping[str, Array], per_s: Array
    ) -> tuple[Contact, ...]:
        """The knee's contacts with the dampers of a step.

        Args:
            before: contact -> the overlap of which it has no rate, mm.
            pressing: contact -> the elastic force that is expected, N.
            per_s: factor between a change of overlap and its rate, 1/s.
        """

        def damped(name: str, contact: Contact) -> Contact:
            if name not in self.contact_dissipation:
                return contact
            shape = before[name].shape
            each = self.contact_dissipation[name], pressing[name], before[name], per_s
            damper = ContactDamper(*(jnp.broadcast_to(x, shape) for x in each))
            return eqx.tree_at(lambda c: c.damper, contact, damper, is_leaf=lambda x: x is None)

        both = zip(self.knee.contact_names, self.knee.contacts, strict=True)
        return tuple(damped(name, contact) for name, contact in both)

    @property
    def weights(self) -> tuple[Load, ...]:
        """Of its bones."""
        g, nothing = self.gravity_m_s2, jnp.zeros_like(self.gravity_m_s2)
        return tuple(
            Load(mass.mass_kg * g, nothing, mass.center_mm, point_in=bone, name=WEIGHT, bone=bone)
            for bone, mass in self.masses.items()
        )

    @property
    def loads(self) -> tuple:
        """What acts throughout: the knee's own loads and the weights of its bones."""
        return *self.knee.loads, *self.weights


def gravity_of(femur_deg: float) -> tuple[float, float, float]:
    """Gravity along the femur's axes, m/s^2.

    Args:
        femur_deg: of the femur from the horizontal, knee above hip positive: 0 for a person who
            sits, -90 for one who stands.

    Example:
        >>> [round(x, 3) for x in gravity_of(-90.0)], [round(x, 3) for x in gravity_of(0.0)]
        ([-0.0, -9.807, 0.0], [-9.807, 0.0, 0.0])
    """
    turn = math.radians(femur_deg)
    return -GRAVITY * math.cos(turn), GRAVITY * math.sin(turn), 0.0
