"""A knee document with the numbers of a knee, and who says so."""

from __future__ import annotations

import copy
import operator
from collections.abc import Mapping
from typing import Any

import numpy as np

from kneejax.files.knee._building import detour_counts, ends_of, slack_length
from kneejax.files.knee._mirror import mirror_document
from kneejax.files.knee._patella_section import merged, parted, with_own_section
from kneejax.files.knee._schema_parts import FACES, SLACK_FIELDS
from kneejax.geometry import PATELLA
from kneejax.mechanics import RANGES, Fibres, Knee, at_reference, usual_failure_strain

#: Field of a fibre -> attribute of fibres that it gives; likewise those below.
FIBRE = {
    "stiffness_N": "stiffness",
    "transition_strain": "transition_strain",
    "transition_width": "transition_width",
    "failure_strain": "failure_strain",
    "damping_N_s": "damping",
}
_CONTACT = {
    "youngs_modulus_MPa": "youngs_modulus",
    "poisson_ratio": "poisson_ratio",
    "layer_thickness_mm": "layer_thickness",
    "layer_variation_mm": "layer_variation",
    "onset_width_mm": "onset_width",
}
_PLACED = {"center_mm": "frame.origin", "rotation_deg": "frame.rotation"}
_SHAPES = {
    "condyle": {
        "axis_point_mm": "frame.origin",
        "axis_rotation_deg": "frame.rotation",
        "angle_deg": "angle",
        "width_mm": "width",
        "coefficients_mm": "coefficients",
    },
    "plateau": {
        "origin_mm": "frame.origin",
        "rotation_deg": "frame.rotation",
        "anterior_mm": "x",
        "lateral_mm": "z",
        "coefficients_mm": "coefficients",
        "outline_mm": "outline",
    },
    "plane": {
        "origin_mm": "frame.origin",
        "rotation_deg": "frame.rotation",
        "half_extent_mm": "half_extent",
    },
    "sphere": {**_PLACED, "radius_mm": "radius"},
    "cylinder": {**_PLACED, "radius_mm": "radius", "length_mm": "length"},
    "ellipsoid": {**_PLACED, "semi_axes_mm": "semi_axes"},
}
_MUSCLE = {
    "origin_mm": "femoral_attachment",
    "insertion_mm": "tibial_attachment",
    "tension_N": "tension",
}
_LINE = {"tension_N": "tension", "insertion_mm": "insertion", "origin_mm": "origin"}
_LOAD = {"force_N": "force", "moment_Nmm": "moment", "point_mm": "point"}
#: Fields without a number, and parts that have a source of their own.
_NOT_SOURCED = (
    "source", "kind", "bone", "side", "wrap", "form", "points", "law", "axes", "point_in",
    "insertion_bone", *FACES,
)  # fmt: skip
#: Numbers that differ by less than so many of the last digit are one.
_LAST_DIGITS = 500.0


def restated(document: dict[str, Any], knee: Knee, source: str) -> dict[str, Any]:
    """A knee document with the numbers of a knee.

    Only numbers that are others than those of the document are written, in the document's own
    terms: a reference strain stays one, and follows attachments that have moved. A reference force
    becomes a slack length where its fibre has changed, and an obstacle that two courses share
    becomes two where they differ.

    Args:
        document: content of a knee file, of either side.
        knee: the knee of this document with other numbers, of two bones or with its patella; a left
            one as its mirrored right twin.
        source: of the numbers that are others.

    Returns:
        A new document; reading it gives the knee, to rounding.

    Example:
        >>> from kneejax.files import load_knee_file
        >>> from kneejax.parameters import with_values
        >>> read = load_knee_file("four_ligament")
        >>> stiff = with_values(read.knee, {"ACL.stiffness": 5000.0})
        >>> ligament = restated(read.document, stiff, "our robot")["ligaments"]["ACL"]
        >>> ligament["stiffness_N"], ligament["source"]["stiffness_N"]
        (5000.0, 'our robot')
    """
    left = document["side"] == "left"
    right = mirror_document(document) if left else copy.deepcopy(document)
    if PATELLA in knee.bodies:
        own = with_own_section(right)
        whole = copy.deepcopy(merged(own))
        _parts(whole, knee, source)
        found = copy.deepcopy(parted(whole, own))
        _muscles(found["patella"], knee, source)
        unchanged = found["patella"] == own["patella"]
        right = found | ({"patella": right["patella"]} if unchanged else {})
    else:
        _parts(right, knee, source)
        for part, line in zip(right.get("lines", {}).values(), knee.lines, strict=True):
            _state(part, line, _LINE, source)
    return mirror_document(right) if left else right


def _parts(right: dict[str, Any], knee: Knee, source: str) -> None:
    """Ligaments, contacts and loads."""
    _fibres(right["ligaments"], knee, source)
    _courses(right["ligaments"], right.get("wraps", {}), knee.ligaments, source)
    for part, contact in zip(right["contacts"].values(), knee.contacts, strict=True):
        _state(part, contact, _CONTACT, source)
        faces = [face for face in FACES if face in part]
        for field, surface in zip(faces, (contact.femoral, contact.tibial), strict=True):
            _state(part[field], surface, _SHAPES[part[field]["kind"]], source)
    still = dict.fromkeys(_LOAD, (0.0, 0.0, 0.0))
    for part, load in zip(right.get("loads", {}).values(), knee.loads, strict=True):
        _state(part, load, _LOAD, source, still)


