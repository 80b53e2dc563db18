"""Contacts of a knee from meshes of its cartilage."""

from __future__ import annotations

import dataclasses
import functools
import os
from pathlib import Path
from typing import Any

import numpy as np

from kneejax.files.knee import mirror_part
from kneejax.files.meshes import _anatomy as anatomy
from kneejax.files.meshes import _choices as choices
from kneejax.files.meshes import _layer as layer
from kneejax.files.meshes._choices import THICKNESSES as THICKNESSES
from kneejax.files.meshes._health import Sheet, check_holes, read_sheets
from kneejax.files.meshes._patella import fit_patella, fit_trochlea
from kneejax.files.meshes._region import PATCH_MM, SheetFit, contact_regions, quality
from kneejax.files.reading import InputProblem
from kneejax.geometry import (
    Frame,
    Placement,
    Pose,
    fit_condyle_spline,
    fit_plateau_spline,
)
from kneejax.mechanics import QUADRATURE

#: Distances from the fit over the contact region that are wished for, and refused, mm.
TARGET_RMS_MM, WORST_RMS_MM = 0.1, 0.5
_POINT_DISTANCE_MM = 1.7
_DIGITS = 5


@dataclasses.dataclass(frozen=True)
class MeshImport:
    """Contacts and surfaces fitted to meshes.

    Attributes:
        contacts: name -> contact of a knee document, of the side that was given.
        findings: what was found, repaired and assumed, one sentence each.
        fits: `medial condyle`, `medial plateau`, ..., `patella`, `trochlea` -> its fit.
        doubtful: whether a fit misses the target.
        patellofemoral: the contact of femur and patella; None without its mesh.
    """

    contacts: dict[str, dict[str, Any]]
    findings: tuple[str, ...]
    fits: dict[str, SheetFit]
    doubtful: bool
    patellofemoral: dict[str, Any] | None = None


