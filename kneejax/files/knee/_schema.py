"""What a knee file may say: every field, its type, its range, and the slips people make in units.

The checks leave the document as it is. `_file` builds a knee from a checked document.
"""

from __future__ import annotations

import fnmatch

from kneejax.files._bundled import bundled_files
from kneejax.files.knee import _schema_parts as parts
from kneejax.files.reading import Field
from kneejax.geometry import FEMUR, PATELLA, TIBIA

#: Version of the format that this package reads and writes.
VERSION = 1
#: The sides a knee may be of.
SIDES = ("right", "left")
#: Fields of a knee file, in the order in which they are written; likewise those below.
KNEE_FIELDS = (
    "kneejax",
    "name",
    "side",
    "description",
    "reference_pose",
    "ligaments",
    "contacts",
    "patella",
    "surfaces",
    "wraps",
    "groups",
    "lines",
    "loads",
    "adaptations",
    "notes",
    "imported_from",
)
PATELLA_FIELDS = ("reference_pose", "ligaments", "contacts", "muscles", "wraps")
#: Bones whose articular surface may stand in a file before any contact uses it.
SURFACE_BONES = ("patella",)
#: Instead of these: the bundled knee whose patella it is.
SAME_AS = "same_as"
ADAPTATION_FIELDS = ("field", "from", "to", "reason")
IMPORT_FIELDS = ("file", "sha256", "side", "femur", "tibia", "ligaments", "wraps")


def check_knee(document: Field) -> dict[str, str]:
    """Check every field of a knee file.

    Args:
        document: the whole file.

    Returns:
        Place of a field (or of a part with all its fields) -> its source.

    Raises:
        InputProblem: the first field that is missing, unknown, or out of range.
    """
    if not isinstance(document.value, dict):
        raise document.problem("a mapping with the fields of a knee")
    if isinstance(kind := document.value.get("kneejax"), str):
        expected = f"{VERSION}, as in a knee file; this file holds a {kind}"
        raise document["kneejax"].problem(expected)
    document.mapping(KNEE_FIELDS[:7], KNEE_FIELDS[7:])
    if document["kneejax"].integer(1) != VERSION:
        raise document["kneejax"].problem(f"{VERSION}, the version of the format")
    document["name"].text()
    document["side"].choice(SIDES)
    document["description"].text()
    sources: dict[str, str] = {}
    parts.check_pose(document["reference_pose"], sources)
    wraps = document["wraps"].named("an obstacle") if "wraps" in document else []
    for _, wrap in wraps:
        parts.check_wrap(wrap, sources)
    # A model without meshes has no contacts yet, meshes alone have no ligaments.
    for _, ligament in document["ligaments"].named("a ligament", empty=True):
        parts.check_ligament(ligament, sources, tuple(name for name, _ in wraps))
    for _, contact in document["contacts"].named("a contact", empty=True):
        parts.check_contact(contact, sources)
    if not document["ligaments"].value and not document["contacts"].value:
        raise document["ligaments"].problem("a mapping from a name to a ligament, or contacts")
    if "patella" in document:
        check_patella(document["patella"], sources, tuple(document["ligaments"].value))
    if "surfaces" in document:
        surfaces = document["surfaces"].mapping((), SURFACE_BONES)
        for surface in (surfaces[bone] for bone in surfaces.value):
            parts.check_surface(surface)
            sources[surface.path] = surface["source"].text()
    if "groups" in document:
        _check_groups(document["groups"], tuple(document["ligaments"].value))
    for section, check in (("lines", parts.check_line), ("loads", parts.check_load)):
        if section in document:
            for _, part in document[section].named(f"one of the {section}"):
                check(part, sources)
    if "adaptations" in document:
        for adaptation in document["adaptations"].items("adaptations"):
            adaptation.mapping(ADAPTATION_FIELDS)
            adaptation["field"].text()
            adaptation["reason"].text()
    if "notes" in document:
        document["notes"].text()
    if "imported_from" in document:
        _check_import(document["imported_from"])
    return sources


def check_patella(patella: Field, sources: dict[str, str], ligaments: tuple[str, ...]) -> None:
    """Check the patella: its pose, and all parts that join it, with the muscles.

    Args:
        patella: the section, or `same_as` with the name of a bundled knee in the same frames.
        sources: to which those of its parts are added.
        ligaments: names of the other ligaments.
    """
    if isinstance(patella.value, dict) and SAME_AS in patella:
        known = patella.mapping((SAME_AS,), ("source",))[SAME_AS].choice(bundled_files("knees"))
        sources[patella.path] = f"the patella of {known}"
        return
    patella.mapping(PATELLA_FIELDS[:-1], PATELLA_FIELDS[-1:])
    parts.check_pose(patella["reference_pose"], sources, PATELLA)
    wraps = patella["wraps"].named("an obstacle") if "wraps" in patella else []
    for _, wrap in wraps:
        parts.check_wrap(wrap, sources, (FEMUR, PATELLA, TIBIA))
    known = tuple(name for name, _ in wraps)
    for name, ligament in patella["ligaments"].named("a ligament"):
        if name in ligaments:
            raise ligament.problem("a name that no ligament between femur and tibia has")
        ends = [end for end in parts.ENDS if isinstance(ligament.value, dict) and end in ligament]
        if len(ends) != 2:
            given = ", ".join(ends) or "none"
            expected = f"two of {', '.join(parts.ENDS)}"
            raise Field(ligament.file, ligament.path, given).problem(expected)
        parts.check_ligament(ligament, sources, known, tuple(ends))
    for _, contact in patella["contacts"].named("a contact", empty=True):
        parts.check_contact(contact, sources, ("femoral_surface", "patellar_surface"))
    muscles = patella["muscles"].named("a muscle")
    for _, muscle in muscles:
        parts.check_muscle(muscle, sources, known)
    heads = [m for _, m in muscles if m.value["insertion_bone"] == PATELLA]
    if not any(head.value["tension_N"] for head in heads):
        expected = "a quadriceps, inserted on the patella, whose tension at rest is above 0"
        raise Field(patella.file, f"{patella.path}.muscles", "none").problem(expected)


def _check_groups(groups: Field, ligaments: tuple[str, ...]) -> None:
    for name, group in groups.named("a list of ligaments"):
        if name in ligaments:
            raise group.problem("a group's name that is not a ligament's")
        for pattern in group.items("names of ligaments, or patterns such as ACL*"):
            if not fnmatch.filter(ligaments, pattern.text()):
                raise pattern.problem(
                    "the name of a ligament, or a pattern that fits one", ligaments
                )


def _check_import(origin: Field) -> None:
    """The model that a knee came from; names only where they differ from the knee's."""
    origin.mapping(IMPORT_FIELDS[:-2], IMPORT_FIELDS[-2:])
    for name in IMPORT_FIELDS[:-2]:
        origin[name].text()
    for section in IMPORT_FIELDS[-2:]:
        if section in origin:
            for _, name in origin[section].named("the model's name"):
                name.text()
