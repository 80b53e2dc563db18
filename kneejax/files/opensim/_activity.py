"""A movement that a whole-body program recorded, as what acts on one knee."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from kneejax.files.opensim._external_loads import (
    ExternalLoads,
    of_contacts,
    on_bodies,
    place_doubts,
    read_external_loads,
)
from kneejax.files.opensim._joints import read_joints
from kneejax.files.opensim._knee import SIDES, OsimKneeJoint, find_knee
from kneejax.files.opensim._model import Model, angles_xyz, read_model, turn_xyz
from kneejax.files.opensim._movement import Movement, Rigid, coordinate_columns, moved, turning
from kneejax.files.opensim._muscle_lines import Crossing, crossing, muscles_of, tension_of_ligament
from kneejax.files.opensim._record_checks import (
    bodies_below,
    check_movement,
    check_reaction,
    check_tensions,
    missing_words,
    record_doubts,
    with_prescribed,
)
from kneejax.files.opensim._registration import (
    Registration,
    flexion_coordinate,
    in_knee,
    poses_of,
    registration,
)
from kneejax.files.reading import InputProblem, counted
from kneejax.files.tables import Storage, angles_rad, common_times, last_word, read_storage
from kneejax.geometry import FEMUR, TIBIA, Pose, State
from kneejax.mechanics import Knee, LegRecord, MovingMass, Muscles, wrench_in_frame

#: Between the five instants by which accelerations are taken, s.
_STEP_S = 5e-4


@dataclasses.dataclass(frozen=True)
class _Files:
    """What was given, by kind."""

    motion: Storage
    muscles: Storage | None
    ground: ExternalLoads | None
    reaction: Storage | None

    @property
    def tables(self) -> list[Storage]:
        own = [self.motion, self.muscles, self.reaction]
        tables = [table for table in own if table is not None]
        return [*tables, self.ground.table] if self.ground is not None else tables


def read_activity(
    model_path: str | os.PathLike[str],
    files: Sequence[str | os.PathLike[str]],
    *,
    side: str,
    knee: Knee,
    document: dict[str, Any] | None = None,
    frames: str | Registration = "auto",
    instants: int | None = None,
    femur: str | None = None,
    tibia: str | None = None,
) -> LegRecord:
    """Read a recorded movement, without OpenSim.

    Args:
        model_path: the model that moved (.osim).
        files: .sto or .mot tables of coordinates, and either of muscle forces with the external
            loads (.xml, whose table is sought beside it; left out where nothing touches the body,
            or where the forces are recorded with those of the model's own contacts), or of joint
            reactions, alone or beside muscle forces; each is known by its columns.
        side: `r` or `l`.
        knee: in whose frames the record is wanted.
        document: of the knee's file, which tells whether it was made of this model.
        frames: `same`, `landmarks`, or `auto` for the first where the knee was made of this model;
            or those of `registered`.
        instants: how many, evenly spaced; by default the rows of the coarsest table.
        femur: body of the model that is the femur, with `tibia`; by default found by names.
        tibia: likewise.

    Returns:
        What acted on the leg below the knee: its weight and inertia, the ground, muscles.

    Raises:
        InputProblem: a file cannot be read or is of no known kind, tables do not overlap in time,
            numbers are in another unit than they should be, or the model has no such knee.
    """
    if side not in SIDES:
        raise InputProblem("--side", "side", side, "r or l")
    model = read_model(model_path)
    bones = find_knee(model, side, femur, tibia, may_be_named=True)
    given = _sorted(model, bones, files)
    time = common_times(given.tables, instants)
    shifts = frames
    if not isinstance(shifts, Registration):
        shifts = registration(model, bones, knee, document or {}, shifts)
    movement, around = _moved(model, bones, given.motion, time)
    below = bodies_below(movement.joints, bones)
    frame = in_knee(movement.placed[bones.tibia], TIBIA, shifts, side)
    if given.reaction is not None:
        acting, mass, ground = _reaction(given.reaction, bones, time, shifts, frame), 0.0, None
    else:
        acting, mass, ground = _acting(given, movement, around, below, frame, time)
    notes, doubts = [*shifts.notes], [*shifts.doubts, *bones.doubts]
    doubts += record_doubts(model, bones, below, given.motion)
    notes += missing_words(model, bones, below, given.motion)
    if given.ground is not None:
        doubts += [*given.ground.doubts, *place_doubts(given.ground, movement, below, time)]
    elif ground is not None and not ground.any():
        notes.append("No external loads were given: none act on the leg.")
    frames_of = {
        TIBIA: frame, FEMUR: in_knee(movement.placed[bones.femur], FEMUR, shifts, side),
    }  # fmt: skip
    found = crossing(movement, bones, below)
    muscles, quadriceps = _muscles(given, movement, bones, found, frames_of, shifts, time, notes)
    there = frames_of[FEMUR].after(frame.inverse())
    own = poses_of(Rigid(there.turn, there.shift / 1e3), "r")
    if given.reaction is not None and given.muscles is not None:
        acting = _besides(acting, muscles, own)
        notes.append("Other loads than the muscles' are what the joint reaction leaves.")
    still = np.zeros((len(time), 3))
    return LegRecord(
        time, own, acting, muscles, quadriceps, still if ground is None else ground, shifts.same,
        mass, tuple(notes), tuple(doubts),
    )  # fmt: skip


def _sorted(model: Model, bones: OsimKneeJoint, files: Sequence[str | os.PathLike[str]]) -> _Files:
    """Each file by what it has."""
    kinds: dict[str, Any] = {}

    def take(kind: str, value: Any, file: str) -> None:
        if kind in kinds:
            raise InputProblem(file, "file", f"a second table of {kind}", "one of each kind")
        kinds[kind] = value

    flexion = flexion_coordinate(model, bones)
    muscles = {e.name for e in model.elements() if e.tag.endswith("Muscle")}
    for path in files:
        file = os.fspath(path)
        if Path(path).suffix.lower() == ".xml":
            take("external loads", read_external_loads(path, model), file)
            continue
        table = read_storage(path)
        words = {last_word(name) for name in table.columns}
        if flexion in words:
            take("coordinates", table, file)
        elif len(words & muscles) > 1:
            take("muscle forces", table, file)
        elif any(f"_on_{bones.tibia}_in_".lower() in name.lower() for name in table.columns):
            take("joint reactions", table, file)
        else:
            expected = (
                f"a table with the coordinate {flexion}, with forces of the model's muscles, or "
                f"with reactions on {bones.tibia}; forces of the ground come with their .xml"
            )
            raise InputProblem(file, "columns", next(iter(table.columns)), expected, [flexion])
    if "coordinates" not in kinds:
        expected = f"a table with the coordinate {flexion} among the files"
        raise InputProblem("FILES", "coordinates", "missing", expected)
    if "joint reactions" not in kinds and "muscle forces" not in kinds:
        expected = "a table of muscle forces, or one of joint reactions, among the files"
        raise InputProblem("FILES", "muscle forces", "missing", expected)
    return _Files(
        kinds["coordinates"], kinds.get("muscle forces"), kinds.get("external loads"),
        kinds.get("joint reactions"),
    )  # fmt: skip


def _moved(model: Model, bones: OsimKneeJoint, table: Storage, time: np.ndarray):
    """The model at the instants, and at five about each."""
    columns = coordinate_columns(model, table)
    angles_rad(table, columns[flexion_coordinate(model, bones)])
    check_movement(bones, table)
    steps = time + _STEP_S * np.arange(-2, 3)[:, None]
    values = dict(zip(columns, table.at(steps, list(columns.values())), strict=True))
    if table.in_degrees:
        angles = turning(read_joints(model))
        values = {k: np.deg2rad(x) if k in angles else x for k, x in values.items()}
    values = with_prescribed(model, values, steps)
    # Translations and small rotations of a knee follow its balance without inertia of their own.
    for name in {c.name for joint in bones.joints for c in joint.coordinates} & {*values}:
        if name != flexion_coordinate(model, bones):
            values[name] = np.broadcast_to(values[name][2], values[name].shape)
    around = moved(model, values)
    placed = {name: there.at(2) for name, there in around.placed.items()}
    here = Movement(model, around.joints, {k: x[2] for k, x in around.values.items()}, placed)
    return here, around


def _acting(given: _Files, movement: Movement, around: Movement, below, frame: Rigid, time):
    """What acts besides muscles, by name, in the knee's tibia; the leg's mass; force of the ground
    on this foot."""
    model = movement.model
    gravity = np.array(model.point(model.root, "gravity", "0 -9.80665 0"), float)
    none = np.zeros((len(time), 3))
    weight, inertia, total = (none, none), (none, none), 0.0
    for name in sorted(below):
        part = _mass(model, around, name)
        total += part.mass_kg
        for_weight, for_inertia = part.weight(gravity), part.inertia()
        weight = weight[0] + for_weight[0], weight[1] + for_weight[1]
        inertia = inertia[0] + for_inertia[0], inertia[1] + for_inertia[1]
    if given.ground is not None:
        ground = on_bodies(given.ground, movement, below, time)
    else:
        assert given.muscles is not None  # with the contacts of the model, if it has some
        ground = of_contacts(model, given.muscles, below, time)
    parts = {"ground": ground, "weight": weight, "inertia": inertia}
    found = {name: _on_tibia(pair[0], pair[1], frame) for name, pair in parts.items()}
    return found, total, ground[0]


def _on_tibia(force: np.ndarray, moment: np.ndarray, frame: Rigid) -> np.ndarray:
    """A wrench of the ground in the frame of the knee's tibia, which a mirror may turn over."""
    inverse = frame.inverse()
    found = wrench_in_frame(force, moment, inverse.turn, inverse.shift / 1e3)
    # A moment is a product of two vectors: a mirror turns its sign.
    found[:, 3:] *= np.sign(np.linalg.det(frame.turn))[:, None]
    return found


def _mass(model: Model, around: Movement, name: str) -> MovingMass:
    element = model.bodies[name]
    center = np.array(model.point(element, "mass_center"), float)
    if element.child("inertia") is not None:
        xx, yy, zz, xy, xz, yz = map(float, model.numbers(element, "inertia", 6))
    else:
        tags = (f"inertia_{two}" for two in ("xx", "yy", "zz", "xy", "xz", "yz"))
        xx, yy, zz, xy, xz, yz = (float(model.numbers(element, tag, 1, "0")[0]) for tag in tags)
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    there = around.placed[name]
    mass = float(model.numbers(element, "mass", 1, "0")[0])
    return MovingMass(mass, inertia, there.turn, there.point(center), _STEP_S)


def _reaction(table: Storage, bones: OsimKneeJoint, time, shifts: Registration, frame: Rigid):
    """The opposite of a joint's reaction: the knee's own parts take the joint's place."""
    ends = {}
    for name in table.columns:
        low = name.lower()
        for axis in ("fx", "fy", "fz", "mx", "my", "mz", "px", "py", "pz"):
            if low.endswith(f"_on_{bones.tibia}_in_{bones.tibia}_{axis}".lower()):
                ends[axis] = name
    axes = ("fx", "fy", "fz", "mx", "my", "mz", "px", "py", "pz")
    for axis in axes:
        if axis not in ends:
            column = f"JOINT_on_{bones.tibia}_in_{bones.tibia}_{axis}"
            expected = "reactions on the tibia, in its own axes, as JointReaction writes them"
            raise InputProblem(table.file, "columns", f"no {column}", expected)
    force, moment, point = table.at(time, [ends[x] for x in axes]).reshape(3, 3, -1).swapaxes(1, 2)
    mirror = np.array([1.0, 1.0, -1.0 if bones.side == "l" else 1.0])
    check_reaction(table, force, moment, point, ends)
    place = 1e3 * point * mirror + shifts.tibia
    about = 1e3 * moment * mirror * mirror.prod()
    own = force * mirror
    return {"joint reaction": -np.concatenate([own, about + np.cross(place, own)], axis=1)}


def _besides(
    acting: dict[str, np.ndarray], muscles: Muscles, pose: np.ndarray
) -> dict[str, np.ndarray]:
    """What acts without the muscles that a joint reaction includes: they pull by themselves."""
    if not muscles.names:
        return acting
    pulls = np.asarray(muscles.on_tibia(State({TIBIA: Pose.from_table(pose)}))).sum(axis=0).T
    return {"besides muscles": sum(acting.values(), -pulls)}


def _muscles(given, movement, bones, found: Crossing, frames_of, shifts, time, notes):
    """Muscles with their tensions, and the pull of the quadriceps on the patella."""
    count = len(time)
    if given.muscles is None:
        notes.append("No muscle forces were given: their pull is part of the joint reaction.")
        empty = muscles_of(movement, bones, [], np.zeros((0, count)), frames_of, dict, [])
        return empty, np.zeros(count)
    table = given.muscles
    check_tensions(movement.model, table)
    by_name = {last_word(name): name for name in table.columns}
    for name in (*(way.name for way in found.muscles), *found.on_patella):
        if name not in by_name:
            table.named(name, "a muscle over the knee")

    def tensions(names):
        return np.maximum(table.at(time, [by_name[name] for name in names]), 0.0)

    def entry(document: dict[str, Any]) -> dict[str, Any]:
        return _in_frames(document, shifts, bones.side)

    ways = [*found.muscles, *found.ligaments]
    passive = [tension_of_ligament(movement, way) for way in found.ligaments]
    own = np.concatenate([tensions([w.name for w in found.muscles]), *[x[None] for x in passive]])
    muscles = muscles_of(movement, bones, ways, own, frames_of, entry, notes)
    notes.append(
        f"Over the knee: {counted(len(found.muscles), 'muscle')}"
        + (f", {', '.join(w.name for w in found.ligaments)} by its length" if passive else "")
        + (f"; on the patella: {', '.join(found.on_patella)}" if found.on_patella else "")
        + "."
    )
    return muscles, tensions(found.on_patella).sum(axis=0) + np.zeros(count)


def _in_frames(document: dict[str, Any], shifts: Registration, side: str) -> dict[str, Any]:
    """An obstacle of the model in the frames of the knee."""
    mirror = np.diag([1.0, 1.0, -1.0 if side == "l" else 1.0])
    shift = {FEMUR: shifts.femur, TIBIA: shifts.tibia}[document["bone"]]
    turn = turn_xyz(np.deg2rad(document.get("rotation_deg", [0.0, 0.0, 0.0])))
    # Mirrored axes of an obstacle that is symmetric are axes again where the last is turned back.
    own = mirror @ turn @ mirror
    return document | {
        "center_mm": [float(x) for x in mirror @ np.array(document["center_mm"]) + shift],
        "rotation_deg": [float(x) for x in np.rad2deg(angles_xyz(own))],
    }
