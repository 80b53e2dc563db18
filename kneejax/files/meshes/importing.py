"""Contacts of a knee from meshes of its cartilage."""

__all__ = ["MeshImport", "MeshOptions", "import_meshes"]

import dataclasses
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from kneejax.files.knee.document import mirror_part
from kneejax.files.meshes import anatomy
from kneejax.files.meshes import surfaces as fitted
from kneejax.files.meshes.health import Sheet, check_holes, take_apart
from kneejax.files.meshes.points import read_mesh_points
from kneejax.files.meshes.surfaces import SheetFit
from kneejax.files.reading import InputProblem
from kneejax.geometry import Condyle, Frame, Placement, Pose
from kneejax.mechanics import QUADRATURE, RANGES, cartilage_law

#: Distances from the fit over the contact region that are wished for, and refused, mm.
TARGET_RMS_MM, WORST_RMS_MM = 0.1, 0.5
#: How the layer's thickness may be given over a compartment.
THICKNESSES = ("constant", "field")
_SIDES = {"r": "right", "l": "left", "right": "right", "left": "left"}
_SMALLEST_ANGLE_DEG = 30.0
_POINT_DISTANCE_MM = 1.7
_DIGITS = 5
_MIRROR = np.array([1.0, 1.0, -1.0])

MeshPath = str | os.PathLike[str]


@dataclasses.dataclass(frozen=True)
class MeshOptions:
    """How contacts are made of meshes. What is not given is found: the femoral axis, the notch, the
    compartments, the region of contact, cells and smoothing.

    Attributes:
        patellar_cartilage: in the patella's frame.
        femur_bone: for the layer's thickness, with `tibia_bone`.
        tibia_bone: likewise.
        youngs_modulus_MPa: of the layer.
        poisson_ratio: of the layer.
        law: pressure law.
        layer_thickness_mm: both cartilages; from the bones if they are given, else 6 mm, which the
            findings say.
        thickness: `constant`, or `field` for a smooth thickness over each plateau.
        onset_width_mm: rounding of the depth's corner at first touch.
        reference_pose: of the tibia in the femur at which the meshes meet; all zero by default.
        unit: of the files; see `read_mesh_points`.
        axis_point_mm: a point of the femoral axis.
        axis_rotation_deg: turn of that axis about X and Y, from the femur's Z.
        notch_mm: the intercondylar notch, along the axis.
        split_mm: where the tibial compartments part, along Z.
        angle_deg: region of the condyles from anterior (0) through distal (90).
        cell_mm: size of the splines' cells.
        smoothing_mm: length below which bends are smoothed away.
        source: where the meshes come from; the files' names by default.

    Example:
        >>> MeshOptions(layer_thickness_mm=4.0).layer_thickness_mm
        4.0
    """

    patellar_cartilage: MeshPath | None = None
    femur_bone: MeshPath | None = None
    tibia_bone: MeshPath | None = None
    youngs_modulus_MPa: float = 10.0
    poisson_ratio: float = 0.45
    law: str = "linear"
    layer_thickness_mm: float | None = None
    thickness: str = "constant"
    onset_width_mm: float = 0.02
    reference_pose: Pose | None = None
    unit: str = "auto"
    axis_point_mm: tuple[float, float, float] | None = None
    axis_rotation_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    notch_mm: float | None = None
    split_mm: float | None = None
    angle_deg: tuple[float, float] | None = None
    cell_mm: float | None = None
    smoothing_mm: float | None = None
    source: str | None = None

    @property
    def tibia(self) -> Placement:
        """Where the tibia is in the femur."""
        return (self.reference_pose or Pose.from_table([0.0] * 6)).placement

    def check(self, femoral_cartilage: MeshPath, tibial_cartilage: MeshPath) -> None:
        """Refuse options and files that cannot be meant, before the work begins."""
        if (self.femur_bone is None) != (self.tibia_bone is None):
            missing = "--femur-bone" if self.femur_bone is None else "--tibia-bone"
            raise InputProblem(missing, "file", "missing", "both bone meshes, or neither")
        seen: dict[str, str] = {}
        for option, path in (
            ("--femur-cartilage", femoral_cartilage), ("--tibia-cartilage", tibial_cartilage),
            ("--patella-cartilage", self.patellar_cartilage), ("--femur-bone", self.femur_bone),
            ("--tibia-bone", self.tibia_bone),
        ):
            if path and (first := seen.setdefault(os.path.realpath(path), option)) != option:
                expected = f"another file than that of {first}"
                raise InputProblem(option, "file", os.fspath(path), expected)
        for name, value, known in (("law", self.law, cartilage_law.LAWS),
                                   ("thickness", self.thickness, THICKNESSES)):
            if value not in known:
                raise InputProblem(f"--{name}", name, value, known)
        for option, what, field in (
            ("--modulus", "Young's modulus", "youngs_modulus_MPa"),
            ("--poisson-ratio", "Poisson's ratio", "poisson_ratio"),
            ("--layer-thickness", "thickness", "layer_thickness_mm"),
        ):
            value = getattr(self, field)
            if value is not None and not RANGES[field].holds(value):
                raise InputProblem(option, what, value, RANGES[field].expected(value))
        varies, (lower, upper) = self.thickness != "constant", self.angle_deg or (0.0, 180.0)
        allowed = -180 <= lower and upper <= 360 and upper - lower >= _SMALLEST_ANGLE_DEG
        for wrong, option, what, value, expected in (
            (varies and self.layer_thickness_mm is not None, "--thickness", "thickness",
             self.thickness, "constant, where --layer-thickness gives one number"),
            (varies and self.femur_bone is None, "--thickness", "thickness", self.thickness,
             "both bone meshes, for a field"),
            (self.axis_point_mm is None and any(self.axis_rotation_deg), "--axis-point", "axis",
             "missing", "a point of the axis too, where --axis-rotation is given"),
            (not allowed, "--angle", "region", f"{lower:g} {upper:g}",
             "two angles in degrees from anterior (0) through distal (90) to posterior (180), the "
             f"second larger by {_SMALLEST_ANGLE_DEG:g} at least"),
        ):  # fmt: skip
            if wrong:
                raise InputProblem(option, what, value, expected)


