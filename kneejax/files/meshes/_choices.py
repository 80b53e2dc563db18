"""What a person chose for an import of meshes, checked before the work begins."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence

from kneejax.files.reading import InputProblem
from kneejax.mechanics import RANGES, cartilage_law

#: How the layer's thickness may be given over a compartment.
THICKNESSES = ("constant", "field")
_SIDES = {"r": "right", "l": "left", "right": "right", "left": "left"}
_SMALLEST_ANGLE_DEG = 30.0

Path = str | os.PathLike[str] | None


def checked_side(side: str) -> str:
    """`right` or `left`, whichever way it was said."""
    if side not in _SIDES:
        raise InputProblem("--side", "side", side, "right or left", _SIDES)
    return _SIDES[side]


def check_files(files: Mapping[str, Path]) -> None:
    """Whether every mesh is a file of its own, and the bones both there or both not.

    Args:
        files: option -> path, or None if it is not given.
    """
    femur, tibia = (files[f"--{bone}-bone"] for bone in ("femur", "tibia"))
    if (femur is None) != (tibia is None):
        missing = "--femur-bone" if femur is None else "--tibia-bone"
        raise InputProblem(missing, "file", "missing", "both bone meshes, or neither")
    seen: dict[str, str] = {}
    for option, path in files.items():
        if path is None:
            continue
        place = os.path.realpath(path)
        if place in seen:
            expected = f"another file than that of {seen[place]}"
            raise InputProblem(option, "file", os.fspath(path), expected)
        seen[place] = option


def check_layer(
    law: str,
    youngs_modulus_MPa: float,
    poisson_ratio: float,
    layer_thickness_mm: float | None,
    thickness: str,
    bones: bool,
) -> None:
    """Whether the layer's material and thickness are possible; arguments as `import_meshes`."""
    if law not in cartilage_law.LAWS:
        expected = f"one of {', '.join(cartilage_law.LAWS)}"
        raise InputProblem("--law", "law", law, expected, cartilage_law.LAWS)
    if thickness not in THICKNESSES:
        expected = f"one of {', '.join(THICKNESSES)}"
        raise InputProblem("--thickness", "thickness", thickness, expected, THICKNESSES)
    for option, what, field, value in (
        ("--modulus", "Young's modulus", "youngs_modulus_MPa", youngs_modulus_MPa),
        ("--poisson-ratio", "Poisson's ratio", "poisson_ratio", poisson_ratio),
        ("--layer-thickness", "thickness", "layer_thickness_mm", layer_thickness_mm),
    ):
        if value is not None and not RANGES[field].holds(value):
            raise InputProblem(option, what, value, RANGES[field].expected(value))
    if layer_thickness_mm is not None:
        if thickness != "constant":
            expected = "constant, where --layer-thickness gives one number"
            raise InputProblem("--thickness", "thickness", thickness, expected)
    elif thickness != "constant" and not bones:
        raise InputProblem("--thickness", "thickness", thickness, "both bone meshes, for a field")


def check_region(
    axis_point_mm: Sequence[float] | None,
    axis_rotation_deg: Sequence[float],
    angle_deg: Sequence[float] | None,
) -> None:
    """Whether an axis and a region that were given are some; arguments as `import_meshes`."""
    if axis_point_mm is None and any(axis_rotation_deg):
        expected = "a point of the axis too, where --axis-rotation is given"
        raise InputProblem("--axis-point", "axis", "missing", expected)
    if angle_deg is None:
        return
    lower, upper = angle_deg
    if not (-180 <= lower and upper <= 360 and upper - lower >= _SMALLEST_ANGLE_DEG):
        expected = (
            "two angles in degrees from anterior (0) through distal (90) to posterior (180), the "
            f"second larger by {_SMALLEST_ANGLE_DEG:g} at least"
        )
        raise InputProblem("--angle", "region", f"{lower:g} {upper:g}", expected)
