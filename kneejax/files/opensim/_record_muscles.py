"""What pulls over a knee while a model moves: muscles, and ligaments from above the thigh."""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
import numpy as np

from kneejax.files.knee import build_obstacle
from kneejax.files.opensim._exact import MIRROR, Rigid, angles_xyz, turn_xyz
from kneejax.files.opensim._frames import Registration
from kneejax.files.opensim._joints import Movement
from kneejax.files.opensim._knee import OsimKneeJoint
from kneejax.files.opensim._ligaments import KIND
from kneejax.files.opensim._model import evaluate, function_of
from kneejax.files.opensim._patella import wrap_of
from kneejax.files.opensim._paths import OsimPoint, path_points, read_wraps
from kneejax.files.opensim._xml import Element
from kneejax.files.reading import InputProblem, counted
from kneejax.files.tables import Storage, last_word
from kneejax.geometry import FEMUR, TIBIA
from kneejax.mechanics import RANGES, Course, Muscles, add_lane_axis, ligament_law

#: Activations and controls are no larger: a table of forces is.
_ACTIVATION = 1.5
#: Part of the largest tension by which filters may push one below zero.
_RINGING = 0.05


@dataclasses.dataclass(frozen=True)
class Way:
    """The piece of a path that spans the knee."""

    name: str  # of the muscle or ligament
    element: Element
    ends: dict[str, np.ndarray]  # last point above the knee and first below, by bone, `(n, 3)`, m
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
    last, length = found[0][0], np.zeros(found[0][0].shape[:-1])
    first = second = np.full(last.shape, np.nan)
    for place, active, lower in found:
        first = first if lower else np.where(active[..., None], place, first)
        length = length + np.where(active, np.linalg.norm(place - last, axis=-1), 0.0)
        last = np.where(active[..., None], place, last)
    for place, active, lower in found[::-1]:
        second = np.where(active[..., None], place, second) if lower else second
    return Way(element.name, element, {FEMUR: first, TIBIA: second}, length)


def _in_ground(movement: Movement, point: OsimPoint) -> tuple[np.ndarray, np.ndarray]:
    """Where a point of a path is in the ground, `(n, 3)`, m, and whether the path goes there."""
    element = point.element
    carrier = movement.placed[point.body].after(point.frame)
    shape = carrier.shift.shape[:-1]

    def value(tag: str) -> np.ndarray:
        name = element.last_word(f"socket_{tag}", f"socket_{tag}_connectee_name")
        name = name or element.last_word(tag)
        if name not in movement.values:
            expected = "a coordinate of the model"
            raise element.problem(tag, name or "missing", expected, movement.values)
        return movement.values[name]

    local, active = point.location.astype(float), np.ones(shape, bool)
    if element.tag == "MovingPathPoint":
        local = np.zeros((*shape, 3))
        for k, axis in enumerate("xyz"):
            held = element.child(f"{axis}_location")
            function = None if held is None else function_of(held)
            if function is not None:
                local[..., k] = evaluate(function, [value(f"{axis}_coordinate")])
    if element.tag == "ConditionalPathPoint":
        low, high = (float(x) for x in element.numbers("range", 2))
        at = value("coordinate")
        active = (at >= low - 1e-5) & (at <= high + 1e-5)
    return carrier.point(np.broadcast_to(local, (*shape, 3))), active


def check_tensions(muscles: set[str], table: Storage) -> None:
    """Refuse a table of muscles whose numbers are no forces in N: activations, negative tensions,
    or more than any muscle pulls with."""
    names = [name for name in table.columns if last_word(name) in muscles]
    least = min(names, key=lambda name: table.columns[name].min())
    most = max(names, key=lambda name: table.columns[name].max())
    low, high = float(table.columns[least].min()), float(table.columns[most].max())
    if 0.0 < high <= _ACTIVATION:
        expected = "muscle forces, N; activations are suspected"
        found = f"nothing above {_ACTIVATION:g} in {counted(len(names), 'column')} of muscles"
        raise InputProblem(table.file, most, found, expected)
    if low < -_RINGING * max(high, 0.0):
        expected = "muscle forces, N, 0 or more: muscles pull"
        raise InputProblem(table.file, least, f"{low:g}", expected)
    if not RANGES["tension_N"].holds(max(high, 0.0)):
        raise InputProblem(table.file, most, f"{high:g}", f"muscle forces, {RANGES['tension_N']}")


