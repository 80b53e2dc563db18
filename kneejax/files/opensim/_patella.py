"""The patella of an OpenSim model, with the muscles and ligaments that come over the knee."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping, Sequence
from typing import Any

from kneejax.files.opensim import _paths as paths
from kneejax.files.opensim._knee import OsimKneeJoint
from kneejax.files.opensim._ligaments import OsimLigament
from kneejax.files.opensim._model import Model
from kneejax.files.opensim._xml import Element
from kneejax.geometry import BODIES, FEMUR, PATELLA

#: Pull of the whole quadriceps where nothing is said, N: the weight of 2 kg that hangs on it in
#: tests of passive flexion.
AT_REST_N = 19.61


@dataclasses.dataclass(frozen=True)
class PatellaSection:
    """What a model says of the patella, but for its surfaces."""

    # the section, without contacts; empty where the model has no patella with ligaments and a
    # quadriceps
    document: dict[str, Any]
    notes: tuple[str, ...]  # what was assumed or left out, a sentence each
    muscles: tuple[paths.OsimPath, ...] = ()  # that it has
    doubts: tuple[str, ...] = ()  # where it is not the model's


def wrap_names(fibres: Sequence[paths.OsimPath]) -> list[tuple[paths.OsimWrap, str]]:
    """What fibres or muscles go around, each once, with its name in a knee file."""
    used = {x.wrap.element: x.wrap for x in fibres if x.wrap is not None}
    return [*zip(used.values(), paths.file_names((w.key for w in used.values()), "W"), strict=True)]


def read_patella(
    model: Model, whole: OsimKneeJoint, beside: list[OsimLigament], knee: OsimKneeJoint,
    at: Mapping[str, float],
) -> PatellaSection:  # fmt: skip
    """The section of the patella, with the muscles over the knee and ligaments from the pelvis.

    `whole` is the knee with pelvis and foot, at coordinates `at`.
    """
    where = ", ".join(f"{name}={value:g}" for name, value in at.items())
    file = model.name + (f" at {where}" if at else "")
    notes: list[str] = []
    doubts: list[str] = []
    muscles = _muscles(model, whole, notes, doubts)
    every = (*beside, *muscles)
    if any(point.body not in knee.rigid for one in every for point in one.points):
        notes.append(
            "Pelvis and foot stand where the model's default coordinates have them"
            + (f", but for {where}" if at else "")
            + ": what comes from there begins or ends at a fixed point of the femur or the tibia."
        )
    names = {wrap.element: name for wrap, name in wrap_names(every)}
    keys = paths.file_names((x.key for x in beside), "L")
    ligaments = {name: one.document(whole, file, names)
                 for name, one in zip(keys, beside, strict=True)}
    strongest = {m.element: m.element.number("max_isometric_force", "1000") for m in muscles
                 if whole.bone_of(m.points[-1].body) == PATELLA}
    held = any("patellar_attachment_mm" in entry for entry in ligaments.values())
    if not whole.patella or not held or not strongest:
        lacks = "a patella" if not whole.patella else "muscles" if held else "its ligaments"
        return PatellaSection({}, (f"Read without a patella: the model has not {lacks}.",))
    entries = {}
    for name, muscle in zip(paths.file_names([m.key for m in muscles], "M"), muscles, strict=True):
        entries[name] = entry = _entry(muscle, whole, file)
        if muscle.element in strongest:
            share = strongest[muscle.element] / sum(strongest.values())
            entry["tension_N"] = round(AT_REST_N * share, 4)
        # OpenSim leaves out an obstacle that a point is inside.
        inside = muscle.wrap and muscle.wrap.deepest(whole, muscle.points)[1]
        if muscle.wrap is not None and inside is None:
            entry["wrap"] = names[muscle.wrap.element]
        elif muscle.wrap is not None and inside is not None:
            notes.append(
                f"Muscle {muscle.key} runs without {muscle.wrap.key}: its point "
                f"{inside.element.name} lies inside."
            )
    pose = zip(BODIES[PATELLA].values(), whole.patella_pose, strict=True)
    source = f"{file}: {whole.patella} in {whole.femur} at the coordinates' default values"
    document: dict[str, Any] = {
        "reference_pose": {one.column: value for one, value in pose} | {"source": source},
        "ligaments": ligaments,
        "contacts": {},
        "muscles": entries,
    }
    used = {part.get("wrap") for part in (*ligaments.values(), *entries.values())}
    wraps = {names[wrap.element]: wrap for wrap in paths.read_wraps(model) if wrap.element in names}
    if used & {*wraps}:
        document["wraps"] = {name: wraps[name].document(whole, file) for name in names.values()
                             if name in used}
    return PatellaSection(document, tuple(notes), tuple(muscles), tuple(doubts))


def _muscles(
    model: Model, knee: OsimKneeJoint, notes: list[str], doubts: list[str]
) -> list[paths.OsimPath]:
    """Muscles from the femur, or the pelvis above it, to the patella, the tibia or the foot.

    `notes` gets a sentence for what was left out or assumed, `doubts` for a path that is not the
    model's.
    """
    wraps, found = paths.read_wraps(model), []
    for element in model.muscles():
        points = paths.path_points(model, element) if element.applied else []
        bones = [knee.bone_of(point.body) for point in points]
        if not all(bones) or len(set(bones)) < 2:
            continue
        if not paths.in_order(bones[0], bones[-1]):
            points, bones = points[::-1], bones[::-1]
        straight = all(point.element.tag == "PathPoint" for point in points)
        if len(set(bones)) > 2 or bones[0] != FEMUR or not straight:
            why = "a point that moves along the bone" if not straight else "three bones"
            notes.append(f"Muscle {element.name} was left out: its path has {why}.")
            continue
        wrap = wrap_of(element, wraps, knee, (bones[0], bones[-1]), doubts)
        name = re.sub(r"_[rl]$", "", element.name)
        found.append(paths.OsimPath(element, name, tuple(points), wrap))
    return found


def wrap_of(
    element: Element, wraps: list[paths.OsimWrap], knee: OsimKneeJoint, bones: tuple[str, str],
    notes: list[str],
) -> paths.OsimWrap | None:  # fmt: skip
    """The obstacle of a muscle on one of the two bones that it joins; `notes` gets a sentence for
    what was left out or assumed."""
    names = [one.last_word("wrap_object") for one in paths.path_objects(element, "PathWrapSet")]
    found = [
        wrap for name in names for wrap in wraps if wrap.element.name == name and wrap.active
        and knee.bone_of(wrap.body) in bones and wrap.element.tag in paths.WRAP_KINDS
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


def _entry(muscle: paths.OsimPath, knee: OsimKneeJoint, file: str) -> dict[str, Any]:
    bones = [knee.bone_of(point.body) for point in muscle.points]
    # What runs along a bone does not change its length: it begins and ends where it leaves one.
    begin = next(k for k, bone in enumerate(bones) if bone != bones[0]) - 1
    end = -next(k for k, bone in enumerate(bones[::-1]) if bone != bones[-1])
    (_, origin), (bone, insertion), via = muscle.ends(knee, begin, end)
    source = f"{file}, {muscle.element.tag} {muscle.key}"
    if bone == PATELLA:
        source += f"; tension_N: {AT_REST_N:g} N shared by greatest isometric force"
    return {"tension_N": 0.0, "origin_mm": origin, **via, "insertion_bone": bone,
            "insertion_mm": insertion, "source": source}
