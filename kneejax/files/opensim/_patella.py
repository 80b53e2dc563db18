"""The patella of an OpenSim model, and the muscles over the knee, as a section of a knee file."""

from __future__ import annotations

import dataclasses
import re
from typing import Any

from kneejax.files.opensim._knee import OsimKneeJoint
from kneejax.files.opensim._model import Model
from kneejax.files.opensim._paths import (
    WRAP_KINDS,
    OsimPoint,
    OsimWrap,
    file_names,
    in_order,
    path_objects,
    path_points,
    read_wraps,
)
from kneejax.files.opensim._xml import Element
from kneejax.geometry import BODIES, FEMUR, PATELLA

#: Pull of the whole quadriceps where nothing is said, N: the weight of 2 kg that hangs on it in
#: tests of passive flexion.
AT_REST_N = 19.61


@dataclasses.dataclass(frozen=True)
class OsimMuscle:
    """A muscle over the knee.

    Attributes:
        element: in the file.
        points: from the femur's side to the patella or the tibia.
        wrap: what it goes around; None if nothing on these bones.
        strongest_N: its greatest isometric force.
    """

    element: Element
    points: tuple[OsimPoint, ...]
    wrap: OsimWrap | None
    strongest_N: float

    @property
    def name(self) -> str:
        """Its name, without a side."""
        return re.sub(r"_[rl]$", "", self.element.name)


@dataclasses.dataclass(frozen=True)
class PatellaSection:
    """What a model says of the patella, but for its surfaces.

    Attributes:
        document: the section, without contacts; empty where the model has no patella with
            ligaments and a quadriceps.
        notes: what was assumed or left out, a sentence each.
        muscles: that it has.
        doubts: where it is not the model's.
    """

    document: dict[str, Any]
    notes: tuple[str, ...]
    muscles: tuple[OsimMuscle, ...] = ()
    doubts: tuple[str, ...] = ()


def find_muscles(
    model: Model, knee: OsimKneeJoint, notes: list[str], doubts: list[str]
) -> list[OsimMuscle]:
    """Muscles from the femur, or the pelvis above it, to the patella, the tibia or the foot.

    `notes` gets a sentence for what was left out or assumed, `doubts` for a path that is not the
    model's.
    """
    wraps, found = read_wraps(model), []
    for element in model.muscles():
        if not model.applied(element):
            continue
        points = path_points(model, element)
        bones = [knee.bone_of(point.body) for point in points]
        if not all(bones) or len(set(bones)) < 2:
            continue
        if not in_order(bones[0], bones[-1]):
            points, bones = points[::-1], bones[::-1]
        straight = all(point.element.tag == "PathPoint" for point in points)
        if len(set(bones)) > 2 or bones[0] != FEMUR or not straight:
            why = "a point that moves along the bone" if not straight else "three bones"
            notes.append(f"Muscle {element.name} was left out: its path has {why}.")
            continue
        wrap = wrap_of(element, wraps, knee, (bones[0], bones[-1]), doubts)
        strongest = model.number(element, "max_isometric_force", "1000")
        found.append(OsimMuscle(element, tuple(points), wrap, strongest))
    return found


def wrap_of(
    element: Element,
    wraps: list[OsimWrap],
    knee: OsimKneeJoint,
    bones: tuple[str, str],
    notes: list[str],
) -> OsimWrap | None:
    """The obstacle of a muscle on one of the two bones that it joins; `notes` gets a sentence for
    what was left out or assumed."""
    found = []
    for path_wrap in path_objects(element, "PathWrapSet"):
        name = path_wrap.last_word("wrap_object")
        found += [
            wrap for wrap in wraps
            if wrap.element.name == name and wrap.active
            and knee.bone_of(wrap.body) in bones and wrap.element.tag in WRAP_KINDS
        ]
    if not found:
        return None
    if found[0].unsupported:
        quadrant = found[0].element.word("quadrant")
        notes.append(
            f"Muscle {element.name} takes the shorter way around {found[0].key}, which the model "
            f"confines to the quadrant {quadrant}."
        )
    for other in found[1:]:
        notes.append(f"Muscle {element.name} goes around one obstacle: {other.key} was left out.")
    return found[0]


