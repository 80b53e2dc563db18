"""Thickness of the layer that femoral and tibial cartilage form together."""

from __future__ import annotations

import dataclasses

import numpy as np

from kneejax.files.meshes._anatomy import Cloud, Femur, in_frame, joined
from kneejax.files.meshes._health import Sheet
from kneejax.files.meshes._region import SheetFit
from kneejax.files.meshes._thickness import thickness as thickness_below
from kneejax.files.reading import InputProblem

#: Thickness of both cartilages where nothing is known of it, mm.
ASSUMED_MM = 6.0
#: A field is nowhere thinner than this, mm: else it is taken simpler.
_THINNEST_MM = 0.5
_DEGREES = (3, 2, 1)


@dataclasses.dataclass(frozen=True)
class Layer:
    """Thickness of a compartment's layer.

    Attributes:
        thickness_mm: mean over the contact region.
        source: how it was found.
        places: tibial points at which it is known, tibia frame; None where it was not measured.
        there_mm: thickness there; the femoral share is its mean, since that part moves.
        weights: area that each place stands for in the contact region, or less outside.
        variation: polynomial over the plateau's scaled parameters that is added, or None.
    """

    thickness_mm: float
    source: str
    places: np.ndarray | None = None
    there_mm: np.ndarray | None = None
    weights: np.ndarray | None = None
    variation: np.ndarray | None = None


def find_layer(
    name: str,
    condyle: SheetFit,
    plateau: SheetFit,
    femur: Femur,
    sheet: Sheet,
    bones: tuple[list[Sheet], list[Sheet]] | None,
    findings: list[str],
) -> Layer:
    """Measure the layer between the bones.

    Args:
        name: of the compartment.
        condyle: its fit and contact region.
        plateau: likewise.
        femur: whose cartilage holds the condyle's points.
        sheet: of the plateau.
        bones: surfaces of femur and tibia; None where they are not known.
        findings: to which a sentence is added.

    Raises:
        InputProblem: cartilage lies below its bone.
    """
    if bones is None:
        return Layer(ASSUMED_MM, "assumed: no bone meshes")
    on_condyle = _of_region(femur.cloud, condyle)
    tibial = joined([sheet])
    above_femur = thickness_below(on_condyle, bones[0], f"{name} femoral")
    above_tibia = thickness_below(tibial, bones[1], f"{name} tibial")
    known = np.isfinite(above_femur)
    femoral = float(np.average(above_femur[known], weights=on_condyle.areas[known]))
    known = np.isfinite(above_tibia)
    here = known & plateau.region
    own = float(np.average(above_tibia[here], weights=tibial.areas[here]))
    findings.append(
        f"{name}: cartilage {femoral:.2f} mm thick on the femur and {own:.2f} mm on the tibia, on "
        "average over the contact region."
    )
    if femoral + own < _THINNEST_MM:
        value = f"{femoral + own:.2f} mm in the {name} contact region"
        expected = f"cartilage of at least {_THINNEST_MM:g} mm on both bones together"
        raise InputProblem(sheet.name, "thickness", value, expected)
    # What lies outside the contact region steers a field little, and keeps it in bounds.
    weights = np.where(plateau.region, 1.0, 0.1)[known] * tibial.areas[known]
    source = "mean distance along the normal from cartilage to bone, both bones, contact region"
    return Layer(
        femoral + own, source, tibial.points[known], femoral + above_tibia[known], weights
    )


def chosen(
    found: Layer,
    given_mm: float | None,
    kind: str,
    plateau: SheetFit,
    name: str,
    findings: list[str],
) -> Layer:
    """The layer as the knee file gets it.

    Args:
        found: what was measured.
        given_mm: a thickness that a person gave.
        kind: `constant` or `field`.
        plateau: over whose parameters a field is given.
        name: of the compartment.
        findings: to which a sentence is added.
    """
    if given_mm is not None:
        return Layer(float(given_mm), "given at import")
    if kind == "constant":
        return found
    assert found.places is not None and found.there_mm is not None  # refused before
    surface = plateau.fit.surface
    local = in_frame(surface.frame, found.places)
    limits = [np.asarray(x) for x in (surface.x, surface.z)]
    s, t = (
        2.0 * (c - lower) / (upper - lower) - 1.0
        for c, (lower, upper) in zip(local.T[[0, 2]], limits, strict=True)
    )
    values, weights = found.there_mm - found.thickness_mm, found.weights
    s, t, values, weights = _with_corners(s, t, values, weights)
    grid = np.linspace(-1.0, 1.0, 25)
    for degree in _DEGREES:
        table = _fitted(s, t, values, weights, degree)
        field = found.thickness_mm + np.polynomial.polynomial.polygrid2d(grid, grid, table)
        if field.min() >= _THINNEST_MM:
            off = values - np.polynomial.polynomial.polyval2d(s, t, table)
            rms = float(np.sqrt(np.average(off**2, weights=weights)))
            findings.append(
                f"{name}: thickness from {field.min():.1f} to {field.max():.1f} mm as a polynomial "
                f"of degree {degree}, {rms:.2f} mm rms from the measured."
            )
            return dataclasses.replace(found, variation=table)
    findings.append(f"{name}: the thickness varies too much for a smooth field; constant instead.")
    return found


def _with_corners(s, t, values, weights):
    """With places beyond the sheet, as thick as the nearest of its own: they hold a field there."""
    grid = np.linspace(-1.0, 1.0, 11)
    a, b = (x.ravel() for x in np.meshgrid(grid, grid))
    apart = (a[:, None] - s) ** 2 + (b[:, None] - t) ** 2
    nearest = np.argmin(apart, axis=1)
    beyond = apart[np.arange(len(a)), nearest] > 0.1**2
    own = np.full(beyond.sum(), 0.5 * weights.sum() / len(a))
    return (
        np.r_[s, a[beyond]], np.r_[t, b[beyond]], np.r_[values, values[nearest[beyond]]],
        np.r_[weights, own],
    )  # fmt: skip


def _of_region(cloud: Cloud, condyle: SheetFit) -> Cloud:
    """Points of the condyle's contact region with their normals."""
    wanted = {tuple(p) for p in condyle.fit.points[condyle.region].tolist()}
    return cloud.kept(np.array([tuple(p) in wanted for p in cloud.points.tolist()]))


def _fitted(s, t, values, weights, degree: int) -> np.ndarray:
    powers = [(i, j) for i in range(degree + 1) for j in range(degree + 1 - i)]
    root = np.sqrt(weights)
    columns = np.stack([s**i * t**j for i, j in powers], axis=1) * root[:, None]
    solution, *_ = np.linalg.lstsq(columns, root * values, rcond=None)
    table = np.zeros((degree + 1, degree + 1))
    for (i, j), c in zip(powers, solution, strict=True):
        table[i, j] = c
    return table
