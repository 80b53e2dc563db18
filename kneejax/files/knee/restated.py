"""A knee document with the numbers of a knee, or with grafts, and who says so."""

__all__ = ["reconstructed", "restated"]

import copy
import fnmatch
import operator
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from kneejax import mechanics
from kneejax.files.knee import parts, surfaces
from kneejax.files.knee.document import mirror_document, with_own_patella
from kneejax.files.knee.file import detour_counts, slack_length
from kneejax.files.reading import Part
from kneejax.geometry import PATELLA

#: Numbers that differ by less than so many of the last digit are one.
_LAST_DIGITS = 500.0


def restated(document: dict[str, Any], knee: mechanics.Knee, source: str) -> dict[str, Any]:
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
        >>> read = load_knee_file("four_ligament")
        >>> stiff = read.knee.replace({"ACL.stiffness": 5000.0})
        >>> ligament = restated(read.document, stiff, "our robot")["ligaments"]["ACL"]
        >>> ligament["stiffness_N"], ligament["source"]["stiffness_N"]
        (5000.0, 'our robot')
    """
    left = document["side"] == "left"
    right = mirror_document(document) if left else copy.deepcopy(document)
    sections, own = [right], {}
    if PATELLA in knee.bodies:
        own = with_own_patella(right)["patella"]
        sections.append(copy.deepcopy(own))
    _fibres({k: x for one in sections for k, x in one["ligaments"].items()}, knee, source)
    _courses(sections, parts.Ligament, knee.ligaments, source)
    contacts = [part for section in sections for part in section["contacts"].values()]
    for part, contact in zip(contacts, knee.contacts, strict=True):
        _state(part, contact, surfaces.ContactPart, source)
        if "ring" in part and _put(part["ring"], _numbers_of(contact.ring, surfaces.RingPart)):
            _say(part, surfaces.ContactPart, ["ring"], source)
        faces = [part[face] for face in surfaces.FACES if face in part]
        for face, surface in zip(faces, (contact.femoral, contact.tibial), strict=True):
            _state(face, surface, surfaces.model_of(face), source)
    still = dict.fromkeys(parts.attributes(parts.LoadOfFile), (0.0, 0.0, 0.0))
    for part, load in zip(right.get("loads", {}).values(), knee.loads, strict=True):
        _state(part, load, parts.LoadOfFile, source, still)
    if not own:
        for part, line in zip(right.get("lines", {}).values(), knee.lines, strict=True):
            _state(part, line, parts.Line, source)
    elif knee.muscles is not None:
        fields, muscles = parts.attributes(parts.Muscle), knee.muscles
        for row, name in enumerate(muscles.names):  # others of the section do not pull
            part = sections[1]["muscles"][name]
            found = {field: np.asarray(getattr(muscles, x))[row] for field, x in fields.items()}
            _say(part, parts.Muscle, _put(part, found), source)
        _courses(sections[1:], parts.Muscle, muscles, source)
    if own and sections[1] != own:
        right["patella"] = sections[1]
    return mirror_document(right) if left else right


def reconstructed(
    document: dict[str, Any], knee: mechanics.Knee, torn: Sequence[str], grafts: Sequence[str],
    source: str,
) -> dict[str, Any]:  # fmt: skip
    """A knee document without its torn fibres, and with grafts.

    Args:
        document: content of a knee file, of either side.
        knee: a knee of two bones that has the grafts among its ligaments, fixed; a left one as its
            mirrored right twin.
        torn: fibres of the document that are taken out; groups without a fibre go with them.
        grafts: fibres of `knee` that are put in, straight between their ends. Several are a group
            `graft`.
        source: of the grafts' numbers.

    Returns:
        A new document; the others of its numbers are those of `document`.

    Example:
        >>> from kneejax.files import load_knee_file
        >>> read = load_knee_file("four_ligament")
        >>> own = reconstructed(read.document, read.knee, ["ACL"], ["ACL"], "my own")["ligaments"]
        >>> [*own], round(own["ACL"]["slack_length_mm"], 2), own["ACL"]["source"]
        (['PCL', 'MCL', 'LCL', 'ACL'], 25.82, 'my own')
    """
    left = document["side"] == "left"
    right = mirror_document(document) if left else copy.deepcopy(document)
    if torn and "patella" in right:
        right = with_own_patella(right)
    for name in torn:
        del (right if name in right["ligaments"] else right["patella"])["ligaments"][name]
    fibres = knee.ligaments
    for name in grafts:
        row = fibres.names.index(name)
        fields = ("slack_length_mm", "femoral_attachment_mm", "tibial_attachment_mm")
        entry = {x: np.asarray(getattr(fibres, parts.quantity(x))[row], float).tolist()
                 for x in (*fields, *parts.OF_FIBRE)}
        right["ligaments"][name] = entry | {"source": source}
    groups = {group: [x for x in patterns if fnmatch.filter(right["ligaments"], x)]
              for group, patterns in right.pop("groups", {}).items()}
    groups |= {"graft": [*grafts]} if len(grafts) > 1 else {}
    if groups := {group: patterns for group, patterns in groups.items() if patterns}:
        right["groups"] = groups
    return mirror_document(right) if left else right


def _fibres(ligaments: dict[str, dict[str, Any]], knee: mechanics.Knee, source: str) -> None:
    fibres = knee.ligaments
    models = [parts.Ligament.model_construct(**one) for one in ligaments.values()]
    _, lengths = mechanics.at_reference(fibres, knee.at_reference, detour_counts(models))
    lengths, slack = np.asarray(lengths).tolist(), np.asarray(fibres.slack_length)
    attachments = [np.asarray(x) for x in (fibres.femoral_attachment, fibres.tibial_attachment)]
    numbers = {x: np.asarray(getattr(fibres, parts.quantity(x))) for x in parts.OF_FIBRE}
    usual = mechanics.usual_failure_strain(tuple(ligaments))
    for row, (part, model) in enumerate(zip(ligaments.values(), models, strict=True)):
        found = {field: end[row] for field, end in zip(model.ends, attachments, strict=True)}
        found |= {field: values[row] for field, values in numbers.items()}
        if model.law == mechanics.NEO_HOOKEAN:
            del found["transition_strain"]
        others = {"failure_strain": usual[row], "damping_N_s": 0.0, "area_mm2": 0.0}
        changed = _put(part, found, others)
        # The slack length as the part gives it now.
        model = parts.Ligament.model_construct(**part)
        if not _same(slack[row], slack_length(model, lengths[row])):
            given = model.slack_field
            del part[given]
            number = float(lengths[row] / slack[row] - 1.0)
            if given != "reference_strain" or not mechanics.RANGES[given].holds(number):
                given, number = "slack_length_mm", float(slack[row])
            part[given] = number
            changed.append(given)
        _say(part, parts.Ligament, changed, source)


def _courses(
    sections: list[dict[str, Any]], model: type[parts.Sourced], among: mechanics.Fibres, source: str
) -> None:
    """Via points, and what fibres go around, each in its own section."""
    kind = "ligaments" if model is parts.Ligament else "muscles"
    home = {name: place for place, one in enumerate(sections) for name in one[kind]}
    before = [copy.deepcopy(section.get("wraps", {})) for section in sections]
    stated: set[tuple[int, str]] = set()
    for course in among.courses:
        fibres = [among.names[row] for row in course.rows]
        for fibre, way in zip(fibres, np.moveaxis(np.asarray(course.via), 1, 0), strict=True):
            part = sections[home[fibre]][kind][fibre]
            points = zip(part.get("via_points", ()), way, strict=True)
            changed = [_put(via, {"point_mm": point}) for via, point in points]
            _say(part, model, ["via_points"] if any(changed) else [], source)
        if course.obstacle is None:
            continue
        place = home[fibres[0]]
        section, name = sections[place], sections[place][kind][fibres[0]]["wrap"]
        wrap = copy.deepcopy(before[place][name])
        _state(wrap, course.obstacle, surfaces.model_of(wrap), source)
        if (place, name) in stated and wrap != section["wraps"][name]:
            name = f"{name}_{fibres[0]}"
            for fibre in fibres:
                section[kind][fibre]["wrap"] = name
        section["wraps"][name] = wrap
        stated.add((place, name))


def _state(
    part: dict[str, Any], of: Any, model: type[Part], source: str, usual: Mapping[str, Any] = {}
) -> None:
    """Put the numbers of an object into its part of the document, and say whose they are."""
    _say(part, model, _put(part, _numbers_of(of, model), usual), source)


def _numbers_of(of: Any, model: type[Part]) -> dict[str, Any]:
    """Field -> number of an object, in the units of its part of a document."""
    found = {x: operator.attrgetter(name)(of) for x, name in parts.attributes(model).items()}
    return {field: np.rad2deg(value) if field.endswith("_deg") else value
            for field, value in found.items() if value is not None}


def _put(
    part: dict[str, Any], found: Mapping[str, Any], usual: Mapping[str, Any] = {}
) -> list[str]:
    """Write what differs from what stands there, or is usual; the names of these fields."""
    changed = []
    for field, value in found.items():
        stated = part.get(field, usual.get(field))
        if stated is None or not _same(value, stated):
            part[field] = np.asarray(value, float).tolist()
            changed.append(field)
    return changed


def _same(value: Any, stated: Any) -> bool:
    """Whether two numbers, or tables of them, are one to rounding."""
    value = np.asarray(value)
    rounding = _LAST_DIGITS * float(np.finfo(value.dtype).eps)
    return np.allclose(value, np.asarray(stated, float), rtol=rounding, atol=0.0)


def _say(part: dict[str, Any], model: type[Part], changed: list[str], source: str) -> None:
    """State the source of the fields that have changed."""
    if not changed:
        return
    said = part["source"]
    if issubclass(model, surfaces.Surface):  # it has one text
        part["source"] = f"{said}; {', '.join(changed)}: {source}"
        return
    if not isinstance(said, dict):
        marks = parts.marked(model, parts.Source)
        numbers = [x for x in part if x != "source" and marks.get(x, parts.SPARED).number]
        said = dict.fromkeys(numbers, said)
    stated = {field: text for field, text in said.items() if field in part}
    part["source"] = stated | dict.fromkeys(changed, source)
