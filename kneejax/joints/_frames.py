"""Frames of the bones for simple joints, and what is wrong with them.

The frames have the package's names: X anterior, Y superior, Z lateral of a right knee. (Paper 5
calls them Y, Z and, to medial, X.)
"""

__all__ = [
    "JointProblem", "UnsuitableAxis", "UnsuitableLandmarks", "UnsuitableMesh", "UnsuitablePoses",
    "femur_frame", "in_frame", "joint_center", "pose_between", "tibia_frame",
]

import numpy as np
from jax.typing import ArrayLike

from kneejax.geometry import (
    Matrix,
    Placement,
    Pose,
    SurfaceFit,
    Vector,
    angles_from_rotation,
    fit_sphere,
)
from kneejax.numerics import WrongValue


class JointProblem(WrongValue):
    """Input from which no joint can be made; `field` is the part that it is about.

    Example:
        >>> print(JointProblem("poses", "1 row", "at least 2"))
        poses: 1 row; expected at least 2
    """


class UnsuitableMesh(JointProblem):
    """A mesh in which axes of condyles cannot be found."""


class UnsuitableLandmarks(JointProblem):
    """Landmarks that make no anatomical frame."""


class UnsuitableAxis(JointProblem):
    """Points or calibration angles that make no axis of a knee."""


class UnsuitablePoses(JointProblem):
    """Measured poses on which no joint can be calibrated."""


# Medial and lateral landmarks of an adult's knee are about 80 mm apart, of a child's half of that.
_WIDTH_MM = (20.0, 200.0)
_LEAST_ANGLE_DEG = 10.0
_FEWEST_POINTS = 20


def femur_frame(
    hip_center: ArrayLike,
    medial_epicondyle: ArrayLike,
    lateral_epicondyle: ArrayLike,
    anterior: ArrayLike | None = (1.0, 0.0, 0.0),
) -> Placement:
    """Frame of the femur: Y to the hip's centre, Z along the epicondyles as far as normal to Y.

    Args:
        hip_center: centre of the femoral head, shape `(3,)`, mm, in any frame (the mesh's).
        medial_epicondyle: likewise.
        lateral_epicondyle: likewise.
        anterior: roughly forwards in that frame, to tell a right knee from a left one; None leaves
            it untold.

    Returns:
        The motion from the anatomical frame, whose origin is midway between the epicondyles, to
        the frame of the landmarks.

    Raises:
        UnsuitableLandmarks: they are nearly collinear, not a knee's width apart in mm, or the
            frame's X points backwards.

    Source: paper 5, Figure 2; Grood and Suntay (1983).

    Example:
        >>> frame = femur_frame([0.0, 400.0, 5.0], [0.0, 0.0, -40.0], [0.0, 0.0, 50.0])
        >>> [float(x) for x in frame.translation], [float(x) for x in frame.turn((0.0, 1.0, 0.0))]
        ([0.0, 0.0, 5.0], [0.0, 1.0, 0.0])
    """
    names = "hip centre", "medial epicondyle", "lateral epicondyle"
    return _frame(names, (hip_center, medial_epicondyle, lateral_epicondyle), 1.0, anterior)


def tibia_frame(
    ankle_center: ArrayLike,
    medial_edge: ArrayLike,
    lateral_edge: ArrayLike,
    anterior: ArrayLike | None = (1.0, 0.0, 0.0),
) -> Placement:
    """Frame of the tibia: Y from the ankle's centre, Z along the plateau's edges, normal to Y.

    Args:
        ankle_center: centre of the talocrural joint, or midway between the malleoli, shape `(3,)`,
            mm, in any frame (the mesh's).
        medial_edge: of the plateau, likewise.
        lateral_edge: likewise.
        anterior: roughly forwards in that frame; None leaves it untold.

    Returns:
        The motion from the anatomical frame, whose origin is midway between the edges, to the
        frame of the landmarks.

    Raises:
        UnsuitableLandmarks: as in `femur_frame`.

    Source: paper 5, Figure 2; Grood and Suntay (1983).

    Example:
        >>> frame = tibia_frame([0.0, -380.0, 0.0], [0.0, 0.0, -35.0], [0.0, 0.0, 35.0])
        >>> [round(float(x), 6) for x in frame.translation]
        [0.0, 0.0, 0.0]
    """
    names = "ankle centre", "medial edge", "lateral edge"
    return _frame(names, (ankle_center, medial_edge, lateral_edge), -1.0, anterior)


