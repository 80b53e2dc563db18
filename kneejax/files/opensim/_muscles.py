"""Muscles of an OpenSim model that pull on the patella or the tibia, as lines."""

from __future__ import annotations

import dataclasses
import re

from kneejax.files.opensim._joints import read_joints
from kneejax.files.opensim._knee import OsimKneeJoint, placed
from kneejax.files.opensim._ligaments import OsimPoint, in_order, path_objects, path_point
from kneejax.files.opensim._model import Model
from kneejax.files.opensim._wraps import WRAP_KINDS, OsimWrap, read_wraps
from kneejax.files.opensim._xml import Element
from kneejax.geometry import FEMUR, PATELLA, TIBIA


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
class OsimMuscles:
    """The muscles over a knee.

    Attributes:
        muscles: that can be read.
        knee: with pelvis and foot where the coordinates' defaults have them: a muscle from the
            pelvis begins at a point of the femur here.
        notes: what was left out or assumed, a sentence each.
    """

    muscles: tuple[OsimMuscle, ...]
    knee: OsimKneeJoint
    notes: tuple[str, ...]


def find_muscles(model: Model, knee: OsimKneeJoint) -> OsimMuscles:
    """Muscles from the femur, or the pelvis above it, to the patella, the tibia or the foot.

    Args:
        model: the model.
        knee: its bones.
    """
    whole, notes = _with_pelvis_and_foot(model, knee), []
    wraps, found = read_wraps(model), []
    for element in model.elements():
        if not element.tag.endswith("Muscle"):
            continue
        path = element.child("GeometryPath")
        points = [path_point(model, e) for e in path_objects(path, "PathPointSet")]
        if any(point.body not in whole.rigid for point in points):
            continue
        bones = [whole.rigid[point.body][0] for point in points]
        if len(set(bones)) < 2:
            continue
        if not in_order(bones[0], bones[-1]):
            points, bones = points[::-1], bones[::-1]
        straight = all(point.element.tag == "PathPoint" for point in points)
        if len(set(bones)) > 2 or bones[0] != FEMUR or not straight:
            why = "a point that moves along the bone" if not straight else "three bones"
            notes.append(f"Muscle {element.name} was left out: its path has {why}.")
            continue
        wrap = wrap_of(model, element, wraps, whole, (bones[0], bones[-1]), notes)
        strongest = float(model.numbers(element, "max_isometric_force", 1, "1000")[0])
        found.append(OsimMuscle(element, tuple(points), wrap, strongest))
    if any(point.body not in knee.rigid for muscle in found for point in muscle.points):
        notes.append(
            "Pelvis and foot stand where the model's default coordinates have them: muscles from "
            "there begin or end at a fixed point of the femur or the tibia."
        )
    return OsimMuscles(tuple(found), whole, tuple(notes))


def _with_pelvis_and_foot(model: Model, knee: OsimKneeJoint) -> OsimKneeJoint:
    joints = read_joints(model)
    above = {joint.child: joint for joint in joints}
    rigid = dict(knee.rigid)
    body, seen = knee.femur, set()
    while body in above and body not in seen:
        seen.add(body)
        body = above[body].parent
        if body not in rigid and body in model.bodies:
            rigid[body] = FEMUR, _motion(model, above, knee.femur, body)
    waiting = [name for name, (bone, _) in knee.rigid.items() if bone == TIBIA]
    while waiting:
        at = waiting.pop()
        for joint in joints:
            if joint.parent == at and joint.child not in rigid:
                rigid[joint.child] = TIBIA, _motion(model, above, knee.tibia, joint.child)
                waiting.append(joint.child)
    return dataclasses.replace(knee, rigid=rigid)


def _motion(model: Model, above: dict, bone: str, body: str):
    """From a body's coordinates to a bone's, at the coordinates' defaults."""
    return placed(model, above, bone, []).inverse().after(placed(model, above, body, []))


def wrap_of(
    model: Model,
    element: Element,
    wraps: list[OsimWrap],
    knee: OsimKneeJoint,
    bones: tuple[str, str],
    notes: list[str],
) -> OsimWrap | None:
    """The obstacle of a muscle on one of its two bones.

    Args:
        model: the model.
        element: the muscle.
        wraps: of the model.
        knee: its bones.
        bones: those that the muscle joins.
        notes: gets a sentence for what was left out or assumed.
    """
    found = []
    for path_wrap in path_objects(element.child("GeometryPath"), "PathWrapSet"):
        name = path_wrap.word("wrap_object").rstrip("/").rsplit("/", 1)[-1]
        for wrap in (w for w in wraps if w.element.name == name and w.active):
            own = knee.rigid.get(wrap.body, ("",))[0]
            if own in bones and wrap.element.tag in WRAP_KINDS:
                found.append(wrap)
    if not found:
        return None
    quadrant = found[0].element.word("quadrant")
    if quadrant.lower() not in ("", "all", "unassigned"):
        notes.append(
            f"Muscle {element.name} takes the shorter way around {found[0].key}, which the model "
            f"confines to the quadrant {quadrant}."
        )
    for other in found[1:]:
        notes.append(f"Muscle {element.name}: of its obstacles {other.key} was left out.")
    return found[0]


def quadriceps(muscles: tuple[OsimMuscle, ...], knee: OsimKneeJoint) -> tuple[OsimMuscle, ...]:
    """Those that pull on the patella."""
    return tuple(m for m in muscles if knee.rigid[m.points[-1].body][0] == PATELLA)
