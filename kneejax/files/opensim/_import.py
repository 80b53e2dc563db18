"""A knee made of an OpenSim model: its ligaments, obstacles, pose and contact settings."""

from __future__ import annotations

import collections
import dataclasses
import fnmatch
import hashlib
import os
import re
from collections.abc import Mapping
from typing import Any

from kneejax.files.knee import ENDS, check_knee
from kneejax.files.opensim._acting import ACTS, ELSEWHERE, Untaken, listed, untaken
from kneejax.files.opensim._axes import anatomical, turned
from kneejax.files.opensim._beyond import posed, standing, with_pelvis_and_foot
from kneejax.files.opensim._contact import OsimContact, find_contacts
from kneejax.files.opensim._joints import Joint
from kneejax.files.opensim._knee import SIDES, OsimKneeJoint, find_knee
from kneejax.files.opensim._ligaments import (
    Found,
    OsimLigament,
    check_lengths,
    find_ligaments,
    outside_obstacles,
)
from kneejax.files.opensim._model import Model, read_model
from kneejax.files.opensim._muscles import find_muscles
from kneejax.files.opensim._names import file_names
from kneejax.files.opensim._numbers import METRES_TO_MM, shifted
from kneejax.files.opensim._patella import PatellaSection, patella_section
from kneejax.files.opensim._wraps import OsimWrap, wrap_document
from kneejax.files.reading import InputProblem
from kneejax.geometry import COLUMNS, PATELLA, TIBIA
from kneejax.mechanics import FAILURE_SOURCE, usual_failure_strain

#: Rounding of the ligament law's corners, which OpenSim's law does not have: small enough for its
#: forces, see `kneejax.mechanics.ligament_law.largest_tension_error`.
TRANSITION_WIDTH = 1e-4
#: Fibres are hardly ever softer: N per unit strain.
SOFT_N = 50.0
_TO_MM = {"slack_length_mm"}


@dataclasses.dataclass(frozen=True)
class OsimImport:
    """A knee as read from an OpenSim model.

    Attributes:
        document: content of a knee file, in mm and N.
        model: the model as it was read.
        knee: its bones and joints.
        ligaments: name in the knee file -> fibre of the model.
        wraps: name in the knee file -> wrap object of the model.
        found: fibres, with those left out and why.
        contacts: contacts of femur and tibia.
        untaken: forces and constraints of the model that are no part of the knee.
        without: names that were left out because a person asked for it.
        patellofemoral: contacts of femur and patella.
        patella_notes: what was assumed or left out of the patella and the muscles.
        patella_doubts: where they are not the model's.
    """

    document: dict[str, Any]
    model: Model
    knee: OsimKneeJoint
    ligaments: dict[str, OsimLigament]
    wraps: dict[str, OsimWrap]
    found: Found
    contacts: tuple[OsimContact, ...]
    untaken: tuple[Untaken, ...]
    without: tuple[str, ...]
    patellofemoral: tuple[OsimContact, ...] = ()
    patella_notes: tuple[str, ...] = ()
    patella_doubts: tuple[str, ...] = ()

    @property
    def doubts(self) -> tuple[str, ...]:
        """What a person should look at; empty if everything of the knee was read."""
        unsupported = (
            f"{name} was left out: not supported: {why}."
            for name, why in self.found.unsupported.items()
        )
        acting = [one for one in self.untaken if one.how == ACTS]
        others = (f"{line}: left out, though it {ACTS}." for line in listed(acting))
        contact = (f"{c.name}: {doubt}" for c in self.contacts for doubt in c.doubts)
        return (
            *unsupported, *others, *self.patella_doubts, *self.knee.doubts, *contact,
            *_soft(self.document),
        )  # fmt: skip

    @property
    def left_out(self) -> tuple[str, ...]:
        """What the model has for this knee besides, and why no doubt follows from it."""
        groups = collections.defaultdict(list)
        for one in self.untaken:
            if one.how not in (ACTS, ELSEWHERE):
                groups[one.how].append(one)
        asked = [f"{', '.join(self.without)}: as asked by --without"] if self.without else []
        return (*(f"{line}: {how}" for how, many in groups.items() for line in listed(many)),
                *asked)  # fmt: skip


