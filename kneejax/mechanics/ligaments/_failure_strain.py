"""Strain at which a ligament tears, as published, and what is wrong with a knee's fibres."""

from __future__ import annotations

from collections.abc import Sequence

import equinox as eqx
import numpy as np
from jax import Array

#: Strain at which ligaments failed in tension, human tissue: the kind, as it stands in a fibre's
#: name, and its mean. Fascicle-bone units of cruciate and lateral collateral ligaments: 15.0 %
#: (Butler, Kay and Stouffer, J Biomech 19, 1986); the medial collateral along its fibres: 17.1 %
#: (Quapp and Weiss, J Biomech Eng 120, 1998); the posterior cruciate's main bundle: 18.0 % (Race
#: and Amis, J Biomech 27, 1994).
FAILURE_STRAIN = {"PCL": 0.18, "MCL": 0.17, "ACL": 0.15, "LCL": 0.15}
#: Who measured them, in a line for a knee file.
FAILURE_SOURCE = "published (Butler 1986; Quapp and Weiss 1998; Race and Amis 1994)"
#: Of any other: Butler's mean of knee ligaments.
USUAL_FAILURE_STRAIN = 0.15


class FibreFaults(eqx.Module):
    """What is wrong with any fibre of a knee, each of the shape of the poses.

    Attributes:
        overstretched: strained beyond its failure strain.
        past_wrap: touches its cylinder beyond the cylinder's length.
        wrap_inside: has an end inside its obstacle.
    """

    overstretched: Array
    past_wrap: Array
    wrap_inside: Array


def usual_failure_strain(names: Sequence[str]) -> np.ndarray:
    """Published failure strain of fibres, by the kind that their names tell.

    Args:
        names: of the fibres.

    Returns:
        Shape `(n,)`.

    Example:
        >>> usual_failure_strain(["ACLam1", "PCL", "pCAP3"]).tolist()
        [0.15, 0.18, 0.15]
    """
    return np.array([_of(name.upper()) for name in names], float)


def _of(name: str) -> float:
    known = (strain for kind, strain in FAILURE_STRAIN.items() if kind in name)
    return next(known, USUAL_FAILURE_STRAIN)