@dataclasses.dataclass(frozen=True)
class MeshImport:
    """Contacts and surfaces fitted to meshes."""

    contacts: dict[str, dict[str, Any]]  # of a knee document, by name, of the side that was given
    findings: tuple[str, ...]  # what was found, repaired and assumed, a sentence each
    fits: dict[str, SheetFit]  # `medial condyle`, `medial plateau`, ..., `patella`, `trochlea`
    doubtful: bool  # whether a fit misses the target
    # the contact of femur and patella; None without its mesh
    patellofemoral: dict[str, Any] | None = None


def import_meshes(
    femoral_cartilage: MeshPath, tibial_cartilage: MeshPath, *, side: str,
    options: MeshOptions | None = None,
) -> MeshImport:  # fmt: skip
    """Fit contacts to meshes of cartilage, in the frames of their bones.

    Frames are X anterior, Y superior, Z to the person's right.

    Args:
        femoral_cartilage: STL, PLY, OBJ or VTP file: an open sheet or a closed volume.
        tibial_cartilage: likewise, one sheet or two.
        side: `right` or `left` (or `r`, `l`).
        options: further meshes, material, and what is not to be found; `MeshOptions()` by default.

    Returns:
        Contacts, that of the patella, findings and fits.

    Raises:
        InputProblem: a file cannot be read or repaired, meshes are no femur and tibia that meet,
            cartilage is not thicker than zero, or the surfaces are none over these parameters.

    Example:
        >>> wet = MeshOptions(poisson_ratio=0.5)
        >>> found = import_meshes("femur.stl", "tibia.stl", side="r", options=wet)
        Traceback (most recent call last):
        kneejax.files.reading._text.InputProblem: --poisson-ratio: Poisson's ratio: 0.5:
        expected between 0 and 0.4999
    """
    if side not in _SIDES:
        raise InputProblem("--side", "side", side, "right or left", _SIDES)
    options = options or MeshOptions()
    options.check(femoral_cartilage, tibial_cartilage)
    left, findings, fits = _SIDES[side] == "left", [], {}
    given = {"cell_mm": options.cell_mm, "smoothing_mm": options.smoothing_mm}
    splines = {name: value for name, value in given.items() if value is not None}
    stated = options.source or ", ".join(
        Path(path).name for path in (femoral_cartilage, tibial_cartilage))

    def read(path: MeshPath) -> list[Sheet]:
        return right_sheets(path, options.unit, left, findings)

    femoral, tibial = read(femoral_cartilage), read(tibial_cartilage)
    femur, plateaus = find_bones(femoral, tibial, options, left, findings)
    contacts, bones, given_mm = {}, None, options.layer_thickness_mm
    if given_mm is None and options.femur_bone is not None and options.tibia_bone is not None:
        bones = read(options.femur_bone), read(options.tibia_bone)
    for name, sheet in plateaus.items():
        condyle, plateau = fitted.fit_compartment(
            name, sheet, femur, options.tibia, options.angle_deg, splines)
        for kind, part in (("condyle", condyle), ("plateau", plateau)):
            judge(f"{name} {kind}", part, "in the contact region", stated, findings)
            fits[f"{name} {kind}"] = part
        found = fitted.Layer(float(given_mm or 0.0), "given at import")
        if given_mm is None:
            found = fitted.find_layer(
                name, condyle, plateau, femur, sheet, bones, options.thickness, findings)
        varies = {} if found.variation is None else {"layer_variation_mm": listed(found.variation)}
        layer = {"layer_thickness_mm": round(found.thickness_mm, 3), **varies}
        surfaces = {"femoral_surface": surface_entry(condyle, stated),
                    "tibial_surface": surface_entry(plateau, stated)}
        contacts[name] = _contact(options, plateau, layer, surfaces, found.source, left)
    patellofemoral = None
    if options.patellar_cartilage is not None:
        on_patella, sheets = Path(options.patellar_cartilage).name, read(options.patellar_cartilage)
        for sheet in sheets:
            check_holes(sheet, findings)
        patella, trochlea = fitted.fit_patellofemoral(sheets, femur, findings, splines)
        for name, part in (("patella", patella), ("trochlea", trochlea)):
            judge(name, part, "everywhere", on_patella, findings)
            fits[name] = part
        layer = {"layer_thickness_mm": float(given_mm or fitted.ASSUMED_MM)}
        surfaces = {"femoral_surface": surface_entry(trochlea, stated),
                    "patellar_surface": surface_entry(patella, on_patella)}
        said = "given at import" if given_mm else "assumed"
        patellofemoral = _contact(options, patella, layer, surfaces, said, left)
    if given_mm is None and bones is None:
        findings.append("No bone meshes, no thickness: the layer is taken as "
                        f"{fitted.ASSUMED_MM:g} mm thick.")
    if given_mm is not None and options.femur_bone is not None:
        findings.append("The layer's thickness was given: the bone meshes were not read.")
    doubtful = any(fit.quality.rms > TARGET_RMS_MM for fit in fits.values())
    return MeshImport(contacts, tuple(findings), fits, doubtful, patellofemoral)