def _muscles(section: dict[str, Any], knee: Knee, source: str) -> None:
    """Muscles that pull; the others of the section are no part of the knee."""
    muscles = knee.muscles
    if muscles is None:
        return
    for row, name in enumerate(muscles.names):
        found = {field: np.asarray(getattr(muscles, own))[row] for field, own in _MUSCLE.items()}
        part = section["muscles"][name]
        _say(part, _put(part, found), source)
    _courses(section["muscles"], section.get("wraps", {}), muscles, source)


def _fibres(parts: dict[str, dict[str, Any]], knee: Knee, source: str) -> None:
    fibres = knee.ligaments
    numbers = {field: np.asarray(getattr(fibres, name)) for field, name in FIBRE.items()}
    _, lengths = at_reference(fibres, knee.at_reference, detour_counts(parts))
    lengths, slack = np.asarray(lengths).tolist(), np.asarray(fibres.slack_length)
    attachments = [np.asarray(x) for x in (fibres.femoral_attachment, fibres.tibial_attachment)]
    usual = usual_failure_strain(tuple(parts))
    for row, part in enumerate(parts.values()):
        found = {field: end[row] for field, end in zip(ends_of(part), attachments, strict=True)}
        found |= {field: values[row] for field, values in numbers.items()}
        changed = _put(part, found, {"failure_strain": usual[row], "damping_N_s": 0.0})
        if not _same(slack[row], slack_length(part, lengths[row])):
            given = next(name for name in SLACK_FIELDS if name in part)
            del part[given]
            strain = float(lengths[row] / slack[row] - 1.0)
            if given == "reference_strain" and RANGES[given].holds(strain):
                part[given] = strain
            else:
                given = "slack_length_mm"
                part[given] = float(slack[row])
            changed.append(given)
        _say(part, changed, source)


def _courses(
    parts: dict[str, Any], wraps: dict[str, Any], among: Fibres, source: str
) -> None:
    """Via points, and what fibres go around."""
    before = copy.deepcopy(wraps)
    stated: set[str] = set()
    for course in among.courses:
        fibres = [among.names[row] for row in course.rows]
        for fibre, way in zip(fibres, np.moveaxis(np.asarray(course.via), 1, 0), strict=True):
            points = zip(parts[fibre].get("via_points", ()), way, strict=True)
            changed = [_put(via, {"point_mm": point}) for via, point in points]
            _say(parts[fibre], ["via_points"] if any(changed) else [], source)
        if course.obstacle is None:
            continue
        name = parts[fibres[0]]["wrap"]
        wrap = copy.deepcopy(before[name])
        _state(wrap, course.obstacle, _SHAPES[wrap["kind"]], source)
        if name in stated and wrap != wraps[name]:
            name = f"{name}_{fibres[0]}"
            for fibre in fibres:
                parts[fibre]["wrap"] = name
        wraps[name] = wrap
        stated.add(name)


def _state(
    part: dict[str, Any],
    of: Any,
    fields: Mapping[str, str],
    source: str,
    usual: Mapping[str, Any] | None = None,
) -> None:
    """Put the numbers of an object into its part of the document, and say whose they are."""
    found = {}
    for field, name in fields.items():
        value = operator.attrgetter(name)(of)
        if value is not None:
            found[field] = np.rad2deg(value) if field.endswith("_deg") else value
    _say(part, _put(part, found, usual), source)


def _put(
    part: dict[str, Any], found: Mapping[str, Any], usual: Mapping[str, Any] | None = None
) -> list[str]:
    """Write what differs from what stands there, or is usual; the names of these fields."""
    changed = []
    for field, value in found.items():
        stated = part.get(field, (usual or {}).get(field))
        if stated is None or not _same(value, stated):
            part[field] = np.asarray(value, float).tolist()
            changed.append(field)
    return changed


def _same(value: Any, stated: Any) -> bool:
    """Whether two numbers, or tables of them, are one to rounding."""
    value = np.asarray(value)
    rounding = _LAST_DIGITS * float(np.finfo(value.dtype).eps)
    return np.allclose(value, np.asarray(stated, float), rtol=rounding, atol=0.0)


def _say(part: dict[str, Any], changed: list[str], source: str) -> None:
    """State the source of the fields that have changed."""
    if not changed:
        return
    said = part["source"]
    if "kind" in part and "bone" not in part:  # a surface, which has one text
        part["source"] = f"{said}; {', '.join(changed)}: {source}"
        return
    if not isinstance(said, dict):
        said = {field: said for field in part if field not in _NOT_SOURCED}
    stated = {field: text for field, text in said.items() if field in part}
    part["source"] = stated | dict.fromkeys(changed, source)
