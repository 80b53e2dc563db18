"""Meshes of soft tissue: a meniscus as a ring on its plateau, a ligament as a band."""

__all__ = ["MeshBand", "MeshMeniscus", "band_of_meshes", "meniscus_of_mesh"]

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from kneejax import geometry
from kneejax.files.knee.document import mirror_document, mirror_part
from kneejax.files.knee.surfaces import build_surface
from kneejax.files.meshes import anatomy, importing
from kneejax.files.meshes.health import Sheet, check_holes
from kneejax.files.meshes.importing import TARGET_RMS_MM, MeshPath, judge, right_sheets
from kneejax.files.meshes.points import bone_surface, cut_by_plane, read_mesh_points
from kneejax.files.meshes.surfaces import SheetFit, sheet_fit
from kneejax.files.reading import InputProblem
from kneejax.geometry import Plateau, Pose, Vector
from kneejax.mechanics import QUADRATURE, AttachmentArea, untwisted

#: Numbers of the contact and of its ring that a mesh does not state.
MATERIAL = {"youngs_modulus_MPa": 20.0, "poisson_ratio": 0.2, "onset_width_mm": 0.05}
RING = {"youngs_modulus_MPa": 120.0, "horn_stiffness_N_per_mm": 180.0,
        "coronary_stiffness_N_per_mm": 30.0}  # fmt: skip
_OF_RING = {"youngs_modulus_MPa": "along the fibres, Haut Donahue 2003",
            "horn_stiffness_N_per_mm": "18 springs of 10 N/mm",
            "coronary_stiffness_N_per_mm": "assumed"}  # fmt: skip
#: Sections along the arc, places across each, and corners along either border of the outline.
_SECTIONS, _PLACES, _CORNERS = 60, 200, 24
#: From the horns to the ends of the outline, rad: a plane through the end of a horn cuts nothing.
_END = np.deg2rad(0.1)
_RENEWALS = 4  # of the middle
_DOWN = -0.3  # of normals of the lower side
#: Sizes of a meniscus; distances from the plateau and lengths of edges that are doubted; distances
#: from the plateau and from its middle that are refused, mm.
_WIDTHS_MM = (15.0, 80.0)
_LYING_MM, _COARSE_MM, _FARTHEST_MM, _BESIDE_MM = 1.0, 3.0, 5.0, 20.0
_FEWEST = 6  # triangles where a ligament is attached
_ALONG = 21  # cross-sections of a ligament


class MeshMeniscus(NamedTuple):
    """What a meniscus's mesh states of a contact with a ring."""

    name: str  # of the contact: its compartment's, with `_meniscus`
    contact: dict[str, Any]  # entry of a knee document, of the side that was given
    fit: SheetFit  # of the upper surface, in the tibia's frame of a right knee
    # of sections through the middle, from the front towards the right, `(n,)`
    angle_deg: np.ndarray
    inner_mm: np.ndarray  # distance of their inner border from the middle, `(n,)`
    outer_mm: np.ndarray  # likewise of their outer border
    height_mm: np.ndarray  # where they are highest, `(n,)`
    area_mm2: np.ndarray  # their areas, `(n,)`
    findings: tuple[str, ...]  # what was found, a sentence each
    doubts: tuple[str, ...]  # what a person should look at, likewise


