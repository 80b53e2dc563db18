"""A knee made of an OpenSim model: its ligaments, obstacles, pose and contact settings."""

from __future__ import annotations

import collections
import dataclasses
import fnmatch
import hashlib
import os
import re
from collections.abc import Mapping, Sequence
from typing import Any

from kneejax.files.knee import check_knee
from kneejax.files.opensim._contact import OsimContact, find_contacts
from kneejax.files.opensim._frames import anatomical, turned
from kneejax.files.opensim._knee import SIDES, OsimKneeJoint, find_knee, with_pelvis_and_foot
from kneejax.files.opensim._ligaments import (
    Found,
    OsimLigament,
    check_lengths,
    find_ligaments,
    outside_obstacles,
)
from kneejax.files.opensim._model import Model, read_model
from kneejax.files.opensim._muscles import PatellaSection, find_muscles, patella_section
from kneejax.files.opensim._paths import OsimWrap, file_names
from kneejax.files.opensim._untaken import (
    ACTS,
    ELSEWHERE,
    OFF,
    Untaken,
    listed,
    numbers_of_kinds,
    untaken,
)
from kneejax.files.reading import InputProblem
from kneejax.geometry import COLUMNS, PATELLA, TIBIA

#: Fibres are hardly ever softer: N per unit strain.
SOFT_N = 50.0


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
        bodies: at the knee that are part of none of its bones, as menisci.
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
    bodies: tuple[str, ...] = ()
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
        )

    @property
    def left_out(self) -> tuple[str, ...]:
        """What the model has for this knee besides, and why no doubt follows from it."""
        groups = collections.defaultdict(list)
        for one in self.untaken:
            if one.how not in (ACTS, ELSEWHERE):
                groups[one.how].append(one)
        asked = [f"{', '.join(self.without)}: as asked by --without"] if self.without else []
        return (*(f"{line}: {how}" for how, many in groups.items() for line in listed(many)),
                *asked)

    @property
    def numbers_left_out(self) -> str:
        """How many of which kind the knee has not: of what acts on it, is switched off, or is
        elsewhere in the model."""
        fibres = [e.tag for e in self.found.answered if e.name not in self.without]
        tags = collections.defaultdict(list, {ACTS: fibres})
        for one in self.untaken:
            tags[one.how if one.how in (OFF, ELSEWHERE) else ACTS].append(one.element.tag)
        parts = {
            "left out": numbers_of_kinds(tags[ACTS], self.bodies),
            "as asked by --without": f"{len(self.without)}" if self.without else "",
            "switched off in the model": numbers_of_kinds(tags[OFF]),
            "not at this knee": numbers_of_kinds(tags[ELSEWHERE]),
        }
        return "; ".join(f"{what}: {numbers}" for what, numbers in parts.items() if numbers)


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
    knee = _with_small_bones(knee, whole, found.ligaments)
    own = [x for x in found.ligaments if not _beside(x, knee)]
    if not own:
        why = [f"{name} {reason}" for name, reason in (found.unsupported | found.outside).items()]
        shown = "; ".join(why[:4]) + ("; ..." if len(why) > 4 else "")
        raise InputProblem(
            path, "ligaments", f"none between {knee.femur} and {knee.tibia}",
            f"a ligament that spans the {SIDES[knee.side]} knee ({shown or 'all were left out'})",
        )
    knee, turn = anatomical(model, knee, own)
    whole = turned(whole, turn)
    every = outside_obstacles(model, whole, found, inside)
    beside = [x for x in every if _beside(x, knee)]
    found.ligaments[:] = [x for x in every if not _beside(x, knee)]
    names = file_names((ligament.key for ligament in found.ligaments), "L")
    ligaments = dict(zip(names, found.ligaments, strict=True))
    wraps = {name: wrap for wrap, name in _wrap_names(found.ligaments)}
    contacts = find_contacts(model, knee)
    of_tibia, of_patella = (tuple(c for c in contacts if (c.other.bone == PATELLA) == there)
                            for there in (False, True))
    section = _patella(model, whole, beside, knee, at or {}) if patella else PatellaSection({}, ())
    taken = [x.element for x in (*found.ligaments, *of_tibia)] + found.answered
    if section.document:
        taken += [x.element for x in (*beside, *section.muscles, *of_patella)]
    else:
        found.outside.update((one.key, f"attached to {_beside(one, knee)}") for one in beside)
    others, bodies = untaken(model, knee, taken)
    others = [one for one in others if one.element.name not in left_out
              and (patella or not one.muscle_or_patella)]
    bodies = [body for body in bodies if patella or "menisc" in body.lower()]
    bodies += [knee.patella] if patella and knee.patella and not section.document else []
    doubts = section.doubts
    if not section.document and any(x.muscle_or_patella and x.how == ACTS for x in others):
        doubts += (f"{section.notes[0]} --without-patella does without it and its muscles.",)
    answer = OsimImport(
        {}, model, knee, ligaments, wraps, found, of_tibia, tuple(others), left_out,
        tuple(bodies), of_patella, section.notes, doubts,
    )
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
    knee: OsimKneeJoint, whole: OsimKneeJoint, ligaments: list[OsimLigament]
) -> OsimKneeJoint:
    """The knee with what its fibres end on below the tibia, held where the defaults have it."""
    ends: dict[str, list[str]] = collections.defaultdict(list)
    for ligament in ligaments:
        bodies = {point.body for point in ligament.points} - {*knee.rigid}
        if all(whole.bone_of(body) == TIBIA for body in bodies):
            for body in bodies:
                ends[body].append(ligament.key)
    doubts = tuple(
        f"{', '.join(names)}: on {body}, which can move against the tibia in this model; here it "
        "does not: it is held at the model's default coordinates."
        for body, names in ends.items()
    )
    rigid = knee.rigid | {body: whole.rigid[body] for body in ends}
    return dataclasses.replace(knee, rigid=rigid, doubts=(*knee.doubts, *doubts))


