"""What is wrong with a triangle mesh, and its repair.

Repairs are said in findings, one sentence each. What cannot be repaired is refused.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from kneejax.files.meshes.points import MeshPoints
from kneejax.files.reading import InputProblem, counted

#: Corners closer than this are one, mm.
_SAME_MM = 1e-3
_SMALLEST_MM2 = 1e-9
#: Holes up to this diameter are bridged by a smooth fit, mm.
LARGEST_HOLE_MM = 10.0
_FRAGMENT = 0.05
_MOST_BRANCHING = 0.01


class Sheet(NamedTuple):
    """A connected, consistently wound part of a mesh."""

    points: np.ndarray  # corners of the whole mesh, shape `(n, 3)`, mm
    faces: np.ndarray  # rows of three corners, shape `(m, 3)`
    closed: bool  # whether it bounds a volume; its normals then point outwards
    name: str  # the file

    @property
    def area(self) -> float:
        """In mm^2."""
        return float(self.face_areas.sum())

    @property
    def face_areas(self) -> np.ndarray:
        """Of each face, mm^2."""
        return 0.5 * np.linalg.norm(self._crosses, axis=1)

    @property
    def normals(self) -> np.ndarray:
        """Unit normals of the faces, shape `(m, 3)`."""
        crosses = self._crosses
        return crosses / np.linalg.norm(crosses, axis=1, keepdims=True)

    @property
    def centers(self) -> np.ndarray:
        """Of the faces, shape `(m, 3)`, mm."""
        return self.points[self.faces].mean(axis=1)

    @property
    def _crosses(self) -> np.ndarray:
        a, b, c = (self.points[self.faces[:, k]] for k in range(3))
        return np.cross(b - a, c - a)

    def kept(self, faces: np.ndarray) -> "Sheet":
        """The part with these faces only (a mask or row numbers)."""
        return self._replace(faces=self.faces[faces], closed=False)

    def turned(self) -> "Sheet":
        """The same sheet with the other side out."""
        return self._replace(faces=self.faces[:, ::-1])

    def corners(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Used corners, the area that each stands for, and unit normals there."""
        used, place = np.unique(self.faces, return_inverse=True)
        place = place.reshape(-1, 3)
        share = np.repeat(self.face_areas / 3.0, 3)
        area = np.bincount(place.ravel(), share, len(used))
        crosses = np.repeat(self._crosses, 3, axis=0)
        raw = np.stack([np.bincount(place.ravel(), c, len(used)) for c in crosses.T], axis=1)
        length = np.linalg.norm(raw, axis=1, keepdims=True)
        return self.points[used], area, raw / np.where(length > 0, length, 1.0)


