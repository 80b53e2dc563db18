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
from kneejax.files.meshes._documents import (
    material_document,
    patellofemoral_document,
    tibiofemoral_document,
)
from kneejax.files.meshes._health import Sheet, check_holes, read_sheets
from kneejax.files.meshes._patella import fit_patella, fit_trochlea
from kneejax.files.meshes._region import PATCH_MM, SheetFit, contact_regions, quality
from kneejax.files.reading import InputProblem
from kneejax.geometry import Frame, Placement, Pose, fit_condyle_spline, fit_plateau_spline

#: Distances from the fit over the contact region that are wished for, and refused, mm.
TARGET_RMS_MM, WORST_RMS_MM = 0.1, 0.5


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
    wanted = _Wanted(
        material_document(law, youngs_modulus_MPa, poisson_ratio, onset_width_mm),
        _splines(cell_mm, smoothing_mm), angle_deg, layer_thickness_mm, thickness,
        source or ", ".join(Path(p).name for p in (femoral_cartilage, tibial_cartilage)), left,
    )  # fmt: skip
    fits: dict[str, SheetFit] = {}
    contacts = {
        name: _tibiofemoral(name, sheet, femur, tibia, bones, wanted, fits, findings)
        for name, sheet in plateaus.items()
    }
    patellofemoral = None
    if patellar_cartilage is not None:
        sheets, name = read(patellar_cartilage), Path(patellar_cartilage).name
        patellofemoral = _patellofemoral(sheets, name, femur, wanted, fits, findings)
    if layer_thickness_mm is None and bones is None:
        findings.append(
            f"No bone meshes, no thickness: the layer is taken as {layer.ASSUMED_MM:g} mm thick."
        )
    if layer_thickness_mm is not None and femur_bone is not None:
        findings.append("The layer's thickness was given: the bone meshes were not read.")
    doubtful = any(fit.quality.rms > TARGET_RMS_MM for fit in fits.values())
    return MeshImport(contacts, tuple(findings), fits, doubtful, patellofemoral)


@dataclasses.dataclass(frozen=True)
class _Wanted:
    """What is asked of every contact.

    Attributes:
        material: fields of the contact's document.
        splines: options of their fits.
        angle_deg: region of the condyles; None where it is to be found.
        thickness_mm: of the layer; None where it is to be found.
        thickness: `constant` or `field`.
        stated: where the meshes come from.
        left: whether the knee is a left one, which is fitted in a mirror.
    """

    material: dict[str, Any]
    splines: dict[str, float]
    angle_deg: tuple[float, float] | None
    thickness_mm: float | None
    thickness: str
    stated: str
    left: bool

    def as_given(self, contact: dict[str, Any]) -> dict[str, Any]:
        """A contact on the side that was given."""
        return mirror_part(contact) if self.left else contact


def _splines(cell_mm: float | None, smoothing_mm: float | None) -> dict[str, float]:
    given = {"cell_mm": cell_mm, "smoothing_mm": smoothing_mm}
    return {name: value for name, value in given.items() if value is not None}


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


def _tibiofemoral(
    name: str,
    sheet: Sheet,
    femur: anatomy.Femur,
    tibia: Placement,
    bones: tuple[list[Sheet], list[Sheet]] | None,
    wanted: _Wanted,
    fits: dict[str, SheetFit],
    findings: list[str],
) -> dict[str, Any]:
    """The contact of a compartment; its fits and what is to be said of them are added."""
    condyle, plateau = _compartment(name, sheet, femur, tibia, wanted.angle_deg, wanted.splines)
    for kind, part in (("condyle", condyle), ("plateau", plateau)):
        _judge(f"{name} {kind}", part, "in the contact region", wanted.stated, findings)
        fits[f"{name} {kind}"] = part
    found = layer.find_layer(name, condyle, plateau, femur, sheet, bones, findings)
    found = layer.chosen(found, wanted.thickness_mm, wanted.thickness, plateau, name, findings)
    contact = tibiofemoral_document(condyle, plateau, found, wanted.material, wanted.stated)
    return wanted.as_given(contact)


def _patellofemoral(
    sheets: list[Sheet],
    on_patella: str,
    femur: anatomy.Femur,
    wanted: _Wanted,
    fits: dict[str, SheetFit],
    findings: list[str],
) -> dict[str, Any]:
    """The contact of the patella with the groove; likewise."""
    for sheet in sheets:
        check_holes(sheet, findings)
    patella = fit_patella(sheets, findings, wanted.splines)
    trochlea = fit_trochlea(femur, wanted.splines)
    across = anatomy.in_frame(patella.surface.frame, patella.points)[:, [0, 2]]
    angle, radius, along = femur.cylindrical(trochlea.points)
    mean = float(np.average(radius, weights=trochlea.weights))
    for name, fit, at in (
        ("patella", patella, across), ("trochlea", trochlea, np.c_[mean * angle, along])
    ):  # fmt: skip
        everywhere = np.ones(len(fit.points), bool)
        fits[name] = part = SheetFit(fit, everywhere, quality(fit, everywhere, at))
        _judge(name, part, "everywhere", on_patella, findings)
    contact = patellofemoral_document(
        fits["patella"], fits["trochlea"], wanted.thickness_mm, wanted.material, wanted.stated,
        on_patella,
    )  # fmt: skip
    return wanted.as_given(contact)


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


