"""What acts in a recorded movement: forces from the ground, muscles, ligaments over the knee."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from kneejax.files.knee.document import mirror_part
from kneejax.files.knee.surfaces import build_surface
from kneejax.files.opensim import ligaments as fibres
from kneejax.files.opensim.exact import Rigid
from kneejax.files.opensim.frames import Registration
from kneejax.files.opensim.joints import Movement
from kneejax.files.opensim.knee import OsimKneeJoint
from kneejax.files.opensim.model import GROUND, Model, evaluate, function_of
from kneejax.files.opensim.paths import OsimPoint, path_points, read_wraps
from kneejax.files.opensim.xml import Element, parse_xml
from kneejax.files.reading import InputProblem, counted
from kneejax.files.tables.storage import Storage, last_word, read_storage
from kneejax.geometry import FEMUR, TIBIA
from kneejax.mechanics import RANGES, Course, Muscles, add_lane_axis, ligament_law

KIND = "external loads of OpenSim (.xml)"
#: Parts of the largest force above which a force's point is looked at: below, points are noise.
_SOME_FORCE = 0.1
#: A heel is no farther than this from the toes on which it presses: a point farther from the body
#: is another foot's, or of an origin elsewhere, m.
_FAR_M = 0.5
_NOWHERE_M = 3.0  # a point that no body reaches, m
#: Largest forces and torques of the ground that are taken without a doubt, N and N m.
_LEAST_N, _MOST_N, _MOST_NM = 5.0, 2e4, 300.0
_ACTIVATION = 1.5  # activations and controls are no larger: a table of forces is
_RINGING = 0.05  # part of the largest tension by which filters may push one below zero


class ExternalForce(NamedTuple):
    """A force on a body over the times of a table."""

    name: str
    body: str  # on which it acts
    force_in: str  # body whose axes the force and the torque are along
    point_in: str  # body in whose frame the point is
    force: np.ndarray  # N, `(rows, 3)`
    point: np.ndarray  # m; zeros where the file names none, likewise the torque
    torque: np.ndarray  # N m
    point_columns: list[str]  # three, or none where the file names no point


class ExternalLoads(NamedTuple):
    """Forces from the ground over time."""

    table: Storage  # with the columns
    forces: tuple[ExternalForce, ...]  # of the file, those that apply
    doubts: tuple[str, ...]  # what looks wrong in the file, a sentence each


def read_external_loads(
    path: str | os.PathLike[str], model: Model, called: Mapping[str, str] | None = None
) -> ExternalLoads:
    """Read forces on a model's bodies and their table; `called`: body -> what the file calls it."""
    file, back = parse_xml(path, KIND), {own: name for name, own in (called or {}).items()}
    top = next(file.root.iter("ExternalLoads"), None)
    if top is None:
        raise file.root.problem("", file.root.tag, f"{KIND}: an element ExternalLoads")
    word = top.word("datafile")
    if not word:
        raise top.problem("datafile", "missing", "the table of forces")
    table, found, doubts = read_storage(Path(path).parent / word), [], []
    spins = [name for name in table.columns if "torque" in name.lower() and name[-1:] == "x"]
    none = np.zeros((len(table.time), 3))
    for element in (x for x in top.findall("objects[1]/ExternalForce") if x.applied):
        bodies, columns, rows = [], [], []
        for tag, usual in (("applied_to_body", ""), ("force_expressed_in_body", GROUND),
                           ("point_expressed_in_body", GROUND)):
            body = element.last_word(tag) or usual
            bodies.append(model.named(back.get(body, body)))
            if not bodies[-1]:
                word, expected = element.word(tag) or "missing", "a body of the model"
                raise element.problem(tag, word, expected, model.bodies)
        for kind in ("force", "point", "torque"):
            stem = element.word(tag := f"{kind}_identifier")
            columns.append([f"{stem}{axis}" for axis in "xyz"] if stem or kind == "force" else [])
            values = [table.named(x, f"a column of {tag} of {element.name}") for x in columns[-1]]
            rows.append(np.stack(values, axis=1) if values else none)
        found.append(ExternalForce(element.name, *bodies, *rows, point_columns=columns[1]))
        # A torque is another force's where that one's name begins more like the name of this force,
        # but for the word that says which it is.
        first, spin = columns[0][0].lower(), columns[2][:1]
        likeness = {
            name: len(os.path.commonprefix([name.lower().replace("torque", "force"), first]))
            for name in (*spin, *spins)}
        nearest = max(likeness, key=lambda name: likeness[name], default="")
        if spin and likeness[nearest] > likeness[spin[0]]:
            own, better = (name[:-1].rstrip("_") for name in (*spin, nearest))
            doubts.append(f"{Path(path).name}: force {element.name} takes its torque from {own}; "
                          f"{better} would fit its force.")
    if not found:
        raise top.problem("objects", "none", "at least one ExternalForce")
    return ExternalLoads(table, tuple(found), tuple(doubts))


