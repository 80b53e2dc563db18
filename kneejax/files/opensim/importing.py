"""A knee made of an OpenSim model: its ligaments, obstacles, pose and contact settings."""

__all__ = ["import_osim"]

import collections
import dataclasses
import fnmatch
import hashlib
import os
import re
from collections.abc import Mapping
from typing import Any

from kneejax.files.knee.document import check_knee
from kneejax.files.opensim import ligaments as fibres
from kneejax.files.opensim import report
from kneejax.files.opensim.contact import OsimContact, OsimMeniscus, find_contacts
from kneejax.files.opensim.frames import anatomical, turned
from kneejax.files.opensim.knee import SIDES, OsimKneeJoint, find_knee, with_pelvis_and_foot
from kneejax.files.opensim.model import Model, read_model
from kneejax.files.opensim.paths import OsimWrap, by_file_name
from kneejax.files.reading import InputProblem
from kneejax.geometry import COLUMNS, PATELLA, TIBIA

#: Fibres are hardly ever softer: N per unit strain.
SOFT_N = 50.0


@dataclasses.dataclass(frozen=True)
class OsimImport:
    """A knee as read from an OpenSim model."""

    document: dict[str, Any]  # content of a knee file, in mm and N
    model: Model
    knee: OsimKneeJoint
    ligaments: dict[str, fibres.OsimLigament]  # by the names in the knee file
    wraps: dict[str, OsimWrap]  # likewise
    contacts: tuple[OsimContact, ...]  # of femur and tibia
    untaken: tuple[report.Untaken, ...]  # forces and constraints that are no part of the knee
    bodies: tuple[str, ...]  # at the knee that are part of none of its bones
    patellofemoral: tuple[OsimContact, ...]  # contacts of femur and patella
    menisci: tuple[OsimMeniscus, ...] = ()  # those for which rings stand

    @property
    def doubts(self) -> tuple[str, ...]:
        """What a person should look at; empty if everything of the knee was read."""
        found = self.knee.found
        doubts = [f"{name} was left out: not supported: {why}."
                  for name, why in found.unsupported.items()]
        doubts += [f"{line}: left out, though it {report.ACTS}."
                   for line in report.listed(self.untaken, report.ACTS)]
        doubts += found.doubts
        doubts += [f"{c.name}: {doubt}" for c in self.contacts for doubt in c.doubts]
        parts = (self.document, self.document.get("patella", {}))
        soft = {name: x for part in parts for name, x in part.get("ligaments", {}).items()
                if x["stiffness_N"] < SOFT_N}
        if soft:
            softest = min(x["stiffness_N"] for x in soft.values())
            name, first = next(iter(soft.items()))
            meant = first["stiffness_N"] * first["slack_length_mm"]
            doubts.append(f"Stiffness below {SOFT_N:g} N per unit strain, from {softest:.3g} N on: "
                          f"{', '.join(soft)}. N/mm are suspected: of {name} that would be "
                          f"{meant:.4g} N per unit strain.")
        return tuple(doubts)

    @property
    def left_out(self) -> tuple[str, ...]:
        """What the model has for this knee besides, and why no doubt follows from it."""
        ways = dict.fromkeys(one.how for one in self.untaken)
        return tuple(f"{line}: {how}" for how in ways if how not in (report.ACTS, report.ELSEWHERE)
                     for line in report.listed(self.untaken, how))

    @property
    def numbers_left_out(self) -> str:
        """How many of which kind the knee has not, by the reason."""
        tags = {"left out": [element.tag for element in self.knee.found.answered]}
        tags |= {title: [] for title in report.TITLES.values()}
        for one in self.untaken:
            tags[report.TITLES.get(one.how, "left out")].append(one.element.tag)
        numbers = {title: report.numbers_of_kinds(many, self.bodies * (title == "left out"))
                   for title, many in tags.items()}
        return "; ".join(f"{title}: {number}" for title, number in numbers.items() if number)


