"""`kneejax joint fit`: a moving axis and a hinge, of poses or of a contact knee; `joint export`."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path

import jax
import numpy as np

from kneejax.cli import options
from kneejax.cli._deliver import deliver
from kneejax.cli._given import check_columns
from kneejax.cli.joint._axes import (
    FemurAxes,
    FindAxes,
    axes_from_file,
    axes_from_knee,
    axes_from_mesh,
    problem,
)
from kneejax.cli.options import JointExport
from kneejax.experiments import passive_flexion
from kneejax.files import (
    AxisPoints,
    InputProblem,
    JointFile,
    counted,
    export_joint,
    load_knee,
    parse_flexion,
    read_calibrated,
    read_joint,
    read_poses,
    write_axis_points,
    write_joint,
    write_poses,
    write_text,
)
from kneejax.geometry import COORDINATES, Pose
from kneejax.joints import JointFit, JointProblem, UnsuitablePoses, calibration_rows, fit_joints
from kneejax.mechanics import Knee
from kneejax.report import joint_fit_answer, status_doubts
from kneejax.statics import Status
from kneejax.studies import stages_on_terminal

#: Splines that leave more than this of a pose, degrees or mm, are doubtful.
_DOUBTFUL = 1e-6


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
class _Motion:
    """Poses that joints are made of and held against.

    Attributes:
        table: shape `(n, 6)`, degrees and mm; NaN where a contact knee has no balance.
        at_deg: flexions to calibrate at; empty for the first and the last.
        name: in tables and figures.
        source: the file, or the knee.
        status: of a contact knee's poses.
        doubts: sentences on them.
    """

    table: np.ndarray
    at_deg: tuple[float, ...]
    name: str
    source: str
    status: tuple[Status, ...] = ()
    doubts: tuple[str, ...] = ()


def run(arguments: options.JointFit) -> int:
    """Calibrate the joints, and say what they keep of the motion."""
    flexion = parse_flexion(arguments.flexion)
    # All that can be at fault is read before a knee is bent, which takes long.
    read = None if arguments.knee is None else read_contact_knee(arguments.knee)
    side = _side(arguments, read)
    find_axes = _axes(arguments, side, read)
    motion = _measured(arguments) if read is None else _bent(arguments, read, flexion)
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


def _side(arguments: options.JointFit, read: ContactKnee | None) -> str:
    if read is None:
        return arguments.side or "right"
    if arguments.side not in (None, read.knee.side):
        raise InputProblem("--side", "side", arguments.side, f"{read.knee.side}, as {read.title}")
    return read.knee.side


def _axes(arguments: options.JointFit, side: str, read: ContactKnee | None) -> FindAxes:
    if arguments.axes is not None:
        return axes_from_file(arguments, side)
    if arguments.femur is None and read is not None:
        return axes_from_knee(arguments, read)
    return axes_from_mesh(arguments, side)


def _measured(arguments: options.JointFit) -> _Motion:
    check_columns(arguments.column)
    table = read_poses(arguments.poses, arguments.convention or "femoral", arguments.column)
    return _Motion(table, tuple(arguments.at or ()), "measured", str(arguments.poses))


def _bent(arguments: options.JointFit, read: ContactKnee, flexion: np.ndarray) -> _Motion:
    """Passive flexion of a contact knee, balanced where joints are calibrated on it."""
    at = tuple(arguments.at or (flexion.min(), flexion.max()))
    parse_flexion(",".join(map(str, at)), "--at", "degrees")
    angles = np.unique(np.concatenate([flexion, at]))
    try:  # whether these are flexions for a joint is known before any pose
        calibration_rows(np.pad(angles[:, None], ((0, 0), (0, 5))), at)
    except UnsuitablePoses as error:
        raise problem("--at" if arguments.at else "--flexion", error) from None
    found = passive_motion(read, angles)
    usable = np.array([status.converged for status in found.status])
    for angle in sorted(at):
        status = found.status[int(np.searchsorted(angles, angle))]
        if not status.converged:
            expected = "a pose with balance to calibrate on; choose by --at"
            if usable.any():
                expected += f", from {angles[usable].min():g} to {angles[usable].max():g} degrees"
            place = f"pose at {angle:g} degrees"
            raise InputProblem(arguments.knee, place, status.word, expected)
    table = found.table
    table[:, 0] = angles
    return _Motion(table, at, read.title, arguments.knee, found.status, found.doubts)


def _write(
    arguments: options.JointFit, fit: JointFit, axes: FemurAxes, motion: _Motion, side, whence
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
        write_joint(JointFile(joint, title, side, source), out / file)
    if axes.facets is None:
        return ["joint.yaml", "hinge.yaml"]
    write_axis_points(AxisPoints(axes.points, axes.epicondyles), out / "axes.csv")
    return ["joint.yaml", "hinge.yaml", "axes.csv"]


def export(arguments: JointExport) -> int:
    """Write the joint for OpenSim and as a table of coupled coordinates; say how well."""
    file = read_joint(arguments.joint)
    found = export_joint(file)
    low, high = np.ceil(found.flexion_deg[0]), np.floor(found.flexion_deg[-1])
    table = file.joint.pose(np.deg2rad(np.arange(low, high + 1.0))).to_table()
    out = arguments.out
    write_text(out / "custom_joint.xml", found.snippet)
    write_text(out / "joint.osim", found.model)
    write_poses(out / "coupled_coordinates.csv", np.asarray(table))
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