def meniscus_of_mesh(
    meshes: MeshPath | Sequence[MeshPath], document: Mapping[str, Any],
    compartment: str | None = None, *, pose: Pose | None = None, unit: str = "auto",
    material: Mapping[str, Any] = {}, ring: Mapping[str, float] = {},
) -> MeshMeniscus:  # fmt: skip
    """The contact with a ring that a meniscus's mesh is.

    Args:
        meshes: a closed mesh; or the upper and the lower side of one meniscus, as two sheets.
        document: of a knee file with the contact of the compartment in which it lies.
        compartment: `medial` or `lateral`; by the place of the mesh if it is not given.
        pose: of the tibia in the femur, if the mesh is in the femur's frame; without it the mesh
            is in the tibia's.
        unit: of the files; see `read_mesh_points`.
        material: fields of the contact in place of `MATERIAL`'s, or besides them; None is none.
        ring: fields of its ring in place of `RING`'s.

    Returns:
        The contact, its sections, and how well the surface fits.

    Raises:
        InputProblem: the mesh is not closed, is in pieces, no arc, not of the size of a meniscus,
            or lies elsewhere; or the knee has no such contact.
    """
    paths = [meshes] if isinstance(meshes, str | os.PathLike) else [*meshes]
    left, findings, doubts = document["side"] == "left", [], []
    path, stated = paths[0], " and ".join(Path(one).name for one in paths)
    sheets: list[Sheet] = []
    for one in paths:
        sheets += (found := right_sheets(one, unit, left, findings))
        if len(found) > 1:
            raise InputProblem(one, "pieces", f"{len(found)} of them", "one meniscus, in one piece")
    if len(paths) == 1:  # its small holes are no border
        check_holes(sheets[0], doubts, bordered=False)
        a, b, c = sheets[0].points[sheets[0].faces].swapaxes(0, 1)
        inside_out = np.einsum("ij,ij->", a - a.mean(axis=0), np.cross(b - a, c - a)) < 0.0
        whole = sheets[0]._replace(closed=True)
        sheets = [whole.turned() if inside_out else whole]
    (low, high), wide = _WIDTHS_MM, max(float(np.ptp(s.corners()[0], axis=0).max()) for s in sheets)
    if not low < wide < high:
        expected = f"a meniscus {low:g} to {high:g} mm wide; is the unit right?"
        raise InputProblem(path, "width", f"{wide:.3g} mm", expected)
    if pose is not None:
        there = pose.placement.inverse()
        sheets = [s._replace(points=anatomy.moved(there, s.points)) for s in sheets]
    right = mirror_document({**document}) if left else document
    name = _compartment(path, anatomy.joined(sheets), right["contacts"], compartment)
    cartilage = right["contacts"][name]
    plateau: Any = build_surface(cartilage["tibial_surface"])
    local = [s._replace(points=anatomy.in_frame(plateau.frame, s.points)) for s in sheets]
    corners = np.concatenate([sheet.points[sheet.faces] for sheet in local])
    middle = _middle(corners)
    begin, end = _horns(path, corners, middle, name)
    turns = begin + (end - begin) * (np.arange(_SECTIONS) + 0.5) / _SECTIONS
    inner, outer, height, area = _sections(corners, middle, turns).T
    if not np.all(area > 0.0):
        value = f"{np.nanmin(area):.3g} mm2" if np.isfinite(area).all() else "a gap in its arc"
        expected = "a closed mesh of one arc, or its upper and its lower side"
        raise InputProblem(path, "cross-section", value, expected)
    up = np.array([float(c) for c in plateau.frame.placement.turn((0.0, 1.0, 0.0)).full()])
    (upper,) = anatomy.articular(sheets[:1], up, "upper", findings)
    cloud = anatomy.joined([upper])
    at = np.linspace(begin + _END, end - _END, _CORNERS)
    near, far, *_ = _sections(corners, middle, at).T
    rays = np.stack([np.cos(at), np.sin(at)], axis=1)
    outline = middle + np.concatenate([far[:, None] * rays, (near[:, None] * rays)[::-1]])
    flat = np.concatenate([anatomy.in_frame(plateau.frame, cloud.points)[:, [0, 2]], outline])
    x, z = ((float(c.min()), float(c.max())) for c in flat.T)
    try:
        spline = geometry.fit_plateau_spline(cloud.points, x, z, plateau.frame, cloud.areas,
                                             outline=np.round(outline, 3))  # fmt: skip
    except ValueError as error:
        raise InputProblem(path, "upper side", str(error), "a finer mesh") from None
    fit = sheet_fit(spline, None)
    judge(f"{name} meniscus", fit, "everywhere", stated, findings)
    if fit.quality.rms > TARGET_RMS_MM:
        doubts.append(findings.pop())
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    if (edge := float(np.median(edges))) > _COARSE_MM:
        doubts.append(f"{stated}: edges of {edge:.1f} mm are coarse for a meniscus.")
    lower = local[-1].kept(local[-1].normals[:, 1] < _DOWN) if len(local) == 1 else local[-1]
    points, areas, _ = lower.corners()
    gap = float(np.average(np.asarray(_above(plateau, points)), weights=areas))
    said = f"{stated}: the lower side lies {gap:+.1f} mm above the {name} plateau on average"
    if abs(gap) > _FARTHEST_MM:
        expected = f"within {_FARTHEST_MM:g} mm of it; is the frame right?"
        raise InputProblem(path, "place", f"{gap:+.1f} mm above the {name} plateau", expected)
    (doubts if abs(gap) > _LYING_MM else findings).append(f"{said}.")

    cartilage_mm, width = float(cartilage["layer_thickness_mm"]), outer - inner
    thick = float(area.mean() / width.mean())
    arc = float(0.5 * (inner + outer).mean()) * (end - begin)
    findings += [
        f"{name} meniscus: cross-section {area.mean():.1f} mm2 on average ({area.min():.1f} to "
        f"{area.max():.1f} along the arc), {height.mean():.1f} mm high ({height.min():.1f} to "
        f"{height.max():.1f}), {width.mean():.1f} mm wide, {np.rad2deg(end - begin):.0f} degrees "
        "from horn to horn.",
        f"{name} meniscus: {thick:.1f} mm thick on average, with {cartilage_mm:g} mm of cartilage.",
    ]
    material, ring = ({key: x for key, x in given.items() if x not in (None, usual.get(key))}
                      for given, usual in ((material, MATERIAL), (ring, RING)))  # fmt: skip
    source = dict.fromkeys(MATERIAL, "across the fibres: Haut Donahue 2003")
    source["layer_thickness_mm"] = f"mean thickness of {stated}, and both cartilages'"
    whence = {**_OF_RING, **dict.fromkeys(ring, "given at import")}
    source["ring"] = "; ".join([f"{stated}", *(f"{x}: {y}" for x, y in whence.items())])
    contact = {
        "form": QUADRATURE, "points": importing.spread_points([arc, float(width.mean())], least=6),
        "law": "linear", **MATERIAL,
        "layer_thickness_mm": round(thick + cartilage_mm, 3), **material,
        "ring": {**RING, "cross_section_mm2": round(float(area.mean()), 2),
                 "middle_mm": importing.listed(middle),
                 "horns_deg": importing.listed(np.rad2deg([begin, end])), **ring},
        "femoral_surface": cartilage["femoral_surface"],
        "tibial_surface": importing.surface_entry(fit, stated),
        "source": source | dict.fromkeys(source.keys() & material.keys(), "given at import"),
    }  # fmt: skip
    sign = -1.0 if left else 1.0
    return MeshMeniscus(
        f"{name}_meniscus", mirror_part(contact) if left else contact, fit,
        sign * np.rad2deg(turns), inner, outer, height, area, tuple(findings), tuple(doubts))