def recorded_muscles(
    table: Storage | None, movement: Movement, knee: OsimKneeJoint, below: set[str],
    frames: dict[str, Rigid], shifts: Registration, time: np.ndarray, notes: list[str],
) -> tuple[Muscles, np.ndarray]:  # fmt: skip
    """Muscles with their tensions, and the pull of the quadriceps on the patella.

    `frames` lead from the ground to those of the knee's bones, mm; arrays end in instants. `notes`
    get a sentence for what was left out.
    """
    none = np.zeros(len(time))
    if table is None:
        notes.append("No muscle forces were given: their pull is part of the joint reaction.")
        empty = np.zeros((0, 3, len(time)))
        return Muscles(empty, empty, empty[:, 0], (), add_lane_axis([])), none
    check_tensions({e.name for e in movement.model.muscles()}, table)
    found, straight = crossing(movement, knee, below), []
    by_name = {last_word(name): name for name in table.columns}
    for name in (*(way.name for way in found.muscles), *found.on_patella):
        if name not in by_name:
            table.named(name, "a muscle over the knee")

    def tensions(names) -> np.ndarray:
        return np.maximum(table.at(time, [by_name[name] for name in names]), 0.0)

    ways, tension = [*found.muscles, *found.ligaments], [*tensions(w.name for w in found.muscles)]
    for ligament in found.ligaments:
        slack, stiffness, transition = (ligament.element.number(*one) for one in (
            ("slack_length", "0"), ("linear_stiffness", "1"), ("transition_strain", "0.06")))
        strain = jnp.asarray(ligament.length / slack - 1.0)
        tension.append(np.asarray(ligament_law.exact_tension(strain, stiffness, transition)))
    ends = {bone: np.reshape([frames[bone].point(1e3 * way.ends[bone]).T for way in ways],
                             (len(ways), 3, -1 if ways else len(time))) for bone in (FEMUR, TIBIA)}
    wraps, by_wrap = read_wraps(movement.model), {}
    for row, way in enumerate(ways):
        wrap = wrap_of(way.element, wraps, knee, (FEMUR, TIBIA), straight)
        if wrap is not None:
            by_wrap.setdefault(wrap.element, (wrap, []))[1].append(row)
    courses, mirror = [], MIRROR[knee.side]
    for wrap, rows in by_wrap.values():
        entry = wrap.document(knee, "")
        bone = entry["bone"]
        # In the knee's frames. Mirrored axes of a symmetric obstacle are axes again where the last
        # is turned back.
        turn = turn_xyz(np.deg2rad(entry.get("rotation_deg", [0.0, 0.0, 0.0])))
        center = mirror @ np.array(entry["center_mm"]) + getattr(shifts, bone)
        obstacle = build_obstacle(entry | {
            "center_mm": center.tolist(),
            "rotation_deg": np.rad2deg(angles_xyz(mirror @ turn @ mirror)).tolist(),
        })
        # As OpenSim has it: what ends inside an obstacle at any instant does not lie around it.
        there = obstacle.frame.placement.apply_inverse(tuple(np.moveaxis(ends[bone][rows], 1, 0)))
        parts = zip(there, obstacle.semi_axes_along_frame, strict=True)
        buried = np.any(np.asarray(sum((x / a) ** 2 for x, a in parts)) < 1.0, axis=-1)
        straight += [
            f"{ways[row].name} ends inside {wrap.element.name} and runs straight, as in OpenSim."
            for row, inside in zip(rows, buried, strict=True) if inside
        ]
        if not buried.all():
            kept = [row for row, inside in zip(rows, buried, strict=True) if not inside]
            courses.append(Course(kept, obstacle=obstacle, obstacle_bone=bone))
    by_length = ", ".join(way.name for way in found.ligaments)
    notes += straight
    notes.append(
        f"Over the knee: {counted(len(found.muscles), 'muscle')}"
        + (f", {by_length} by its length" if by_length else "")
        + (f"; on the patella: {', '.join(found.on_patella)}" if found.on_patella else "")
        + "."
    )
    names = tuple(way.name for way in ways)
    every = np.reshape(tension, (len(ways), len(time)))
    muscles = Muscles(ends[FEMUR], ends[TIBIA], every, names, add_lane_axis(courses))
    return muscles, tensions(found.on_patella).sum(axis=0) + none
