"""Muscles over the knee: lines of a section of the patella, and of a model that moves."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np

from kneejax.files.knee import build_obstacle
from kneejax.files.opensim._exact import Rigid
from kneejax.files.opensim._functions import evaluate, function_of
from kneejax.files.opensim._joints import Movement
from kneejax.files.opensim._knee import OsimKneeJoint
from kneejax.files.opensim._ligaments import KIND
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
from kneejax.geometry import BODIES, FEMUR, PATELLA, TIBIA
from kneejax.mechanics import Course, Muscles, add_lane_axis, ligament_law

#: Pull of the whole quadriceps where nothing is said, N: the weight of 2 kg that hangs on it in
#: tests of passive flexion.
AT_REST_N = 19.61


@dataclasses.dataclass(frozen=True)
class OsimMuscle:
    """A muscle over the knee."""

    element: Element
    points: tuple[OsimPoint, ...]  # from the femur's side to the patella or the tibia
    wrap: OsimWrap | None  # what it goes around; None if nothing on these bones
    strongest_N: float  # its greatest isometric force

    @property
    def name(self) -> str:
        """Its name, without a side."""
        return re.sub(r"_[rl]$", "", self.element.name)


@dataclasses.dataclass(frozen=True)
class PatellaSection:
    """What a model says of the patella, but for its surfaces."""

    # the section, without contacts; empty where the model has no patella with ligaments and a
    # quadriceps
    document: dict[str, Any]
    notes: tuple[str, ...]  # what was assumed or left out, a sentence each
    muscles: tuple[OsimMuscle, ...] = ()  # that it has
    doubts: tuple[str, ...] = ()  # where it is not the model's


def find_muscles(
    model: Model, knee: OsimKneeJoint, notes: list[str], doubts: list[str]
) -> list[OsimMuscle]:
    """Muscles from the femur, or the pelvis above it, to the patella, the tibia or the foot.

    `notes` gets a sentence for what was left out or assumed, `doubts` for a path that is not the
    model's.
    """
    wraps, found = read_wraps(model), []
    for element in model.muscles():
        if not element.applied:
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
        strongest = element.number("max_isometric_force", "1000")
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
    """Make the section of the patella, with ligaments that are entries of a knee document already.

    `knee` has pelvis and foot, `names` are those of wrap objects in the section; `notes` get a
    sentence for each muscle that runs straight.
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


@dataclasses.dataclass(frozen=True)
class Way:
    """The piece of a path that spans the knee."""

    name: str  # of the muscle or ligament
    element: Element
    first: np.ndarray  # last point above the knee, in the ground, `(n, 3)`, m
    second: np.ndarray  # first point below the knee, likewise
    length: np.ndarray  # of the whole path between its points, m, `(n,)`


@dataclasses.dataclass(frozen=True)
class Crossing:
    """What pulls over a knee."""

    muscles: tuple[Way, ...]  # whose path goes from the thigh to the leg below
    ligaments: tuple[Way, ...]  # likewise, of those that do not begin on the femur or the patella
    on_patella: tuple[str, ...]  # names of muscles that end on the patella


def crossing(movement: Movement, knee: OsimKneeJoint, below: set[str]) -> Crossing:
    """Find what pulls over a knee, to the bodies below it."""
    muscles, ligaments, on_patella = [], [], []
    for element in movement.model.elements:
        muscle = element.tag.endswith("Muscle")
        if not muscle and element.tag != KIND:
            continue
        points = path_points(movement.model, element)
        bodies = [point.body for point in points]
        if muscle and knee.patella and knee.patella in (*bodies[:1], *bodies[-1:]):
            on_patella.append(element.name)
        elif {x in below for x in bodies} == {True, False}:
            if muscle:
                muscles.append(_way(movement, element, points, below))
            elif not ({bodies[0], bodies[-1]} - below) & {*knee.rigid}:
                ligaments.append(_way(movement, element, points, below))
    return Crossing(tuple(muscles), tuple(ligaments), tuple(on_patella))


def _way(movement: Movement, element: Element, points: list[OsimPoint], below: set[str]) -> Way:
    points = points[::-1] if points[0].body in below else points
    found = [(*_in_ground(movement, point), point.body in below) for point in points]
    last = found[0][0]
    first = second = np.full(last.shape, np.nan)
    length = np.zeros(last.shape[:-1])
    for k, (place, active, lower) in enumerate(found):
        if not lower:
            first = np.where(active[..., None], place, first)
        if k > 0:
            length = length + np.where(active, np.linalg.norm(place - last, axis=-1), 0.0)
            last = np.where(active[..., None], place, last)
    for place, active, lower in found[::-1]:
        if lower:
            second = np.where(active[..., None], place, second)
    return Way(element.name, element, first, second, length)