def import_meshes(
    femoral_cartilage: str | os.PathLike[str],
    tibial_cartilage: str | os.PathLike[str],
    *,
    side: str,
    patellar_cartilage: str | os.PathLike[str] | None = None,
    femur_bone: str | os.PathLike[str] | None = None,
    tibia_bone: str | os.PathLike[str] | None = None,
    youngs_modulus_MPa: float = 10.0,
    poisson_ratio: float = 0.45,
    law: str = "linear",
    layer_thickness_mm: float | None = None,
    thickness: str = "constant",
    onset_width_mm: float = 0.02,
    reference_pose: Pose | None = None,
    unit: str = "auto",
    axis_point_mm: tuple[float, float, float] | None = None,
    axis_rotation_deg: tuple[float, float, float] = (0.0, 0.0, 0.0),
    notch_mm: float | None = None,
    split_mm: float | None = None,
    angle_deg: tuple[float, float] | None = None,
    cell_mm: float | None = None,
    smoothing_mm: float | None = None,
    source: str | None = None,
) -> MeshImport:
    """Fit contacts to meshes of cartilage, in the frames of their bones.

    Frames are X anterior, Y superior, Z to the person's right. What is not given is found: the
    femoral axis, the notch, the compartments, the region of contact, cells and smoothing.

    Args:
        femoral_cartilage: STL, PLY, OBJ or VTP file: an open sheet or a closed volume.
        tibial_cartilage: likewise, one sheet or two.
        side: `right` or `left` (or `r`, `l`).
        patellar_cartilage: in the patella's frame.
        femur_bone: for the layer's thickness.
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

    Returns:
        Contacts, that of the patella, findings and fits.

    Raises:
        InputProblem: a file cannot be read or repaired, meshes are no femur and tibia that meet,
            cartilage is not thicker than zero, or the surfaces are none over these parameters.

    Example:
        >>> found = import_meshes("femur.stl", "tibia.stl", side="r", poisson_ratio=0.5)
        Traceback (most recent call last):
        kneejax.files.reading._problem.InputProblem: --poisson-ratio: Poisson's ratio: 0.5:
        expected between 0 and 0.4999
    """
    side = choices.checked_side(side)
    files = {
        "--femur-cartilage": femoral_cartilage, "--tibia-cartilage": tibial_cartilage,
        "--patella-cartilage": patellar_cartilage,
        "--femur-bone": femur_bone, "--tibia-bone": tibia_bone,
    }  # fmt: skip
    choices.check_files(files)
    choices.check_layer(
        law, youngs_modulus_MPa, poisson_ratio, layer_thickness_mm, thickness,
        bones=femur_bone is not None,
    )  # fmt: skip
    choices.check_region(axis_point_mm, axis_rotation_deg, angle_deg)
    left, findings = side == "left", []
    read = functools.partial(_read, unit=unit, left=left, findings=findings)
    tibia = (Pose.from_table([0.0] * 6) if reference_pose is None else reference_pose).placement
    femur, plateaus = _bones(
        read(femoral_cartilage), read(tibial_cartilage), tibia,
        _given_axis(axis_point_mm, axis_rotation_deg, left), notch_mm, split_mm, left, findings,
    )  # fmt: skip
    bones = None
    if layer_thickness_mm is None and femur_bone is not None and tibia_bone is not None:
        bones = read(femur_bone), read(tibia_bone)
    stated = source or ", ".join(Path(p).name for p in (femoral_cartilage, tibial_cartilage))
    cells = {"cell_mm": cell_mm, "smoothing_mm": smoothing_mm}
    options = {key: value for key, value in cells.items() if value is not None}
    material = {
        "form": QUADRATURE,
        "law": law,
        "youngs_modulus_MPa": float(youngs_modulus_MPa),
        "poisson_ratio": float(poisson_ratio),
        "onset_width_mm": float(onset_width_mm),
    }
    contacts, fits = {}, {}
    for name, sheet in plateaus.items():
        condyle, plateau = _compartment(name, sheet, femur, tibia, angle_deg, options)
        for kind, part in (("condyle", condyle), ("plateau", plateau)):
            _judge(f"{name} {kind}", part, "in the contact region", stated, findings)
            fits[f"{name} {kind}"] = part
        found = layer.find_layer(name, condyle, plateau, femur, sheet, bones, findings)
        found = layer.chosen(found, layer_thickness_mm, thickness, plateau, name, findings)
        contact = _contact_document(condyle, plateau, found, material, stated)
        contacts[name] = mirror_part(contact) if left else contact
    patellofemoral = None
    if patellar_cartilage is not None:
        on_patella = Path(patellar_cartilage).name
        fits |= _patellofemoral(read(patellar_cartilage), femur, options, on_patella, findings)
        contact = _patellofemoral_document(fits, layer_thickness_mm, material, stated, on_patella)
        patellofemoral = mirror_part(contact) if left else contact
    if layer_thickness_mm is None and bones is None:
        findings.append(
            f"No bone meshes, no thickness: the layer is taken as {layer.ASSUMED_MM:g} mm thick."
        )
    if layer_thickness_mm is not None and femur_bone is not None:
        findings.append("The layer's thickness was given: the bone meshes were not read.")
    doubtful = any(fit.quality.rms > TARGET_RMS_MM for fit in fits.values())
    return MeshImport(contacts, tuple(findings), fits, doubtful, patellofemoral)


def _read(path, *, unit: str, left: bool, findings: list[str]) -> list[Sheet]:
    """Sheets of a mesh; those of a left knee as in a mirror."""
    sheets, said = read_sheets(path, unit)
    findings.extend(said)
    return [_mirrored(sheet) for sheet in sheets] if left else sheets


