"""Anatomical frames from landmarks."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kneejax.geometry import Pose
from kneejax.joints import (
    UnsuitableLandmarks,
    femur_frame,
    in_frame,
    joint_center,
    pose_between,
    tibia_frame,
)

HIP = np.array([10.0, 410.0, 15.0])
MEDIAL, LATERAL = np.array([0, 2, -41.0]), np.array([3, 0, 42.0])
ANKLE, IN, OUT = np.array([-5.0, -380.0, -4.0]), np.array([1, 0, -36.0]), np.array([0, 1, 37.0])


def _matrix(frame):
    return np.array(frame.rotation, float)


def test_femur_frame_after_paper_5():
    frame = femur_frame(HIP, MEDIAL, LATERAL)
    turn, origin = _matrix(frame), 0.5 * (MEDIAL + LATERAL)
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turn) == pytest.approx(1.0)
    np.testing.assert_allclose(frame.translation, origin)
    # Y points to the hip; the epicondyles lie in the plane of Y and Z, the lateral one along Z.
    np.testing.assert_allclose(turn[:, 1], (HIP - origin) / np.linalg.norm(HIP - origin))
    assert abs(turn[:, 0] @ (LATERAL - MEDIAL)) < 1e-12
    assert turn[:, 2] @ (LATERAL - MEDIAL) > 0


def test_tibia_frame_after_paper_5():
    frame = tibia_frame(ANKLE, IN, OUT)
    up = 0.5 * (IN + OUT) - ANKLE
    np.testing.assert_allclose(_matrix(frame)[:, 1], up / np.linalg.norm(up))
    assert _matrix(frame)[2, 2] > 0.9 and _matrix(frame)[0, 0] > 0.9


def test_frames_move_with_their_landmarks():
    turn, shift = Rotation.random(random_state=3), np.array([50.0, -20.0, 7.0])
    moved = [turn.apply(x) + shift for x in (HIP, MEDIAL, LATERAL)]
    forwards = turn.apply([1.0, 0.0, 0.0])
    frame, other = femur_frame(HIP, MEDIAL, LATERAL), femur_frame(*moved, anterior=forwards)
    np.testing.assert_allclose(_matrix(other), turn.as_matrix() @ _matrix(frame), atol=1e-12)
    points = np.random.default_rng(0).normal(0, 30, (5, 3))
    np.testing.assert_allclose(
        in_frame(other, turn.apply(points) + shift), in_frame(frame, points), atol=1e-10
    )


def test_a_pose_between_anatomical_frames():
    """A point fixed to the tibia is where it was, whichever frames describe the pose."""
    femur, tibia = femur_frame(HIP, MEDIAL, LATERAL), tibia_frame(ANKLE, IN, OUT)
    pose = Pose.from_table([[30.0, 2.0, 5.0, 3.0, -30.0, 1.0]])
    new = pose_between(pose, femur, tibia)
    point = np.array([[7.0, -20.0, 11.0]])

    def moved(by, p):
        return np.stack([np.asarray(c) for c in by.apply(tuple(p.T))], axis=1)

    seen = in_frame(femur, moved(pose.placement, point))
    np.testing.assert_allclose(moved(new.placement, in_frame(tibia, point)), seen, atol=1e-10)


def test_a_femoral_head():
    rng = np.random.default_rng(0)
    ball = rng.normal(0, 1, (400, 3))
    ball = HIP + 24.0 * ball / np.linalg.norm(ball, axis=1)[:, None]
    shaft = rng.uniform(-20, 20, (300, 3)) + [0, 200, 0]
    found = joint_center(np.r_[ball, shaft], HIP + [4, -3, 2], 32.0)
    np.testing.assert_allclose(found.surface.frame.origin, HIP, atol=1e-6)
    assert float(found.surface.radius) == pytest.approx(24.0)
    with pytest.raises(UnsuitableLandmarks, match="does the mesh reach there"):
        joint_center(shaft, HIP, 30.0)


@pytest.mark.parametrize(
    ("landmarks", "said"),
    [
        ((MEDIAL + [0, 0, -400.0], MEDIAL, LATERAL), "nearly collinear"),
        ((0.5 * (MEDIAL + LATERAL), MEDIAL, LATERAL), "nearly collinear"),
        ((HIP, LATERAL, MEDIAL), "changed places, or is this a left knee"),
        ((HIP * [1, 1, -1], MEDIAL * [1, 1, -1], LATERAL * [1, 1, -1]), "left knee"),
        ((HIP * 1e-3, MEDIAL * 1e-3, LATERAL * 1e-3), "are they in metres"),
        ((HIP, MEDIAL, MEDIAL), "0 mm apart"),
        ((HIP, [0, np.nan, 0], LATERAL), "three finite numbers"),
    ],
)
def test_bad_landmarks_are_named(landmarks, said):
    with pytest.raises(UnsuitableLandmarks, match=said):
        femur_frame(*landmarks)
