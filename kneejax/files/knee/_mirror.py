"""Left knees as mirrored right ones.

In a knee file Z points to the person's right on both sides: laterally on a right knee, medially on
a left one. A left knee is mirrored through its sagittal plane on reading, `z -> -z`:

| what | becomes |
|---|---|
| points, attachments, polynomial paths, forces `(x, y, z)` | `(x, y, -z)` |
| moments, rotations about X, Y, Z `(x, y, z)` | `(-x, -y, z)` |
| regions along Z `[lower, upper]` | `[-upper, -lower]` |
| coefficients of `t^j`, `t` the scaled width or z | times `(-1)^j` |
| control values of a spline over the width or z | the last comes first |
| half extents, radii, semi-axes, everything else | the same |

The reference pose stays the same, its `lateral_mm` included: it is given by clinical meaning
(varus, internal rotation and lateral are positive on either side).
"""

from __future__ import annotations

import copy
from typing import Any

from kneejax.files.knee._schema_parts import FACES
from kneejax.geometry import CUBIC_SPLINE

_POINTS = (
    "femoral_attachment_mm",
    "patellar_attachment_mm",
    "tibial_attachment_mm",
    "axis_point_mm",
    "origin_mm",
    "center_mm",
    "insertion_mm",
    "force_N",
    "point_mm",  # via points among them
)
_TURNS = ("axis_rotation_deg", "rotation_deg", "moment_Nmm")
_SECTIONS = ("ligaments", "contacts", "muscles", "surfaces", "wraps", "lines", "loads")
_REGIONS = ("width_mm", "lateral_mm")


def mirror_document(document: dict[str, Any]) -> dict[str, Any]:
    """The other side's twin of a knee document.

    Args:
        document: content of a knee file, of either side.

    Returns:
        A new document of the other side; mirroring it again gives the first one back.

    Example:
        >>> document = {"side": "right", "loads": {"push": {"force_N": [1.0, 2.0, 3.0]}}}
        >>> mirror_document(document)
        {'side': 'left', 'loads': {'push': {'force_N': [1.0, 2.0, -3.0]}}}
    """
    twin = copy.deepcopy(document)
    twin["side"] = "left" if document["side"] == "right" else "right"
    for whole in (twin, twin.get("patella", {})):
        for section in _SECTIONS:
            if section in whole:
                whole[section] = {name: _mirrored(part) for name, part in whole[section].items()}
    return twin


def mirror_part(part: dict[str, Any]) -> dict[str, Any]:
    """The other side's twin of a contact or a surface of a knee document."""
    return _mirrored(copy.deepcopy(part))


def _mirrored(part: dict[str, Any]) -> dict[str, Any]:
    twin = {name: _mirrored_field(name, value) for name, value in part.items()}
    if part.get("basis") == CUBIC_SPLINE:
        twin["coefficients_mm"] = [list(row[::-1]) for row in part["coefficients_mm"]]
    return twin


def _mirrored_field(name: str, value: Any) -> Any:
    if name in FACES:
        return _mirrored(value)
    if name == "via_points":
        return [_mirrored(point) for point in value]
    if name in _POINTS:
        if isinstance(value[0], list):
            return [_mirrored_field(name, row) for row in value]
        return [value[0], value[1], _negative(value[2])]
    if name in _TURNS:
        return [_negative(value[0]), _negative(value[1]), value[2]]
    if name == "outline_mm":
        return [[a, _negative(b)] for a, b in value]
    if name in _REGIONS:
        return [_negative(value[1]), _negative(value[0])]
    if name in ("coefficients_mm", "layer_variation_mm"):
        return [[_negative(c) if j % 2 else c for j, c in enumerate(row)] for row in value]
    return value


def _negative(x: float) -> float:
    return 0.0 - x if x == 0 else -x
