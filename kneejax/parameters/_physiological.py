"""Which balanced poses are those of a knee that still works as one."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from kneejax.geometry import FREE_COORDINATES

#: How far a pose may be from that of the knee itself, degrees and mm. Clinical tests move no knee
#: as far: 13 mm by 90 N without an ACL, 12 degrees by an axial torque, 7 degrees from varus to
#: valgus (robot tests, n = 12; Komzak 2013; Markolf 1978).
PHYSIOLOGICAL_LIMITS = {
    "adduction": 10.0,
    "internal_rotation": 20.0,
    "anterior": 15.0,
    "superior": 15.0,
    "lateral": 15.0,
}


def unphysiological(table: ArrayLike, own: ArrayLike) -> np.ndarray:
    """Mark poses that have left what a knee does.

    A balance can be stable and yet that of a knee that has come apart: paper 1 calls such motion
    unphysiological, of reference strains far from the usual.

    Args:
        table: free coordinates, degrees and mm, `(..., 5)`.
        own: those of the knee itself, of a shape that broadcasts.

    Returns:
        Truth values of shape `(...)`; a pose that is NaN is not marked, it failed already.

    Source: paper 1, section 3.2; the limits are ours.

    Example:
        >>> unphysiological([[0.0, 5.0, 2.0, 0.0, 1.0], [0.0, 60.0, 2.0, 0.0, 1.0]], 0.0).tolist()
        [False, True]
    """
    limits = [PHYSIOLOGICAL_LIMITS[name] for name in FREE_COORDINATES]
    return np.any(np.abs(np.asarray(table, float) - np.asarray(own, float)) > limits, axis=-1)