def take_apart(mesh: MeshPoints, name: str) -> tuple[list[Sheet], list[str]]:
    """Repair a mesh and take it apart into sheets, the largest first; a sentence each."""
    from trimesh.grouping import group_rows

    findings: list[str] = []
    named = Path(name).name
    if mesh.scale != 1.0:
        findings.append(f"{named}: lengths were multiplied by {mesh.scale:g} to be in mm.")
    points, faces = _cleaned(mesh, name, findings)
    edges = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
    ends, forwards = np.sort(edges, axis=1), edges[:, 0] < edges[:, 1]
    alone, two = (np.asarray(group_rows(ends, require_count=count)) for count in (1, 2))
    branching = len(np.unique(ends, axis=0)) - len(alone) - len(two)
    if branching > _MOST_BRANCHING * 1.5 * len(faces):
        raise InputProblem(name, "edges", f"{branching} with more than two triangles", "a surface")
    if branching:
        findings.append(f"{named}: {counted(branching, 'edge')} of more than two triangles, kept.")
    # Parts, and faces that are wound against their part's first: in a graph with a node for each
    # face as it is, and one for it turned, an edge joins those wound alike.
    count, (first, second), (one, other) = len(faces), (two // 3).T, forwards[two].T
    wound = second + count * (one == other), second + count * (one != other)
    part, own = (
        connected_components(coo_array((np.ones(len(a)), (a, b)), (size, size)), directed=False)[1]
        for a, b, size in ((first, second, count),
                           (np.r_[first, first + count], np.r_[wound], 2 * count)))
    flip = own[:count] != own[np.unique(part, return_index=True)[1][part]]
    boundary = np.zeros(part.max() + 1, bool)
    boundary[part[alone // 3]] = True
    sheets, turned = [], 0
    for number in range(part.max() + 1):
        rows = part == number
        flipped = flip[rows]
        # The winding of the majority stays, until the sheet as a whole is turned to the joint.
        flipped = ~flipped if 2 * flipped.sum() > len(flipped) else flipped
        turned += int(flipped.sum())
        own = np.where(flipped[:, None], faces[rows][:, ::-1], faces[rows])
        sheet = Sheet(points, own, not boundary[number], name)
        a, b, c = (points[own[:, k]] for k in range(3))
        if sheet.closed and np.einsum("ij,ij->", a, np.cross(b, c)) < 0:  # six times its volume
            sheet, turned = sheet.turned(), turned + len(own)
        sheets.append(sheet)
    if turned:
        findings.append(f"{named}: {turned} of {len(faces)} triangles faced the other way; turned.")
    sheets = sorted(sheets, key=lambda sheet: -sheet.area)
    total = sum(sheet.area for sheet in sheets)
    large = [sheet for sheet in sheets if sheet.area >= _FRAGMENT * total]
    if len(large) < len(sheets):
        lost = 100.0 * (1.0 - sum(sheet.area for sheet in large) / total)
        fragments = counted(len(sheets) - len(large), "fragment")
        findings.append(f"{named}: left out {fragments} with {lost:.1f} % of the area.")
    return large, findings


def borders(sheet: Sheet) -> list[np.ndarray]:
    """Closed border lines of a sheet, the longest first: rows of corner numbers."""
    a, b = sheet.faces.ravel(), np.roll(sheet.faces, -1, axis=1).ravel()
    there = set(zip(a.tolist(), b.tolist(), strict=True))
    onwards: dict[int, list[int]] = {}
    for i, j in there:
        if (j, i) not in there:
            onwards.setdefault(i, []).append(j)
    lines = []
    for start in sorted(onwards):
        while onwards[start]:
            line, at = [start], onwards[start].pop()
            while at != start and onwards.get(at):
                line.append(at)
                at = onwards[at].pop()
            lines.append(np.array(line))
    lengths = [_length(sheet.points[line]) for line in lines]
    return [lines[k] for k in np.argsort(lengths)[::-1]]


def check_holes(sheet: Sheet, findings: list[str], bordered: bool = True) -> None:
    """Add a sentence for each hole of a sheet; raises for one too wide to be bridged."""
    lines, named = borders(sheet), Path(sheet.name).name
    size = np.sqrt(sheet.area)
    is_border = bordered and lines and _length(sheet.points[lines[0]]) > 0.5 * np.pi * size
    for line in lines[1:] if is_border else lines:
        diameter = _length(sheet.points[line]) / np.pi
        place = ", ".join(f"{x:.0f}" for x in sheet.points[line].mean(axis=0))
        if diameter > LARGEST_HOLE_MM:
            expected = f"holes of at most {LARGEST_HOLE_MM:g} mm"
            value = f"a hole of {diameter:.0f} mm at ({place}) mm"
            raise InputProblem(sheet.name, "faces", value, expected)
        said = f"a hole of {diameter:.1f} mm at ({place}) mm; the fit bridges it."
        findings.append(f"{named}: {said}")


def _length(line: np.ndarray) -> float:
    return float(np.linalg.norm(line - np.roll(line, -1, axis=0), axis=1).sum())


def _cleaned(mesh: MeshPoints, name: str, findings: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Corners, those that coincide as one, and triangles with area, each once."""
    _, first, place = np.unique(np.round(mesh.points_mm / _SAME_MM), axis=0, return_index=True,
                                return_inverse=True)
    count, named = len(mesh.points_mm) - len(first), Path(name).name
    if count:
        findings.append(f"{named}: corners that coincide with others, merged: {count}.")
    points, faces = mesh.points_mm[first], place.ravel()[mesh.faces]
    flat = Sheet(points, faces, False, name).face_areas < _SMALLEST_MM2
    twice = np.ones(len(faces), bool)
    twice[np.unique(np.sort(faces, axis=1), axis=0, return_index=True)[1]] = False
    for wrong, what in ((flat, "without area"), (twice & ~flat, "that stood there twice")):
        if wrong.any():
            findings.append(f"{named}: left out {counted(wrong.sum(), 'triangle')} {what}.")
    faces = faces[~(flat | twice)]
    if len(faces) < 4:
        expected = "a mesh of triangles with area"
        raise InputProblem(name, "faces", f"{len(faces)} with area", expected)
    return points, faces


def narrowest(sheet: Sheet) -> float | None:
    """Where along Z a sheet is narrowest between two compartments, mm; None where nowhere."""
    z = sheet.centers[:, 2]
    edges = np.arange(np.floor(z.min()), np.ceil(z.max()) + 1.0)
    width, _ = np.histogram(z, edges, weights=sheet.face_areas)
    width = np.convolve(width, np.ones(3) / 3.0, mode="same")
    quarter = len(width) // 4
    k = quarter + int(np.argmin(width[quarter : len(width) - quarter]))
    if width[k] > 0.75 * min(width[:k].max(initial=0.0), width[k:].max(initial=0.0)):
        return None
    return float(0.5 * (edges[k] + edges[k + 1]))
