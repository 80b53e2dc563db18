"""Articular surfaces fitted to cartilage: where they can touch, how good the fits are there."""

from __future__ import annotations

import dataclasses

import jax
import numpy as np

from kneejax.files.meshes import _anatomy as anatomy
from kneejax.files.meshes._anatomy import Femur
from kneejax.files.meshes._health import Sheet
from kneejax.files.reading import InputProblem
from kneejax.geometry import (
    Condyle,
    Frame,
    Placement,
    Plateau,
    SplineFit,
    fit_condyle_spline,
    fit_plane,
    fit_plateau_spline,
)

#: Flexion of the hinge that carries the plateau around the condyle, from the reference pose.
FLEXIONS_DEG = np.arange(-10.0, 151.0, 10.0)
#: How far it also slides forwards and backwards, since a knee rolls as it bends, mm.
SLIDES_MM = (-10.0, -5.0, 0.0, 5.0, 10.0)
#: Places that come this near when the surfaces first touch belong to the contact region, mm.
NEAR_MM = 2.0
#: Size of the patches over which the mean residual is formed, mm.
PATCH_MM = 5.0
_CELL = np.deg2rad(3.0), 1.5
_FEWEST_IN_PATCH = 5
_PATELLA_WIDTHS_MM = (20.0, 80.0)
#: How far around the condyles a patella gets, degrees from anterior, in a knee bent by 120: bent by
#: 140 it reaches 5 mm farther, which its status says.
_LOWEST_DEG = 120.0
#: The patella's joint looks backwards: Y of this frame points there, X upwards, Z to the right.
_BACKWARDS = (0.0, 0.0, 0.5 * np.pi)


@dataclasses.dataclass(frozen=True)
class FitQuality:
    """What a fit leaves over in the contact region, mm."""

    rms: float  # root of the area-weighted mean square normal distance
    maximum: float  # largest distance
    mean: float  # area-weighted mean distance, positive where points lie outside the fit
    patch_rms: float  # root mean square of the means over patches of `PATCH_MM`
    patch_maximum: float  # largest of those means
    everywhere_rms: float  # `rms` over the whole fitted region
    held_out_rms: float  # over the whole fitted region, of points that were held out


@dataclasses.dataclass(frozen=True)
class SheetFit:
    """A fitted articular surface.

    Attributes:
        fit: the spline and its residuals, in the frames of a right knee.
        region: mask of its points that lie in the contact region.
        quality: what is left over there.
    """

    fit: SplineFit
    region: np.ndarray
    quality: FitQuality


def fit_compartment(
    name: str,
    sheet: Sheet,
    femur: Femur,
    tibia: Placement,
    angle_deg: tuple[float, float] | None,
    splines: dict[str, float],
) -> tuple[SheetFit, SheetFit]:
    """Fits of a condyle and its plateau, and where they can touch.

    The region of the condyle is found unless it is given; `splines` are options of the fits.
    """
    lateral = femur.cylindrical(femur.cloud.points)[2] > femur.notch_mm
    cloud = femur.cloud.kept(lateral == (name == "lateral"))
    tibial = anatomy.joined([sheet])
    at_reference = anatomy.moved(tibia, tibial.points)
    angle, width = anatomy.condyle_region(femur, cloud, at_reference)
    angle = angle if angle_deg is None else tuple(float(a) for a in angle_deg)
    try:
        condyle = fit_condyle_spline(cloud.points, angle, width, femur.axis, cloud.areas, **splines)
        plateau = _fit_plateau(sheet, fit_plane(tibial.points, tibial.areas).surface.frame, splines)
    except ValueError as error:
        raise InputProblem(sheet.name, name, str(error), "enough of both cartilages") from None
    on_condyle, on_plateau = contact_regions(femur, condyle, at_reference)
    across = anatomy.in_frame(plateau.surface.frame, plateau.points)[:, [0, 2]]
    return (
        SheetFit(condyle, on_condyle, _quality(condyle, on_condyle, _along(femur, condyle))),
        SheetFit(plateau, on_plateau, _quality(plateau, on_plateau, across)),
    )


def fit_patellofemoral(
    sheets: list[Sheet], femur: Femur, findings: list[str], splines: dict[str, float]
) -> tuple[SheetFit, SheetFit]:
    """Fits of the patella and of the groove that it meets, everywhere.

    The groove is one surface of the femur's cartilage from its upper border down and around both
    condyles. It overlaps with the condyles that meet the tibia, which are fitted to the same
    cartilage: no load is handed over from one surface to another. Across the notch it falls off.
    """
    patella, cloud = fit_patella(sheets, findings, splines), femur.cloud
    angle, _, along = femur.cylindrical(cloud.points)
    region = float(np.rad2deg(angle.min())), _LOWEST_DEG
    width = float(along.min()), float(along.max())
    trochlea = fit_condyle_spline(cloud.points, region, width, femur.axis, cloud.areas, **splines)
    across = anatomy.in_frame(patella.surface.frame, patella.points)[:, [0, 2]]
    pairs = ((patella, across), (trochlea, _along(femur, trochlea)))
    every = [np.ones(len(fit.points), bool) for fit, _ in pairs]
    first, second = (SheetFit(fit, all_, _quality(fit, all_, at))
                     for (fit, at), all_ in zip(pairs, every, strict=True))
    return first, second


