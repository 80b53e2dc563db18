"""A movement that a whole-body program recorded, as what acts on one knee."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from kneejax.files.opensim import _record_checks as checks
from kneejax.files.opensim._exact import MIRROR, Rigid, angles_xyz, poses_of, turn_xyz
from kneejax.files.opensim._frames import Registration, flexion_coordinate, registration
from kneejax.files.opensim._ground import (
    ExternalLoads,
    of_contacts,
    on_bodies,
    place_doubts,
    read_external_loads,
)
from kneejax.files.opensim._joints import (
    Movement,
    coordinate_columns,
    coordinates_of,
    moved,
    read_joints,
    turning,
)
from kneejax.files.opensim._knee import SIDES, OsimKneeJoint, find_knee
from kneejax.files.opensim._model import Model, read_model
from kneejax.files.opensim._record_muscles import (
    Crossing,
    crossing,
    muscles_of,
    tension_of_ligament,
)
from kneejax.files.reading import InputProblem, counted, nearest_name
from kneejax.files.tables import Storage, angles_rad, common_times, last_word, read_storage
from kneejax.geometry import FEMUR, TIBIA, Pose, State
from kneejax.mechanics import Knee, LegRecord, MovingMass, Muscles, wrench_in_frame

#: Between the five instants by which accelerations are taken, s.
_STEP_S = 5e-4
#: Columns of a table of no known kind that are named.
_SHOWN = 4
_AXES = tuple(f"{kind}{axis}" for kind in "fmp" for axis in "xyz")


@dataclasses.dataclass(frozen=True)
class RecordedFiles:
    """Tables of a movement by kind: coordinates, muscle forces, ground, joint reactions."""

    motion: Storage
    muscles: Storage | None
    ground: ExternalLoads | None
    reaction: Storage | None

    @property
    def tables(self) -> list[Storage]:
        """All of them."""
        ground = None if self.ground is None else self.ground.table
        own = (self.motion, self.muscles, self.reaction, ground)
        return [table for table in own if table is not None]


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
    called: Mapping[str, str] | None = None,
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
        called: coordinate, muscle or body of the model -> what the files call it.

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
    given = sorted_files(model, bones, files, called)
    time = common_times(given.tables, instants)
    shifts = frames
    if not isinstance(shifts, Registration):
        shifts = registration(model, bones, knee, document or {}, shifts)
    around = moved_around(model, bones, given.motion, time)
    movement = around.at(2)
    below = checks.bodies_below(movement.joints, bones)
    frames_of = {bone: shifts.in_knee(movement.placed[body], bone, side)
                 for bone, body in ((TIBIA, bones.tibia), (FEMUR, bones.femur))}
    mass, ground = 0.0, None
    if given.reaction is not None:
        acting = {"joint reaction": _reaction(given.reaction, bones, time, shifts)}
    else:
        acting, mass, ground = acting_on(given, movement, around, below, frames_of[TIBIA], time)
    notes, doubts = [*shifts.notes], [*shifts.doubts, *bones.doubts]
    doubts += checks.record_doubts(model, bones, below, given.motion)
    notes += checks.missing_words(model, bones, below, given.motion)
    if given.ground is not None:
        doubts += [*given.ground.doubts, *place_doubts(given.ground, movement, below, time)]
    elif ground is not None and not ground.any():
        notes.append("No external loads were given: none act on the leg.")
    found = crossing(movement, bones, below)
    muscles, quadriceps = _muscles(given, movement, bones, found, frames_of, shifts, time, notes)
    there = frames_of[FEMUR].after(frames_of[TIBIA].inverse())
    own = poses_of(Rigid(there.turn, there.shift / 1e3), "r")
    if given.reaction is not None and given.muscles is not None:
        if muscles.names:  # the reaction includes the muscles, which pull by themselves
            pulls = np.asarray(muscles.on_tibia(State({TIBIA: Pose.from_table(own)})))
            acting = {"besides muscles": acting["joint reaction"] - pulls.sum(axis=0).T}
        notes.append("Other loads than the muscles' are what the joint reaction leaves.")
    none = np.zeros((len(time), 3))
    return LegRecord(
        time, own, acting, muscles, quadriceps, none if ground is None else ground, shifts.same,
        mass, tuple(notes), tuple(doubts),
    )


def sorted_files(
    model: Model, bones: OsimKneeJoint, files: Sequence[str | os.PathLike[str]],
    called: Mapping[str, str] | None = None,
) -> RecordedFiles:  # fmt: skip
    """Each file by what it has."""
    kinds: dict[str, Any] = {}
    called = called or {}
    _check_called(model, called)
    flexion = flexion_coordinate(model, bones)
    muscles = {e.name for e in model.muscles()}
    for path in files:
        file = os.fspath(path)
        if Path(path).suffix.lower() == ".xml":
            kind, value = "external loads", read_external_loads(path, model, called)
        else:
            value = read_storage(path).renamed(called)
            words = {last_word(name) for name in value.columns}
            on_tibia = f"_on_{bones.tibia}_in_".lower()
            if flexion in words:
                kind = "coordinates"
            elif len(words & muscles) > 1:
                kind = "muscle forces"
            elif any(on_tibia in name.lower() for name in value.columns):
                kind = "joint reactions"
            else:
                near = nearest_name(flexion, words)
                so = f" (--called {flexion}={near})" if near else ""
                expected = (
                    f"a table with the coordinate {flexion}{so}, with forces of the model's "
                    f"muscles, or with reactions on {bones.tibia}; forces of the ground come with "
                    "their .xml"
                )
                found = ", ".join(sorted(words)[:_SHOWN]) + ", ..." * (len(words) > _SHOWN)
                raise InputProblem(file, "columns", found, expected, flexion if near else None)
        if kind in kinds:
            raise InputProblem(file, "file", f"a second table of {kind}", "one of each kind")
        kinds[kind] = value
    if "coordinates" not in kinds:
        expected = f"a table with the coordinate {flexion} among the files"
        raise InputProblem("FILES", "coordinates", "missing", expected)
    if "joint reactions" not in kinds and "muscle forces" not in kinds:
        expected = "a table of muscle forces, or one of joint reactions, among the files"
        raise InputProblem("FILES", "muscle forces", "missing", expected)
    order = ("coordinates", "muscle forces", "external loads", "joint reactions")
    return RecordedFiles(*(kinds.get(kind) for kind in order))


def _check_called(model: Model, called: Mapping[str, str]) -> None:
    """What files have by other names is there in the model."""
    known = {*(c.name for c in coordinates_of(read_joints(model))), *model.bodies,
             *(e.name for e in model.muscles())}  # fmt: skip
    for name in called:
        if name not in known:
            expected = f"a coordinate, a muscle or a body of {model.name}"
            raise InputProblem("--called", "name", name, expected, known)


def moved_around(
    model: Model, bones: OsimKneeJoint, table: Storage, time: np.ndarray
) -> Movement:
    """The model at five instants about each of `(n,)`, along a first axis."""
    columns, flexion = coordinate_columns(model, table), flexion_coordinate(model, bones)
    angles_rad(table, columns[flexion])
    checks.check_movement(bones, table)
    steps = time + _STEP_S * np.arange(-2, 3)[:, None]
    values = dict(zip(columns, table.at(steps, list(columns.values())), strict=True))
    if table.in_degrees:
        angles = turning(read_joints(model))
        values = {k: np.deg2rad(x) if k in angles else x for k, x in values.items()}
    values = checks.with_prescribed(model, values, steps)
    # Translations and small rotations of a knee follow its balance without inertia of their own.
    for name in {c.name for c in coordinates_of(bones.joints)} & {*values} - {flexion}:
        values[name] = np.broadcast_to(values[name][2], values[name].shape)
    return moved(model, values)


def acting_on(
    given: RecordedFiles, movement: Movement, around: Movement, below: set[str], frame: Rigid,
    time: np.ndarray,
) -> tuple[dict[str, np.ndarray], float, np.ndarray]:
    """What acts besides muscles, by name, in the knee's tibia; the leg's mass; force of the ground
    on this foot."""
    model = movement.model
    gravity = np.array(model.root.point("gravity", "0 -9.80665 0"), float)
    masses = [_mass(model, around, name) for name in sorted(below)]
    if given.ground is not None:
        ground = on_bodies(given.ground, movement, below, time)
    else:
        assert given.muscles is not None  # with the contacts of the model, if it has some
        ground = of_contacts(model, given.muscles, below, time)
    none = np.zeros((len(time), 3))
    parts = {
        "ground": [ground],
        "weight": [mass.weight(gravity) for mass in masses],
        "inertia": [mass.inertia() for mass in masses],
    }
    inverse, found = frame.inverse(), {}
    for name, pairs in parts.items():
        force, moment = (sum((pair[k] for pair in pairs), none) for k in (0, 1))
        found[name] = wrench_in_frame(force, moment, inverse.turn, inverse.shift / 1e3)
        # A moment is a product of two vectors: a mirror, which the frame may be, turns its sign.
        found[name][:, 3:] *= np.sign(np.linalg.det(frame.turn))[:, None]
    return found, sum((mass.mass_kg for mass in masses), 0.0), ground[0]


def _mass(model: Model, around: Movement, name: str) -> MovingMass:
    element = model.bodies[name]
    center = np.array(element.point("mass_center"), float)
    if element.child("inertia") is not None:
        xx, yy, zz, xy, xz, yz = map(float, element.numbers("inertia", 6))
    else:
        tags = (f"inertia_{two}" for two in ("xx", "yy", "zz", "xy", "xz", "yz"))
        xx, yy, zz, xy, xz, yz = (element.number(tag, "0") for tag in tags)
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    there, mass = around.placed[name], element.number("mass", "0")
    return MovingMass(mass, inertia, there.turn, there.point(center), _STEP_S)


def _reaction(
    table: Storage, bones: OsimKneeJoint, time: np.ndarray, shifts: Registration
) -> np.ndarray:
    """The opposite of a joint's reaction: the knee's own parts take the joint's place."""
    ends = {}
    for axis in _AXES:
        ending = f"_on_{bones.tibia}_in_{bones.tibia}_{axis}"
        found = [name for name in table.columns if name.lower().endswith(ending.lower())]
        if not found:
            expected = "reactions on the tibia, in its own axes, as JointReaction writes them"
            raise InputProblem(table.file, "columns", f"no JOINT{ending}", expected)
        ends[axis] = found[-1]
    parts = table.at(time, [*ends.values()]).reshape(3, 3, -1).swapaxes(1, 2)
    checks.check_reaction(table, parts, ends)
    mirror = np.diag(MIRROR[bones.side])
    force, moment, point = parts * np.stack([mirror, mirror * mirror.prod(), mirror])[:, None]
    about = 1e3 * moment + np.cross(1e3 * point + shifts.tibia, force)
    return -np.concatenate([force, about], axis=1)


