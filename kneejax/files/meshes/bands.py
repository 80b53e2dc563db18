"""A ligament's mesh as a band: the areas where it touches two bones, and its cross-section."""

from __future__ import annotations

import os
from typing import NamedTuple

import numpy as np

from kneejax.files.meshes.anatomy import moved
from kneejax.files.meshes.points import bone_surface, cut_by_plane, read_mesh_points
from kneejax.files.reading import InputProblem
from kneejax.geometry import Pose, Vector
from kneejax.mechanics import AttachmentArea, untwisted

_FEWEST = 6  # triangles of an area
_STATIONS = 21  # along the ligament


class MeshBand(NamedTuple):
    """What a ligament's mesh tells of a band."""

    femoral: AttachmentArea  # where it is attached to the first bone, in its frame
    # likewise, to the second; its half diameters are those that twist the band least
    tibial: AttachmentArea
    # unit vector from the first to the second area, in the first bone's frame
    direction: np.ndarray
    # distances from the first area to where cross-sections were measured, `(n,)`
    along_mm: np.ndarray
    areas_mm2: np.ndarray  # those cross-sections, across the direction, `(n,)`

    @property
    def area_mm2(self) -> float:
        """Cross-section of a bar of even width that is as compliant: the harmonic mean."""
        return float(1.0 / np.mean(1.0 / self.areas_mm2))

    def entry(self) -> dict[str, object]:
        """The fields of a band in a knee file that a mesh can tell."""
        return {
            f"{name}_area": {"centre_mm": area.centre.tolist(),
                             "half_axes_mm": area.half_axes.tolist()}
            for name, area in (("femoral", self.femoral), ("tibial", self.tibial))
        } | {"area_mm2": self.area_mm2}  # fmt: skip


def band_of_meshes(
    ligament: str | os.PathLike[str], first_bone: str | os.PathLike[str],
    second_bone: str | os.PathLike[str], pose: Pose, within_mm: float = 1.0, side: str = "right",
) -> MeshBand:  # fmt: skip
    """The band that a ligament's mesh is.

    Args:
        ligament: a closed mesh in the frame of the first bone, at the pose in which it was
            scanned; STL, PLY, OBJ or VTP.
        first_bone: a mesh in its own frame of the knee.
        second_bone: likewise.
        pose: of the second bone in the first, when the ligament was scanned.
        within_mm: how far from a bone the ligament's surface may be where it is attached.
        side: of the knee; a pose is that of a right one, which a left one mirrors.

    Returns:
        Areas, direction and cross-sections. Young's modulus, prestretch and law are no matter of
        a mesh.

    Raises:
        InputProblem: a file is no mesh, the ligament does not touch a bone, or is not closed
            between its areas.
    """
    mesh, back = read_mesh_points(ligament), pose.placement.inverse()
    mirror = np.array([1.0, 1.0, 1.0 if side == "right" else -1.0])
    corners = mesh.points_mm[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    middles, sizes = corners.mean(axis=1), 0.5 * np.linalg.norm(normals, axis=1)
    found = []
    in_second = moved(back, mesh.points_mm * mirror) * mirror
    for bone, own in ((first_bone, mesh.points_mm), (second_bone, in_second)):
        near = bone_surface(bone)(own)[2] <= within_mm
        touching = near[mesh.faces].all(axis=1)
        if touching.sum() < _FEWEST:
            expected = (f"{_FEWEST} or more within {within_mm:g} mm of {os.fspath(bone)}; is the "
                        "ligament in the frame of the first bone, and is the pose that of the "
                        "scan?")
            raise InputProblem(ligament, "triangles", int(touching.sum()), expected)
        found.append(AttachmentArea.of_points(middles[touching], sizes[touching]))
    first, second = found[0], untwisted(*found)
    span = second.centre - first.centre
    length = float(np.linalg.norm(span))
    along = length * np.linspace(0.2, 0.8, _STATIONS)
    areas = np.array([_section(corners, normals, first.centre, span / length, x) for x in along])
    if not np.all(areas > 0.0):
        expected = "a closed mesh, with the ligament's inside between its areas"
        raise InputProblem(ligament, "cross-section", f"{areas.min():.3g} mm^2", expected)
    axes = [[*map(float, back.turn(Vector(*x)))] for x in second.half_axes * mirror]
    centre = moved(back, second.centre[None] * mirror)[0] * mirror
    tibial = AttachmentArea(centre, np.array(axes) * mirror)
    return MeshBand(first, tibial, span / length, along, areas)


def _section(corners, normals, origin, direction, at: float) -> float:
    """Area in which a plane across a direction cuts a closed mesh, mm^2, from its border: half of
    the product of each piece's outward normal with its place is summed."""
    pieces, rows = cut_by_plane(corners, origin + at * direction, direction)
    outwards = normals[rows] - (normals[rows] @ direction)[:, None] * direction
    size = np.linalg.norm(outwards, axis=1)
    reach = np.einsum("ij,ij->i", pieces.mean(axis=1) - origin, outwards)
    length = np.linalg.norm(pieces[:, 1] - pieces[:, 0], axis=1)
    return float(0.5 * np.sum(reach / np.where(size > 0.0, size, np.inf) * length))
