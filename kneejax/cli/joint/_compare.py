"""`kneejax joint compare`: joints and contact knees against measured motion, as in paper 5."""

from __future__ import annotations

import numpy as np

from kneejax.cli._deliver import deliver
from kneejax.cli._given import check_columns
from kneejax.cli.joint._models import (
    Modelled,
    curve_flexion,
    each_subject,
    fitted_models,
    joint_models,
    knee_model,
    read_contact_knee,
)
from kneejax.cli.options import JointCompare
from kneejax.files import InputProblem, counted, read_poses
from kneejax.joints import (
    Comparison,
    UnsuitableMotions,
    clinical_measures,
    compare_motions,
    is_tested,
)
from kneejax.parameters import UnsuitableData
from kneejax.report import comparison_answer


def run(arguments: JointCompare) -> int:
    """Compare models with what was measured."""
    _check_tests(arguments)
    tables = _measured(arguments)
    flexion = tables[..., 0]
    # All that can be at fault is read before the knees move, which takes long.
    used = _calibration_rows(arguments, flexion.mean(axis=0))
    models = _joints(arguments, tables, used)
    knees = {}
    for name in arguments.knee:
        read = read_contact_knee(name)
        if read.title in (*models, *knees):
            raise InputProblem("--knee", "knee", name, f"every model once; {read.title} is twice")
        knees[read.title] = (read, name)
    if not models and not knees:
        expected = "a model: --joint, --knee, or --calibrate-at with --axes"
        raise InputProblem("joint compare", "models", "none", expected)
    for title, (read, name) in knees.items():
        models[title] = knee_model(read, name, flexion)
    found = _compared(arguments, tables, models, used)
    settings = arguments.options()
    settings["measured"] = [str(file) for file in arguments.measured]
    settings["sources"] = {name: one.source for name, one in models.items()}
    answer = comparison_answer(
        found, {name: one.curve for name, one in models.items()}, curve_flexion(flexion), flexion,
        doubts=[doubt for one in models.values() for doubt in one.doubts], settings=settings,
    )  # fmt: skip
    return deliver(answer, arguments)


def _check_tests(arguments: JointCompare) -> None:
    """Whether there are subjects enough for the tests that are asked for."""
    try:
        is_tested(len(arguments.measured), arguments.anova)
    except UnsuitableMotions as problem:
        raise UnsuitableData(f"--anova: {problem}") from problem


def _measured(arguments: JointCompare) -> np.ndarray:
    """Tables of all subjects by flexion, shape `(subjects, n, 6)`."""
    tables, columns = [], arguments.column
    check_columns(columns)
    for file in arguments.measured:
        table = read_poses(file, arguments.convention, columns)
        tables.append(table[np.argsort(table[:, 0], kind="stable")])
    first = tables[0]
    for file, table in zip(arguments.measured, tables, strict=True):
        if len(table) != len(first):
            expected = f"{counted(len(first), 'flexion')}, as {arguments.measured[0]}"
            raise InputProblem(file, "rows", counted(len(table), "pose"), expected)
        apart = np.abs(table[:, 0] - first[:, 0])
        if apart.max() > arguments.spread:
            i = int(apart.argmax())
            expected = (
                f"{first[i, 0]:g} within {arguments.spread:g} degrees (--spread), as "
                f"{arguments.measured[0]}"
            )
            raise InputProblem(file, "flexion_deg", f"{table[i, 0]:g}", expected)
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
            raise InputProblem("--calibrate-at", "degrees", f"{angle:g}", expected)
        rows = np.concatenate([rows, near[None]])
    if len(rows) == 1:
        only = f"{arguments.calibrate_at[0]:g} alone"
        raise InputProblem("--calibrate-at", "degrees", only, "two flexions or more")
    return rows


def _joints(
    arguments: JointCompare, tables: np.ndarray, used: np.ndarray
) -> dict[str, Modelled]:
    """Joints from files, and those fitted to the mean of each subject's poses in `used` rows."""
    flexion = tables[..., 0]
    models = joint_models(arguments.joint, flexion)
    if not len(used):
        return models
    poses = np.stack([tables[:, near].mean(axis=1) for near in used], axis=1)
    listed = [file for words in arguments.axes for file in words.split(",")]
    axes = each_subject("--axes", listed, len(tables))
    fitted = fitted_models(axes, arguments.side, arguments.measured, poses, flexion)
    for name in fitted:
        if name in models:
            expected = "another NAME=FILE; --calibrate-at makes a model of this name"
            raise InputProblem("--joint", "name", name, expected)
    return models | fitted


def _compared(
    arguments: JointCompare, tables: np.ndarray, models: dict[str, Modelled], used: np.ndarray
) -> Comparison:
    flexion = tables[..., 0].mean(axis=0)
    # Where a joint was calibrated on a pose of any subject, that condition predicts nothing.
    known = np.any([*used, *(one.calibrated for one in models.values())], axis=0)
    try:
        return compare_motions(
            flexion,
            clinical_measures(tables),
            {name: one.measures for name, one in models.items()},
            calibrated_at_deg=tuple(flexion[known]),
            anova=arguments.anova,
            alpha=arguments.alpha,
        )
    except UnsuitableMotions as problem:
        files = ", ".join(str(file) for file in arguments.measured)
        raise UnsuitableData(f"{files}: {problem}") from problem
