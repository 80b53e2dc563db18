"""Paper 5's constraint equations, written out in NumPy for one pose: shares no code with kneejax.

Four segments: femur (F), tibia (T), and between them an invisible femur (IF) and an invisible
tibia (IT). The femur is the global frame.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

_LATERAL = np.array([0.0, 0.0, 1.0])


def tibia_in_femur(row):
    """Rotation and place of the tibia from a row of degrees and mm."""
    flexion, adduction, internal = row[:3]
    turn = Rotation.from_euler("ZXY", [-flexion, adduction, internal], degrees=True)
    return turn.as_matrix(), np.asarray(row[3:], float)


def untwisted(axis):
    """An invisible segment in its bone: Z along the axis, no turn about Z in the order Z, X, Y."""
    z = axis / np.linalg.norm(axis)
    about_y = np.arcsin(z[0])
    about_x = np.arctan2(-z[1], z[2])
    return Rotation.from_euler("XY", [about_x, about_y]).as_matrix()


def linear_points(knots_deg, points, flexion_deg):
    """Eqs 2 and 3: `(2, 3)` from `(2, 2, 3)`."""
    share = (flexion_deg - knots_deg[0]) / (knots_deg[1] - knots_deg[0])
    share = min(max(share, 0.0), 1.0)
    return points[0] * (1.0 - share) + points[1] * share


def residual(row, femoral, tibial, flexion_deg):
    """Eq 1 and the driver of Eq 4 at a pose, with each invisible segment where its bone wants it.

    The invisible segments are placed by the equations about their medial point, their Z angle and
    the lateral point; what is left are those that tie both together, and all are returned.

    Args:
        row: pose, degrees and mm.
        femoral: medial and lateral point in the femur, `(2, 3)`.
        tibial: in the tibia.
        flexion_deg: prescribed.

    Returns:
        Residuals, mm, and sines and differences of rotation matrices without unit.
    """
    turn, place = tibia_in_femur(row)
    a_if, r_if = untwisted(femoral[1] - femoral[0]), femoral[0]
    a_it = turn @ untwisted(tibial[1] - tibial[0])
    r_it = place + turn @ tibial[0]
    lateral_f, lateral_t = femoral[1], place + turn @ tibial[1]
    z_femur = Rotation.from_matrix(a_if).as_euler("ZXY")[0]
    z_tibia = Rotation.from_matrix(turn.T @ a_it).as_euler("ZXY")[0]
    flexion = -Rotation.from_matrix(turn).as_euler("ZXY")[0]
    hinge = a_if.T @ a_it @ _LATERAL
    return np.r_[
        (a_if.T @ (lateral_f - r_if))[:2],  # lateral points on their segment's axis
        (a_it.T @ (lateral_t - r_it))[:2],
        z_femur,
        z_tibia,
        r_if - r_it,  # a revolute joint: one origin, one axis
        hinge[:2],
        flexion - np.deg2rad(flexion_deg),
    ]