@jax.jit
def _above(plateau: Plateau, points: np.ndarray) -> jax.Array:
    """How far points of the plateau's frame `(n, 3)` lie above it, mm, `(n,)`."""
    return plateau.level(tuple(points.T))


def _compartment(
    path: MeshPath, cloud: anatomy.Cloud, contacts: Mapping[str, Any], asked: str | None
) -> str:
    """The compartment over which a mesh lies."""
    away = {}
    for name in ("medial", "lateral"):
        if contacts.get(name, {}).get("tibial_surface", {}).get("kind") == "plateau":
            plateau: Any = build_surface(contacts[name]["tibial_surface"])
            local = anatomy.in_frame(plateau.frame, cloud.points)[:, [0, 2]]
            middle = np.mean([np.asarray(plateau.x), np.asarray(plateau.z)], axis=1)
            off = np.average(local, axis=0, weights=cloud.areas) - middle
            away[name] = float(np.hypot(*off))
    if not away or (asked or "") not in ("", *away):
        expected = f"a contact {asked or 'medial or lateral'} with a plateau, in the knee"
        raise InputProblem(path, "contacts", ", ".join(contacts) or "none", expected)
    nearest = min(away, key=lambda name: away[name])
    if away[nearest] > _BESIDE_MM or asked not in (None, nearest):
        expected = f"a mesh over the {asked or nearest} plateau; are compartment and frame right?"
        value = f"{away[asked or nearest]:.0f} mm beside its middle"
        raise InputProblem(path, "place", value, expected)
    return nearest


def _middle(corners: np.ndarray) -> np.ndarray:
    """Centre of the circle nearest to the outer border, forwards and to the right, mm, `(2,)`."""
    border, middle = corners.reshape(-1, 3)[:, [0, 2]], np.zeros(2)
    turns = np.linspace(-np.pi, np.pi, 72, endpoint=False)
    for _ in range(_RENEWALS + 1):
        columns = np.c_[2.0 * border, np.ones(len(border))]
        middle = np.linalg.lstsq(columns, (border**2).sum(axis=1), rcond=None)[0][:2]
        outer = _sections(corners, middle, turns)[:, 1]
        rays = np.stack([np.cos(turns), np.sin(turns)], axis=1)
        border = (middle + outer[:, None] * rays)[np.isfinite(outer)]
    return middle


