"""What pulls over a knee while a model moves: muscles, and ligaments from above the thigh."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import jax.numpy as jnp
import numpy as np

from kneejax.files.knee import build_obstacle
from kneejax.files.opensim._exact import Rigid
from kneejax.files.opensim._functions import evaluate, function_of
from kneejax.files.opensim._joints import Movement
from kneejax.files.opensim._knee import OsimKneeJoint
from kneejax.files.opensim._ligaments import KIND
from kneejax.files.opensim._patella import wrap_of
from kneejax.files.opensim._paths import OsimPoint, path_points, read_wraps
from kneejax.files.opensim._xml import Element
from kneejax.geometry import FEMUR, TIBIA
from kneejax.mechanics import Course, Muscles, add_lane_axis, ligament_law


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
        document = entry(wrap.document(knee, ""))
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
