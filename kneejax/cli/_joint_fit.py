"""`kneejax joint fit`: a moving axis and a hinge, of poses or of a contact knee, whose axis points
come from a file, a mesh or a contact knee; `joint export`."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import jax
import numpy as np

from kneejax import files, joints
from kneejax.cli._deliver import deliver
from kneejax.cli.options.joints import JointExport, JointFit
from kneejax.experiments import passive_flexion
from kneejax.geometry import COLUMNS, COORDINATES, Pose
from kneejax.joints import JointProblem, UnsuitablePoses, calibration_rows, fit_joints
from kneejax.mechanics import Knee, condyle_points
from kneejax.report.joint_fit import joint_fit_answer
from kneejax.report.pose_tables import status_doubts
from kneejax.statics import Status
from kneejax.studies import stages_on_terminal

#: Points of the femur as near to the tibia as this, mm, meet it.
TOUCHING_MM = 4.0
#: A facet of a larger radius, mm, is nearly flat. Condyles have 20 to 45.
FLATTEST_MM = 50.0
#: Splines that leave more than this of a pose, degrees or mm, are doubtful.
_DOUBTFUL = 1e-6


@dataclasses.dataclass(frozen=True)
class FemurAxes:
    """Axis points of a femur, mm, in the frame of the poses; medial ones before lateral ones."""

    points: np.ndarray  # of the extension, then of the flexion axis, `(2, 2, 3)`
    hinge: np.ndarray  # of the hinge's axis, `(2, 3)`
    hinge_source: str  # what that axis goes through, in words
    epicondyles: np.ndarray | None  # `(2, 3)`, if they are known
    surface: np.ndarray | None = None  # points of the mesh or of the knee's condyles, `(n, 3)`
    facets: joints.CondyleAxes | None = None  # the cylinders that were fitted to them
    regions: str = ""  # how the facets were chosen, in words
    doubts: tuple[str, ...] = ()  # sentences on facets that are none of a condyle


#: Given the calibration poses, finds the axes: where the tibia is may matter.
FindAxes = Callable[[Pose], FemurAxes]


def axes_from_file(arguments: JointFit, side: str) -> FindAxes:
    """Axis points by coordinates (`--axes`)."""
    found = files.read_axis_points(arguments.axes, side)
    given = _given_epicondyles(arguments, side)
    known = found.epicondyles if given is None else given
    hinge, words = known, "the epicondyles"
    if hinge is None:
        hinge, words = found.points[0], "the extension axis (no epicondyles are given)"
    return lambda _: FemurAxes(found.points, hinge, words, known)


def axes_from_mesh(arguments: JointFit, side: str) -> FindAxes:
    """Axis points of a mesh (`--femur`), placed by `--landmarks`, touched by that of `--tibia`,
    where that is found only when the axes are sought."""
    femur = files.read_mesh_points(arguments.femur, arguments.unit or "auto")
    points, normals = femur.points_mm * _mirror(side), femur.normals * _mirror(side)
    epicondyles = _given_epicondyles(arguments, side)
    if arguments.landmarks is not None:
        known = files.read_femur_landmarks(arguments.landmarks, side)
        epicondyles = known.epicondyles if epicondyles is None else epicondyles
        with files.said_of(arguments.landmarks):
            (hip,) = _centers(points, known.hip_center[None], (known.head_within,))
            frame = joints.femur_frame(hip, *epicondyles, anterior=None)
        points, epicondyles = joints.in_frame(frame, points), joints.in_frame(frame, epicondyles)
        normals = np.stack([np.asarray(c) for c in frame.turn_back(tuple(normals.T))], axis=1)
    if arguments.tibia is None:
        axes = _fitted(arguments, arguments.femur, points, normals, epicondyles)
        return lambda _: axes
    tibia, within = _tibia(arguments, side), arguments.touching_within or TOUCHING_MM

    def touched(poses: Pose) -> FemurAxes:
        ends = [Pose.from_table(row) for row in np.asarray(poses.to_table())[[0, -1]]]
        try:
            met = tuple(joints.touching_rows(points, tibia, pose, within) for pose in ends)
        except joints.UnsuitableMesh as error:
            expected = f"{error.expected} Bones without cartilage want a larger --touching-within"
            raise files.InputProblem(arguments.tibia, error.field, error.found, expected) from None
        first, last = np.rad2deg(np.asarray(poses.flexion)[[0, -1]])
        axes = _fitted(arguments, arguments.femur, points, normals, epicondyles, met)
        regions = f"within {within:g} mm of the tibia at {first:.1f} and {last:.1f} degrees"
        return dataclasses.replace(axes, regions=regions)

    return touched


def axes_from_knee(arguments: JointFit, knee: Knee, offset: Mapping[str, float]) -> FindAxes:
    """Axis points of a contact knee's own condyles (`--knee`), moved with its frame offset."""
    try:
        points, normals = condyle_points(knee)
    except ValueError as error:
        expected = "condyles; or axis points, by --femur or --axes"
        raise files.InputProblem(arguments.knee, "contacts", str(error), expected) from None
    # Fitted in the knee's own frame, in which the sign of Z tells medial from lateral.
    own = _fitted(arguments, arguments.knee, points, normals, None)
    shift = np.array([offset.get(name, 0.0) for name in list(COORDINATES)[3:]])
    known = {"hinge": own.hinge + shift, "facets": _shifted(own.facets, shift)}
    if (given := _given_epicondyles(arguments, knee.side)) is not None:
        known |= {"hinge": given, "epicondyles": given, "hinge_source": "the epicondyles"}
    axes = dataclasses.replace(own, points=own.points + shift, surface=points + shift, **known)
    return lambda _: axes


