"""A bone's surface as a place for points: the nearest point of its triangles."""

from __future__ import annotations

import os
from collections.abc import Callable

import numpy as np

from kneejax.files.meshes._points import read_mesh_points

#: Corners whose triangles are asked: the nearest point lies on one of theirs, unless triangles are
#: far larger than their distance from each other.
_NEAREST = 24


def bone_surface(
    path: str | os.PathLike[str],
) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """The surface of a bone, on which points can be laid.

    Args:
        path: a mesh in the bone's frame of the knee, in m, cm or mm (`read_mesh_points`).

    Returns:
        A function of points `(n, 3)`, mm, that gives the nearest points of the mesh `(n, 3)`, the
        unit normals of their triangles `(n, 3)`, and the distances `(n,)`, mm.

    Raises:
        InputProblem: the file is no mesh.
    """
    import trimesh
    from scipy.spatial import KDTree

    mesh = read_mesh_points(path, "auto")
    corners = mesh.points_mm[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normals, axis=1)
    flat = size > 0.0
    faces, corners = mesh.faces[flat], corners[flat]
    normals = normals[flat] / size[flat, None]
    tree = KDTree(mesh.points_mm)
    around: list[list[int]] = [[] for _ in mesh.points_mm]
    for face, three in enumerate(faces):
        for corner in three:
            around[corner].append(face)
    count = min(_NEAREST, len(mesh.points_mm))

    def lay(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        found = [_nearest(point, near) for point, near in zip(points, tree.query(points, count)[1],
                                                              strict=True)]  # fmt: skip
        face = np.array([one for one, _ in found], int)
        laid = np.array([place for _, place in found]).reshape(-1, 3)
        return laid, normals[face], np.linalg.norm(points - laid, axis=1)

    def _nearest(point: np.ndarray, near: np.ndarray) -> tuple[int, np.ndarray]:
        own = np.unique([face for corner in np.atleast_1d(near) for face in around[corner]])
        at = trimesh.triangles.closest_point(corners[own], np.tile(point, (len(own), 1)))
        best = int(np.argmin(np.linalg.norm(at - point, axis=1)))
        return int(own[best]), at[best]

    return lay
