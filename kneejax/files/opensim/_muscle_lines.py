"""Where muscles of a moving OpenSim model leave the thigh for the leg below the knee."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import jax.numpy as jnp
import numpy as np

from kneejax.files.knee import build_obstacle
from kneejax.files.opensim._functions import evaluate, function_of
from kneejax.files.opensim._knee import OsimKneeJoint
from kneejax.files.opensim._ligaments import KIND, path_objects, path_point
from kneejax.files.opensim._movement import Movement, Rigid
from kneejax.files.opensim._muscles import wrap_of
from kneejax.files.opensim._wraps import read_wraps, wrap_document
from kneejax.files.opensim._xml import Element
from kneejax.geometry import FEMUR, TIBIA, Obstacle
from kneejax.mechanics import Course, Muscles, add_lane_axis, ligament_law


@dataclasses.dataclass(frozen=True)
class Way:
    """The piece of a path that spans the knee.

    Attributes:
        name: of the muscle or ligament.
        element: in the file.
        first: last point above the knee, in the ground, `(n, 3)`, m.
        second: first point below the knee, likewise.
        length: of the whole path between its points, m, `(n,)`.
    """

    name: str
    element: Element
    first: np.ndarray
    second: np.ndarray
    length: np.ndarray


@dataclasses.dataclass(frozen=True)
class Crossing:
    """What pulls over a knee.

    Attributes:
        muscles: whose path goes from the thigh to the leg below.
        ligaments: likewise, of those that do not begin on the femur or the patella.
        on_patella: names of muscles that end on the patella.
    """

    muscles: tuple[Way, ...]
    ligaments: tuple[Way, ...]
    on_patella: tuple[str, ...]


def crossing(movement: Movement, knee: OsimKneeJoint, below: set[str]) -> Crossing:
    """Find what pulls over a knee.

    Args:
        movement: the model at the instants.
        knee: its bones.
        below: bodies below the knee.
    """
    muscles, ligaments, on_patella = [], [], []
    for element in movement.model.elements():
        muscle = element.tag.endswith("Muscle")
        if not muscle and element.tag != KIND:
            continue
        points = path_objects(element.child("GeometryPath"), "PathPointSet")
        bodies = [path_point(movement.model, e).body for e in points]
        if muscle and knee.patella and knee.patella in (*bodies[:1], *bodies[-1:]):
            on_patella.append(element.name)
        elif {x in below for x in bodies} == {True, False}:
            own = {bodies[0], bodies[-1]} - below
            if muscle:
                muscles.append(_way(movement, element, points, bodies, below))
            elif not own & {*knee.rigid}:
                ligaments.append(_way(movement, element, points, bodies, below))
    return Crossing(tuple(muscles), tuple(ligaments), tuple(on_patella))


def _way(movement: Movement, element: Element, points: list[Element], bodies, below: set[str]):
    if bodies[0] in below:
        points, bodies = points[::-1], bodies[::-1]
    found = [_point(movement, e) for e in points]
    shape = found[0][0].shape
    first = second = np.full(shape, np.nan)
    for (place, active), body in zip(found, bodies, strict=True):
        if body not in below:
            first = np.where(active[..., None], place, first)
    for (place, active), body in zip(found[::-1], bodies[::-1], strict=True):
        if body in below:
            second = np.where(active[..., None], place, second)
    length, last = np.zeros(shape[:-1]), found[0][0]
    for place, active in found[1:]:
        length = length + np.where(active, np.linalg.norm(place - last, axis=-1), 0.0)
        last = np.where(active[..., None], place, last)
    return Way(element.name, element, first, second, length)


def _point(movement: Movement, element: Element) -> tuple[np.ndarray, np.ndarray]:
    """Where a point of a path is in the ground, `(n, 3)`, m, and whether the path goes there."""
    model, place = movement.model, path_point(movement.model, element)
    carrier = movement.placed[place.body].after(Rigid.of(place.frame))
    local = np.array(place.location, float)
    active = np.ones(carrier.shift.shape[:-1], bool)
    if element.tag == "MovingPathPoint":
        local = np.stack([_along(movement, element, axis, active.shape) for axis in "xyz"], -1)
    if element.tag == "ConditionalPathPoint":
        low, high = (float(x) for x in model.numbers(element, "range", 2))
        value = movement.values[_coordinate(movement, element, "coordinate")]
        active = (value >= low - 1e-5) & (value <= high + 1e-5)
    return carrier.point(np.broadcast_to(local, (*active.shape, 3))), active


def _along(movement: Movement, element: Element, axis: str, shape) -> np.ndarray:
    held = element.child(f"{axis}_location")
    function = None if held is None else (held.children[0] if held.children else None)
    if function is not None and function.tag == "function":
        function = function_of(held)  # pyright: ignore[reportArgumentType]
    if function is None:
        return np.zeros(shape)
    value = movement.values[_coordinate(movement, element, f"{axis}_coordinate")]
    return np.broadcast_to(evaluate(function, [value]), shape)


def _coordinate(movement: Movement, element: Element, tag: str) -> str:
    word = element.word(f"socket_{tag}", f"socket_{tag}_connectee_name", tag)
    name = (word or element.word(tag)).rstrip("/").rsplit("/", 1)[-1]
    if name not in movement.values:
        expected = "a coordinate of the model"
        raise movement.model.file.problem(
            element, tag, name or "missing", expected, movement.values
        )
    return name


def tension_of_ligament(movement: Movement, way: Way) -> np.ndarray:
    """Tension of a ligament from above the thigh, by the length that its path has, N."""
    model, defaults = movement.model, {e.tag: e for e in movement.model.root.inside("defaults")}
    numbers = {}
    for tag, usual in (("linear_stiffness", "1"), ("slack_length", "0"),
                       ("transition_strain", "0.06")):  # fmt: skip
        said = way.element.word(tag) or (defaults[KIND].word(tag) if KIND in defaults else "")
        owner = way.element if way.element.word(tag) else defaults.get(KIND, way.element)
        numbers[tag] = float(model.numbers(owner, tag, 1, said or usual)[0])
    strain = jnp.asarray(way.length / numbers["slack_length"] - 1.0)
    law = numbers["linear_stiffness"], numbers["transition_strain"]
    return np.asarray(ligament_law.exact_tension(strain, *law))


def muscles_of(
    movement: Movement,
    knee: OsimKneeJoint,
    ways: list[Way],
    tension: np.ndarray,
    frames: dict[str, Rigid],
    entry: Callable[[dict], dict],
    notes: list[str],
) -> Muscles:
    """Paths as muscles of a knee, arrays end in instants.

    Args:
        movement: the model at the instants.
        knee: its bones.
        ways: paths.
        tension: of each, `(ways, n)`, N.
        frames: bone -> from the ground to the frame of the knee's bone, mm.
        entry: states an obstacle's entry in those frames.
        notes: gets a sentence for what was left out.
    """
    names = tuple(way.name for way in ways)
    ends = {
        bone: np.stack([frames[bone].point(1e3 * getattr(way, end)).T for way in ways])
        if ways else np.zeros((0, 3, tension.shape[-1]))
        for bone, end in ((FEMUR, "first"), (TIBIA, "second"))
    }  # fmt: skip
    wraps, by_wrap = read_wraps(movement.model), {}
    for row, way in enumerate(ways):
        wrap = wrap_of(movement.model, way.element, wraps, knee, (FEMUR, TIBIA), notes)
        if wrap is not None:
            by_wrap.setdefault(id(wrap.element), (wrap, []))[1].append(row)
    courses = []
    for wrap, rows in by_wrap.values():
        document = entry(wrap_document(movement.model, wrap, knee, ""))
        obstacle, bone = build_obstacle(document), document["bone"]
        # As OpenSim has it: what ends inside an obstacle does not lie around it.
        buried = _ends_inside(obstacle, ends[bone][rows])
        notes += [
            f"{names[r]} ends inside {wrap.element.name} and runs straight, as in OpenSim."
            for r in np.array(rows)[buried]
        ]
        if not buried.all():
            kept = [int(row) for row in np.array(rows)[~buried]]
            courses.append(Course(kept, obstacle=obstacle, obstacle_bone=bone))
    return Muscles(ends[FEMUR], ends[TIBIA], tension, names, add_lane_axis(courses))


def _ends_inside(obstacle: Obstacle, ends: np.ndarray) -> np.ndarray:
    """Whether ends on an obstacle's bone, `(rows, 3, n)`, mm, lie inside it at any instant."""
    point = obstacle.frame.placement.apply_inverse(tuple(np.moveaxis(ends, 1, 0)))
    parts = zip(point, obstacle.semi_axes_along_frame, strict=True)
    return np.any(np.asarray(sum((x / a) ** 2 for x, a in parts)) < 1.0, axis=-1)