def _sections(corners: np.ndarray, middle: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Inner and outer distance, height, area of sections from the middle, `(n, 4)`; NaN: no cut."""
    found, origin = [], np.array([middle[0], 0.0, middle[1]])
    for turn in turns:
        c, s = np.cos(turn), np.sin(turn)
        pieces, _ = cut_by_plane(corners, origin, np.array([-s, 0.0, c]))
        away = (pieces - origin) @ [c, 0.0, s]
        ahead = (away > 0.0).all(axis=1)
        if not ahead.any():
            found.append([np.nan] * 4)
            continue
        (a, b), (low, high) = away[ahead].T, pieces[ahead][..., 1].T
        inner, outer = min(a.min(), b.min()), max(a.max(), b.max())
        at = inner + (outer - inner) * (np.arange(_PLACES)[:, None] + 0.5) / _PLACES
        part = (at - a) / np.where(a == b, np.inf, b - a)
        level, here = low + part * (high - low), (at - a) * (at - b) <= 0.0
        top = np.where(here, level, -np.inf).max(axis=1)
        thick = np.maximum(top - np.where(here, level, np.inf).min(axis=1), 0.0)
        found.append([inner, outer, thick.max(), thick.mean() * (outer - inner)])
    return np.array(found)


def _horns(
    path: MeshPath, corners: np.ndarray, middle: np.ndarray, name: str
) -> tuple[float, float]:
    """Angles between which the arc lies, rad, from the front towards the right."""
    forwards, right = (corners.reshape(-1, 3)[:, [0, 2]] - middle).T
    turns = np.unique(np.arctan2(right, forwards))
    gaps = np.diff(np.r_[turns, turns[0] + 2.0 * np.pi])
    k = int(np.argmax(gaps))
    opening = turns[k] + 0.5 * gaps[k]
    if np.isfinite(_sections(corners, middle, np.array([opening]))).any():
        expected = "an arc with two horns, open towards the middle of the knee"
        raise InputProblem(path, "arc", "closed all around its middle", expected)
    if (np.sin(opening) > 0.0) != (name == "medial"):
        value = f"open {'laterally' if np.sin(opening) > 0.0 else 'medially'}"
        expected = f"a {name} meniscus, open towards the middle of the knee; is the side right?"
        raise InputProblem(path, "arc", value, expected)
    begin, end = float(turns[k] + gaps[k] - 2.0 * np.pi), float(turns[k])
    # The same numbers whatever the direction in which an angle begins to count.
    shift = 2.0 * np.pi * np.round(0.5 * (begin + end) / (2.0 * np.pi))
    return begin - shift, end - shift


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
    in_second = anatomy.moved(back, mesh.points_mm * mirror) * mirror
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
    along = length * np.linspace(0.2, 0.8, _ALONG)
    areas = np.array([_cross_section(corners, normals, first.centre, span / length, x)
                      for x in along])
    if not np.all(areas > 0.0):
        expected = "a closed mesh, with the ligament's inside between its areas"
        raise InputProblem(ligament, "cross-section", f"{areas.min():.3g} mm^2", expected)
    axes = [[*map(float, back.turn(Vector(*x)))] for x in second.half_axes * mirror]
    centre = anatomy.moved(back, second.centre[None] * mirror)[0] * mirror
    tibial = AttachmentArea(centre, np.array(axes) * mirror)
    return MeshBand(first, tibial, span / length, along, areas)


def _cross_section(corners, normals, origin, direction, at: float) -> float:
    """Area in which a plane cuts a closed mesh, mm^2, from its border by Gauss's theorem."""
    pieces, rows = cut_by_plane(corners, origin + at * direction, direction)
    outwards = normals[rows] - (normals[rows] @ direction)[:, None] * direction
    size = np.linalg.norm(outwards, axis=1)
    reach = np.einsum("ij,ij->i", pieces.mean(axis=1) - origin, outwards)
    length = np.linalg.norm(pieces[:, 1] - pieces[:, 0], axis=1)
    return float(0.5 * np.sum(reach / np.where(size > 0.0, size, np.inf) * length))