def _shifted(axes: joints.CondyleAxes, shift: np.ndarray) -> joints.CondyleAxes:
    facets = []
    for facet in axes.facets:
        cylinder = dataclasses.replace(facet.cylinder, center=facet.center + shift)
        facets.append(dataclasses.replace(facet, cylinder=cylinder))
    return dataclasses.replace(axes, facets=tuple(facets), points=axes.points + shift)


def problem(file: str | Path, error: joints.JointProblem) -> "files.InputProblem":
    """The error of a command for what no joint can be made of."""
    return files.InputProblem(file, error.field, error.found, error.expected)


def _fitted(arguments: JointFit, file: str | Path, points: np.ndarray, normals: np.ndarray,
            epicondyles: np.ndarray | None,
            touching: tuple[np.ndarray, ...] | None = None) -> FemurAxes:  # fmt: skip
    extension = tuple(arguments.extension_facet or joints.EXTENSION_DEG)
    flexion = tuple(arguments.flexion_facet or joints.FLEXION_DEG)
    regions = " and ".join(f"{low:g} to {high:g}" for low, high in (extension, flexion))
    regions += " degrees, from anterior through distal"
    with files.said_of(file):
        found = joints.condyle_axes(points, normals, extension, flexion, touching=touching)
    hinge, words = epicondyles, "the epicondyles"
    if hinge is None:
        axis = found.transverse
        along = (found.points[0] - axis.center) @ axis.direction
        hinge = axis.center + along[:, None] * axis.direction
        words = "the cylinder through both condyles (no epicondyles are given)"
    doubts = tuple(
        f"{facet.side} {facet.name} facet: a radius of {facet.cylinder.radius:.0f} mm is nearly "
        "flat, so that its centre means little: choose it elsewhere "
        f"({'--touching-within, or no --tibia' if touching else f'--{facet.name}-facet'})"
        for facet in found.facets if facet.cylinder.radius > FLATTEST_MM)  # fmt: skip
    return FemurAxes(found.points, hinge, words, epicondyles, points, found, regions, doubts)


def _tibia(arguments: JointFit, side: str) -> np.ndarray:
    """Points of the tibia's mesh, in its anatomical frame if there are landmarks."""
    mesh = files.read_mesh_points(arguments.tibia, arguments.unit or "auto")
    points = mesh.points_mm * _mirror(side)
    if arguments.landmarks is None:
        return points
    known = files.read_tibia_landmarks(arguments.landmarks, side)
    with files.said_of(arguments.landmarks):
        ankle = _centers(points, known.ankle, known.ankle_within).mean(axis=0)
        frame = joints.tibia_frame(ankle, *known.plateau, anterior=None)
    return joints.in_frame(frame, points)


def _centers(mesh: np.ndarray, places: np.ndarray, within: Sequence[float | None]) -> np.ndarray:
    """The places, or the centres of the balls of bone about them."""
    return np.array([
        place if near is None else joints.joint_center(mesh, place, near).surface.frame.origin
        for place, near in zip(places, within, strict=True)])  # fmt: skip


def _given_epicondyles(arguments: JointFit, side: str) -> np.ndarray | None:
    both = arguments.medial_epicondyle, arguments.lateral_epicondyle
    return None if both == (None, None) else np.array(both) * _mirror(side)


def _mirror(side: str) -> np.ndarray:
    return np.array([1.0, 1.0, -1.0 if side == "left" else 1.0])


def check_columns(names: Mapping[str, str]) -> None:
    """Refuse columns (the package's -> the table's) that are unknown, or stand for nothing."""
    for name, column in names.items():
        if name not in COLUMNS:
            raise files.InputProblem("--column", "name", name, COLUMNS)
        if not column:
            raise files.InputProblem("--column", name, column, f"one {name}=COLUMN of the table")


def read_contact_knee(name: str) -> tuple[Knee, Mapping[str, float]]:
    """A knee, and what is added to its motion to compare it with the measured one, mm or degrees:
    coordinate -> the offset that a calibration fitted."""
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


def run(arguments: JointFit) -> int:
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
        # Whether these are flexions for a joint is known before any pose.
        with files.said_of("--at" if arguments.at else "--flexion"):
            calibration_rows(np.pad(angles[:, None], ((0, 0), (0, 5))), at)
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
    except JointProblem as error:
        axes_from = arguments.femur or arguments.axes or arguments.knee
        raise problem(source if isinstance(error, UnsuitablePoses) else axes_from, error) from None
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
        document={"poses": poses, "knee": None if knee is None else knee.name,
                  "convention": convention, "side": side, "axes": whence,
                  "facets": axes.regions or None, "settings": arguments.options()})  # fmt: skip
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
    print(f"{file.name}: flexion {found.flexion_deg[0]:g} to {found.flexion_deg[-1]:g} degrees, "
          f"{len(found.flexion_deg)} knots; splines within {turn:.1e} degrees and {shift:.1e} mm")
    print(f"written: {out}/custom_joint.xml, joint.osim, coupled_coordinates.csv, settings.json")
    if found.error.max() > _DOUBTFUL:
        print("doubtful: the joint turns its axis too sharply for a cubic spline of OpenSim")
        return 1
    return 0