def _in_ground(movement: Movement, point: OsimPoint) -> tuple[np.ndarray, np.ndarray]:
    """Where a point of a path is in the ground, `(n, 3)`, m, and whether the path goes there."""
    element = point.element
    carrier = movement.placed[point.body].after(point.frame)
    shape = carrier.shift.shape[:-1]
    local, active = np.array(point.location, float), np.ones(shape, bool)
    if element.tag == "MovingPathPoint":
        local = np.stack([_along(movement, element, axis, shape) for axis in "xyz"], -1)
    if element.tag == "ConditionalPathPoint":
        low, high = (float(x) for x in element.numbers("range", 2))
        value = movement.values[_coordinate(movement, element, "coordinate")]
        active = (value >= low - 1e-5) & (value <= high + 1e-5)
    return carrier.point(np.broadcast_to(local, (*shape, 3))), active


def _along(movement: Movement, element: Element, axis: str, shape: tuple[int, ...]) -> np.ndarray:
    held = element.child(f"{axis}_location")
    function = None if held is None else function_of(held)
    if function is None:
        return np.zeros(shape)
    value = movement.values[_coordinate(movement, element, f"{axis}_coordinate")]
    return np.broadcast_to(evaluate(function, [value]), shape)


def _coordinate(movement: Movement, element: Element, tag: str) -> str:
    name = element.last_word(f"socket_{tag}", f"socket_{tag}_connectee_name")
    name = name or element.last_word(tag)
    if name not in movement.values:
        expected = "a coordinate of the model"
        raise element.problem(tag, name or "missing", expected, movement.values
        )
    return name


def tension_of_ligament(movement: Movement, way: Way) -> np.ndarray:
    """Tension of a ligament from above the thigh, by the length that its path has, N."""
    element = way.element
    strain = jnp.asarray(way.length / element.number("slack_length", "0") - 1.0)
    return np.asarray(ligament_law.exact_tension(
        strain, element.number("linear_stiffness", "1"),
        element.number("transition_strain", "0.06"),
    ))


def muscles_of(
    movement: Movement,
    knee: OsimKneeJoint,
    ways: list[Way],
    tension: np.ndarray,
    frames: dict[str, Rigid],
    entry: Callable[[dict], dict],
    notes: list[str],
) -> Muscles:
    """Paths as muscles of a knee, of tension `(ways, n)`, N; arrays end in instants.

    `frames` lead from the ground to those of the knee's bones, mm, and `entry` states an obstacle's
    entry in these; `notes` get a sentence for what was left out.
    """
    names = tuple(way.name for way in ways)
    ends = {
        bone: np.stack([frames[bone].point(1e3 * getattr(way, end)).T for way in ways])
        if ways else np.zeros((0, 3, tension.shape[-1]))
        for bone, end in ((FEMUR, "first"), (TIBIA, "second"))
    }
    wraps, by_wrap = read_wraps(movement.model), {}
    for row, way in enumerate(ways):
        wrap = wrap_of(way.element, wraps, knee, (FEMUR, TIBIA), notes)
        if wrap is not None:
            by_wrap.setdefault(wrap.element, (wrap, []))[1].append(row)
    courses = []
    for wrap, rows in by_wrap.values():
        document = entry(wrap.document(movement.model, knee, ""))
        obstacle, bone = build_obstacle(document), document["bone"]
        # As OpenSim has it: what ends inside an obstacle at any instant does not lie around it.
        there = obstacle.frame.placement.apply_inverse(tuple(np.moveaxis(ends[bone][rows], 1, 0)))
        parts = zip(there, obstacle.semi_axes_along_frame, strict=True)
        buried = np.any(np.asarray(sum((x / a) ** 2 for x, a in parts)) < 1.0, axis=-1)
        notes += [
            f"{names[row]} ends inside {wrap.element.name} and runs straight, as in OpenSim."
            for row, inside in zip(rows, buried, strict=True) if inside
        ]
        if not buried.all():
            kept = [row for row, inside in zip(rows, buried, strict=True) if not inside]
            courses.append(Course(kept, obstacle=obstacle, obstacle_bone=bone))
    return Muscles(ends[FEMUR], ends[TIBIA], tension, names, add_lane_axis(courses))
