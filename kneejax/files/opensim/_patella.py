"""The patella of an OpenSim model as a section of a knee document."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from kneejax.files.opensim._knee import OsimKneeJoint
from kneejax.files.opensim._model import Model
from kneejax.files.opensim._muscles import OsimMuscle, OsimMuscles, quadriceps
from kneejax.files.opensim._names import file_names
from kneejax.files.opensim._numbers import METRES_TO_MM, shifted
from kneejax.files.opensim._wraps import OsimWrap, depth_inside, wrap_document
from kneejax.geometry import BODIES, PATELLA

#: Pull of the whole quadriceps where nothing is said, N: the weight of 2 kg that hangs on it in
#: tests of passive flexion.
AT_REST_N = 19.61


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


def patella_section(
    model: Model,
    knee: OsimKneeJoint,
    ligaments: dict[str, dict[str, Any]],
    found: OsimMuscles,
    wraps: list[OsimWrap],
    names: dict[int, str],
    file: str,
) -> PatellaSection:
    """Make the section of the patella.

    Args:
        model: the model.
        knee: its bones, with pelvis and foot.
        ligaments: of the patella and from beyond the femur, as entries of a knee document.
        found: the muscles over the knee.
        wraps: what these ligaments and muscles go around.
        names: identity of a wrap object's element -> its name in the section.
        file: what the numbers' sources call the model.
    """
    heads = quadriceps(found.muscles, knee)
    held = any("patellar_attachment_mm" in entry for entry in ligaments.values())
    if not knee.patella or not held or not heads:
        lacks = "a patella" if not knee.patella else "muscles" if held else "its ligaments"
        return PatellaSection({}, (f"Read without a patella: the model has not {lacks}.",))
    notes = list(found.notes)
    whole = sum(head.strongest_N for head in heads)
    muscles = {}
    for name, muscle in zip(file_names([m.name for m in found.muscles], "M"), found.muscles,
                            strict=True):  # fmt: skip
        muscles[name] = entry = _muscle(muscle, knee, file)
        if muscle in heads:
            entry["tension_N"] = round(AT_REST_N * muscle.strongest_N / whole, 4)
        if muscle.wrap is not None and _is_outside(model, muscle, knee, notes):
            entry["wrap"] = names[id(muscle.wrap.element)]
    asked = {part.get("wrap") for part in (*ligaments.values(), *muscles.values())}
    obstacles = {names[id(wrap.element)]: wrap for wrap in wraps}
    obstacles = {name: wrap for name, wrap in obstacles.items() if name in asked}
    pose = zip(BODIES[PATELLA].values(), knee.patella_pose, strict=True)
    document: dict[str, Any] = {
        "reference_pose": {one.column: value for one, value in pose}
        | {"source": f"{file}: {knee.patella} in {knee.femur} at the coordinates' default values"},
        "ligaments": ligaments,
        "contacts": {},
        "muscles": muscles,
        "wraps": {
            name: wrap_document(
                model, wrap, knee, f"{file}, {wrap.element.tag} {wrap.key} of {wrap.body}"
            )
            for name, wrap in obstacles.items()
        },
    }
    if not obstacles:
        del document["wraps"]
    return PatellaSection(document, tuple(notes), found.muscles, found.doubts)


def _muscle(muscle: OsimMuscle, knee: OsimKneeJoint, file: str) -> dict[str, Any]:
    bones = [knee.rigid[point.body][0] for point in muscle.points]
    places = [[shifted(x, METRES_TO_MM) for x in point.in_bone(knee)] for point in muscle.points]
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


def _is_outside(model: Model, muscle: OsimMuscle, knee: OsimKneeJoint, notes: list[str]) -> bool:
    """Whether no point lies inside the obstacle; OpenSim leaves out one that a point is inside."""
    assert muscle.wrap is not None
    obstacle = wrap_document(model, muscle.wrap, knee, "")
    to_obstacle = knee.in_femur[obstacle["bone"]].inverse()
    for point in muscle.points:
        place = to_obstacle.after(knee.in_femur[knee.rigid[point.body][0]]).point(
            point.in_bone(knee)
        )
        if depth_inside(obstacle, np.array(place, float) * 1e3) > 0:
            notes.append(
                f"Muscle {muscle.name} runs without {muscle.wrap.key}: its point "
                f"{point.element.name} lies inside."
            )
            return False
    return True
