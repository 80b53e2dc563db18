"""Paper 2's octagon: its anterior bundle in eight places on the tibia, by what a plan calls."""

from __future__ import annotations

import dataclasses

import numpy as np

from kneejax.geometry import FEMUR, TIBIA
from kneejax.mechanics import Knee
from kneejax.planning import (
    GRAFTS,
    WINDOW,
    Limits,
    Outcome,
    Protocol,
    Surgery,
    footprint_of,
    octagon,
    reconstruction_of,
)

#: The motion of section 4.3, and the test of 4.2; in how many places flexion is looked at is not
#: printed.
EXTENSION_DEG = np.arange(80.0, -1.0, -2.5)
LACHMAN_DEG, FORCE_N = 20.0, 100.0
#: Pretension of hamstring grafts at the flexion of the test, N; the paper prints none.
TENSION_N = 80.0
#: What a search for an optimum would keep; none is made here.
_NO_LIMITS = Limits(np.inf, np.inf, (1.0, 1000.0))


@dataclasses.dataclass(frozen=True)
class Octagon:
    """What the claims on insertions and bundles are judged by.

    Attributes:
        ligaments: names; the moved bundle is `graft`.
        moved: aACL with its own resting length in the eight corners, all else intact.
        planned: a hamstring graft in the place of both bundles in the eight corners.
        one: laxity with one hamstring graft from end to end of aACL, mm.
        two: the same with a second one, as stiff and as tight, from end to end of pACL, mm.
    """

    ligaments: tuple[str, ...]
    moved: Outcome
    planned: Outcome
    one: float
    two: float


def octagon_study(knee: Knee) -> Octagon:
    """Put paper 2's graft in the corners of its octagon.

    Args:
        knee: with the ten bundles of its Table 1.

    Raises:
        MissingPackage: dtaidistance is not installed.
    """
    own, row = knee.ligaments, knee.ligaments.names.index("aACL")
    bundle = _surgery(knee, "aACL", 1, float(own.stiffness[row]))
    corners = np.zeros((8, 5))
    corners[:, :2], corners[:, 4] = octagon(), TENSION_N
    slack = np.full((8, 1), float(own.slack_length[row]))
    graft = GRAFTS["hamstring"].stiffness_N
    single, double = (_surgery(knee, "ACL", n, n * graft) for n in (1, 2))
    places = np.hstack([single.tibia.fibres, single.femur.fibres, np.full((2, 1), TENSION_N)])
    return Octagon(
        bundle.ligaments,
        bundle.try_out(corners, slack_mm=slack),
        single.try_out(corners),
        float(single.try_out(places[0]).laxity_mm[0, 0]),
        float(double.try_out(places.ravel()).laxity_mm[0, 0]),
    )


def _surgery(knee: Knee, ligament: str, bundles: int, stiffness_N: float) -> Surgery:
    plan = reconstruction_of(knee, ligament, bundles, stiffness_N, np.inf)
    tibia, femur = (footprint_of(knee, ligament, bone) for bone in (TIBIA, FEMUR))
    replaced = (plan.torn,) if bundles == 1 else tuple((name,) for name in plan.torn)
    through = Protocol(EXTENSION_DEG, (LACHMAN_DEG,), FORCE_N)
    return Surgery(plan, tibia, femur, replaced, LACHMAN_DEG, through, WINDOW, _NO_LIMITS)