def patella_section(
    model: Model,
    knee: OsimKneeJoint,
    ligaments: dict[str, dict[str, Any]],
    muscles: list[OsimMuscle],
    names: dict[Element, str],
    file: str,
    notes: list[str],
) -> PatellaSection:
    """Make the section of the patella.

    Args:
        model: the model.
        knee: its bones, with pelvis and foot.
        ligaments: of the patella and from beyond the femur, as entries of a knee document.
        muscles: over the knee.
        names: wrap object of these ligaments and muscles -> its name in the section.
        file: what the numbers' sources call the model.
        notes: get a sentence for each muscle that runs straight.
    """
    heads = [m for m in muscles if knee.bone_of(m.points[-1].body) == PATELLA]
    held = any("patellar_attachment_mm" in entry for entry in ligaments.values())
    if not knee.patella or not held or not heads:
        lacks = "a patella" if not knee.patella else "muscles" if held else "its ligaments"
        return PatellaSection({}, (f"Read without a patella: the model has not {lacks}.",))
    whole, entries = sum(head.strongest_N for head in heads), {}
    for name, muscle in zip(file_names([m.name for m in muscles], "M"), muscles, strict=True):
        entries[name] = entry = _muscle(muscle, knee, file)
        if muscle in heads:
            entry["tension_N"] = round(AT_REST_N * muscle.strongest_N / whole, 4)
        if muscle.wrap is None:
            continue
        # OpenSim leaves out an obstacle that a point is inside.
        _, inside = muscle.wrap.deepest(model, knee, muscle.points)
        if inside is None:
            entry["wrap"] = names[muscle.wrap.element]
        else:
            notes.append(
                f"Muscle {muscle.name} runs without {muscle.wrap.key}: its point "
                f"{inside.element.name} lies inside."
            )
    pose = zip(BODIES[PATELLA].values(), knee.patella_pose, strict=True)
    document: dict[str, Any] = {
        "reference_pose": {one.column: value for one, value in pose}
        | {"source": f"{file}: {knee.patella} in {knee.femur} at the coordinates' default values"},
        "ligaments": ligaments,
        "contacts": {},
        "muscles": entries,
    }
    used = {part.get("wrap") for part in (*ligaments.values(), *entries.values())}
    wraps = {names[wrap.element]: wrap for wrap in read_wraps(model) if wrap.element in names}
    asked = {name: wraps[name].document(model, knee, file) for name in names.values()
             if name in used}
    if asked:
        document["wraps"] = asked
    return PatellaSection(document, tuple(notes), tuple(muscles))


def _muscle(muscle: OsimMuscle, knee: OsimKneeJoint, file: str) -> dict[str, Any]:
    bones = [knee.bone_of(point.body) for point in muscle.points]
    places = [point.in_bone_mm(knee) for point in muscle.points]
    # What runs along a bone does not change its length: it begins and ends where it leaves one.
    first = next(k for k, bone in enumerate(bones) if bone != bones[0]) - 1
    last = len(bones) - next(k for k, bone in enumerate(bones[::-1]) if bone != bones[-1])
    entry: dict[str, Any] = {"tension_N": 0.0, "origin_mm": places[first]}
    if last - first > 1:
        entry["via_points"] = [
            {"bone": bone, "point_mm": place}
            for bone, place in zip(bones[first + 1 : last], places[first + 1 : last], strict=True)
        ]
    entry |= {"insertion_bone": bones[last], "insertion_mm": places[last]}
    source = f"{file}, {muscle.element.tag} {muscle.name}"
    if bones[-1] == PATELLA:
        source += f"; tension_N: {AT_REST_N:g} N shared by greatest isometric force"
    return entry | {"source": source}