def import_osim(
    path: str | os.PathLike[str],
    *,
    side: str,
    femur: str | None = None,
    tibia: str | None = None,
    without: tuple[str, ...] | list[str] = (),
    inside: str = "refuse",
    patella: bool = True,
    at: Mapping[str, float] | None = None,
    data: bytes | None = None,
) -> OsimImport:
    """Read a knee from an OpenSim model of schema 3 or 4.

    Lengths become mm by moving the decimal point, so that every digit of the file is kept.

    Args:
        path: the model.
        side: `r` or `l`.
        femur: body of the femur; found from the joints if it is not given.
        tibia: body of the tibia; likewise, and only together with it.
        without: names or patterns of fibres to leave out, and of forces not to miss.
        inside: what to do with a fibre that begins more than 0.5 mm inside what it goes around:
            `refuse` the model, or let it run `straight`, as OpenSim does.
        patella: whether to read the patella, its ligaments, and the muscles and ligaments that
            come over the knee from the pelvis or go to the foot; if not, they are not missed.
        at: coordinate of hip or foot -> where those begin and end, degrees or mm; at the model's
            defaults without it.
        data: the model's bytes, if they are at hand.

    Returns:
        A knee document without contacts, and what the model said.

    Raises:
        InputProblem: the file is not a model that can be read, it has no knee of that side or
            several, no ligament spans it, something in a ligament or wrap object is wrong, or hip
            and foot have no such coordinate.

    Example:
        >>> from kneejax.files import SMALLEST_MODEL
        >>> read = import_osim("smallest.osim", side="r", data=SMALLEST_MODEL.encode())
        >>> read.document["ligaments"]["LCL"]["tibial_attachment_mm"]
        [-18.0, -52.0, 36.0]
        >>> read.doubts
        ()
    """
    if side not in SIDES:
        raise InputProblem(path, "--side", side, "r or l")
    model = read_model(path, data)
    knee = find_knee(model, side, femur, tibia, may_be_named=True)
    whole = with_pelvis_and_foot(model, knee, at)
    found = find_ligaments(model, whole)
    left_out = _leave_out(model, found, without)
    knee = _with_small_bones(model, knee, whole, found.ligaments)
    if not any(_of_two_bones(x, knee) for x in found.ligaments):
        raise _no_ligament(path, knee, found)
    knee, turn = anatomical(model, knee, [x for x in found.ligaments if _of_two_bones(x, knee)])
    whole = turned(whole, turn)
    found.ligaments[:] = outside_obstacles(model, whole, found, inside)
    beside = [x for x in found.ligaments if not _of_two_bones(x, knee)]
    found.ligaments[:] = [x for x in found.ligaments if _of_two_bones(x, knee)]
    keys = [ligament.key for ligament in found.ligaments]
    ligaments = dict(zip(file_names(keys, "L"), found.ligaments, strict=True))
    used = {id(x.wrap.element): x.wrap for x in found.ligaments if x.wrap is not None}
    wraps = dict(zip(file_names([w.key for w in used.values()], "W"), used.values(), strict=True))
    every = find_contacts(model, knee)
    contacts = tuple(c for c in every if c.other.bone != PATELLA)
    on_patella = tuple(c for c in every if c.other.bone == PATELLA)
    section = PatellaSection({}, ())
    if patella:
        section = _patella(model, whole, beside, set(knee.rigid), posed(at))
    taken = [x.element for x in (*found.ligaments, *contacts)] + found.answered
    if section.document:
        taken += [x.element for x in (*beside, *section.muscles, *on_patella)]
    else:
        found.outside.update((one.key, f"attached to {_beside(one, knee)}") for one in beside)
    others = [
        one for one in untaken(model, knee, taken)
        if one.element.name not in left_out and (patella or not one.muscle_or_patella)
    ]  # fmt: skip
    doubts = section.doubts
    if not section.document and any(x.muscle_or_patella and x.how == ACTS for x in others):
        doubts += (f"{section.notes[0]} --without-patella does without it and its muscles.",)
    answer = OsimImport(
        {}, model, knee, ligaments, wraps, found, contacts, tuple(others), left_out, on_patella,
        section.notes, doubts,
    )  # fmt: skip
    check_lengths(model, whole, [*found.ligaments, *beside])
    answer.document.update(_document(answer))
    if section.document:
        answer.document["patella"] = section.document
    check_knee(answer.document, path)
    return answer


