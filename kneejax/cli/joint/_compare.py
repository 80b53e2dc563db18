"""Compare simple joints, knees and measured motion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from kneejax import files, joints
from kneejax.cli._deliver import deliver
from kneejax.cli._given import check_columns
from kneejax.cli.joint._axes import problem
from kneejax.cli.joint._fit import passive_motion, read_contact_knee
from kneejax.cli.options import JointCompare
from kneejax.parameters import UnsuitableData
from kneejax.report import comparison_answer

#: Flexions of the curves that figures draw.
_CURVE = 25
_SAME_FLEXION_DEG = 1e-3


class Modelled(NamedTuple):
    """What one model says."""

    # Of each subject at its own flexions, shape `(subjects, n, 5)`; NaN without a pose.
    measures: np.ndarray
    curve: np.ndarray  # of each subject over `_over`, shape `(subjects, m, 5)`
    source: tuple[str, ...]  # the files or names that it came from
    # Of each flexion, whether a subject was measured just where its joint was calibrated, shape
    # `(n,)`.
    calibrated: np.ndarray
    doubts: Sequence[str] = ()  # sentences on poses that are missing or in doubt


def _over(flexion_deg: np.ndarray) -> np.ndarray:
    """Flexions of curves, from the least to the most that was measured, `(m,)`, degrees."""
    return np.linspace(flexion_deg.min(), flexion_deg.max(), _CURVE)


def _joint_models(asked: Sequence[str], flexion_deg: np.ndarray) -> dict[str, Modelled]:
    """Models from words `[NAME=]FILE[,FILE...]`, one file for all subjects or one for each."""
    models: dict[str, Modelled] = {}
    for words in asked:
        given, _, listed = words.rpartition("=")
        named = _each_subject("--joint", listed.split(","), len(flexion_deg))
        read = {file: files.read_joint(file) for file in dict.fromkeys(named)}
        name = given or read[named[0]].name
        if name in (*models, joints.MEASURED):
            expected = "a name of its own for every model and none for the measured one: NAME=FILE"
            raise files.InputProblem("--joint", "name", name, expected)
        each = [read[file].joint for file in named]
        models[name] = _of_joints(each, flexion_deg, tuple(read))
    return models


def _each_subject(option: str, named: Sequence[str], subjects: int) -> list[str]:
    """Files of the subjects, of which one may stand for all."""
    if len(named) not in (1, subjects):
        expected = f"one for all, or one for each of {files.counted(subjects, 'subject')}"
        raise files.InputProblem(option, "files", files.counted(len(named), "file"), expected)
    for number, file in enumerate(named, 1):
        if not file.strip():
            raise files.InputProblem(option, f"file {number}", file, "the name of a file")
    return [*named] * (subjects // len(named))


def _fitted_models(
    arguments: JointCompare, tables: np.ndarray, used: np.ndarray
) -> dict[str, Modelled]:
    """Joints fitted here, to the mean of each subject's poses in `used` rows.

    They are a moving axis on the first and the last pose; a generalised axis on all if there are
    more than two; and a hinge, put at the first, if the files of axes have epicondyles.
    """
    listed = [file for words in arguments.axes for file in words.split(",")]
    axes = _each_subject("--axes", listed, len(tables))
    read = {file: files.read_axis_points(file, arguments.side) for file in dict.fromkeys(axes)}
    without = [file for file, one in read.items() if one.epicondyles is None]
    if 0 < len(without) < len(read):
        expected = "epicondyles in every file of --axes, or in none"
        raise files.InputProblem(without[0], "epicondyles", "missing", expected)
    made: dict[str, list[joints.Joint]] = {}
    for k, (file, table) in enumerate(zip(axes, arguments.measured, strict=True)):
        points, epicondyles = read[file].points, read[file].epicondyles
        fixed = points[0] if epicondyles is None else epicondyles
        poses = np.stack([tables[k, near].mean(axis=0) for near in used])
        try:
            ends = joints.fit_joints(poses[[0, -1]], points, fixed)
            made.setdefault("moving axis", []).append(ends.moving)
            if len(poses) > 2:
                through = joints.fit_joints(poses, points, fixed, poses[:, 0]).moving
                made.setdefault("generalised axis", []).append(through)
        except joints.JointProblem as error:
            of_axis = isinstance(error, joints.UnsuitableAxis)
            raise problem(file if of_axis else table, error) from None
        if epicondyles is not None:
            made.setdefault("hinge", []).append(ends.hinge)
    return {name: _of_joints(own, tables[..., 0], tuple(read)) for name, own in made.items()}


def _of_joints(
    each: Sequence[joints.Joint], flexion_deg: np.ndarray, source: tuple[str, ...]
) -> Modelled:
    def measures(joint: joints.Joint, angles: np.ndarray) -> np.ndarray:
        return joints.clinical_measures(joint.pose(jnp.deg2rad(angles)).to_table())

    over, subjects = _over(flexion_deg), list(zip(each, flexion_deg, strict=True))
    exact = [
        np.abs(angles[:, None] - np.rad2deg(joint.flexion)).min(axis=1) < _SAME_FLEXION_DEG
        for joint, angles in subjects
    ]
    return Modelled(
        np.array([measures(*one) for one in subjects]),
        np.array([measures(joint, over) for joint in each]), source, np.any(exact, axis=0),
    )  # fmt: skip


def run(arguments: JointCompare) -> int:
    """Compare models with what was measured."""
    try:  # whether there are subjects enough for the tests that are asked for
        joints.is_tested(len(arguments.measured), arguments.anova)
    except joints.UnsuitableMotions as error:
        raise UnsuitableData(f"--anova: {error}") from error
    tables = _measured(arguments)
    flexion = tables[..., 0]
    # All that can be at fault is read before the knees move, which takes long.
    used = _calibration_rows(arguments, flexion.mean(axis=0))
    models = _joint_models(arguments.joint, flexion)
    for name, one in (_fitted_models(arguments, tables, used) if len(used) else {}).items():
        if name in models:
            expected = "another NAME=FILE; --calibrate-at makes a model of this name"
            raise files.InputProblem("--joint", "name", name, expected)
        models[name] = one
    knees = {}
    for name in arguments.knee:
        knee, offset = read_contact_knee(name)
        if (title := knee.name) in (*models, *knees):
            raise files.InputProblem("--knee", "knee", name, f"every model once; {title} is twice")
        knees[title] = knee, offset, name
    if not models and not knees:
        expected = "a model: --joint, --knee, or --calibrate-at with --axes"
        raise files.InputProblem("joint compare", "models", "none", expected)
    over, at = _over(flexion), flexion.mean(axis=0)
    for title, (knee, offset, name) in knees.items():  # each stands for all subjects
        angles, back = np.unique(np.concatenate([flexion.ravel(), over]), return_inverse=True)
        table, _, doubts = passive_motion(knee, offset, angles)
        seen = joints.clinical_measures(table)[back]
        measures = seen[: flexion.size].reshape(*flexion.shape, -1)
        nowhere = np.zeros(len(at), bool)
        models[title] = Modelled(measures, seen[None, flexion.size :], (name,), nowhere, doubts)
    settings = arguments.options()
    settings["measured"] = [str(file) for file in arguments.measured]
    settings["sources"] = {name: one.source for name, one in models.items()}
    # Where a joint was calibrated on a pose of any subject, that condition predicts nothing.
    known = np.any([*used, *(one.calibrated for one in models.values())], axis=0)
    try:
        found = {name: one.measures for name, one in models.items()}
        compared = joints.compare_motions(
            at, joints.clinical_measures(tables), found, calibrated_at_deg=tuple(at[known]),
            anova=arguments.anova, alpha=arguments.alpha,
        )  # fmt: skip
    except joints.UnsuitableMotions as error:
        named = ", ".join(str(file) for file in arguments.measured)
        raise UnsuitableData(f"{named}: {error}") from error
    answer = comparison_answer(
        compared, {name: one.curve for name, one in models.items()}, over, flexion,
        doubts=[doubt for one in models.values() for doubt in one.doubts], settings=settings,
    )  # fmt: skip
    return deliver(answer, arguments)


def _measured(arguments: JointCompare) -> np.ndarray:
    """Tables of all subjects by flexion, shape `(subjects, n, 6)`."""
    tables, columns = [], arguments.column
    check_columns(columns)
    for file in arguments.measured:
        table = files.read_poses(file, arguments.convention, columns)
        tables.append(table[np.argsort(table[:, 0], kind="stable")])
    first = tables[0]
    for file, table in zip(arguments.measured, tables, strict=True):
        if len(table) != len(first):
            expected = f"{files.counted(len(first), 'flexion')}, as {arguments.measured[0]}"
            raise files.InputProblem(file, "rows", files.counted(len(table), "pose"), expected)
        apart = np.abs(table[:, 0] - first[:, 0])
        if apart.max() > arguments.spread:
            i = int(apart.argmax())
            expected = (
                f"{first[i, 0]:g} within {arguments.spread:g} degrees (--spread), as "
                f"{arguments.measured[0]}"
            )
            raise files.InputProblem(file, "flexion_deg", f"{table[i, 0]:g}", expected)
    return np.array(tables)


def _calibration_rows(arguments: JointCompare, flexion: np.ndarray) -> np.ndarray:
    """Which of the flexions, means over the subjects, joints are fitted at, shape `(k, n)`."""
    rows = np.zeros((0, len(flexion)), bool)
    for angle in sorted(arguments.calibrate_at):
        near = np.abs(flexion - angle) <= arguments.average_within
        expected = ""
        if not near.any():
            expected = (
                f"a flexion within {arguments.average_within:g} degrees of a measured one, of "
                f"{flexion[0]:g} to {flexion[-1]:g} (or another --average-within)"
            )
        elif (rows & near).any():
            expected = f"flexions farther apart than twice {arguments.average_within:g} degrees"
        if expected:
            raise files.InputProblem("--calibrate-at", "degrees", f"{angle:g}", expected)
        rows = np.concatenate([rows, near[None]])
    if len(rows) == 1:
        only = f"{arguments.calibrate_at[0]:g} alone"
        raise files.InputProblem("--calibrate-at", "degrees", only, "two flexions or more")
    return rows
