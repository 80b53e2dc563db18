"""`kneejax joint fit POSES.csv --femur MESH | --axes FILE`."""

from __future__ import annotations

import argparse
import dataclasses
import json
from pathlib import Path

import numpy as np

from kneejax.files import (
    InputProblem,
    JointFile,
    parse_flexion,
    read_axis_points,
    read_femur_landmarks,
    read_mesh_points,
    read_poses,
    write_joint,
    write_poses,
    write_rows,
    write_text,
)
from kneejax.geometry import FREE_COORDINATES
from kneejax.joints import (
    CondyleAxes,
    JointFit,
    JointProblem,
    UnsuitableLandmarks,
    UnsuitableMesh,
    UnsuitablePoses,
    condyle_axes,
    femur_frame,
    fit_joints,
    in_frame,
    joint_center,
)

_MIRROR = np.array([1.0, 1.0, -1.0])
_FACET_COLUMNS = (
    "side", "facet", "points", "radius_mm", "rms_mm", "center_anterior_mm", "center_superior_mm",
    "center_lateral_mm", "center_error_mm", "direction_anterior", "direction_superior",
    "direction_lateral", "direction_error_deg", "own_direction",
)  # fmt: skip


@dataclasses.dataclass(frozen=True)
class _Axes:
    """Axis points of the femur, in the frame of the poses, and where they come from."""

    points: np.ndarray
    hinge: np.ndarray
    hinge_source: str
    mesh: np.ndarray | None = None
    facets: CondyleAxes | None = None


def run(arguments: argparse.Namespace) -> int:
    """Calibrate the joints, write them, their motion and figures, print a summary."""
    measured = read_poses(arguments.poses, arguments.convention)
    flexion = parse_flexion(arguments.flexion)
    axes = _from_file(arguments) if arguments.femur is None else _from_mesh(arguments)
    try:
        fit = fit_joints(
            measured, axes.points, axes.hinge, arguments.at or (), arguments.interpolation
        )
    except UnsuitablePoses as error:
        raise _problem(arguments.poses, error) from None
    except ValueError as error:
        found, _, rest = str(error).partition("; ")
        expected = "a transverse axis" + (f"; {rest}" if rest else "")
        raise InputProblem(arguments.femur or arguments.axes, "axis", found, expected) from None
    _write(arguments, fit, axes, measured, flexion)
    print(_summary(fit, axes, len(measured)))
    files = ["joint.yaml", "hinge.yaml", "poses.csv", "hinge_poses.csv", "result.json"]
    files += ["facets.csv"] if axes.facets else []
    print(f"written to {arguments.out}:\n{', '.join(files)}, figures/")
    return 0


def _from_file(arguments: argparse.Namespace) -> _Axes:
    found = read_axis_points(arguments.axes, arguments.side)
    given = _given_epicondyles(arguments)
    known = found.epicondyles if given is None else given
    if known is not None:
        return _Axes(found.points, known, "the epicondyles")
    return _Axes(found.points, found.points[0], "the extension axis (no epicondyles are given)")


def _from_mesh(arguments: argparse.Namespace) -> _Axes:
    mesh = read_mesh_points(arguments.femur, arguments.unit)
    points, normals = mesh.points_mm, mesh.normals
    if arguments.side == "left":
        points, normals = points * _MIRROR, normals * _MIRROR
    epicondyles = _given_epicondyles(arguments)
    if arguments.landmarks is not None:
        frame, epicondyles = _anatomical(arguments, points, epicondyles)
        points, normals = in_frame(frame, points), _turned_back(frame, normals)
    try:
        found = condyle_axes(
            points, normals, tuple(arguments.extension_facet), tuple(arguments.flexion_facet)
        )
    except UnsuitableMesh as error:
        raise _problem(arguments.femur, error) from None
    if epicondyles is not None:
        return _Axes(found.points, epicondyles, "the epicondyles", points, found)
    axis = found.transverse
    along = (found.points[0] - axis.center) @ axis.direction
    ends = axis.center + along[:, None] * axis.direction
    source = "the cylinder through both condyles (no epicondyles are given)"
    return _Axes(found.points, ends, source, points, found)


def _problem(file: Path, error: JointProblem) -> InputProblem:
    return InputProblem(file, error.part, error.found, error.expected)


def _given_epicondyles(arguments: argparse.Namespace) -> np.ndarray | None:
    both = arguments.medial_epicondyle, arguments.lateral_epicondyle
    if both == (None, None):
        return None
    if None in both:
        missing = "--medial-epicondyle" if both[0] is None else "--lateral-epicondyle"
        raise InputProblem(missing, "point", "missing", "both epicondyles, or none")
    return np.array(both) * (_MIRROR if arguments.side == "left" else 1.0)