def _muscles(
    given: RecordedFiles, movement: Movement, bones: OsimKneeJoint, found: Crossing, frames_of,
    shifts: Registration, time: np.ndarray, notes: list[str],
) -> tuple[Muscles, np.ndarray]:
    """Muscles with their tensions, and the pull of the quadriceps on the patella."""
    count, table = len(time), given.muscles
    if table is None:
        notes.append("No muscle forces were given: their pull is part of the joint reaction.")
        empty = muscles_of(movement, bones, [], np.zeros((0, count)), frames_of, dict, [])
        return empty, np.zeros(count)
    checks.check_tensions(movement.model, table)
    by_name = {last_word(name): name for name in table.columns}
    for name in (*(way.name for way in found.muscles), *found.on_patella):
        if name not in by_name:
            table.named(name, "a muscle over the knee")

    def tensions(names) -> np.ndarray:
        return np.maximum(table.at(time, [by_name[name] for name in names]), 0.0)

    def entry(document: dict[str, Any]) -> dict[str, Any]:
        """An obstacle of the model in the frames of the knee."""
        mirror = MIRROR[bones.side]
        shift = {FEMUR: shifts.femur, TIBIA: shifts.tibia}[document["bone"]]
        turn = turn_xyz(np.deg2rad(document.get("rotation_deg", [0.0, 0.0, 0.0])))
        # Mirrored axes of a symmetric obstacle are axes again where the last is turned back.
        angles = np.rad2deg(angles_xyz(mirror @ turn @ mirror))
        center = mirror @ np.array(document["center_mm"]) + shift
        return document | {"center_mm": center.tolist(), "rotation_deg": angles.tolist()}

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
