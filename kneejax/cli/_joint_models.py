"""The models of `kneejax joint compare`: joint files, joints fitted at once, contact knees."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from kneejax.cli._contact_knee import passive_motion, read_contact_knee
from kneejax.files import InputProblem, counted, read_axis_points, read_joint
from kneejax.joints import Joint, UnsuitablePoses, clinical_measures, fit_joints

#: Flexions of the curves that figures draw.
_CURVE = 25


@dataclasses.dataclass(frozen=True)
class Modelled:
    """What one model says.

    Attributes:
        measures: of each subject at its own flexions, shape `(subjects, n, 5)`; NaN without a pose.
        curve: of each subject over `curve_flexion`, shape `(subjects, m, 5)`.
        source: the files or names that it came from.
        calibrated_deg: flexions at which it was calibrated.
        doubts: sentences on poses that are missing or in doubt.
    """

    measures: np.ndarray
    curve: np.ndarray
    source: tuple[str, ...]
    calibrated_deg: tuple[float, ...] = ()
    doubts: tuple[str, ...] = ()


def curve_flexion(flexion_deg: np.ndarray) -> np.ndarray:
    """Flexions from the least to the most that was measured, `(m,)`, degrees."""
    return np.linspace(flexion_deg.min(), flexion_deg.max(), _CURVE)


def joint_models(asked: Sequence[str], flexion_deg: np.ndarray) -> dict[str, Modelled]:
    """Models from joint files.

    Args:
        asked: words `[NAME=]FILE[,FILE...]`, one file for all subjects or one for each.
        flexion_deg: of each subject, shape `(subjects, n)`.

    Returns:
        Name -> model, in the order asked.

    Raises:
        InputProblem: a file is at fault, there are neither one nor as many as subjects, or a name
            comes twice.
    """
    models: dict[str, Modelled] = {}
    for words in asked:
        given, _, files = words.rpartition("=")
        read = [read_joint(file) for file in files.split(",")]
        name = given or read[0].name
        subjects = len(flexion_deg)
        if len(read) not in (1, subjects):
            expected = f"one joint file for all, or one for each of {counted(subjects, 'subject')}"
            raise InputProblem("--joint", name, counted(len(read), "file"), expected)
        if name in models:
            raise InputProblem("--joint", "name", name, "every model once; begin with NAME=")
        joints = [one.joint for one in read] * (subjects // len(read))
        models[name] = _of_joints(joints, flexion_deg, tuple(files.split(",")))
    return models


def fitted_models(
    axes: Path, poses: np.ndarray, flexion_deg: np.ndarray
) -> dict[str, Modelled]:
    """Joints fitted here, to poses of the one subject.

    Args:
        axes: file of axis points.
        poses: calibration poses by increasing flexion, shape `(k, 6)`, degrees and mm.
        flexion_deg: of the subject, shape `(1, n)`.

    Returns:
        `moving axis` on the first and the last pose; `generalised axis` on all if there are more
        than two; `hinge`, put at the first, if the file has epicondyles.

    Raises:
        InputProblem: the file is at fault, its points make no transverse axis, or the poses do not
            do.
    """
    points = read_axis_points(axes)
    fixed = points.points[0] if points.epicondyles is None else points.epicondyles
    try:
        ends = fit_joints(poses[[0, -1]], points.points, fixed)
        made = {"moving axis": ends.moving}
        if len(poses) > 2:
            made["generalised axis"] = fit_joints(
                poses, points.points, fixed, poses[:, 0]
            ).moving
    except UnsuitablePoses as problem:
        expected = "two flexions or more"
        raise InputProblem("--calibrate-at", "degrees", str(problem), expected) from None
    except ValueError as problem:
        raise InputProblem(axes, "axis", str(problem), "a transverse axis") from None
    if points.epicondyles is not None:
        made["hinge"] = ends.hinge
    return {name: _of_joints([one], flexion_deg, (str(axes),)) for name, one in made.items()}


def _of_joints(
    joints: Sequence[Joint], flexion_deg: np.ndarray, source: tuple[str, ...]
) -> Modelled:
    over = curve_flexion(flexion_deg)

    def said(joint: Joint, angles: np.ndarray) -> np.ndarray:
        return clinical_measures(joint.pose(jnp.deg2rad(angles)).to_table())

    return Modelled(
        np.array([said(*pair) for pair in zip(joints, flexion_deg, strict=True)]),
        np.array([said(joint, over) for joint in joints]),
        source,
        tuple(dict.fromkeys(float(x) for j in joints for x in np.rad2deg(j.flexion).round(6))),
    )


def knee_model(name: str, flexion_deg: np.ndarray) -> tuple[str, Modelled]:
    """A contact knee in passive flexion.

    Args:
        name: bundled knee, knee file, or the result.json of a calibration.
        flexion_deg: of each subject, shape `(subjects, n)`; one knee stands for all.

    Returns:
        Its name, and the model; poses that do not balance are NaN and said.

    Raises:
        InputProblem: there is no such knee.
    """
    read = read_contact_knee(name)
    over = curve_flexion(flexion_deg)
    angles, back = np.unique(np.concatenate([flexion_deg.ravel(), over]), return_inverse=True)
    motion = passive_motion(read, angles)
    seen = clinical_measures(motion.table)[back]
    measures = seen[: flexion_deg.size].reshape(*flexion_deg.shape, -1)
    curve = seen[None, flexion_deg.size :]
    return read.title, Modelled(measures, curve, (name,), doubts=motion.doubts)
