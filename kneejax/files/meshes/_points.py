"""Meshes of bones and cartilage: STL, PLY, OBJ and, with VTK, VTP."""

from __future__ import annotations

import dataclasses
import io
import os
from pathlib import Path

import numpy as np

from kneejax.files.meshes._complete import COMPLETE, check_complete
from kneejax.files.meshes._vtk import read_vtp
from kneejax.files.reading import InputProblem, counted, read_bytes

#: Endings of the files that can be read.
MESH_ENDINGS = (".stl", ".ply", ".obj", ".vtp")
#: Unit of a mesh file -> mm; `auto` decides by size.
MESH_UNITS = {"auto": None, "m": 1000.0, "mm": 1.0, "cm": 10.0}

_FEWEST_TRIANGLES = 4


@dataclasses.dataclass(frozen=True)
class MeshPoints:
    """A triangle mesh whose corners are shared.

    Attributes:
        points_mm: corners, shape `(n, 3)`, mm.
        normals: outward unit normals at the corners, shape `(n, 3)`.
        faces: rows of three corners, shape `(m, 3)`.
        scale: mm per unit of the file.
    """

    points_mm: np.ndarray
    normals: np.ndarray
    faces: np.ndarray
    scale: float


def read_mesh_points(path: str | os.PathLike[str], unit: str = "auto") -> MeshPoints:
    """Read the corners of a triangle mesh.

    Args:
        path: an STL, PLY, OBJ or, where VTK is installed, VTP file.
        unit: of the file: `m`, `mm`, `cm`, or `auto`, which takes a bounding box with a diagonal
            below 1 as metres and between 10 and 2000 as mm.

    Returns:
        The mesh, with corners that coincide merged.

    Raises:
        InputProblem: the file is not a mesh, has fewer than four triangles or corners that are
            not finite, or its unit is unknown or unclear.

    Example:
        >>> import tempfile
        >>> path = Path(tempfile.mkdtemp()) / "corner.obj"
        >>> corners = "v 0 0 0\\nv 30 0 0\\nv 0 20 0\\nv 0 0 10\\n"
        >>> _ = path.write_text(corners + "f 1 3 2\\nf 1 2 4\\nf 1 4 3\\nf 2 3 4\\n")
        >>> mesh = read_mesh_points(path)
        >>> mesh.points_mm.shape, mesh.faces.shape, mesh.scale
        ((4, 3), (4, 3), 1.0)
    """
    path = Path(path)
    if unit not in MESH_UNITS:
        expected = f"one of {', '.join(MESH_UNITS)}"
        raise InputProblem(path, "unit", unit, expected, MESH_UNITS)
    data = read_bytes(path, "a triangle mesh")
    if path.suffix.lower() not in MESH_ENDINGS:
        expected = f"a triangle mesh ending in {', '.join(MESH_ENDINGS)}"
        raise InputProblem(path, "file", path.suffix or "no ending", expected)
    mesh = _load(path, data)
    size = float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
    scale = MESH_UNITS[unit] or _guessed_scale(path, size)
    return MeshPoints(
        points_mm=np.array(mesh.vertices, float) * scale,
        normals=np.array(mesh.vertex_normals, float),
        faces=np.array(mesh.faces, int),
        scale=scale,
    )


def _load(path: Path, data: bytes):
    import trimesh

    kind = path.suffix[1:].lower()
    if kind in COMPLETE:
        check_complete(path, data)
    try:
        if kind == "vtp":
            mesh = trimesh.Trimesh(*read_vtp(path), process=False)
        else:
            mesh = trimesh.load_mesh(io.BytesIO(data), file_type=kind, process=False)
        faces = np.asarray(mesh.faces)
    except InputProblem:
        raise
    except Exception as error:  # parsers of damaged files raise whatever they stumble over
        reason = str(error) or type(error).__name__
        raise InputProblem(path, "file", reason, f"a triangle mesh in {kind.upper()}") from None
    if len(faces) < _FEWEST_TRIANGLES:
        value = "no triangles" if len(faces) == 0 else counted(len(faces), "triangle")
        expected = f"a triangle mesh of at least {_FEWEST_TRIANGLES} triangles"
        raise InputProblem(path, "faces", value, expected)
    if faces.min() < 0 or faces.max() >= len(mesh.vertices):
        raise InputProblem(path, "faces", "a corner that does not exist", "corners of the mesh")
    if not np.isfinite(mesh.vertices).all():
        raise InputProblem(path, "vertices", "not finite", "finite coordinates")
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    mesh.remove_unreferenced_vertices()
    return mesh


def _guessed_scale(path: Path, size: float) -> float:
    if 0 < size < 1:
        return 1000.0
    if 10 <= size <= 2000:
        return 1.0
    expected = "a diagonal below 1 (metres) or between 10 and 2000 (mm), or a unit given"
    raise InputProblem(path, "bounding box", f"diagonal {size:.4g}", expected)
