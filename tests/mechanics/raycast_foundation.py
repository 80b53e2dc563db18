"""An elastic foundation between two triangle meshes, by rays: NumPy and SciPy, nothing of kneejax.

The reference that analytic surfaces are held against. Each triangle of the tibial cartilage sends
one ray from its centroid, against its outward normal, to the femoral cartilage; the length of the
ray is the depth of overlap `d`, and the triangle carries the pressure `K d / h` (Smith et al.,
J Biomech Eng 138, 2016; Bei and Fregly, Med Eng Phys 26, 2004). Needs no closed meshes.
"""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation


@dataclasses.dataclass(frozen=True)
class FoundationContact:
    """What the foundation exerts; vectors in tibia axes, points in the tibia's frame.

    Attributes:
        force: on the tibia, N, shape `(3,)`.
        moment: on the tibia about its origin, N mm, shape `(3,)`.
        area: of the triangles that are pressed, mm^2.
        max_pressure: MPa.
        mean_pressure: of the triangles that are pressed, weighted by area, MPa.
        center: centre of pressure, mm, shape `(3,)`; NaN without contact.
        depth: of each tibial triangle, mm, 0 where it is not pressed.
        pressure: of each tibial triangle, MPa.
    """

    force: np.ndarray
    moment: np.ndarray
    area: float
    max_pressure: float
    mean_pressure: float
    center: np.ndarray
    depth: np.ndarray
    pressure: np.ndarray

    @property
    def max_depth(self) -> float:
        """Deepest overlap, mm."""
        return float(self.depth.max(initial=0.0))


def confined_modulus(youngs_modulus: float, poisson_ratio: float) -> float:
    """Modulus of a thin layer that cannot bulge, of the unit of Young's."""
    e, nu = youngs_modulus, poisson_ratio
    return e * (1 - nu) / ((1 + nu) * (1 - 2 * nu))


def load_mesh_mm(path: Path, mm_per_unit: float = 1000.0):
    """A mesh in mm, with its triangles in the order of the file.

    Args:
        path: STL, PLY or OBJ.
        mm_per_unit: of the file; 1000 for metres.
    """
    import trimesh

    mesh = trimesh.load_mesh(path, process=False)
    mesh.apply_scale(mm_per_unit)
    return mesh


def raycast_contact(
    femur_mesh, tibia_mesh, pose_row, modulus: float, thickness: float, triangles=None
) -> FoundationContact:
    """Contact of two cartilage meshes at a pose.

    Args:
        femur_mesh: `vertices` (mm, femur frame) and `faces`, outward; a `trimesh.Trimesh` has them.
        tibia_mesh: likewise in the tibia frame.
        pose_row: flexion, adduction, internal rotation (degrees), anterior, superior, lateral (mm):
            `R = Rz(-flexion) Rx(adduction) Ry(rotation)`, translation in femur axes.
        modulus: confined modulus K, MPa.
        thickness: of both layers together, mm; also the longest ray.
        triangles: indices (or a mask) of the tibial triangles to use; all by default. The others
            have depth 0: that parts the compartments.

    Returns:
        Force, area, pressures, centre of pressure, and the depth of each tibial triangle.
    """
    pose_row = np.asarray(pose_row, float)
    turn = Rotation.from_euler("ZXY", pose_row[:3] * [-1, 1, 1], degrees=True)
    femur = turn.inv().apply(np.asarray(femur_mesh.vertices, float) - pose_row[3:])
    corners = np.asarray(tibia_mesh.vertices, float)[tibia_mesh.faces]
    centroid, normal, area = _centroids(corners)
    chosen = np.arange(len(corners)) if triangles is None else np.arange(len(corners))[triangles]
    depth = np.zeros(len(corners))
    depth[chosen] = _ray_lengths(
        femur[femur_mesh.faces], centroid[chosen], -normal[chosen], thickness
    )
    pressure = modulus * depth / thickness
    push = -(pressure * area)[:, None] * normal
    touched = depth > 0
    total, covered = float(np.sum(pressure * area)), float(np.sum(area[touched]))
    nowhere = np.full(3, math.nan)
    return FoundationContact(
        force=push.sum(axis=0),
        moment=np.cross(centroid, push).sum(axis=0),
        area=covered,
        max_pressure=float(pressure.max(initial=0.0)),
        mean_pressure=total / covered if covered else 0.0,
        center=(pressure * area) @ centroid / total if total else nowhere,
        depth=depth,
        pressure=pressure,
    )


def _centroids(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centroids, unit normals and areas of triangles `(n, 3, 3)`."""
    raw = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    twice = np.linalg.norm(raw, axis=1)
    normal = raw / np.where(twice > 0, twice, 1.0)[:, None]
    return corners.mean(axis=1), normal, 0.5 * twice


def _ray_lengths(
    target: np.ndarray, origin: np.ndarray, direction: np.ndarray, reach: float
) -> np.ndarray:
    """Length of each ray to the nearest triangle it leaves the solid through; 0 if it meets none.

    Args:
        target: triangles `(m, 3, 3)` with outward normals.
        origin: `(n, 3)`.
        direction: unit vectors `(n, 3)`.
        reach: longest ray.
    """
    centroid = target.mean(axis=1)
    size = np.linalg.norm(target - centroid[:, None], axis=2).max()
    # Every point of a ray lies within half its reach of its middle.
    near = cKDTree(centroid).query_ball_point(origin + 0.5 * reach * direction, 0.5 * reach + size)
    count = np.array([len(found) for found in near])
    ray = np.repeat(np.arange(len(origin)), count)
    if not len(ray):
        return np.zeros(len(origin))
    a, b, c = np.moveaxis(target[np.concatenate(near).astype(int)], 1, 0)
    edge_ab, edge_ac, d = b - a, c - a, direction[ray]
    # Moeller and Trumbore, J Graphics Tools 2, 1997.
    across = np.cross(d, edge_ac)
    volume = np.einsum("ij,ij->i", edge_ab, across)
    leaves = volume < 0  # the triangle's normal is along the ray
    scale = np.where(leaves, volume, -1.0)
    offset = origin[ray] - a
    u = np.einsum("ij,ij->i", offset, across) / scale
    beside = np.cross(offset, edge_ab)
    v = np.einsum("ij,ij->i", d, beside) / scale
    length = np.einsum("ij,ij->i", edge_ac, beside) / scale
    slip = 1e-9  # a ray through an edge shared by two triangles shall not fall between them
    hit = leaves & (u >= -slip) & (v >= -slip) & (u + v <= 1 + slip)
    hit &= (length > 0) & (length <= reach)
    answer = np.full(len(origin), math.inf)
    np.minimum.at(answer, ray[hit], length[hit])
    return np.where(np.isfinite(answer), answer, 0.0)
