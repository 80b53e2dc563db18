"""Muscles of an OpenSim model that pull on the patella or the tibia, as lines."""

from __future__ import annotations

import dataclasses
import re

from kneejax.files.opensim._knee import OsimKneeJoint
from kneejax.files.opensim._ligaments import OsimPoint, in_order, path_objects, path_point
from kneejax.files.opensim._model import Model
from kneejax.files.opensim._wraps import WRAP_KINDS, OsimWrap, read_wraps, unsupported
from kneejax.files.opensim._xml import Element
from kneejax.geometry import FEMUR, PATELLA


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
        notes: what was left out or assumed, a sentence each.
        doubts: where their paths are not the model's, likewise.
    """

    muscles: tuple[OsimMuscle, ...]
    notes: tuple[str, ...]
    doubts: tuple[str, ...] = ()

    def noted(self, sentence: str) -> OsimMuscles:
        """The same with a further sentence."""
        return dataclasses.replace(self, notes=(*self.notes, sentence))


def find_muscles(model: Model, knee: OsimKneeJoint) -> OsimMuscles:
    """Muscles from the femur, or the pelvis above it, to the patella, the tibia or the foot.

    Args:
        model: the model.
        knee: its bones, with what a muscle may begin or end on.
    """
    notes, doubts, wraps, found = [], [], read_wraps(model), []
    for element in model.elements():
        if not element.tag.endswith("Muscle") or not model.applied(element):
            continue
        path = element.child("GeometryPath")
        points = [path_point(model, e) for e in path_objects(path, "PathPointSet")]
        if any(point.body not in knee.rigid for point in points):
            continue
        bones = [knee.rigid[point.body][0] for point in points]
        if len(set(bones)) < 2:
            continue
        if not in_order(bones[0], bones[-1]):
            points, bones = points[::-1], bones[::-1]
        straight = all(point.element.tag == "PathPoint" for point in points)
        if len(set(bones)) > 2 or bones[0] != FEMUR or not straight:
            why = "a point that moves along the bone" if not straight else "three bones"
            notes.append(f"Muscle {element.name} was left out: its path has {why}.")
            continue
        wrap = wrap_of(model, element, wraps, knee, (bones[0], bones[-1]), doubts)
        strongest = float(model.numbers(element, "max_isometric_force", 1, "1000")[0])
        found.append(OsimMuscle(element, tuple(points), wrap, strongest))
    return OsimMuscles(tuple(found), tuple(notes), tuple(doubts))


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
    if unsupported(found[0]):
        quadrant = found[0].element.word("quadrant")
        notes.append(
            f"Muscle {element.name} takes the shorter way around {found[0].key}, which the model "
            f"confines to the quadrant {quadrant}."
        )
    for other in found[1:]:
        notes.append(f"Muscle {element.name} goes around one obstacle: {other.key} was left out.")
    return found[0]


def quadriceps(muscles: tuple[OsimMuscle, ...], knee: OsimKneeJoint) -> tuple[OsimMuscle, ...]:
    """Those that pull on the patella."""
    return tuple(m for m in muscles if knee.rigid[m.points[-1].body][0] == PATELLA)