def fit_patella(
    sheets: list[Sheet], findings: list[str], splines: dict[str, float]
) -> SplineFit[Plateau]:
    """Fit a spline to the patella's cartilage: how far back it reaches, over height and width.

    Sheets are in the patella's frame, of a right knee: X anterior, Y superior, Z lateral. Raises
    where they are no patella's cartilage that faces backwards, in one sheet.
    """
    name = sheets[0].name
    width = float(np.ptp(np.concatenate([sheet.points[:, 2] for sheet in sheets])))
    low, high = _PATELLA_WIDTHS_MM
    if not low < width < high:
        expected = f"a patellar cartilage {low:g} to {high:g} mm wide (along Z)"
        raise InputProblem(name, "width", f"{width:.3g} mm", expected + "; is the unit right?")
    facing = [
        anatomy.towards_joint(sheet, np.tile([-1.0, 0.0, 0.0], (len(sheet.faces), 1)), findings)
        for sheet in sheets
    ]
    facing = anatomy.outermost(
        facing, lambda p: (p[:, 1] / 3.0, p[:, 2] / 3.0, -p[:, 0]), "rear", findings)
    if len(facing) > 1:
        raise InputProblem(name, "sheets", f"{len(facing)} of them", "one sheet")
    (sheet,) = facing
    mean = np.average(sheet.normals, axis=0, weights=sheet.face_areas)
    if -mean[0] < np.abs(mean[1:]).max():
        towards = f"({', '.join(f'{x:.1f}' for x in mean)}) on average"
        expected = "a surface that faces backwards, (-1, 0, 0); is X anterior and Y superior?"
        raise InputProblem(name, "frame", towards, expected)
    cloud = anatomy.joined([sheet])
    frame = Frame(np.average(cloud.points, axis=0, weights=cloud.areas), _BACKWARDS)
    try:
        return _fit_plateau(sheet, frame, splines)
    except ValueError as error:
        raise InputProblem(name, "patella", str(error), "enough of its cartilage") from None


def contact_regions(
    femur: Femur, condyle: SplineFit[Condyle], tibial: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Which points of a condyle and its plateau can touch: masks of both.

    The plateau, with points `(n, 3)` at the reference pose in the femur's frame, is carried around
    the femoral axis as by a hinge, and slid along itself. At each place the gap counts from where
    it is smallest: the pose of the meshes need not be one of contact.
    """
    surface = condyle.surface
    limits = [np.asarray(x) for x in (surface.angle, surface.width)]
    plateau, touched = np.zeros(len(tibial), bool), []
    for slide in SLIDES_MM:
        angle, distance, along = femur.cylindrical(tibial + np.array([slide, 0.0, 0.0]))
        # A row for each flexion.
        turned, along = np.broadcast_arrays(angle + np.deg2rad(FLEXIONS_DEG)[:, None], along)
        over = (turned > limits[0][0]) & (turned < limits[0][1])
        over &= (along > limits[1][0]) & (along < limits[1][1])
        radius = _radius(surface, np.clip(turned, *limits[0]), np.clip(along, *limits[1]))
        gap = np.where(over, distance - np.asarray(radius), np.inf)
        near = gap < gap.min(axis=1, keepdims=True) + NEAR_MM
        plateau |= near.any(axis=0)
        touched.append(_cells(turned[near], along[near]))
    # The cells and their eight neighbours.
    cells = {(i + p, j + q) for i, j in set(map(tuple, np.concatenate(touched).tolist()))
             for p in range(-1, 2) for q in range(-1, 2)}
    own_angle, _, own_along = femur.cylindrical(condyle.points)
    own = _cells(own_angle, own_along)
    return np.array([tuple(cell) in cells for cell in own.tolist()], bool), plateau


def _fit_plateau(sheet: Sheet, frame: Frame, splines: dict[str, float]) -> SplineFit[Plateau]:
    """A height over the plane of a frame, within the outline of a sheet."""
    cloud = anatomy.joined([sheet])
    local = anatomy.in_frame(frame, cloud.points)
    x, z = ((float(c.min()), float(c.max())) for c in (local[:, 0], local[:, 2]))
    outline = np.round(anatomy.outline(sheet, frame), 3)
    return fit_plateau_spline(cloud.points, x, z, frame, cloud.areas, outline=outline, **splines)


def _along(femur: Femur, fit: SplineFit[Condyle]) -> np.ndarray:
    """Lengths around and along the femoral axis, mm, `(n, 2)`."""
    angle, radius, along = femur.cylindrical(fit.points)
    return np.c_[float(np.average(radius, weights=fit.weights)) * angle, along]


def _quality(fit: SplineFit, region: np.ndarray, across: np.ndarray) -> FitQuality:
    """What a fit leaves over in a region; `across` are two lengths along the surface, mm."""
    rows = region if region.any() else np.ones(len(fit.points), bool)
    residual, weight = fit.residual[rows], fit.weights[rows]
    patch = np.floor(across[rows] / PATCH_MM).astype(int)
    _, place = np.unique(patch, axis=0, return_inverse=True)
    place = place.ravel()
    total, count = np.bincount(place, weight), np.bincount(place)
    means = (np.bincount(place, weight * residual) / total)[count >= _FEWEST_IN_PATCH]
    means = means if len(means) else np.array([np.average(residual, weights=weight)])
    return FitQuality(
        rms=float(np.sqrt(np.average(residual**2, weights=weight))),
        maximum=float(np.abs(residual).max()),
        mean=float(np.average(residual, weights=weight)),
        patch_rms=float(np.sqrt(np.mean(means**2))),
        patch_maximum=float(np.abs(means).max()),
        everywhere_rms=fit.rms,
        held_out_rms=fit.held_out_rms,
    )


# One program for all places: operation by operation they take 5.8 s for a knee instead of 0.3.
@jax.jit
def _radius(surface: Condyle, angle: np.ndarray, along: np.ndarray) -> jax.Array:
    return surface.radius(angle, along)


def _cells(angle: np.ndarray, along: np.ndarray) -> np.ndarray:
    return np.floor(np.c_[angle / _CELL[0], along / _CELL[1]]).astype(int)