def _soft(document: dict[str, Any]) -> list[str]:
    """A doubt where stiffnesses look like N/mm."""
    every = document["ligaments"] | document.get("patella", {}).get("ligaments", {})
    soft = {name: x for name, x in every.items() if x["stiffness_N"] < SOFT_N}
    if not soft:
        return []
    name, entry = next(iter(soft.items()))
    softest = min(x["stiffness_N"] for x in soft.values())
    return [
        f"Stiffness below {SOFT_N:g} N per unit strain, from {softest:.3g} N on: "
        f"{', '.join(soft)}. N/mm are suspected: of {name} that would be "
        f"{entry['stiffness_N'] * entry['slack_length_mm']:.4g} N per unit strain."
    ]


def _with_small_bones(
    model: Model, knee: OsimKneeJoint, whole: OsimKneeJoint, ligaments: list[OsimLigament]
) -> OsimKneeJoint:
    """The knee with what its fibres end on below the tibia, held where the defaults have it."""
    ends: dict[str, list[str]] = collections.defaultdict(list)
    for ligament in ligaments:
        bodies = {point.body for point in ligament.points} - {*knee.rigid}
        if all(whole.rigid[body][0] == TIBIA for body in bodies):
            for body in bodies:
                ends[body].append(ligament.key)
    doubts = tuple(
        f"{', '.join(names)}: on {body}, which can move against the tibia in this model; here it "
        "does not: it is held at the model's default coordinates."
        for body, names in ends.items()
    )
    rigid = knee.rigid | {body: whole.rigid[body] for body in ends}
    return dataclasses.replace(knee, rigid=rigid, doubts=(*knee.doubts, *doubts))


def _no_ligament(path, knee: OsimKneeJoint, found: Found) -> InputProblem:
    why = [f"{name} {reason}" for name, reason in (found.unsupported | found.outside).items()]
    shown = "; ".join(why[:4]) + ("; ..." if len(why) > 4 else "")
    return InputProblem(
        path, "ligaments", f"none between {knee.femur} and {knee.tibia}",
        f"a ligament that spans the {SIDES[knee.side]} knee ({shown or 'all were left out'})",
    )  # fmt: skip


def _of_two_bones(ligament: OsimLigament, knee: OsimKneeJoint) -> bool:
    """Whether it joins femur and tibia themselves: no patella, nothing beyond them."""
    return not _beside(ligament, knee)


def _beside(ligament: OsimLigament, knee: OsimKneeJoint) -> str:
    """The body of a fibre that is neither of femur nor of tibia; empty without one."""
    bodies = (point.body for point in ligament.points)
    others = (x for x in bodies if x not in knee.rigid or knee.rigid[x][0] == PATELLA)
    return next(others, "")


def _patella(
    model: Model, knee: OsimKneeJoint, ligaments: list[OsimLigament], own: set[str], where: str
) -> PatellaSection:
    """The section of the patella, with the muscles over the knee and ligaments from the pelvis.

    `own` are the bodies of the knee itself, `where` says how pelvis and foot are posed.
    """
    muscles, file = find_muscles(model, knee), f"{model.file.path.name}{where}"
    every = (*ligaments, *muscles.muscles)
    if any(point.body not in own for one in every for point in one.points):
        muscles = muscles.noted(standing(where))
    used = {id(x.wrap.element): x.wrap for x in every if x.wrap is not None}
    names = dict(zip(used, file_names([w.key for w in used.values()], "W"), strict=True))
    entries = {
        name: _ligament(one, knee, file, names)
        for name, one in zip(file_names([x.key for x in ligaments], "L"), ligaments, strict=True)
    }
    return patella_section(model, knee, entries, muscles, [*used.values()], names, file)


