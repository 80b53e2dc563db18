"""The articular surfaces of the patellofemoral joint."""

from __future__ import annotations

import numpy as np

from kneejax.files.meshes import _anatomy as anatomy
from kneejax.files.meshes._health import Sheet
from kneejax.files.reading import InputProblem
from kneejax.geometry import (
    Condyle,
    Frame,
    Plateau,
    SplineFit,
    fit_condyle_spline,
    fit_plateau_spline,
)

_WIDTHS_MM = (20.0, 80.0)
#: How far around the condyles a patella gets, degrees from anterior, in a knee bent by 120: bent by
#: 140 it reaches 5 mm farther, which its status says.
_LOWEST_DEG = 120.0
#: The patella's joint looks backwards: Y of this frame points there, X upwards, Z to the right.
_BACKWARDS = (0.0, 0.0, 0.5 * np.pi)


def fit_patella(
    sheets: list[Sheet], findings: list[str], options: dict[str, float]
) -> SplineFit[Plateau]:
    """Fit a spline to the patella's cartilage: how far back it reaches, over height and width.

    Args:
        sheets: in the patella's frame, of a right knee: X anterior, Y superior, Z lateral.
        findings: to which sentences are added.
        options: of the fit, where they are given: `cell_mm`, `smoothing_mm`.

    Raises:
        InputProblem: the mesh has not the size of a patella's cartilage, does not face backwards,
            or consists of several sheets.
    """
    name = sheets[0].name
    width = float(np.ptp(np.concatenate([sheet.points[:, 2] for sheet in sheets])))
    if not _WIDTHS_MM[0] < width < _WIDTHS_MM[1]:
        expected = f"a patellar cartilage {_WIDTHS_MM[0]:g} to {_WIDTHS_MM[1]:g} mm wide (along Z)"
        raise InputProblem(name, "width", f"{width:.3g} mm", expected + "; is the unit right?")
    backwards = np.array([-1.0, 0.0, 0.0])
    facing = [
        anatomy.towards_joint(sheet, np.tile(backwards, (len(sheet.faces), 1)), findings)
        for sheet in sheets
    ]
    facing = anatomy.outermost(facing, _by_depth, "rear", findings)
    if len(facing) > 1:
        raise InputProblem(name, "sheets", f"{len(facing)} of them", "one sheet")
    sheet = facing[0]
    mean = np.average(sheet.normals, axis=0, weights=sheet.face_areas)
    if -mean[0] < np.abs(mean[1:]).max():
        towards = f"({', '.join(f'{x:.1f}' for x in mean)}) on average"
        expected = "a surface that faces backwards, (-1, 0, 0); is X anterior and Y superior?"
        raise InputProblem(name, "frame", towards, expected)
    cloud = anatomy.joined([sheet])
    frame = Frame(np.average(cloud.points, axis=0, weights=cloud.areas), _BACKWARDS)
    local = anatomy.in_frame(frame, cloud.points)
    up, across = ((float(c.min()), float(c.max())) for c in (local[:, 0], local[:, 2]))
    try:
        return fit_plateau_spline(
            cloud.points, up, across, frame, cloud.areas,
            outline=np.round(anatomy.outline(sheet, frame), 3), **options,
        )  # fmt: skip
    except ValueError as error:
        raise InputProblem(name, "patella", str(error), "enough of its cartilage") from None


def fit_trochlea(femur: anatomy.Femur, options: dict[str, float]) -> SplineFit[Condyle]:
    """Fit a spline to the femur's cartilage where a patella can meet it: one surface from the upper
    border of the groove down and around both condyles.

    It overlaps with the condyles that meet the tibia, which are fitted to the same cartilage: no
    load is handed over from one surface to another. Across the notch it falls off.

    Args:
        femur: the cartilage and its axis.
        options: of the fit, where they are given: `cell_mm`, `smoothing_mm`.
    """
    angle, _, along = femur.cylindrical(femur.cloud.points)
    region = float(np.rad2deg(angle.min())), _LOWEST_DEG
    width = float(along.min()), float(along.max())
    cloud = femur.cloud
    return fit_condyle_spline(cloud.points, region, width, femur.axis, cloud.areas, **options)


def _by_depth(points: np.ndarray):
    return points[:, 1] / 3.0, points[:, 2] / 3.0, -points[:, 0]
