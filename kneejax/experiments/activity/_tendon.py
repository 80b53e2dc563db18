"""How much of the quadriceps' pull the patellar tendon hands on, where a knee has no patella."""

from __future__ import annotations

import numpy as np

#: Flexion, degrees, and tension of the patellar tendon by pull of the quadriceps there: passive
#: flexion of the model lenhart2015 of OpenSim JAM, recorded (Lenhart et al., Annals of Biomedical
#: Engineering 43, 2015; Apache-2.0); constant beyond.
FLEXION_DEG = np.arange(0.0, 91.0, 10.0)
TENDON_BY_QUADRICEPS = np.array([1.13, 1.04, 0.86, 0.77, 0.68, 0.59, 0.50, 0.52, 0.55, 0.60])


def tendon_of_quadriceps(quadriceps_N: np.ndarray, flexion_deg: np.ndarray) -> np.ndarray:
    """Tension of the patellar tendon under a pull of the quadriceps, N.

    Args:
        quadriceps_N: of all heads together, `(n,)`.
        flexion_deg: of the tibia, `(n,)`.

    Source: as `TENDON_BY_QUADRICEPS`.

    Example:
        >>> tendon_of_quadriceps(np.array([100.0, 100.0]), np.array([0.0, 65.0])).round(6).tolist()
        [113.0, 51.0]
    """
    return quadriceps_N * np.interp(flexion_deg, FLEXION_DEG, TENDON_BY_QUADRICEPS)