def import_osim(
    path: str | os.PathLike[str], *, side: str, femur: str | None = None, tibia: str | None = None,
    without: tuple[str, ...] | list[str] = (), inside: str = "refuse", patella: bool = True,
    at: Mapping[str, float] | None = None, data: bytes | None = None,
) -> OsimImport:  # fmt: skip
    """Read a knee from an OpenSim model of schema 2, 3 or 4.

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
    model = read_model(path, data)
    knee = find_knee(model, side, femur, tibia)
    found, whole = knee.found, with_pelvis_and_foot(model, knee, at)
    every = fibres.find_ligaments(model, whole)
    known = [*(x.key for x in every), *found.unsupported, *found.outside]
    known = [*dict.fromkeys([*known, *(x.name for x in model.forces() if x.name)])]
    unwanted: list[str] = []
    for pattern in without:
        unwanted += (hits := fnmatch.filter(known, pattern))
        if not hits:
            expected = "the name of a fibre or force, or a pattern that fits one"
            raise InputProblem(path, "--without", pattern, expected, known)
    every = [x for x in every if x.key not in unwanted]
    found.answered[:] = [x for x in found.answered if x.name not in unwanted]
    for name in unwanted:
        found.unsupported.pop(name, None)
    # What fibres end on below the tibia is held where the defaults have it.
    ends: dict[str, list[str]] = collections.defaultdict(list)
    for ligament in every:
        small = {point.body for point in ligament.points} - {*knee.rigid}
        for body in small if {whole.bone_of(body) for body in small} == {TIBIA} else ():
            ends[body].append(ligament.key)
    found.doubts += [
        f"{', '.join(names)}: on {body}, which can move against the tibia in this model; here it "
        "does not: it is held at the model's default coordinates." for body, names in ends.items()]
    knee = knee._replace(rigid=knee.rigid | {body: whole.rigid[body] for body in ends})
    own = [x for x in every if not _beside(x, knee)]
    if not own:
        why = [f"{name} {reason}" for name, reason in (found.unsupported | found.outside).items()]
        shown = "; ".join([*why[:4], *["..."] * (len(why) > 4)]) or "all were left out"
        raise InputProblem(path, "ligaments", f"none between {knee.femur} and {knee.tibia}",
                           f"a ligament that spans the {SIDES[knee.side]} knee ({shown})")
    rotation, turning, doubts = anatomical(model, knee, own)
    found.unusual += [turning] * bool(turning)
    found.doubts += doubts
    knee, whole = turned(knee, rotation), turned(whole, rotation)
    every = fibres.outside_obstacles(whole, every, inside)
    beside = [x for x in every if _beside(x, knee)]
    own = [x for x in every if x not in beside]
    ligaments = by_file_name(own, "L")
    wraps = fibres.wrap_names(own)
    contacts, menisci = find_contacts(model, knee)
    of_tibia, of_patella = (tuple(c for c in contacts if c.other.bone == bone)
                            for bone in (TIBIA, PATELLA))
    section, muscles = {}, []
    if patella:
        section, muscles = fibres.read_patella(model, whole, beside, knee, at or {})
    taken = [x.element for x in (*own, *of_tibia)] + found.answered
    taken += [force for meniscus in menisci for force in meniscus.elements]
    rings = [meniscus.name for meniscus in menisci]
    if section:
        taken += [x.element for x in (*beside, *muscles, *of_patella)]
    else:
        found.outside.update((one.key, f"attached to {_beside(one, knee)}") for one in beside)
    others, bodies = report.untaken(model, knee, taken, unwanted, patella, rings)
    bodies = [x for x in bodies if x not in rings and (patella or "menisc" in x.lower())]
    bodies += [knee.patella] if patella and knee.patella and not section else []
    if not section and any(x.muscle_or_patella and x.how == report.ACTS for x in others):
        say = f"{found.patella[0]} --without-patella does without it and its muscles."
        found.doubts.insert(0, say)
    fibres.check_lengths(whole, [*own, *beside])

    file, word = model.name, SIDES[knee.side]
    keys = {wrap.element: name for name, wrap in wraps.items()}
    notes = [*found.unusual, "Knee joint of the model."]
    notes += [f"{x.name} ({x.kind}): {'; '.join(x.describe())}." for x in knee.joints]
    for named, one in (*((f"Contact {x.name}", x) for x in of_tibia),
                       *((f"Meniscus {x.name}", x) for x in menisci)):
        notes += [f"{named} of the model:", *one.findings]
    origin = {
        "file": file,
        "sha256": hashlib.sha256(model.file.original).hexdigest(),
        "side": knee.side,
        "femur": knee.femur,
        "tibia": knee.tibia,
        # Only names that a knee file does not allow differ from the model's.
        "ligaments": {n: x.key for n, x in ligaments.items() if n != x.key},
        "wraps": {n: x.key for n, x in wraps.items() if n != x.key},
    }
    document: dict[str, Any] = {
        "kneejax": 1,
        "name": model.root.name or model.file.path.stem,
        "side": word,
        "description": f"The {word} knee of the OpenSim model {model.root.name or file} ({file})",
        "reference_pose": dict(zip(COLUMNS, knee.pose, strict=True)) | {
            "source": f"{file}: {knee.tibia} in {knee.femur} at the coordinates' default values"},
        "ligaments": {name: one.document(knee, file, keys) for name, one in ligaments.items()},
        "contacts": {},
        "wraps": {name: wrap.document(knee, file) for name, wrap in wraps.items()},
        "groups": _groups(list(ligaments)),
        "notes": " ".join(notes),
        "imported_from": {name: value for name, value in origin.items() if value != {}},
        "patella": section,
    }
    optional = ("wraps", "groups", "patella")
    document = {name: x for name, x in document.items() if x or name not in optional}
    check_knee(document, path)
    return OsimImport(document, model, knee, ligaments, wraps, of_tibia, tuple(others),
                      tuple(bodies), of_patella, tuple(menisci))


def _beside(ligament: fibres.OsimLigament, knee: OsimKneeJoint) -> str:
    """The body of a fibre that is neither of femur nor of tibia; empty without one."""
    bodies = (point.body for point in ligament.points)
    return next((x for x in bodies if knee.bone_of(x) in ("", PATELLA)), "")


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
    answer: dict[str, list[str]] = {}
    for name, many in (stems | ligaments | stems).items():
        if len(many) > 1 and name and name not in names and many not in answer.values():
            answer[name] = many
    return answer
