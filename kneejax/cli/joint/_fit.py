"""`kneejax joint fit`: a moving axis and a hinge, of poses or of a contact knee; `joint export`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import jax
import numpy as np

from kneejax import files
from kneejax.cli import options
from kneejax.cli._deliver import deliver
from kneejax.cli._given import check_columns
from kneejax.cli.joint._axes import axes_from_file, axes_from_knee, axes_from_mesh, problem
from kneejax.cli.options import JointExport
from kneejax.experiments import passive_flexion
from kneejax.geometry import COORDINATES, Pose
from kneejax.joints import JointProblem, UnsuitablePoses, calibration_rows, fit_joints
from kneejax.mechanics import Knee
from kneejax.report import joint_fit_answer, status_doubts
from kneejax.statics import Status
from kneejax.studies import stages_on_terminal

#: Splines that leave more than this of a pose, degrees or mm, are doubtful.
_DOUBTFUL = 1e-6


def read_contact_knee(name: str) -> tuple[Knee, Mapping[str, float]]:
    """Read a bundled knee, a knee file, or the result.json of a calibration, with its numbers; and
    what is added to the motion of free coordinates to compare it with the measured one, mm or
    degrees, where a calibration fitted that."""
    knee, calibrated = files.load_knee(name), Path(name).suffix.lower() == ".json"
    return knee, files.read_calibrated(name).frame_offset if calibrated else {}


def passive_motion(
    knee: Knee, offset: Mapping[str, float], flexion_deg: np.ndarray
) -> tuple[np.ndarray, list[Status], list[str]]:
    """Poses of a contact knee in passive flexion, in the frames of the measurement, `(n, 6)`,
    degrees and mm, NaN without an equilibrium; their status, and sentences on them."""
    with stages_on_terminal(knee.name):
        motion = jax.block_until_ready(passive_flexion(knee, flexion_deg))
    table, status = np.array(motion.to_table()), [Status(x) for x in np.asarray(motion.status)]
    for coordinate, shift in offset.items():
        table[:, list(COORDINATES).index(coordinate)] += shift
    table[[not one.converged for one in status]] = np.nan

    def where(rows: np.ndarray) -> str:
        return f"{knee.name}: {files.counted(len(rows), 'pose')} {status[rows[0]].word}"

    doubts = status_doubts([int(x) for x in status], [""] * len(status), where, str)
    return table, status, doubts


def run(arguments: options.JointFit) -> int:
    """Calibrate the joints, and say what they keep of the motion."""
    flexion = files.parse_flexion(arguments.flexion)
    # All that can be at fault is read before a knee is bent, which takes long.
    knee, offset = (None, {}) if arguments.knee is None else read_contact_knee(arguments.knee)
    side = arguments.side or "right"
    if knee is not None and (side := knee.side) != (arguments.side or side):
        raise files.InputProblem("--side", "side", arguments.side, f"{side}, as {knee.name}")
    if arguments.axes is not None:
        find_axes = axes_from_file(arguments, side)
    elif arguments.femur is None and knee is not None:
        find_axes = axes_from_knee(arguments, knee, offset)
    else:
        find_axes = axes_from_mesh(arguments, side)
    convention = arguments.convention or "femoral"
    status, at, source = [], tuple(arguments.at), str(arguments.poses or arguments.knee)
    doubts: list[str] = []
    if knee is not None:
        at = at or (flexion.min(), flexion.max())
        files.parse_flexion(",".join(map(str, at)), "--at", "degrees")
        angles = np.unique(np.concatenate([flexion, at]))
        try:  # whether these are flexions for a joint is known before any pose
            calibration_rows(np.pad(angles[:, None], ((0, 0), (0, 5))), at)
        except UnsuitablePoses as error:
            raise problem("--at" if arguments.at else "--flexion", error) from None
        table, status, doubts = passive_motion(knee, offset, angles)
        for angle in sorted(at):
            found = status[int(np.searchsorted(angles, angle))]
            if not found.converged:
                expected = "a flexion with a converged equilibrium; choose by --at"
                if len(usable := angles[[one.converged for one in status]]):
                    expected += f", from {usable.min():g} to {usable.max():g} degrees"
                place = f"pose at {angle:g} degrees"
                raise files.InputProblem(arguments.knee, place, found.word, expected)
        table[:, 0] = angles
    else:
        check_columns(arguments.column)
        table = files.read_poses(arguments.poses, convention, arguments.column)
    try:
        axes = find_axes(Pose.from_table(table[calibration_rows(table, at)]))
        fit = fit_joints(table, axes.points, axes.hinge, at, arguments.interpolation)
    except UnsuitablePoses as error:
        raise problem(source, error) from None
    except JointProblem as error:
        raise problem(arguments.femur or arguments.axes or arguments.knee, error) from None
    origin, out = arguments.femur or arguments.axes, arguments.out
    whence, name = "its condyles" if origin is None else origin.name, out.name or "joint"
    angles = ", ".join(f"{x:.1f}" for x in fit.poses[:, 0])
    poses = None if arguments.poses is None else arguments.poses.name
    whose = poses or f"{knee.name if knee else ''}, passive flexion"
    written = ["joint.yaml", "hinge.yaml"]
    for joint, file, title, words in (
        (fit.moving, written[0], name, f"{whose} at {angles} degrees; axes from {whence}"),
        (fit.hinge, written[1], f"{name} hinge", f"{whose}; axis through {axes.hinge_source}"),
    ):
        files.write_joint(files.JointFile(joint, title, side, words), out / file)
    if axes.facets is not None:  # axis points that were found
        written.append("axes.csv")
        files.write_axis_points(files.AxisPoints(axes.points, axes.epicondyles), out / written[-1])
    answer = joint_fit_answer(
        fit, "measured" if knee is None else knee.name, table, flexion, status=status,
        hinge=axes.hinge_source, facets=axes.facets, regions=axes.regions, surface=axes.surface,
        doubts=(*doubts, *axes.doubts),
        document={
            "poses": poses, "knee": None if knee is None else knee.name,
            "convention": convention, "side": side, "axes": whence,
            "facets": axes.regions or None, "settings": arguments.options(),
        },
    )  # fmt: skip
    return deliver(answer, arguments, written)


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
