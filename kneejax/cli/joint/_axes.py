"""Where the axis points of `kneejax joint fit` come from: a file, a mesh, or a contact knee."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from kneejax import files, joints
from kneejax.cli.options import JointFit
from kneejax.geometry import COORDINATES, Pose
from kneejax.mechanics import Knee, condyle_points

#: Points of the femur as near to the tibia as this, mm, meet it.
TOUCHING_MM = 4.0
#: A facet of a larger radius, mm, is nearly flat. Condyles have 20 to 45.
FLATTEST_MM = 50.0

_MIRROR = np.array([1.0, 1.0, -1.0])


@dataclasses.dataclass(frozen=True)
class FemurAxes:
    """Axis points of a femur, in the frame of the poses."""

    # Medial and lateral point of the extension, then of the flexion axis, shape `(2, 2, 3)`, mm.
    points: np.ndarray
    hinge: np.ndarray  # medial and lateral point of the hinge's axis, shape `(2, 3)`, mm
    hinge_source: str  # what that axis goes through, in words
    # Medial, then lateral, shape `(2, 3)`, mm; None if they are not known.
    epicondyles: np.ndarray | None
    # Points of the mesh or of the knee's condyles, shape `(n, 3)`, mm, if there are any.
    surface: np.ndarray | None = None
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
    if known is None:
        words = "the extension axis (no epicondyles are given)"
        return lambda _: FemurAxes(found.points, found.points[0], words, None)
    return lambda _: FemurAxes(found.points, known, "the epicondyles", known)


def axes_from_mesh(arguments: JointFit, side: str) -> FindAxes:
    """Axis points of a mesh (`--femur`), placed by `--landmarks`, touched by that of `--tibia`,
    where that is found only when the axes are sought."""
    femur = files.read_mesh_points(arguments.femur, arguments.unit or "auto")
    points, normals = femur.points_mm * _mirror(side), femur.normals * _mirror(side)
    epicondyles = _given_epicondyles(arguments, side)
    if arguments.landmarks is not None:
        known = files.read_femur_landmarks(arguments.landmarks, side)
        epicondyles = known.epicondyles if epicondyles is None else epicondyles
        try:
            (hip,) = _centers(points, known.hip_center[None], (known.head_within,))
            frame = joints.femur_frame(hip, *epicondyles, anterior=None)
        except joints.UnsuitableLandmarks as error:
            raise problem(arguments.landmarks, error) from None
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
    if (epicondyles := _given_epicondyles(arguments, knee.side)) is not None:
        known |= {"hinge": epicondyles, "epicondyles": epicondyles,
                  "hinge_source": "the epicondyles"}  # fmt: skip
    axes = dataclasses.replace(own, points=own.points + shift, surface=points + shift, **known)
    return lambda _: axes


def _shifted(axes: joints.CondyleAxes, shift: np.ndarray) -> joints.CondyleAxes:
    facets = []
    for facet in axes.facets:
        cylinder = dataclasses.replace(facet.cylinder, center=facet.center + shift)
        facets.append(dataclasses.replace(facet, cylinder=cylinder))
    return dataclasses.replace(axes, facets=tuple(facets), points=axes.points + shift)


def problem(file: str | Path, error: joints.JointProblem) -> files.InputProblem:
    """The error of a command for what no joint can be made of."""
    return files.InputProblem(file, error.field, error.found, error.expected)


def _fitted(arguments: JointFit, file: str | Path, points: np.ndarray, normals: np.ndarray,
            epicondyles: np.ndarray | None,
            touching: tuple[np.ndarray, ...] | None = None) -> FemurAxes:  # fmt: skip
    extension = tuple(arguments.extension_facet or joints.EXTENSION_DEG)
    flexion = tuple(arguments.flexion_facet or joints.FLEXION_DEG)
    regions = " and ".join(f"{low:g} to {high:g}" for low, high in (extension, flexion))
    regions += " degrees, from anterior through distal"
    try:
        found = joints.condyle_axes(points, normals, extension, flexion, touching=touching)
    except joints.UnsuitableMesh as error:
        raise problem(file, error) from None
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
        for facet in found.facets
        if facet.cylinder.radius > FLATTEST_MM
    )
    return FemurAxes(found.points, hinge, words, epicondyles, points, found, regions, doubts)


def _tibia(arguments: JointFit, side: str) -> np.ndarray:
    """Points of the tibia's mesh, in its anatomical frame if there are landmarks."""
    mesh = files.read_mesh_points(arguments.tibia, arguments.unit or "auto")
    points = mesh.points_mm * _mirror(side)
    if arguments.landmarks is None:
        return points
    known = files.read_tibia_landmarks(arguments.landmarks, side)
    try:
        ankle = _centers(points, known.ankle, known.ankle_within).mean(axis=0)
        frame = joints.tibia_frame(ankle, *known.plateau, anterior=None)
    except joints.UnsuitableLandmarks as error:
        raise problem(arguments.landmarks, error) from None
    return joints.in_frame(frame, points)


def _centers(mesh: np.ndarray, places: np.ndarray, within: Sequence[float | None]) -> np.ndarray:
    """The places, or the centres of the balls of bone about them."""
    return np.array(
        [
            place if near is None else joints.joint_center(mesh, place, near).surface.frame.origin
            for place, near in zip(places, within, strict=True)
        ]
    )


def _given_epicondyles(arguments: JointFit, side: str) -> np.ndarray | None:
    both = arguments.medial_epicondyle, arguments.lateral_epicondyle
    if both == (None, None):
        return None
    return np.array(both) * _mirror(side)


def _mirror(side: str) -> np.ndarray:
    return _MIRROR if side == "left" else np.ones(3)