def _bones(
    femoral: list[Sheet],
    tibial: list[Sheet],
    tibia: Placement,
    axis: Frame | None,
    notch_mm: float | None,
    split_mm: float | None,
    left: bool,
    findings: list[str],
) -> tuple[anatomy.Femur, dict[str, Sheet]]:
    """The femur and the tibia's compartments, by name."""
    for sheet in (*femoral, *tibial):
        check_holes(sheet, findings)
    sign = -1.0 if left else 1.0
    notch, split = (None if at is None else sign * at for at in (notch_mm, split_mm))
    femur = anatomy.find_femur(femoral, findings, axis, notch)
    plateaus = anatomy.find_plateaus(tibial, femur, tibia, findings, split)
    if split_mm is not None and len(plateaus) < 2:
        expected = "a place along Z with cartilage of the tibia on both sides, mm"
        raise InputProblem("--split", "compartments", split_mm, expected)
    return femur, plateaus


_GIVEN = dict.fromkeys(("youngs_modulus_MPa", "poisson_ratio"), "given at import")


def _contact_document(
    condyle: SheetFit, plateau: SheetFit, found: layer.Layer, material: dict[str, Any], stated: str
) -> dict[str, Any]:
    varies = found.variation is not None
    return {
        **material,
        "points": _points(plateau.fit.surface),
        "layer_thickness_mm": round(found.thickness_mm, 3),
        **({"layer_variation_mm": _listed(found.variation)} if varies else {}),
        "femoral_surface": _condyle_document(condyle, stated),
        "tibial_surface": _plateau_document(plateau, stated),
        "source": {
            **_GIVEN,
            "layer_thickness_mm": found.source,
            **({"layer_variation_mm": found.source} if varies else {}),
        },
    }


def _patellofemoral_document(
    fits: dict[str, SheetFit],
    thickness_mm: float | None,
    material: dict[str, Any],
    stated: str,
    on_patella: str,
) -> dict[str, Any]:
    said = "given at import" if thickness_mm else "assumed"
    return {
        **material,
        "points": _points(fits["patella"].fit.surface),
        "layer_thickness_mm": float(thickness_mm or layer.ASSUMED_MM),
        "femoral_surface": _condyle_document(fits["trochlea"], stated),
        "patellar_surface": _plateau_document(fits["patella"], on_patella),
        "source": {**_GIVEN, "layer_thickness_mm": said},
    }


def _mirrored(sheet: Sheet) -> Sheet:
    points = sheet.points * np.array([1.0, 1.0, -1.0])
    return dataclasses.replace(sheet, points=points).turned()


def _given_axis(point, rotation_deg, left: bool) -> Frame | None:
    if point is None:
        return None
    x, y, z = (float(c) for c in point)
    turn = np.deg2rad(np.asarray(rotation_deg, float))
    if left:
        z, turn = -z, turn * np.array([-1.0, -1.0, 1.0])
    return Frame([x, y, z], turn if turn.any() else None)


def _compartment(name, sheet: Sheet, femur: anatomy.Femur, tibia: Placement, angle_deg, options):
    """Fits of a condyle and its plateau, and where they can touch."""
    lateral = femur.cylindrical(femur.cloud.points)[2] > femur.notch_mm
    cloud = femur.cloud.kept(lateral == (name == "lateral"))
    tibial = anatomy.joined([sheet])
    at_reference = anatomy.moved(tibia, tibial.points)
    angle, width = anatomy.condyle_region(femur, cloud, at_reference)
    angle = angle if angle_deg is None else tuple(float(a) for a in angle_deg)
    try:
        condyle = fit_condyle_spline(cloud.points, angle, width, femur.axis, cloud.areas, **options)
        frame = anatomy.plateau_frame(tibial)
        local = anatomy.in_frame(frame, tibial.points)
        x, z = ((float(c.min()), float(c.max())) for c in (local[:, 0], local[:, 2]))
        plateau = fit_plateau_spline(
            tibial.points, x, z, frame, tibial.areas,
            outline=np.round(anatomy.outline(sheet, frame), 3), **options,
        )  # fmt: skip
    except ValueError as error:
        raise InputProblem(sheet.name, name, str(error), "enough of both cartilages") from None
    on_condyle, on_plateau = contact_regions(femur, condyle, at_reference)
    a, radius, along = femur.cylindrical(condyle.points)
    mean = float(np.average(radius, weights=condyle.weights))
    return (
        SheetFit(condyle, on_condyle, quality(condyle, on_condyle, np.c_[mean * a, along])),
        SheetFit(plateau, on_plateau, quality(plateau, on_plateau, local[:, [0, 2]])),
    )