def right_sheets(path: MeshPath, unit: str, left: bool, findings: list[str]) -> list[Sheet]:
    """Sheets of a mesh; those of a left knee as in a mirror."""
    sheets, said = take_apart(read_mesh_points(path, unit), os.fspath(path))
    findings.extend(said)
    if left:
        sheets = [s._replace(points=s.points * _MIRROR).turned() for s in sheets]
    return sheets


def find_bones(
    femoral: list[Sheet], tibial: list[Sheet], options: MeshOptions, left: bool, findings: list[str]
) -> tuple[anatomy.Femur, dict[str, Sheet]]:
    """The femur and the tibia's compartments, by name, of a right knee or the mirror of a left."""
    for sheet in (*femoral, *tibial):
        check_holes(sheet, findings)
    sign, axis = -1.0 if left else 1.0, None
    notch, split = (None if x is None else sign * x for x in (options.notch_mm, options.split_mm))
    if options.axis_point_mm is not None:
        point, turn = np.array(options.axis_point_mm, float), np.array(options.axis_rotation_deg)
        point, turn = point * [1.0, 1.0, sign], np.deg2rad(turn * [sign, sign, 1.0])
        axis = Frame(point.tolist(), turn if turn.any() else None)
    femur = anatomy.find_femur(femoral, findings, axis, notch)
    plateaus = anatomy.find_plateaus(tibial, femur, options.tibia, findings, split)
    if split is not None and len(plateaus) < 2:
        expected = "a place along Z with cartilage of the tibia on both sides, mm"
        raise InputProblem("--split", "compartments", options.split_mm, expected)
    return femur, plateaus


