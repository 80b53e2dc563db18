"""Axis points that stand in for those of paper 5, which were not published."""

from __future__ import annotations

import dataclasses

import numpy as np

from kneejax.mechanics import Knee

#: Whose condyles and ligaments stand in, and how its ligaments are called.
DONOR, _LCL, _MCL = "lenhart2015_reduced", "LCL", "MCLs"
#: From the epicondyles to the femoral attachments of the LCL and of the superficial MCL: posterior
#: and proximal, mm. LaPrade et al. (2003; 2007).
_LCL_FROM_EPICONDYLE, _MCL_FROM_EPICONDYLE = (-3.1, 1.4, 0.0), (-4.8, 3.2, 0.0)
#: Ends of the extension and of the flexion facet, degrees from anterior through distal. `contact`:
#: within 30 degrees of where the tibia touches at 0 and at 87 degrees, as the paper selects them.
#: `iwaki`: before and after 25 degrees of flexion, about where Iwaki et al. (2000) see the medial
#: radius change.
FACETS = {"contact": ((60.0, 120.0), (147.0, 207.0)), "iwaki": ((60.0, 115.0), (115.0, 207.0))}


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

    Centres are those of circles fitted in the sagittal plane to the middle half of each condyle's
    width. As in the paper the lateral flexion centre then slides along the flexion axis until it
    is as far from the medial one as the extension centres are from each other.

    Args:
        knee: with two condyles, medial then lateral, and the ligaments of `DONOR`.
        facets: a key of `FACETS`.

    Returns:
        The points. The long axis is taken to be the femur's Y.
    """
    centres = np.array(
        [[_centre(contact.femoral, *ends) for contact in knee.contacts] for ends in FACETS[facets]]
    )
    extension, flexion = centres
    along = flexion[1] - flexion[0]
    length = np.linalg.norm(extension[1] - extension[0])
    centres[1, 1] = flexion[0] + length * along / np.linalg.norm(along)
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


def _centre(condyle, first_deg: float, last_deg: float) -> np.ndarray:
    """Centre of the circle that fits an arc of a condyle best, in femur axes."""
    low, high = (float(x) for x in condyle.width)
    angles = np.deg2rad(np.linspace(first_deg, last_deg, 61))
    widths = np.linspace(0.75 * low + 0.25 * high, 0.25 * low + 0.75 * high, 9)
    a, b = (x.ravel() for x in np.meshgrid(angles, widths))
    x, y, z = (np.asarray(v) for v in condyle.frame.placement.apply(condyle.point(a, b)))
    equations = np.column_stack([2.0 * x, 2.0 * y, np.ones_like(x)])
    middle = np.linalg.lstsq(equations, x * x + y * y, rcond=None)[0]
    return np.array([middle[0], middle[1], z.mean()])
