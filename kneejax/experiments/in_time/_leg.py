"""Mass, centre and inertia of shank and foot."""

from __future__ import annotations

import numpy as np

from kneejax.experiments.extensor import Shank
from kneejax.mechanics import Mass

#: Radius of gyration of shank and foot about their centre, across, by the shank's length (Winter,
#: Biomechanics and Motor Control of Human Movement, 4th ed. 2009, Table 4.1: leg and foot).
ACROSS = 0.416
#: Of the shank about its own axis, by its length (de Leva, J Biomech 29, 1996, Table 4, males).
SHANK_ALONG = 0.103
#: Of body mass: the foot; of its length from the ankle: radius of gyration about the ankle (Winter
#: 2009, Table 4.1).
FOOT_SHARE, FOOT_FROM_ANKLE = 0.0145, 0.690
#: Of body height: length of the foot (same source, Figure 4.1), half of which is taken for the
#: way from the ankle to the heads of the metatarsals.
FOOT_LENGTH = 0.152


def leg_of_person(body_kg: float, height_m: float, ankle_kg: float = 0.0) -> Mass:
    """Shank and foot of a person of usual proportions, as one rigid body.

    Its centre lies on the tibia's long axis, and the axes of its inertia are the tibia's: the foot
    counts for the moment about the long axis, not for a centre before it.

    Args:
        body_kg: mass of the body.
        height_m: of the body.
        ankle_kg: a weight at the ankle besides.

    Source: Winter (2009), Table 4.1 and Figure 4.1; de Leva (1996), Table 4.

    Example:
        >>> leg = leg_of_person(75.0, 1.75)
        >>> [round(float(x)) for x in (leg.center_mm[1], *np.diag(leg.inertia_kg_mm2))]
        [-261, 146732, 16016, 146732]
    """
    shank = Shank.of_person(body_kg, height_m, ankle_kg)
    length = -shank.ankle_mm[1]
    across = shank.mass_kg * (ACROSS * length) ** 2
    foot_kg = FOOT_SHARE * body_kg
    foot = foot_kg * (FOOT_FROM_ANKLE * 500.0 * FOOT_LENGTH * height_m) ** 2
    along = (shank.mass_kg - foot_kg) * (SHANK_ALONG * length) ** 2 + foot
    leg = Mass(shank.mass_kg, shank.center_mm, np.diag([across, along, across]))
    return leg.with_point(ankle_kg, shank.ankle_mm) if ankle_kg else leg
