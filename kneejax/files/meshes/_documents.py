"""Fitted surfaces and layers as the contacts of a knee document."""

from __future__ import annotations

from typing import Any

import numpy as np

from kneejax.files.meshes._layer import ASSUMED_MM, Layer
from kneejax.files.meshes._region import SheetFit
from kneejax.geometry import Frame
from kneejax.mechanics import QUADRATURE

_POINT_DISTANCE_MM = 1.7
_DIGITS = 5
_GIVEN = dict.fromkeys(("youngs_modulus_MPa", "poisson_ratio"), "given at import")


def material_document(
    law: str, youngs_modulus_MPa: float, poisson_ratio: float, onset_width_mm: float
) -> dict[str, Any]:
    """What all contacts of a knee have alike."""
    return {
        "form": QUADRATURE,
        "law": law,
        "youngs_modulus_MPa": float(youngs_modulus_MPa),
        "poisson_ratio": float(poisson_ratio),
        "onset_width_mm": float(onset_width_mm),
    }


def tibiofemoral_document(
    condyle: SheetFit, plateau: SheetFit, found: Layer, material: dict[str, Any], stated: str
) -> dict[str, Any]:
    """The contact of a condyle with its plateau."""
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


def patellofemoral_document(
    patella: SheetFit,
    trochlea: SheetFit,
    thickness_mm: float | None,
    material: dict[str, Any],
    stated: str,
    on_patella: str,
) -> dict[str, Any]:
    """The contact of a patella with the groove of the femur."""
    said = "given at import" if thickness_mm else "assumed"
    return {
        **material,
        "points": _points(patella.fit.surface),
        "layer_thickness_mm": float(thickness_mm or ASSUMED_MM),
        "femoral_surface": _condyle_document(trochlea, stated),
        "patellar_surface": _plateau_document(patella, on_patella),
        "source": {**_GIVEN, "layer_thickness_mm": said},
    }


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