def _patellofemoral(
    sheets: list[Sheet], femur: anatomy.Femur, options, stated: str, findings: list[str]
) -> dict[str, SheetFit]:
    """Fits of the patella's cartilage and of the groove."""
    for sheet in sheets:
        check_holes(sheet, findings)
    patella, trochlea = fit_patella(sheets, findings, options), fit_trochlea(femur, options)
    across = anatomy.in_frame(patella.surface.frame, patella.points)[:, [0, 2]]
    angle, radius, along = femur.cylindrical(trochlea.points)
    mean = float(np.average(radius, weights=trochlea.weights))
    found = {}
    for name, fit, at in (
        ("patella", patella, across), ("trochlea", trochlea, np.c_[mean * angle, along])
    ):  # fmt: skip
        everywhere = np.ones(len(fit.points), bool)
        found[name] = part = SheetFit(fit, everywhere, quality(fit, everywhere, at))
        _judge(name, part, "everywhere", stated, findings)
    return found


def _judge(name: str, part: SheetFit, where: str, stated: str, findings: list[str]) -> None:
    q = part.quality
    findings.append(
        f"{name}: {part.fit.cells[0]} x {part.fit.cells[1]} cells, smoothed below "
        f"{part.fit.smoothing_mm:g} mm; {where} {q.rms:.3f} mm rms, "
        f"{q.maximum:.2f} mm at most, {q.mean:+.4f} mm on average, {q.patch_maximum:.3f} mm on "
        f"average over the worst {PATCH_MM:g} mm patch; held out {q.held_out_rms:.3f} mm rms "
        "over the whole surface."
    )
    if q.rms > WORST_RMS_MM:
        expected = f"one sheet, single-valued from the joint, within {WORST_RMS_MM} mm rms"
        raise InputProblem(stated, name, f"{q.rms:.2f} mm rms", expected)
    if q.rms > TARGET_RMS_MM:
        findings.append(f"{name}: misses the target of {TARGET_RMS_MM:g} mm rms.")


def _points(surface) -> list[int]:
    extents = [float(upper - lower) for lower, upper in surface.bounds()]
    return [max(8, round(extent / _POINT_DISTANCE_MM)) for extent in extents]


def _condyle_document(part: SheetFit, stated: str) -> dict[str, Any]:
    surface = part.fit.surface
    return {
        "kind": "condyle",
        "axis_point_mm": _listed(surface.frame.origin),
        **_turn(surface.frame, "axis_rotation_deg"),
        "basis": surface.basis,
        "angle_deg": _listed(np.rad2deg(surface.angle)),
        "width_mm": _listed(surface.width),
        **_shared(part, stated),
    }


def _plateau_document(part: SheetFit, stated: str) -> dict[str, Any]:
    surface = part.fit.surface
    return {
        "kind": "plateau",
        "origin_mm": _listed(surface.frame.origin),
        **_turn(surface.frame, "rotation_deg"),
        "basis": surface.basis,
        "outline_mm": _listed(surface.outline),
        "anterior_mm": _listed(surface.x),
        "lateral_mm": _listed(surface.z),
        **_shared(part, stated),
    }


def _shared(part: SheetFit, stated: str) -> dict[str, Any]:
    return {
        "coefficients_mm": _listed(part.fit.surface.coefficients),
        "source": f"smoothed spline fitted to {stated}",
        "fit_rms_mm": round(part.quality.rms, 4),
        "fit_max_mm": round(part.quality.maximum, 4),
    }


def _turn(frame: Frame, name: str) -> dict[str, Any]:
    return {} if frame.rotation is None else {name: _listed(np.rad2deg(frame.rotation))}


def _listed(values) -> list:
    return np.round(np.asarray(values, float), _DIGITS).tolist()
