"""Models that are compared with motion: joint files, joints fitted here, contact knees."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from kneejax.cli._progress import stages_on_terminal
from kneejax.experiments import passive_flexion
from kneejax.files import (
    AxisPoints,
    InputProblem,
    counted,
    load_knee,
    read_axis_points,
    read_calibrated,
    read_joint,
)
from kneejax.geometry import COORDINATES
from kneejax.joints import (
    MEASURED,
    Joint,
    UnsuitableAxis,
    UnsuitablePoses,
    clinical_measures,
    fit_joints,
)
from kneejax.mechanics import Knee
from kneejax.report import status_doubts
from kneejax.statics import Status

#: Flexions of the curves that figures draw.
_CURVE = 25
_SAME_FLEXION_DEG = 1e-3


@dataclasses.dataclass(frozen=True)
class ContactKnee:
    """A contact knee that was asked for.

    Attributes:
        knee: with the numbers of its calibration.
        title: what tables and figures call it.
        frame_offset: free coordinate -> what is added to its motion to compare it with the
            measured one, mm or degrees; empty unless a calibration fitted it.
    """

    knee: Knee
    title: str
    frame_offset: Mapping[str, float]


@dataclasses.dataclass(frozen=True)
class KneeMotion:
    """Passive flexion of a contact knee, in the frames of the measurement.

    Attributes:
        table: shape `(n, 6)`, degrees and mm, frame offset added; rows without balance are NaN.
        status: of each pose.
        doubts: a sentence for each status but balanced.
    """

    table: np.ndarray
    status: tuple[Status, ...]
    doubts: tuple[str, ...]


def read_contact_knee(name: str) -> ContactKnee:
    """Read a contact knee.

    Args:
        name: bundled knee, knee file, or the result.json of a calibration.

    Returns:
        The knee.

    Raises:
        InputProblem: there is no such knee.
    """
    knee = load_knee(name)
    calibrated = Path(name).suffix.lower() == ".json"
    offsets = read_calibrated(name).frame_offset if calibrated else {}
    return ContactKnee(knee, knee.name, offsets)


def passive_motion(read: ContactKnee, flexion_deg: np.ndarray) -> KneeMotion:
    """Bend a contact knee.

    Args:
        read: the knee.
        flexion_deg: shape `(n,)`.

    Returns:
        Its motion; poses that do not balance are NaN, and warned of.
    """
    with stages_on_terminal(read.knee.name):
        motion = jax.block_until_ready(passive_flexion(read.knee, flexion_deg))
    table = np.array(motion.to_table())
    for coordinate, shift in read.frame_offset.items():
        table[:, list(COORDINATES).index(coordinate)] += shift
    status = tuple(Status(s) for s in np.asarray(motion.status))
    table[[not s.converged for s in status]] = np.nan
    numbers = np.array([int(one) for one in status])

    def where(rows: np.ndarray) -> str:
        word = status[rows[0]].word
        return f"{read.knee.name}: {counted(len(rows), 'pose')} {word}"

    doubts = status_doubts(numbers, [""] * len(status), where, str)
    return KneeMotion(table, status, tuple(doubts))


@dataclasses.dataclass(frozen=True)
class Modelled:
    """What one model says.

    Attributes:
        measures: of each subject at its own flexions, shape `(subjects, n, 5)`; NaN without a pose.
        curve: of each subject over `curve_flexion`, shape `(subjects, m, 5)`.
        source: the files or names that it came from.
        calibrated: of each flexion, whether a subject was measured just where its joint was
            calibrated, shape `(n,)`.
        doubts: sentences on poses that are missing or in doubt.
    """

    measures: np.ndarray
    curve: np.ndarray
    source: tuple[str, ...]
    calibrated: np.ndarray
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
        given, _, listed = words.rpartition("=")
        files = each_subject("--joint", listed.split(","), len(flexion_deg))
        read = {file: read_joint(file) for file in dict.fromkeys(files)}
        name = given or read[files[0]].name
        if name in (*models, MEASURED):
            expected = "a name of its own for every model and none for the measured one: NAME=FILE"
            raise InputProblem("--joint", "name", name, expected)
        joints = [read[file].joint for file in files]
        models[name] = _of_joints(joints, flexion_deg, tuple(read))
    return models


def each_subject(option: str, files: Sequence[str], subjects: int) -> list[str]:
    """Files of the subjects, of which one may stand for all.

    Args:
        option: that gave them.
        files: their names.
        subjects: how many there are.

    Returns:
        One name per subject.

    Raises:
        InputProblem: there are neither one nor as many as subjects, or a name is empty.
    """
    if len(files) not in (1, subjects):
        expected = f"one for all, or one for each of {counted(subjects, 'subject')}"
        raise InputProblem(option, "files", counted(len(files), "file"), expected)
    for number, file in enumerate(files, 1):
        if not file.strip():
            raise InputProblem(option, f"file {number}", file, "the name of a file")
    return [*files] * (subjects // len(files))


def fitted_models(
    axes: Sequence[str],
    side: str,
    measured: Sequence[Path],
    poses: np.ndarray,
    flexion_deg: np.ndarray,
) -> dict[str, Modelled]:
    """Joints fitted here, to poses of each subject.

    Args:
        axes: file of axis points of each subject.
        side: `right` or `left`: whose points those are.
        measured: the subjects' tables, to name them in an error.
        poses: calibration poses of each subject by increasing flexion, shape `(subjects, k, 6)`,
            degrees and mm.
        flexion_deg: of each subject, shape `(subjects, n)`.

    Returns:
        `moving axis` on the first and the last pose; `generalised axis` on all if there are more
        than two; `hinge`, put at the first, if the files have epicondyles.

    Raises:
        InputProblem: a file is at fault, its points make no transverse axis, the poses do not do,
            or only some files have epicondyles.
    """
    read = {file: read_axis_points(file, side) for file in dict.fromkeys(axes)}
    without = [file for file, one in read.items() if one.epicondyles is None]
    if 0 < len(without) < len(read):
        expected = "epicondyles in every file of --axes, or in none"
        raise InputProblem(without[0], "epicondyles", "missing", expected)
    fits = [
        _fitted(file, read[file], table, own)
        for file, table, own in zip(axes, measured, poses, strict=True)
    ]
    return {
        name: _of_joints([one[name] for one in fits], flexion_deg, tuple(read)) for name in fits[0]
    }


def _fitted(file: str, axes: AxisPoints, table: Path, poses: np.ndarray) -> dict[str, Joint]:
    """The joints of one subject."""
    fixed = axes.points[0] if axes.epicondyles is None else axes.epicondyles
    try:
        ends = fit_joints(poses[[0, -1]], axes.points, fixed)
        made = {"moving axis": ends.moving}
        if len(poses) > 2:
            made["generalised axis"] = fit_joints(poses, axes.points, fixed, poses[:, 0]).moving
    except UnsuitablePoses as problem:
        raise InputProblem(table, problem.field, problem.found, problem.expected) from None
    except UnsuitableAxis as problem:
        raise InputProblem(file, problem.field, problem.found, problem.expected) from None
    return made if axes.epicondyles is None else made | {"hinge": ends.hinge}


def _of_joints(
    joints: Sequence[Joint], flexion_deg: np.ndarray, source: tuple[str, ...]
) -> Modelled:
    def measures(joint: Joint, angles: np.ndarray) -> np.ndarray:
        return clinical_measures(joint.pose(jnp.deg2rad(angles)).to_table())

    over, subjects = curve_flexion(flexion_deg), list(zip(joints, flexion_deg, strict=True))
    exact = [
        np.abs(angles[:, None] - np.rad2deg(joint.flexion)).min(axis=1) < _SAME_FLEXION_DEG
        for joint, angles in subjects
    ]
    return Modelled(
        np.array([measures(*one) for one in subjects]),
        np.array([measures(joint, over) for joint in joints]), source, np.any(exact, axis=0),
    )  # fmt: skip


def knee_model(read: ContactKnee, source: str, flexion_deg: np.ndarray) -> Modelled:
    """A contact knee in passive flexion.

    Args:
        read: the knee.
        source: how it was asked for.
        flexion_deg: of each subject, shape `(subjects, n)`; one knee stands for all.

    Returns:
        The model; poses that do not balance are NaN, with the reason in `status`.
    """
    over = curve_flexion(flexion_deg)
    angles, back = np.unique(np.concatenate([flexion_deg.ravel(), over]), return_inverse=True)
    motion = passive_motion(read, angles)
    seen = clinical_measures(motion.table)[back]
    measures = seen[: flexion_deg.size].reshape(*flexion_deg.shape, -1)
    curve = seen[None, flexion_deg.size :]
    nowhere = np.zeros(flexion_deg.shape[1], bool)
    return Modelled(measures, curve, (source,), nowhere, motion.doubts)