def pose_between(pose: Pose, femur: Placement, tibia: Placement) -> Pose:
    """A pose between other frames of the bones.

    Args:
        pose: of the tibia's old frame in the femur's, fields of shape `(lanes,)`.
        femur: from the femur's new frame to its old one, as of `femur_frame`.
        tibia: likewise.

    Returns:
        The pose of the tibia's new frame in the femur's.

    Example:
        >>> from kneejax.geometry import Pose, Vector
        >>> pose = Pose.from_table([[0.0, 0.0, 0.0, 1.0, 2.0, 3.0]])
        >>> still = Placement(None, Vector(0.0, 0.0, 0.0))
        >>> lifted = Placement(None, Vector(0.0, 2.0, 0.0))
        >>> pose_between(pose, lifted, still).to_table().round(6).tolist()
        [[0.0, 0.0, 0.0, 1.0, 0.0, 3.0]]
    """
    new = femur.inverse().after(pose.placement).after(tibia)
    return Pose(*angles_from_rotation(new.rotation), *new.translation.full())


def in_frame(frame: Placement, points: ArrayLike) -> np.ndarray:
    """Points in an anatomical frame.

    Args:
        frame: from the anatomical frame to the points'.
        points: shape `(n, 3)`, mm.

    Returns:
        Shape `(n, 3)`, mm.

    Example:
        >>> from kneejax.geometry import Vector
        >>> in_frame(Placement(None, Vector(0.0, 10.0, 0.0)), [[5.0, 12.0, 0.0]]).tolist()
        [[5.0, 2.0, 0.0]]
    """
    local = frame.apply_inverse(Vector.of(np.asarray(points, float).T))
    return np.stack(np.broadcast_arrays(*map(np.asarray, local)), axis=1)


def joint_center(points: ArrayLike, near: ArrayLike, within_mm: float) -> SurfaceFit:
    """Centre of a ball of bone (femoral head, half a malleolus or talus): a sphere near a place.

    Args:
        points: of the bone's mesh, shape `(n, 3)`, mm.
        near: roughly the centre, shape `(3,)`, mm.
        within_mm: points as near as this belong to the ball.

    Returns:
        The sphere; its centre is `surface.frame.origin`.

    Raises:
        UnsuitableLandmarks: fewer than 20 points are as near, or they lie on no sphere.

    Example:
        >>> ball = np.random.default_rng(1).normal(size=(200, 3))
        >>> points = 24.0 * ball / np.linalg.norm(ball, axis=1, keepdims=True) + [4.0, 400.0, 0.0]
        >>> found = joint_center(points, [5.0, 398.0, 1.0], 30.0)
        >>> [round(float(x), 3) for x in found.surface.frame.origin]
        [4.0, 400.0, 0.0]
    """
    points = np.asarray(points, float)
    rows = np.linalg.norm(points - np.asarray(near, float), axis=1) < within_mm
    place = "(" + ", ".join(f"{x:.0f}" for x in np.asarray(near, float)) + ") mm"
    if rows.sum() < _FEWEST_POINTS:
        what, expected = f"points within {within_mm:g} mm of {place}", f"at least {_FEWEST_POINTS}"
        doubt = "does the mesh reach there, and is it in mm?"
        raise UnsuitableLandmarks(what, str(int(rows.sum())), f"{expected}; {doubt}")
    try:
        return fit_sphere(points[rows])
    except ValueError as error:
        raise UnsuitableLandmarks(f"ball at {place}", str(error), "a sphere") from None


def _frame(names, landmarks, sense: float, anterior) -> Placement:
    far, medial, lateral = (np.asarray(x, float) for x in landmarks)
    for name, point in zip(names, (far, medial, lateral), strict=True):
        if point.shape != (3,) or not np.isfinite(point).all():
            raise UnsuitableLandmarks(name, str(point.tolist()), "three finite numbers")
    across = lateral - medial
    width = float(np.linalg.norm(across))
    pair, all_three = f"{names[1]} and {names[2]}", ", ".join(names)
    if not _WIDTH_MM[0] < width < _WIDTH_MM[1]:
        doubt = "are they in metres?" if width < 1.0 else "are they of one knee, in mm?"
        expected = f"{_WIDTH_MM[0]:g} to {_WIDTH_MM[1]:g} mm; {doubt}"
        raise UnsuitableLandmarks(pair, f"{width:.3g} mm apart", expected)
    origin = 0.5 * (medial + lateral)
    long = sense * (far - origin)
    length = np.linalg.norm(long)
    normal = np.cross(long, across)
    sine = np.linalg.norm(normal) / max(width * length, 1e-9)
    if sine < np.sin(np.deg2rad(_LEAST_ANGLE_DEG)):
        found = f"nearly collinear ({np.rad2deg(np.arcsin(sine)):.1f} degrees)"
        expected = f"an angle of at least {_LEAST_ANGLE_DEG:g} degrees"
        raise UnsuitableLandmarks(all_three, found, expected)
    x, y = normal / np.linalg.norm(normal), long / length
    if anterior is not None and x @ np.asarray(anterior, float) <= 0:
        doubt = f"have {pair} changed places, or is this a left knee that was not mirrored?"
        found = "X of the frame points backwards"
        raise UnsuitableLandmarks(all_three, found, f"X forwards; {doubt}")
    axes = Matrix(*(Vector(*axis.tolist()) for axis in (x, y, np.cross(x, y))))
    return Placement(axes.T, Vector(*origin.tolist()))
