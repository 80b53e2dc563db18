"""Meshes of bones and cartilage: STL, PLY, OBJ and, with VTK, VTP; whole ones alone."""

__all__ = ["bone_surface", "read_mesh_points"]

import dataclasses
import importlib
import io
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from kneejax.files.reading import InputProblem, counted, plain_number, read_bytes

#: Endings of the files that can be read.
MESH_ENDINGS = (".stl", ".ply", ".obj", ".vtp")
#: Unit of a mesh file -> mm; `auto` decides by size.
MESH_UNITS = {"auto": None, "m": 1000.0, "mm": 1.0, "cm": 10.0}

_FEWEST_TRIANGLES = 4
#: Type of a number of a PLY file -> that of NumPy.
_TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
          "float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2",
          "uint16": "u2", "int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8"}
_COUNTS = [name for name, kind in _TYPES.items() if kind[0] != "f"]
_STL_HEAD, _STL_FACET = 84, 50
_OBJ_CORNER = re.compile(rb"-?[0-9]+(?:/-?[0-9]*){0,2}")
#: Corners whose triangles are asked: the nearest point lies on one of theirs, unless triangles are
#: far larger than their distance from each other.
_NEAREST = 24


@dataclasses.dataclass(frozen=True)
class MeshPoints:
    """A triangle mesh whose corners are shared."""

    points_mm: np.ndarray  # corners, `(n, 3)`, mm
    normals: np.ndarray  # outward unit normals at the corners, `(n, 3)`
    faces: np.ndarray  # rows of three corners, `(m, 3)`
    scale: float  # mm per unit of the file


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
        raise InputProblem(path, "unit", unit, MESH_UNITS)
    data = read_bytes(path, "a triangle mesh")
    if path.suffix.lower() not in MESH_ENDINGS:
        expected = f"a triangle mesh ending in {', '.join(MESH_ENDINGS)}"
        raise InputProblem(path, "file", path.suffix or "no ending", expected)
    mesh = _load(path, data)
    size, scale = float(np.linalg.norm(np.ptp(mesh.vertices, axis=0))), MESH_UNITS[unit]
    if scale is None:
        if not (0 < size < 1 or 10 <= size <= 2000):
            expected = "a diagonal below 1 (metres) or between 10 and 2000 (mm), or a unit given"
            raise InputProblem(path, "bounding box", f"diagonal {size:.4g}", expected)
        scale = 1000.0 if size < 1 else 1.0
    return MeshPoints(np.array(mesh.vertices, float) * scale, np.array(mesh.vertex_normals, float),
                      np.array(mesh.faces, int), scale)


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
    faces, corners, normals = mesh.faces[flat], corners[flat], normals[flat] / size[flat, None]
    tree, count = KDTree(mesh.points_mm), min(_NEAREST, len(mesh.points_mm))
    around: list[list[int]] = [[] for _ in mesh.points_mm]
    for face, three in enumerate(faces):
        for corner in three:
            around[corner].append(face)

    def lay(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        face, laid = np.zeros(len(points), int), np.zeros((len(points), 3))
        nearest = np.asarray(tree.query(points, count)[1])
        for k, (point, near) in enumerate(zip(points, nearest, strict=True)):
            own = np.unique([face for corner in np.atleast_1d(near) for face in around[corner]])
            at = trimesh.triangles.closest_point(corners[own], np.tile(point, (len(own), 1)))
            best = int(np.argmin(np.linalg.norm(at - point, axis=1)))
            face[k], laid[k] = own[best], at[best]
        return laid, normals[face], np.linalg.norm(points - laid, axis=1)

    return lay


def cut_by_plane(
    corners: np.ndarray, origin: np.ndarray, normal: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Where a plane cuts triangles `(m, 3, 3)`: ends of pieces `(k, 2, 3)`, and their rows."""
    height = (corners - origin) @ normal
    rows = np.flatnonzero((height.min(axis=1) < 0.0) & (height.max(axis=1) >= 0.0))
    height, above = height[rows], height[rows] < 0.0
    # One corner is alone on its side; both pieces of border that it ends are cut.
    alone = np.argmax(above == (above.sum(axis=1) == 1)[:, None], axis=1)
    turned = (alone[:, None] + np.arange(3)) % 3
    points = np.take_along_axis(corners[rows], turned[..., None], axis=1)
    height = np.take_along_axis(height, turned, axis=1)
    part = height[:, :1] / (height[:, :1] - height[:, 1:])
    return points[:, :1] + part[..., None] * (points[:, 1:] - points[:, :1]), rows


def _load(path: Path, data: bytes):
    import trimesh

    kind = path.suffix[1:].lower()
    check = {"ply": _check_ply, "stl": _check_stl, "obj": _check_obj}.get(kind)
    if check is not None:
        check(path, data)
    try:
        if kind == "vtp":
            mesh = trimesh.Trimesh(*_read_vtp(path), process=False)
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


def _read_vtp(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Corners `(n, 3)` and triangles of a `.vtp` file; polygons and strips are cut."""

    def imported(name: str) -> Any:
        try:
            return importlib.import_module(f"vtkmodules.{name}")
        except ImportError:
            way = "VTK to read it (pip install 'kneejax[view]'), or the mesh as STL, PLY or OBJ"
            raise InputProblem(path, "file", path.suffix, way) from None

    # VTK would print paragraphs about a damaged file.
    logger = imported("vtkCommonCore").vtkLogger
    before = logger.GetCurrentVerbosityCutoff()
    logger.SetStderrVerbosity(logger.VERBOSITY_OFF)
    try:
        reader = imported("vtkIOXML").vtkXMLPolyDataReader()
        triangles = imported("vtkFiltersCore").vtkTriangleFilter()
        reader.SetFileName(str(path))
        triangles.SetInputConnection(reader.GetOutputPort())
        triangles.PassLinesOff()
        triangles.PassVertsOff()
        triangles.Update()
    finally:
        logger.SetStderrVerbosity(before)
    if reader.GetErrorCode():
        raise InputProblem(path, "file", "not complete, or damaged", "a triangle mesh in VTP")
    mesh = triangles.GetOutput()
    if mesh.GetNumberOfPolys() == 0:
        return np.zeros((0, 3)), np.zeros((0, 3), int)
    as_array = imported("util.numpy_support").vtk_to_numpy
    corners = as_array(mesh.GetPolys().GetConnectivityArray())
    points = as_array(mesh.GetPoints().GetData())
    return np.array(points, float), np.array(corners, int).reshape(-1, 3)


def _check_ply(path: Path, data: bytes) -> None:
    """Whether the file is complete: parsers read a part without a word."""
    found = re.match(rb"ply\r?\n(?P<lines>.*?)end_header[ \t]*(\r\n|\n|\r)", data, re.DOTALL)
    if found is None:
        raise InputProblem(path, "header", "not complete", "a triangle mesh in PLY")
    # Of each kind of row its name, how many, and the types of its properties, two of a list.
    form, elements = "", list[tuple[str, int, list[tuple[str, ...]]]]()
    for line in found["lines"].decode("ascii", "replace").splitlines():
        match line.split():
            case ["format", ("ascii" | "binary_little_endian" | "binary_big_endian") as form, _]:
                pass
            case ["element", name, count] if re.fullmatch("[0-9]{1,9}", count):
                elements.append((name, int(count), []))
            case ["property", "list", count, kind, _] if elements and count in _COUNTS:
                elements[-1][2].append((count, kind))
            case ["property", kind, _] if elements and kind in _TYPES:
                elements[-1][2].append((kind,))
            case [("comment" | "obj_info"), *_] | []:
                pass
            case _:
                raise InputProblem(path, "header", line, "a line of the header of a PLY mesh")
    if not form or not elements:
        lacks = "no elements" if form else "no format"
        raise InputProblem(path, "header", lacks, "a triangle mesh in PLY")
    body, expected = data[found.end() :], " and ".join(f"{n} rows of {x}" for x, n, _ in elements)
    expected += ", as the header says"
    if form == "ascii":
        rows, first = [line.split() for line in body.split(b"\n") if line.strip()], 0
        for name, count, properties in elements:
            for number, row in enumerate(rows[first : first + count], 1):
                if len(row) != _numbers_of(row, properties):
                    shown = counted(len(row), "number")
                    raise InputProblem(path, f"{name}, row {number}", shown, "a whole row")
            first += count
        if len(rows) != first:
            raise InputProblem(path, "rows", len(rows), expected)
        return
    there, end, order = len(body), 0, "<" if form == "binary_little_endian" else ">"
    for name, count, properties in elements:
        end = _end_of_rows(body, end, count, properties, order)
        if end > there:
            raise InputProblem(path, "rows", f"the end of the file in {name}", expected)
    if body[end:].strip():
        raise InputProblem(path, "rows", counted(there - end, "byte") + " more", expected)


def _numbers_of(row: list[bytes], properties: list[tuple[str, ...]]) -> int:
    """Numbers that a row of an ASCII file should have; lists say how long they are."""
    place = 0
    for kinds in properties:
        if len(kinds) == 1:
            place += 1
        elif place < len(row) and row[place].isdigit():
            place += 1 + int(row[place][:9])
        else:
            return -1
    return place


def _end_of_rows(
    body: bytes, begin: int, count: int, properties: list[tuple[str, ...]], order: str
) -> int:
    """Where so many rows end in a binary file, if it is long enough."""
    sizes = [[np.dtype(_TYPES.get(kind, "u1")).itemsize for kind in kinds] for kinds in properties]
    if all(len(one) == 1 for one in sizes):
        return begin + count * sum(size for (size,) in sizes)
    for _ in range(count):
        for kinds, size in zip(properties, sizes, strict=True):
            if len(kinds) == 2:
                head = body[begin : begin + size[0]]
                if len(head) < size[0]:
                    return len(body) + 1
                begin += max(int(np.frombuffer(head, order + _TYPES[kinds[0]])[0]), 0) * size[1]
            begin += size[0]
    return begin


def _check_stl(path: Path, data: bytes) -> None:
    """A binary file is as long as it says; one of text ends with the word for its end."""
    says = int.from_bytes(data[80:_STL_HEAD], "little") if len(data) >= _STL_HEAD else -1
    if says >= 0 and len(data) == _STL_HEAD + says * _STL_FACET:
        return
    words = [word.lower() for word in data.split()]
    if words[:1] != [b"solid"] or b"\x00" in data:
        lengths = f": {_STL_HEAD} bytes, then {says} triangles of {_STL_FACET}" * (says >= 0)
        raise InputProblem(path, "file", counted(len(data), "byte"),
                           f"a triangle mesh in STL{lengths}")
    facets, loops, ends, corners = (
        words.count(word) for word in (b"outer", b"endloop", b"endfacet", b"vertex"))
    if facets and b"endsolid" not in words:
        raise InputProblem(path, "file", "no endsolid at its end", "a whole triangle mesh in STL")
    if not ends == loops == facets or corners != 3 * facets:
        found = f"{corners} corners of {counted(facets, 'triangle')}"
        raise InputProblem(path, "file", found, "three corners of each triangle")


def _check_obj(path: Path, data: bytes) -> None:
    for number, line in enumerate(data.splitlines(), 1):
        words, good, expected = line.split(b"#")[0].split(), True, ""
        if words[:1] == [b"v"]:
            numbers = (plain_number(word.decode("ascii", "replace")) for word in words[1:4])
            good, expected = all(x is not None for x in numbers), "three coordinates of a corner"
        elif words[:1] == [b"f"]:
            good = all(_OBJ_CORNER.fullmatch(word) for word in words[1:])
            expected = "three corners of a face or more"
        if expected and not (good and len(words) >= 4):
            found = b" ".join(words).decode("utf-8", "replace")
            raise InputProblem(path, f"line {number}", found, expected)