def on_bodies(
    loads: ExternalLoads, movement: Movement, bodies: set[str], time: np.ndarray
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Force, N, and moment, N m, of the ground on bodies, `(n, 3)` each, in its axes; doubts."""
    def between(values: np.ndarray) -> np.ndarray:
        return np.stack([np.interp(time, loads.table.time, x) for x in values.T], axis=1)

    force, moment, doubts = np.zeros((len(time), 3)), np.zeros((len(time), 3)), [*loads.doubts]
    for one in (x for x in loads.forces if x.body in bodies):
        pull, point, torque = map(between, (one.force, one.point, one.torque))
        place, carrier = movement.placed[one.point_in].point(point), movement.placed[one.force_in]
        if one.force_in == one.point_in == GROUND:
            # Forces and moments are taken between rows, not points: one without force jumps.
            here, spin = pull, between(one.torque + np.cross(one.point, one.force))
        else:
            here, spin = (np.einsum("nij,nj->ni", carrier.turn, x) for x in (pull, torque))
            spin = spin + np.cross(place, here)
        force, moment = force + here, moment + spin
        largest = np.linalg.norm(one.force, axis=1).max()
        size, spin = np.linalg.norm(pull, axis=1), np.linalg.norm(torque, axis=1).max()
        name = f"{Path(loads.table.file).name}: force {one.name} on {one.body}"
        if 0.0 < largest < _LEAST_N:
            doubts.append(
                f"{name} is at most {largest:.3g} N: kN or body weights are suspected.")
        if largest > _MOST_N:
            doubts.append(f"{name} is up to {largest:,.0f} N: more than a person presses with.")
        if spin > _MOST_NM:
            doubts.append(f"{name} turns by up to {spin:,.0f} N m: N mm are suspected.")
        if not one.point_columns or not size.any():
            continue
        # From what a model has on a body: its origin, its center of mass and its joints.
        marks = [np.zeros(3), movement.model.bodies[one.body].point("mass_center")]
        marks += [frame.shift for joint in movement.joints if not joint.on_ground
                  for end, frame in joint.ends if end == one.body]
        marks = [movement.placed[one.body].point(np.broadcast_to(np.array(x, float), place.shape))
                 for x in marks]
        away = np.min(np.linalg.norm(place - np.array(marks), axis=2), axis=0)
        away = np.where(size > _SOME_FORCE * size.max(), away, 0.0)
        row = int(np.argmax(away))
        if away[row] > _NOWHERE_M:
            shown = ", ".join(f"{x:g}" for x in point[row])
            suspected = "; mm are suspected" if np.abs(point[row]).max() > 10.0 else ""
            expected = f"a point of {one.body} in m, which is {away[row]:,.1f} m away{suspected}"
            raise InputProblem(loads.table.file, ", ".join(one.point_columns),
                               f"({shown}) at {time[row]:g} s", expected)
        if away[row] > _FAR_M:
            doubts.append(f"{name} acts {away[row]:.2f} m away from it at {time[row]:g} s, farther "
                          "than a foot is long: another foot's plate, or an origin that is not the "
                          "model's?")
    return force, moment, doubts


def of_contacts(
    model: Model, table: Storage, bodies: set[str], time: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """As `on_bodies`, of the model's own contacts: the opposite of what the ground bears."""
    carriers = {e.name: e.last_word("socket_frame") for e in model.elements
                if e.tag.startswith("Contact") and e.child("socket_frame") is not None}
    both = np.zeros((len(time), 6))
    for element in model.elements:
        names = [f"{element.name}.ground.{kind}.{axis}" for kind in ("force", "torque")
                 for axis in "XYZ"]
        words = {w for e in element.iter("geometry") for w in e.content.split()}
        if names[0] in table.columns and {carriers.get(word, "") for word in words} & bodies:
            both = both - table.at(time, names, degree=1).T
    return both[:, :3], both[:, 3:]


class Way(NamedTuple):
    """The piece of the path of a muscle or a ligament that spans the knee."""

    element: Element
    ends: dict[str, np.ndarray]  # last point above the knee and first below, by bone, `(n, 3)`, m
    length: np.ndarray  # of the whole path between its points, m, `(n,)`


def crossing(
    movement: Movement, knee: OsimKneeJoint, below: set[str]
) -> tuple[list[Way], list[Way], list[str]]:
    """Muscles and ligaments over a knee to bodies below; muscles that end on the patella."""
    muscles, ligaments, on_patella = [], [], []
    for element in movement.model.elements:
        muscle = element.tag.endswith("Muscle")
        if not muscle and element.tag != fibres.KIND:
            continue
        points = path_points(movement.model, element)
        bodies = [point.body for point in points]
        if muscle and knee.patella and knee.patella in (*bodies[:1], *bodies[-1:]):
            on_patella.append(element.name)
            continue
        spans = {x in below for x in bodies} == {True, False}
        if not spans or not (muscle or not ({bodies[0], bodies[-1]} - below) & {*knee.rigid}):
            continue
        points = points[::-1] if bodies[0] in below else points
        last, length = _in_ground(movement, points[0])[0], 0.0
        ends = {bone: np.full(last.shape, np.nan) for bone in (FEMUR, TIBIA)}
        for point in points:
            place, active = _in_ground(movement, point)
            length = length + np.where(active, np.linalg.norm(place - last, axis=-1), 0.0)
            last = np.where(active[..., None], place, last)
            bone = TIBIA if point.body in below else FEMUR
            # Of the points below, the first that the path goes through.
            new = active[..., None] & ((bone == FEMUR) | np.isnan(ends[TIBIA]))
            ends[bone] = np.where(new, place, ends[bone])
        way = Way(element, ends, length)
        (muscles if muscle else ligaments).append(way)
    return muscles, ligaments, on_patella


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

    local, active = np.zeros((*shape, 3)) + point.location.astype(float), np.ones(shape, bool)
    for k, axis in enumerate("xyz" if element.tag == "MovingPathPoint" else ""):
        held = element.child(f"{axis}_location")
        function = None if held is None else function_of(held)
        if function is not None:
            local[..., k] = evaluate(function, [value(f"{axis}_coordinate")])
    if element.tag == "ConditionalPathPoint":
        low, high = (float(x) for x in element.numbers("range", 2))
        at = value("coordinate")
        active = (at >= low - 1e-5) & (at <= high + 1e-5)
    return carrier.point(local), active


def recorded_muscles(
    table: Storage | None, movement: Movement, knee: OsimKneeJoint, below: set[str],
    frames: dict[str, Rigid], shifts: Registration, time: np.ndarray, notes: list[str],
) -> tuple[Muscles, np.ndarray]:  # fmt: skip
    """Muscles in a knee's `frames` (from the ground, mm), and the quadriceps' pull, N, `(n,)`."""
    none = np.zeros(len(time))
    if table is None:
        notes.append("No muscle forces were given: their pull is part of the joint reaction.")
        empty = np.zeros((0, 3, len(time)))
        return Muscles(empty, empty, empty[:, 0], (), add_lane_axis([])), none
    names = {e.name for e in movement.model.muscles()}
    names = [name for name in table.columns if last_word(name) in names]
    least = min(names, key=lambda name: table.columns[name].min())
    most = max(names, key=lambda name: table.columns[name].max())
    low, high = float(table.columns[least].min()), float(table.columns[most].max())
    if 0.0 < high <= _ACTIVATION:
        shown = f"nothing above {_ACTIVATION:g} in {counted(len(names), 'column')} of muscles"
        expected = "muscle forces, N; activations are suspected"
        raise InputProblem(table.file, most, shown, expected)
    if low < -_RINGING * max(high, 0.0):
        expected = "muscle forces, N, 0 or more: muscles pull"
        raise InputProblem(table.file, least, f"{low:g}", expected)
    if not RANGES["tension_N"].holds(max(high, 0.0)):
        raise InputProblem(table.file, most, f"{high:g}", f"muscle forces, {RANGES['tension_N']}")
    (over, ligaments, on_patella), straight = crossing(movement, knee, below), []
    by_name = {last_word(name): name for name in table.columns}
    names = [way.element.name for way in over]
    for name in (*names, *on_patella):
        if name not in by_name:
            table.named(name, "a muscle over the knee")

    def tensions(names) -> np.ndarray:
        return np.maximum(table.at(time, [by_name[name] for name in names]), 0.0)

    ways, tension = [*over, *ligaments], [*tensions(names)]
    names += [way.element.name for way in ligaments]
    for ligament in ligaments:
        slack, stiffness, transition = (ligament.element.number(*one) for one in (
            ("slack_length", "0"), ("linear_stiffness", "1"), ("transition_strain", "0.06")))
        strain = jnp.asarray(ligament.length / slack - 1.0)
        tension.append(np.asarray(ligament_law.exact_tension(strain, stiffness, transition)))
    ends = {bone: np.reshape([frames[bone].point(1e3 * way.ends[bone]).T for way in ways],
                             (len(ways), 3, -1 if ways else len(time))) for bone in (FEMUR, TIBIA)}
    wraps, by_wrap, courses = read_wraps(movement.model), {}, []
    for row, way in enumerate(ways):
        wrap = fibres.wrap_of(way.element, wraps, knee, (FEMUR, TIBIA), straight)
        if wrap is not None:
            by_wrap.setdefault(wrap.element, (wrap, []))[1].append(row)
    for wrap, rows in by_wrap.values():
        entry = wrap.document(knee, "")
        entry, bone = mirror_part(entry) if knee.side == "l" else entry, entry["bone"]
        center = np.add(entry["center_mm"], getattr(shifts, bone)).tolist()
        obstacle = build_surface(entry | {"center_mm": center})
        # As OpenSim has it: what ends inside an obstacle at any instant does not lie around it.
        there = obstacle.frame.placement.apply_inverse(tuple(np.moveaxis(ends[bone][rows], 1, 0)))
        parts = zip(there, obstacle.semi_axes_along_frame, strict=True)
        buried = np.any(np.asarray(sum((x / a) ** 2 for x, a in parts)) < 1.0, axis=-1)
        inside, kept = np.array(rows)[buried], np.array(rows)[~buried].tolist()
        straight += [f"{names[row]} ends inside {wrap.element.name} and runs straight, as in "
                     "OpenSim." for row in inside]
        if kept:
            courses.append(Course(kept, obstacle=obstacle, obstacle_bone=bone))
    said = f"Over the knee: {counted(len(over), 'muscle')}"
    if ligaments:
        said += f", {', '.join(names[len(over):])} by its length"
    if on_patella:
        said += f"; on the patella: {', '.join(on_patella)}"
    notes += [*straight, f"{said}."]
    every = np.reshape(tension, (len(ways), len(time)))
    muscles = Muscles(ends[FEMUR], ends[TIBIA], every, tuple(names), add_lane_axis(courses))
    return muscles, tensions(on_patella).sum(axis=0) + none
