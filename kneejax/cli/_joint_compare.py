"""Compare simple joints, knees and measured motion."""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np

from kneejax import files, joints
from kneejax.cli._deliver import deliver
from kneejax.cli._joint_fit import check_columns, passive_motion, problem, read_contact_knee
from kneejax.cli.options.joints import JointCompare
from kneejax.parameters import UnsuitableData
from kneejax.report import comparison_answer

#: Flexions of the curves that figures draw.
_CURVE = 25
_SAME_FLEXION_DEG = 1e-3
#: A joint of each subject, and the files that they come from.
Joints = tuple[list[joints.Joint], tuple[str, ...]]


def _joint_models(asked: Sequence[str], subjects: int) -> dict[str, Joints]:
    """Models from words `[NAME=]FILE[,FILE...]`, one file for all subjects or one for each."""
    models: dict[str, Joints] = {}
    for words in asked:
        given, _, listed = words.rpartition("=")
        named = _each_subject("--joint", listed.split(","), subjects)
        read = {file: files.read_joint(file) for file in dict.fromkeys(named)}
        name = given or read[named[0]].name
        if name in (*models, joints.MEASURED):
            expected = "a name of its own for every model and none for the measured one: NAME=FILE"
            raise files.InputProblem("--joint", "name", name, expected)
        models[name] = [read[file].joint for file in named], tuple(read)
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
) -> dict[str, Joints]:
    """Joints fitted here, to the mean of each subject's poses in `used` rows: a moving axis on the
    first and the last pose; a generalised axis on all if there are more than two; and a hinge, put
    at the first, if the files of axes have epicondyles."""
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
    return {name: (own, tuple(read)) for name, own in made.items()}


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
    simple = _joint_models(arguments.joint, len(flexion))
    for name, one in (_fitted_models(arguments, tables, used) if len(used) else {}).items():
        if name in simple:
            expected = "another NAME=FILE; --calibrate-at makes a model of this name"
            raise files.InputProblem("--joint", "name", name, expected)
        simple[name] = one
    knees = {}
    for name in arguments.knee:
        knee, offset = read_contact_knee(name)
        if (title := knee.name) in (*simple, *knees):
            raise files.InputProblem("--knee", "knee", name, f"every model once; {title} is twice")
        knees[title] = knee, offset, name
    if not simple and not knees:
        expected = "a model: --joint, --knee, or --calibrate-at with --axes"
        raise files.InputProblem("joint compare", "models", "none", expected)
    at, over = flexion.mean(axis=0), np.linspace(flexion.min(), flexion.max(), _CURVE)
    # Of each model: what it says of each subject at its own flexions, `(subjects, n, 5)`, NaN
    # without a pose, and over the flexions of curves, `(subjects, m, 5)`.
    found: dict[str, np.ndarray] = {}
    curves: dict[str, np.ndarray] = {}
    known, doubts = np.any([*used, np.zeros(len(at), bool)], axis=0), []

    def measures(joint: joints.Joint, angles: np.ndarray) -> np.ndarray:
        return joints.clinical_measures(joint.pose(jnp.deg2rad(angles)).to_table())

    for name, (each, _) in simple.items():
        found[name] = np.array([measures(*one) for one in zip(each, flexion, strict=True)])
        curves[name] = np.array([measures(joint, over) for joint in each])
        # Where a joint was calibrated on a pose of any subject, that condition predicts nothing.
        for joint, angles in zip(each, flexion, strict=True):
            away = np.abs(angles[:, None] - np.rad2deg(joint.flexion)).min(axis=1)
            known |= away < _SAME_FLEXION_DEG
    for name, (knee, offset, _) in knees.items():  # each stands for all subjects
        angles, back = np.unique(np.concatenate([flexion.ravel(), over]), return_inverse=True)
        table, _, said = passive_motion(knee, offset, angles)
        seen = joints.clinical_measures(table)[back]
        found[name] = seen[: flexion.size].reshape(*flexion.shape, -1)
        curves[name] = seen[None, flexion.size :]
        doubts += said
    sources = {name: source for name, (_, source) in simple.items()}
    sources |= {title: (name,) for title, (*_, name) in knees.items()}
    settings = arguments.options() | {"sources": sources}
    settings["measured"] = [str(file) for file in arguments.measured]
    try:
        compared = joints.compare_motions(at, joints.clinical_measures(tables), found,
                                          calibrated_at_deg=tuple(at[known]), anova=arguments.anova,
                                          alpha=arguments.alpha)  # fmt: skip
    except joints.UnsuitableMotions as error:
        named = ", ".join(str(file) for file in arguments.measured)
        raise UnsuitableData(f"{named}: {error}") from error
    answer = comparison_answer(compared, curves, over, flexion, doubts=doubts, settings=settings)
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
            expected = (f"{first[i, 0]:g} within {arguments.spread:g} degrees (--spread), as "
                        f"{arguments.measured[0]}")
            raise files.InputProblem(file, "flexion_deg", f"{table[i, 0]:g}", expected)
    return np.array(tables)


def _calibration_rows(arguments: JointCompare, flexion: np.ndarray) -> np.ndarray:
    """Which of the flexions, means over the subjects, joints are fitted at, shape `(k, n)`."""
    rows = np.zeros((0, len(flexion)), bool)
    for angle in sorted(arguments.calibrate_at):
        near = np.abs(flexion - angle) <= arguments.average_within
        expected = ""
        if not near.any():
            expected = (f"a flexion within {arguments.average_within:g} degrees of a measured one, "
                        f"of {flexion[0]:g} to {flexion[-1]:g} (or another --average-within)")
        elif (rows & near).any():
            expected = f"flexions farther apart than twice {arguments.average_within:g} degrees"
        if expected:
            raise files.InputProblem("--calibrate-at", "degrees", f"{angle:g}", expected)
        rows = np.concatenate([rows, near[None]])
    if len(rows) == 1:
        only = f"{arguments.calibrate_at[0]:g} alone"
        raise files.InputProblem("--calibrate-at", "degrees", only, "two flexions or more")
    return rows