def _anatomical(arguments: argparse.Namespace, points: np.ndarray, epicondyles):
    """The anatomical frame of the femur in its mesh's, and the epicondyles in it."""
    known = read_femur_landmarks(arguments.landmarks, arguments.side)
    epicondyles = known.epicondyles if epicondyles is None else epicondyles
    try:
        hip = known.hip_center
        if known.head_within is not None:
            hip = np.asarray(joint_center(points, hip, known.head_within).surface.frame.origin)
        frame = femur_frame(hip, *epicondyles, anterior=None)
    except UnsuitableLandmarks as error:
        raise _problem(arguments.landmarks, error) from None
    return frame, in_frame(frame, epicondyles)


def _turned_back(frame, normals: np.ndarray) -> np.ndarray:
    return np.stack([np.asarray(c) for c in frame.turn_back(tuple(normals.T))], axis=1)


def _write(arguments, fit: JointFit, axes: _Axes, measured, flexion) -> None:
    from kneejax.inference import versions
    from kneejax.report import joint_axes_figure, joint_motion_figure, save_figure

    out, name = arguments.out, arguments.out.name or "joint"
    origin = arguments.femur or arguments.axes
    angles = ", ".join(f"{x:.1f}" for x in fit.poses[:, 0])
    source = f"{arguments.poses.name} at {angles} degrees; axes from {origin.name}"
    for joint, file, what in (
        (fit.moving, "joint.yaml", source),
        (fit.hinge, "hinge.yaml", f"{arguments.poses.name}; axis through {axes.hinge_source}"),
    ):
        kind = name if file == "joint.yaml" else f"{name} hinge"
        write_joint(JointFile(joint, kind, arguments.side, what), out / file)
    for joint, file in ((fit.moving, "poses.csv"), (fit.hinge, "hinge_poses.csv")):
        write_poses(out / file, np.asarray(joint.pose(np.deg2rad(flexion)).to_table()))
    if axes.facets is not None:
        write_rows(out / "facets.csv", list(_FACET_COLUMNS), _facet_rows(axes.facets))
    document = {
        "poses": arguments.poses.name,
        "convention": arguments.convention,
        "axes": origin.name,
        "calibration_flexion_deg": fit.poses[:, 0].tolist(),
        "interpolation": fit.moving.interpolation,
        "hinge": axes.hinge_source,
        "rmse": {
            joint: dict(zip(FREE_COORDINATES, row.tolist(), strict=True))
            for joint, row in zip(("moving", "hinge"), fit.rmse, strict=True)
        },
        "versions": versions(),
    }
    write_text(out / "result.json", json.dumps(document, indent=1) + "\n")
    figures = out / "figures"
    drawn = joint_axes_figure(fit.moving, fit.hinge, axes.mesh, axes.facets)
    save_figure(drawn, figures, "axes")
    dense = np.linspace(flexion.min(), flexion.max(), 241)
    joints = {_kind(fit): fit.moving, "hinge": fit.hinge}
    save_figure(joint_motion_figure(joints, measured, fit.rows, dense), figures, "motion")


def _facet_rows(axes: CondyleAxes) -> list[list]:
    return [
        [
            f.side, f.name, len(f.rows), f.cylinder.radius, f.cylinder.rms, *f.center,
            f.cylinder.center_error, *f.cylinder.direction, f.cylinder.direction_error_deg,
            f.turned,
        ]
        for f in axes.facets
    ]  # fmt: skip


def _kind(fit: JointFit) -> str:
    return "moving axis" if len(fit.rows) == 2 else f"axis through {len(fit.rows)} poses"


def _summary(fit: JointFit, axes: _Axes, count: int) -> str:
    angles = ", ".join(f"{x:.1f}" for x in fit.poses[:, 0])
    lines = [f"{_kind(fit)}, {fit.moving.interpolation}: calibrated at {angles} degrees"]
    lines.append(f"hinge: through {axes.hinge_source}, exact at {fit.poses[0, 0]:.1f} degrees")
    if axes.facets is not None:
        head = f"{'facet, mm':<20}{'points':>7}{'radius':>9}{'rms':>7}{'centre known to':>17}"
        lines.append(head)
        for f in axes.facets.facets:
            row = f"{f.side + ' ' + f.name:<20}{len(f.rows):>7}{f.cylinder.radius:>9.1f}"
            row += f"{f.cylinder.rms:>7.2f}{f.cylinder.center_error:>17.2f}"
            row += "" if f.turned else "  (direction of the transverse axis)"
            lines.append(row)
    lines.append(f"RMSE over {count} measured poses, degrees and mm:")
    head = ("adduction", "int.rot.", "anterior", "superior", "lateral")
    lines.append(" " * 22 + "".join(f"{name:>11}" for name in head))
    for name, row in zip((_kind(fit), "hinge"), fit.rmse, strict=True):
        lines.append(f"{name:<22}" + "".join(f"{x:>11.3f}" for x in row))
    return "\n".join(lines)
