"""Axis points that stand in for those of paper 5, which were not published."""

from __future__ import annotations

import dataclasses

import numpy as np

from kneejax.joints import condyle_axes
from kneejax.mechanics import Knee, condyle_points

#: Whose condyles and ligaments stand in, and how its ligaments are called.
DONOR, _LCL, _MCL = "lenhart2015_reduced", "LCL", "MCLs"
#: From the epicondyles to the femoral attachments of the LCL and of the superficial MCL: posterior
#: and proximal, mm. LaPrade et al., Am J Sports Med 31 (2003), ten knees; J Bone Joint Surg Am 89
#: (2007), eight; both as their abstracts say. Across they say nothing, and 0 is assumed.
_LCL_FROM_EPICONDYLE, _MCL_FROM_EPICONDYLE = (-3.1, 1.4, 0.0), (-4.8, 3.2, 0.0)
#: Ends of the extension and of the flexion facet, degrees from anterior through distal. `contact`:
#: within 30 degrees of where the tibia touches at 0 and at 87 degrees, as the paper selects them.
#: `arcs`: before and after 25 degrees of flexion. Martelli and Pinskerova, J Bone Joint Surg Br 84
#: (2002), see the tibia leave the front segment at 20 +- 10 degrees (abstract). No verdict changes
#: from 15 to 35 degrees.
FACETS = {"contact": ((60.0, 120.0), (147.0, 207.0)), "arcs": ((60.0, 115.0), (115.0, 207.0))}


@dataclasses.dataclass(frozen=True)
class AxisPoints:
    """Where the axes of a femur run, in its anatomical frame.

    The frame is paper 5's: origin midway between the epicondyles, Y the long axis, Z lateral in the
    plane of Y and the epicondyles.

    Attributes:
        facets: extension and flexion facet centres, medial and lateral, shape `(2, 2, 3)`, mm.
        epicondyles: medial and lateral, shape `(2, 3)`, mm.
    """

    facets: np.ndarray
    epicondyles: np.ndarray


def axis_points(knee: Knee, facets: str = "contact") -> AxisPoints:
    """Facet centres and epicondyles of a knee, read off its surfaces and ligaments.

    Centres are those of `kneejax.joints.condyle_axes`, from points of the fitted condyles. (The
    first version fitted circles to half of each condyle's width together, which is round across
    too: residuals of 2.4 mm, radii of 9 mm. It was replaced after its numbers had been seen; the
    criteria were not.)

    Args:
        knee: with two condyles, medial then lateral, and the ligaments of `DONOR`.
        facets: a key of `FACETS`.

    Returns:
        The points. The long axis is taken to be the femur's Y.
    """
    extension_deg, flexion_deg = FACETS[facets]
    centres = condyle_axes(*condyle_points(knee), extension_deg, flexion_deg).points
    names = list(knee.ligaments.names)
    attachments = np.asarray(knee.ligaments.femoral_attachment)
    epicondyles = np.array(
        [
            attachments[names.index(_MCL)] - _MCL_FROM_EPICONDYLE,
            attachments[names.index(_LCL)] - _LCL_FROM_EPICONDYLE,
        ]
    )
    origin, across = epicondyles.mean(axis=0), epicondyles[1] - epicondyles[0]
    turn = np.arctan2(across[0], across[2])
    c, s = np.cos(turn), np.sin(turn)
    axes = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
    return AxisPoints((centres - origin) @ axes.T, (epicondyles - origin) @ axes.T)