def _beside(ligament: OsimLigament, knee: OsimKneeJoint) -> str:
    """The body of a fibre that is neither of femur nor of tibia; empty without one."""
    bodies = (point.body for point in ligament.points)
    return next((x for x in bodies if knee.bone_of(x) in ("", PATELLA)), "")


def _wrap_names(fibres: Sequence[Any]) -> list[tuple[OsimWrap, str]]:
    """What fibres or muscles go around, each once, with its name in a knee file."""
    used = {x.wrap.element: x.wrap for x in fibres if x.wrap is not None}
    return [*zip(used.values(), file_names((w.key for w in used.values()), "W"), strict=True)]


def _patella(
    model: Model,
    whole: OsimKneeJoint,
    beside: list[OsimLigament],
    knee: OsimKneeJoint,
    at: Mapping[str, float],
) -> PatellaSection:
    """The section of the patella, with the muscles over the knee and ligaments from the pelvis."""
    where = f" at {', '.join(f'{name}={value:g}' for name, value in at.items())}" if at else ""
    notes, doubts, file = [], [], f"{model.name}{where}"
    muscles = find_muscles(model, whole, notes, doubts)
    every = (*beside, *muscles)
    if any(point.body not in knee.rigid for one in every for point in one.points):
        notes.append(
            "Pelvis and foot stand where the model's default coordinates have them"
            + (f", but for{where.removeprefix(' at')}" if where else "")
            + ": what comes from there begins or ends at a fixed point of the femur or the tibia."
        )
    names = {wrap.element: name for wrap, name in _wrap_names(every)}
    keys = file_names((x.key for x in beside), "L")
    entries = {name: one.document(whole, file, names)
               for name, one in zip(keys, beside, strict=True)}
    section = patella_section(model, whole, entries, muscles, names, file, notes)
    return dataclasses.replace(section, doubts=tuple(doubts) if section.document else ())


def _document(read: OsimImport) -> dict[str, Any]:
    model, knee, file = read.model, read.knee, read.model.name
    side = SIDES[knee.side]
    names = {wrap.element: name for name, wrap in read.wraps.items()}
    lines = [f"{joint.name} ({joint.kind}): {'; '.join(joint.describe())}."
             for joint in knee.joints]
    for contact in read.contacts:
        lines += [f"Contact {contact.name} of the model:", *contact.findings]
    source = f"{file}: {knee.tibia} in {knee.femur} at the coordinates' default values"
    origin = {
        "file": file,
        "sha256": hashlib.sha256(model.file.original).hexdigest(),
        "side": knee.side,
        "femur": knee.femur,
        "tibia": knee.tibia,
        # Only names that a knee file does not allow differ from the model's.
        "ligaments": {n: x.key for n, x in read.ligaments.items() if n != x.key},
        "wraps": {n: x.key for n, x in read.wraps.items() if n != x.key},
    }
    document: dict[str, Any] = {
        "kneejax": 1,
        "name": model.root.name or model.file.path.stem,
        "side": side,
        "description": f"The {side} knee of the OpenSim model {model.root.name or file} ({file})",
        "reference_pose": dict(zip(COLUMNS, knee.pose, strict=True)) | {"source": source},
        "ligaments": {name: one.document(knee, file, names)
                      for name, one in read.ligaments.items()},
        "contacts": {},
        "wraps": {name: wrap.document(model, knee, file) for name, wrap in read.wraps.items()},
        "groups": _groups(list(read.ligaments)),
        "notes": " ".join((*knee.unusual, "Knee joint of the model.", *lines)),
        "imported_from": {name: value for name, value in origin.items() if value != {}},
    }
    for section in ("wraps", "groups"):
        if not document[section]:
            del document[section]
    return document


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