def judge(name: str, part: SheetFit, where: str, stated: str, findings: list[str]) -> None:
    """Say how well a surface fits; refuse one that does not."""
    q = part.quality
    findings.append(
        f"{name}: {part.fit.cells[0]} x {part.fit.cells[1]} cells, smoothed below "
        f"{part.fit.smoothing_mm:g} mm; {where} {q.rms:.3f} mm rms, "
        f"{q.maximum:.2f} mm at most, {q.mean:+.4f} mm on average, {q.patch_maximum:.3f} mm on "
        f"average over the worst {fitted.PATCH_MM:g} mm patch; held out {q.held_out_rms:.3f} mm "
        "rms over the whole surface.")
    if q.rms > WORST_RMS_MM:
        expected = f"one sheet, single-valued from the joint, within {WORST_RMS_MM} mm rms"
        raise InputProblem(stated, name, f"{q.rms:.2f} mm rms", expected)
    if q.rms > TARGET_RMS_MM:
        findings.append(f"{name}: misses the target of {TARGET_RMS_MM:g} mm rms.")


def _contact(
    options: MeshOptions, part: SheetFit, layer: dict[str, Any], surfaces: dict[str, Any],
    said: str, left: bool,
) -> dict[str, Any]:  # fmt: skip
    """A contact of a knee document, on the side that was given, with its sources."""
    numbers = ("youngs_modulus_MPa", "poisson_ratio", "onset_width_mm")
    contact: dict[str, Any] = {"form": QUADRATURE, "law": options.law}
    contact |= {name: float(getattr(options, name)) for name in numbers}
    extents = [float(upper - lower) for lower, upper in part.fit.surface.bounds()]
    contact |= {"points": spread_points(extents)} | layer | surfaces
    contact["source"] = dict.fromkeys(numbers[:2], "given at import")
    contact["source"] |= dict.fromkeys(layer, said)
    return mirror_part(contact) if left else contact


def spread_points(extents: Iterable[float], least: int = 8) -> list[int]:
    """How many points a contact has over so many mm along each parameter of its surface."""
    return [max(least, round(extent / _POINT_DISTANCE_MM)) for extent in extents]


def surface_entry(part: SheetFit, stated: str) -> dict[str, Any]:
    """An entry of a knee document."""
    surface = part.fit.surface
    if isinstance(surface, Condyle):
        kind, origin, rotation = "condyle", "axis_point_mm", "axis_rotation_deg"
        limits = {"angle_deg": np.rad2deg(surface.angle), "width_mm": surface.width}
    else:
        kind, origin, rotation = "plateau", "origin_mm", "rotation_deg"
        limits = {"outline_mm": surface.outline, "anterior_mm": surface.x, "lateral_mm": surface.z}
    entry: dict[str, Any] = {"kind": kind, origin: listed(surface.frame.origin)}
    if surface.frame.rotation is not None:
        entry[rotation] = listed(np.rad2deg(surface.frame.rotation))
    entry["basis"] = surface.basis
    entry |= {name: listed(value) for name, value in limits.items()}
    return entry | {
        "coefficients_mm": listed(surface.coefficients),
        "source": f"smoothed spline fitted to {stated}",
        "fit_rms_mm": round(part.quality.rms, 4),
        "fit_max_mm": round(part.quality.maximum, 4),
    }


def listed(values) -> list:
    """Numbers as they stand in a file."""
    return np.round(np.asarray(values, float), _DIGITS).tolist()
