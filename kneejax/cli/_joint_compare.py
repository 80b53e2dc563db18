"""`kneejax joint compare`: joints and contact knees against measured motion, as in paper 5."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from kneejax.cli._joint_models import (
    Modelled,
    curve_flexion,
    fitted_models,
    joint_models,
    knee_model,
)
from kneejax.files import InputProblem, counted, read_poses, write_rows, write_text
from kneejax.inference import UnsuitableData, versions
from kneejax.joints import Comparison, UnsuitableMotions, clinical_measures, compare_motions

_CONVENTIONS = ("femoral", "grood-suntay", "tibial", "femur-in-tibia")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `kneejax joint compare`."""
    parser.add_argument(
        "measured", type=Path, nargs="+", help="CSV of measured poses, one file a subject"
    )
    parser.add_argument("--convention", choices=_CONVENTIONS, default="femoral")
    parser.add_argument(
        "--joint",
        action="append",
        default=[],
        metavar="[NAME=]FILE[,FILE...]",
        help="joint file for all subjects, or one for each, in their order; may be repeated",
    )
    parser.add_argument(
        "--knee",
        action="append",
        default=[],
        help="contact knee in passive flexion: bundled name, knee file, or the result.json of a "
        "calibration; may be repeated",
    )
    parser.add_argument(
        "--calibrate-at",
        type=float,
        nargs="+",
        default=[],
        metavar="DEGREES",
        help="fit moving axis and hinge here, on the poses at these flexions with the points of "
        "--axes; and leave those poses out of the comparison",
    )
    parser.add_argument(
        "--average-within",
        type=float,
        default=0.5,
        metavar="DEGREES",
        help="poses as near as this to a flexion of calibration are averaged for it (0.5)",
    )
    parser.add_argument(
        "--axes", type=Path, metavar="FILE", help="YAML of axis points, as for kneejax joint fit"
    )
    parser.add_argument(
        "--spread",
        type=float,
        default=1.0,
        metavar="DEGREES",
        help="by how much subjects may be flexed differently at one condition (1)",
    )
    parser.add_argument(
        "--anova",
        action=argparse.BooleanOptionalAction,
        help="test differences (package pingouin); by default from three subjects on",
    )
    parser.add_argument("--alpha", type=float, default=0.01)
    parser.add_argument("--out", type=Path, default=Path("kneejax-joint-compare"))


def run(arguments: argparse.Namespace) -> int:
    """Compare, print tables, write them with a figure."""
    tables = _measured(arguments)
    flexion = tables[..., 0]
    # All that can be at fault is read before the knees, which take long.
    calibration, used = _calibration(arguments, tables)
    models = joint_models(arguments.joint, flexion)
    models |= fitted_models(arguments.axes, calibration, flexion) if used.any() else {}
    for name in arguments.knee:
        title, model = knee_model(name, flexion)
        if title in models:
            raise InputProblem("--knee", "knee", name, f"every model once; {title} is twice")
        models[title] = model
    if not models:
        expected = "a model: --joint, --knee, or --calibrate-at with --axes"
        raise InputProblem("joint compare", "models", "none", expected)
    found = _compared(arguments, tables, models, used)
    doubts = (*(doubt for one in models.values() for doubt in one.doubts), *found.doubts)
    _write(arguments, found, models, flexion, doubts)
    return 1 if doubts else 0


def _measured(arguments: argparse.Namespace) -> np.ndarray:
    """Tables of all subjects by flexion, shape `(subjects, n, 6)`."""
    tables = []
    for file in arguments.measured:
        table = read_poses(file, arguments.convention)
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


def _calibration(
    arguments: argparse.Namespace, tables: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Mean poses of the first subject near each flexion of calibration, and which rows they are."""
    used = np.zeros(tables.shape[1], bool)
    if not arguments.calibrate_at or arguments.axes is None:
        if arguments.calibrate_at or arguments.axes is not None:
            missing = "--axes" if arguments.axes is None else "--calibrate-at"
            raise InputProblem(missing, "option", "missing", "both --calibrate-at and --axes")
        return np.empty((0, 6)), used
    if len(tables) > 1:
        expected = "one subject; fit each with kneejax joint fit, and give the files by --joint"
        raise InputProblem("--calibrate-at", "subjects", str(len(tables)), expected)
    poses = []
    for angle in sorted(arguments.calibrate_at):
        near = np.abs(tables[0, :, 0] - angle) <= arguments.average_within
        if not near.any():
            low, high = tables[0, 0, 0], tables[0, -1, 0]
            expected = (
                f"a flexion within {arguments.average_within:g} degrees of a measured one, of "
                f"{low:g} to {high:g} (or another --average-within)"
            )
            raise InputProblem("--calibrate-at", "degrees", f"{angle:g}", expected)
        if (used & near).any():
            expected = f"flexions farther apart than twice {arguments.average_within:g} degrees"
            raise InputProblem("--calibrate-at", "degrees", f"{angle:g}", expected)
        used |= near
        poses.append(tables[0, near].mean(axis=0))
    return np.array(poses), used


def _compared(
    arguments: argparse.Namespace, tables: np.ndarray, models: dict[str, Modelled], used: np.ndarray
) -> Comparison:
    flexion = tables[..., 0].mean(axis=0)
    # Where a joint file was calibrated on a pose of any subject, that condition foretells nothing.
    knots = np.array([x for one in models.values() for x in one.calibrated_deg])
    if knots.size and not used.any():
        used = np.any(np.abs(tables[..., :1] - knots) < 1e-3, axis=(0, 2)).reshape(-1)
    try:
        return compare_motions(
            flexion,
            clinical_measures(tables),
            {name: one.measures for name, one in models.items()},
            calibrated_at_deg=tuple(flexion[used]),
            anova=arguments.anova,
            alpha=arguments.alpha,
        )
    except UnsuitableMotions as problem:
        raise UnsuitableData(str(problem)) from problem


def _write(
    arguments: argparse.Namespace,
    found: Comparison,
    models: dict[str, Modelled],
    flexion: np.ndarray,
    doubts: tuple[str, ...],
) -> None:
    from kneejax.report import _joint_comparison_text as text
    from kneejax.report import joint_comparison_figure, save_figure

    out = arguments.out
    tables = {
        "summary.csv": (text.SUMMARY_COLUMNS, text.summary_rows),
        "differences.csv": (text.DIFFERENCE_COLUMNS, text.difference_rows),
        "predictions.csv": (text.PREDICTION_COLUMNS, text.prediction_rows),
    }
    if found.tests:
        tables["tests.csv"] = (text.TEST_COLUMNS, text.test_rows)
    for name, (columns, rows) in tables.items():
        write_rows(out / name, list(columns), rows(found))
    settings = {
        name: value if not isinstance(value, Path) else str(value)
        for name, value in vars(arguments).items()
        if name not in ("command", "kind", "run", "parser", "out", "measured")
    }
    settings["measured"] = [str(file) for file in arguments.measured]
    settings["sources"] = {name: one.source for name, one in models.items()}
    document = text.joint_comparison_document(found, settings, versions())
    document["doubts"] = list(doubts)
    write_text(out / "result.json", json.dumps(document, indent=1) + "\n")
    figure = joint_comparison_figure(
        found,
        curve_flexion(flexion),
        {name: one.curve for name, one in models.items()},
        flexion,
    )
    save_figure(figure, out / "figures", "joints")
    print(text.joint_comparison_summary(found))
    for doubt in doubts[: len(doubts) - len(found.doubts)]:
        print(f"! {doubt}")
    print(f"written: {out}/{', '.join(tables)}, result.json, figures/joints.png")
