"""The weight of shank and foot."""

from __future__ import annotations

import dataclasses

import numpy as np

from kneejax.mechanics import Load

#: m/s^2.
GRAVITY = 9.80665
#: Of body mass, and of the shank's length from the knee: shank with foot (Winter, Biomechanics and
#: Motor Control of Human Movement, 4th ed. 2009, Table 4.1: leg and foot).
MASS_SHARE, CENTER_SHARE = 0.061, 0.606
#: Of body height: length of the shank (same source, Figure 4.1).
LENGTH_SHARE = 0.246
#: What the weight of the leg is called among the forces on the tibia.
WEIGHT = "weight"


@dataclasses.dataclass(frozen=True)
class Shank:
    """Shank and foot as one weight that hangs on the tibia.

    Attributes:
        mass_kg: of both.
        center_mm: of mass, tibia frame, shape `(3,)`.
        ankle_kg: a weight at the ankle besides.
        ankle_mm: where that is, tibia frame, shape `(3,)`.
        femur_deg: of the femur from the horizontal, knee above hip positive: 0 for a person who
            sits, -90 for one who stands.

    Example:
        >>> shank = Shank.of_person(75.0, 1.78)
        >>> round(shank.mass_kg, 2), [round(x) for x in shank.center_mm]
        (4.58, [0, -265, 0])
    """

    mass_kg: float
    center_mm: tuple[float, float, float]
    ankle_kg: float = 0.0
    ankle_mm: tuple[float, float, float] = (0.0, -400.0, 0.0)
    femur_deg: float = 0.0

    def __post_init__(self):
        for name in ("mass_kg", "ankle_kg"):
            if not getattr(self, name) >= 0.0:
                raise ValueError(f"Shank.{name} is {getattr(self, name)}; expected 0 or more")

    @classmethod
    def of_person(
        cls, body_kg: float, height_m: float, ankle_kg: float = 0.0, femur_deg: float = 0.0
    ) -> Shank:
        """Of a person of usual proportions (Winter 2009).

        Args:
            body_kg: mass of the body.
            height_m: of the body.
            ankle_kg: a weight at the ankle besides.
            femur_deg: as in the attributes.
        """
        length = 1000.0 * LENGTH_SHARE * height_m
        center = (0.0, -CENTER_SHARE * length, 0.0)
        return cls(MASS_SHARE * body_kg, center, ankle_kg, (0.0, -length, 0.0), femur_deg)

    def load(self) -> Load:
        """Both weights as one force in the direction that it keeps in the femur's frame."""
        turn = np.deg2rad(self.femur_deg)
        down = np.array([-np.cos(turn), np.sin(turn), 0.0])
        mass = self.mass_kg + self.ankle_kg
        moments = self.mass_kg * np.array(self.center_mm) + self.ankle_kg * np.array(self.ankle_mm)
        return weight_of(GRAVITY * mass * down, moments / mass if mass else np.zeros(3))


def weight_of(force_N: np.ndarray, point_mm: np.ndarray) -> Load:
    """A weight on the tibia, or none: of one form, so that one compiled program serves all."""
    return Load(np.asarray(force_N, float), point=np.asarray(point_mm, float), name=WEIGHT)
