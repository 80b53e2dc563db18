"""`kneejax joint fit`: a moving axis and a hinge, of poses or of a contact knee; `joint export`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

from kneejax import files
from kneejax.cli import options
from kneejax.cli._deliver import deliver
from kneejax.cli._given import check_columns
from kneejax.cli.joint._axes import (
    FemurAxes,
    axes_from_file,
    axes_from_knee,
    axes_from_mesh,
    problem,
)
from kneejax.cli.options import JointExport
from kneejax.experiments import passive_flexion
from kneejax.geometry import COORDINATES, Pose
from kneejax.joints import JointFit, JointProblem, UnsuitablePoses, calibration_rows, fit_joints
from kneejax.mechanics import Knee
from kneejax.report import joint_fit_answer, status_doubts
from kneejax.statics import Status
from kneejax.studies import stages_on_terminal

#: Splines that leave more than this of a pose, degrees or mm, are doubtful.
_DOUBTFUL = 1e-6


class ContactKnee(NamedTuple):
    """A contact knee that was asked for."""

    knee: Knee  # with the numbers of its calibration
    # Free coordinate -> what is added to its motion to compare it with the measured one, mm or
    # degrees; empty unless a calibration fitted it.
    frame_offset: Mapping[str, float]


class Motion(NamedTuple):
    """Poses that joints are made of and compared with, in the frames of the measurement.

    Attributes:
        table: shape `(n, 6)`, degrees and mm; NaN where a contact knee has no equilibrium.
        name: in tables and figures.
        source: the file, or the knee.
        at_deg: flexions to calibrate at; empty for the first and the last.
        status: of a contact knee's poses.
        doubts: sentences on them.
    """

    table: np.ndarray
    name: str
    source: str
    at_deg: tuple[float, ...] = ()
    status: tuple[Status, ...] = ()
    doubts: tuple[str, ...] = ()


def read_contact_knee(name: str) -> ContactKnee:
    """Read a bundled knee, a knee file, or the result.json of a calibration with its offsets."""
    knee, calibrated = files.load_knee(name), Path(name).suffix.lower() == ".json"
    return ContactKnee(knee, files.read_calibrated(name).frame_offset if calibrated else {})


def passive_motion(read: ContactKnee, flexion_deg: np.ndarray, source: str) -> Motion:
    """Bend a contact knee; poses without an equilibrium are NaN, and warned of."""
    name = read.knee.name
    with stages_on_terminal(name):
        motion = jax.block_until_ready(passive_flexion(read.knee, flexion_deg))
    table, status = np.array(motion.to_table()), tuple(map(Status, np.asarray(motion.status)))
    for coordinate, shift in read.frame_offset.items():
        table[:, list(COORDINATES).index(coordinate)] += shift
    table[[not one.converged for one in status]] = np.nan

    def where(rows: np.ndarray) -> str:
        return f"{name}: {files.counted(len(rows), 'pose')} {status[rows[0]].word}"

    doubts = status_doubts([int(x) for x in status], [""] * len(status), where, str)
    return Motion(table, name, source, status=status, doubts=tuple(doubts))


def run(arguments: options.JointFit) -> int:
    """Calibrate the joints, and say what they keep of the motion."""
    flexion = files.parse_flexion(arguments.flexion)
    # All that can be at fault is read before a knee is bent, which takes long.
    read = None if arguments.knee is None else read_contact_knee(arguments.knee)
    side = arguments.side or "right"
    if read is not None and (side := read.knee.side) != (arguments.side or side):
        raise files.InputProblem("--side", "side", arguments.side, f"{side}, as {read.knee.name}")
    if arguments.axes is not None:
        find_axes = axes_from_file(arguments, side)
    elif arguments.femur is None and read is not None:
        find_axes = axes_from_knee(arguments, read)
    else:
        find_axes = axes_from_mesh(arguments, side)
    if read is not None:
        motion = _bent(arguments, read, flexion)
    else:
        check_columns(arguments.column)
        convention = arguments.convention or "femoral"
        table = files.read_poses(arguments.poses, convention, arguments.column)
        motion = Motion(table, "measured", str(arguments.poses), tuple(arguments.at))
    try:
        rows = calibration_rows(motion.table, motion.at_deg)
        axes = find_axes(Pose.from_table(motion.table[rows]))
        fit = fit_joints(
            motion.table, axes.points, axes.hinge, motion.at_deg, arguments.interpolation
        )
    except UnsuitablePoses as error:
        raise problem(motion.source, error) from None
    except JointProblem as error:
        raise problem(arguments.femur or arguments.axes or arguments.knee, error) from None
    origin = arguments.femur or arguments.axes
    whence = "its condyles" if origin is None else origin.name
    written = _write(arguments, fit, axes, motion, side, whence)
    answer = joint_fit_answer(
        fit, motion.name, motion.table, flexion, status=motion.status, hinge=axes.hinge_source,
        facets=axes.facets, regions=axes.regions, surface=axes.surface,
        doubts=(*motion.doubts, *axes.doubts),
        document={
            "poses": None if arguments.poses is None else arguments.poses.name,
            "knee": motion.name if motion.status else None,
            "convention": arguments.convention or "femoral", "side": side, "axes": whence,
            "facets": axes.regions or None, "settings": arguments.options(),
        },
    )  # fmt: skip
    return deliver(answer, arguments, written)


def _bent(arguments: options.JointFit, read: ContactKnee, flexion: np.ndarray) -> Motion:
    """Passive flexion of a contact knee, balanced where joints are calibrated on it."""
    at = tuple(arguments.at or (flexion.min(), flexion.max()))
    files.parse_flexion(",".join(map(str, at)), "--at", "degrees")
    angles = np.unique(np.concatenate([flexion, at]))
    try:  # whether these are flexions for a joint is known before any pose
        calibration_rows(np.pad(angles[:, None], ((0, 0), (0, 5))), at)
    except UnsuitablePoses as error:
        raise problem("--at" if arguments.at else "--flexion", error) from None
    found = passive_motion(read, angles, str(arguments.knee))
    usable = np.array([status.converged for status in found.status])
    for angle in sorted(at):
        status = found.status[int(np.searchsorted(angles, angle))]
        if not status.converged:
            expected = "a flexion with a converged equilibrium; choose by --at"
            if usable.any():
                expected += f", from {angles[usable].min():g} to {angles[usable].max():g} degrees"
            place = f"pose at {angle:g} degrees"
            raise files.InputProblem(arguments.knee, place, status.word, expected)
    found.table[:, 0] = angles
    return found._replace(at_deg=at)


def _write(
    arguments: options.JointFit, fit: JointFit, axes: FemurAxes, motion: Motion, side, whence
) -> list[str]:
    """Write the joints, and axis points that were found; the names of the files."""
    out, name = arguments.out, arguments.out.name or "joint"
    angles = ", ".join(f"{x:.1f}" for x in fit.poses[:, 0])
    table = arguments.poses
    whose = f"{motion.name}, passive flexion" if table is None else table.name
    for joint, file, title, source in (
        (fit.moving, "joint.yaml", name, f"{whose} at {angles} degrees; axes from {whence}"),
        (fit.hinge, "hinge.yaml", f"{name} hinge", f"{whose}; axis through {axes.hinge_source}"),
    ):
        files.write_joint(files.JointFile(joint, title, side, source), out / file)
    if axes.facets is None:
        return ["joint.yaml", "hinge.yaml"]
    files.write_axis_points(files.AxisPoints(axes.points, axes.epicondyles), out / "axes.csv")
    return ["joint.yaml", "hinge.yaml", "axes.csv"]


def export(arguments: JointExport) -> int:
    """Write the joint for OpenSim and as a table of coupled coordinates; say how well."""
    file = files.read_joint(arguments.joint)
    found = files.export_joint(file)
    low, high = np.ceil(found.flexion_deg[0]), np.floor(found.flexion_deg[-1])
    table = file.joint.pose(np.deg2rad(np.arange(low, high + 1.0))).to_table()
    out = arguments.out
    files.write_text(out / "custom_joint.xml", found.snippet)
    files.write_text(out / "joint.osim", found.model)
    files.write_poses(out / "coupled_coordinates.csv", np.asarray(table))
    turn, shift = found.error[:2].max(), found.error[2:].max()
    print(
        f"{file.name}: flexion {found.flexion_deg[0]:g} to {found.flexion_deg[-1]:g} degrees, "
        f"{len(found.flexion_deg)} knots; splines within {turn:.1e} degrees and {shift:.1e} mm"
    )
    print(f"written: {out}/custom_joint.xml, joint.osim, coupled_coordinates.csv, settings.json")
    if found.error.max() > _DOUBTFUL:
        print("doubtful: the joint turns its axis too sharply for a cubic spline of OpenSim")
        return 1
    return 0