def _document(read: OsimImport) -> dict[str, Any]:
    model, knee, file = read.model, read.knee, read.model.file.path.name
    side = SIDES[knee.side]
    wrap_names = {id(wrap.element): name for name, wrap in read.wraps.items()}
    document: dict[str, Any] = {
        "kneejax": 1,
        "name": model.root.name or model.file.path.stem,
        "side": side,
        "description": f"The {side} knee of the OpenSim model {model.root.name or file} ({file})",
        "reference_pose": dict(zip(COLUMNS, knee.pose, strict=True))
        | {"source": f"{file}: {knee.tibia} in {knee.femur} at the coordinates' default values"},
        "ligaments": {
            name: _ligament(ligament, knee, file, wrap_names)
            for name, ligament in read.ligaments.items()
        },
        "contacts": {},
        "wraps": {
            name: wrap_document(
                model, wrap, knee, f"{file}, {wrap.element.tag} {wrap.key} of {wrap.body}"
            )
            for name, wrap in read.wraps.items()
        },
        "groups": _groups(list(read.ligaments)),
        "notes": " ".join((*knee.unusual, _notes(knee.joints, read.contacts))),
        "imported_from": {
            "file": file,
            "sha256": hashlib.sha256(model.file.original).hexdigest(),
            "side": knee.side,
            "femur": knee.femur,
            "tibia": knee.tibia,
            # Only names that a knee file does not allow differ from the model's.
            "ligaments": {n: x.key for n, x in read.ligaments.items() if n != x.key},
            "wraps": {n: x.key for n, x in read.wraps.items() if n != x.key},
        },
    }
    for part, section in (
        (document, "wraps"), (document, "groups"),
        (document["imported_from"], "ligaments"), (document["imported_from"], "wraps"),
    ):  # fmt: skip
        if not part[section]:
            del part[section]
    return document


def _ligament(
    ligament: OsimLigament, knee: OsimKneeJoint, file: str, wraps: dict[int, str]
) -> dict[str, Any]:
    bones = [knee.rigid[point.body][0] for point in ligament.points]
    places = [[shifted(x, METRES_TO_MM) for x in point.in_bone(knee)] for point in ligament.points]
    ends = {bone: field for field, bone in ENDS.items()}
    entry: dict[str, Any] = {ends[bones[0]]: places[0]}
    if len(places) > 2:
        entry["via_points"] = [
            {"bone": bone, "point_mm": place}
            for bone, place in zip(bones[1:-1], places[1:-1], strict=True)
        ]
    entry[ends[bones[-1]]] = places[-1]
    if ligament.wrap is not None:
        entry["wrap"] = wraps[id(ligament.wrap.element)]
    for field, value in ligament.numbers.items():
        entry[field] = shifted(value, METRES_TO_MM) if field in _TO_MM else float(value)
    entry["transition_width"] = TRANSITION_WIDTH
    entry["failure_strain"] = float(usual_failure_strain([ligament.key])[0])
    source = f"{file}, {ligament.element.tag} {ligament.key}; failure_strain: {FAILURE_SOURCE}"
    if ligament.assumed:
        source += f"; OpenSim's default: {', '.join(ligament.assumed)}"
    return entry | {"source": source}


def _leave_out(model: Model, found: Found, without) -> tuple[str, ...]:
    names: list[str] = []
    for pattern in without:
        known = [x.key for x in found.ligaments] + list(found.unsupported) + list(found.outside)
        known = list(dict.fromkeys([*known, *(x.name for x in model.forces() if x.name)]))
        hits = fnmatch.filter(known, pattern)
        if not hits:
            expected = "the name of a fibre or force, or a pattern that fits one"
            raise InputProblem(model.file.path, "--without", pattern, expected, known)
        names += [name for name in hits if name not in names]
    found.ligaments[:] = [x for x in found.ligaments if x.key not in names]
    for name in names:
        found.unsupported.pop(name, None)
    return tuple(names)


def _groups(names: list[str]) -> dict[str, list[str]]:
    """Fibres that differ in the number at the end; bundles that begin with the same capitals."""
    stems: dict[str, list[str]] = collections.defaultdict(list)
    ligaments: dict[str, list[str]] = collections.defaultdict(list)
    for name in names:
        stem = re.sub(r"[_-]?\d+$", "", name)
        stems[stem].append(name)
        capitals = re.match(r"[A-Z]{2,}", stem)
        if capitals:
            ligaments[capitals.group()].append(name)
    # Fibres by number first: a ligament of one bundle is that bundle.
    every = stems | {name: many for name, many in ligaments.items() if name not in stems}
    seen: list[list[str]] = []
    answer = {}
    for name, many in every.items():
        if len(many) > 1 and name and name not in names and many not in seen:
            seen.append(many)
            answer[name] = many
    return answer


def _notes(joints: tuple[Joint, ...], contacts: tuple[OsimContact, ...]) -> str:
    lines = [f"{joint.name} ({joint.kind}): {'; '.join(joint.describe())}." for joint in joints]
    for contact in contacts:
        lines += [f"Contact {contact.name} of the model:", *contact.findings]
    return "Knee joint of the model. " + " ".join(lines)
