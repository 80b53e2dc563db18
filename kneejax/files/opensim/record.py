"""A movement that a whole-body program recorded, as what acts on one knee."""

__all__ = ["read_activity"]

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from kneejax.files.opensim import acting as forces
from kneejax.files.opensim import joints as kinematics
from kneejax.files.opensim.exact import MIRROR, Rigid, poses_of
from kneejax.files.opensim.frames import Registration, flexion_coordinate, registration
from kneejax.files.opensim.joints import Joint, Movement, coordinate_columns, coordinates_of
from kneejax.files.opensim.knee import OsimKneeJoint, chain, connected, find_knee
from kneejax.files.opensim.model import GROUND, Model, evaluate, read_model
from kneejax.files.reading import InputProblem
from kneejax.files.tables.storage import Storage, angles_rad, common_times, last_word, read_storage
from kneejax.geometry import FEMUR, TIBIA, Pose, State
from kneejax.mechanics import RANGES, Knee, LegRecord, MovingMass, wrench_in_frame
from kneejax.quantities import nearest_name

_STEP_S = 5e-4  # between the five instants by which accelerations are taken, s
#: Columns of a table of no known kind that are named.
_SHOWN = 4
_AXES = tuple(f"{kind}{axis}" for kind in "fmp" for axis in "xyz")
_MOST_M = 0.3  # a knee's bones are no farther from where its joint has them, m
_FASTEST_DEG_S = 3000.0  # no knee bends faster, degrees/s: twice a kick's
_SLOWEST_S = 1.0  # rows of a record of a movement are nearer to each other, s
#: Largest force, moment and distance of a joint reaction: no person's knee holds more, and its
#: point lies on the tibia.
_REACTION = (
    (RANGES["force_N"].upper, "a force, N"),
    (1000.0, "a moment, N m; N mm are suspected"),
    (1.0, "a point of the tibia, m; mm are suspected"),
)
#: Kinds of table, in the order in which the times of the first of equally coarse ones are taken.
_KINDS = "coordinates", "muscle forces", "joint reactions", "external loads"


def read_activity(
    model_path: str | os.PathLike[str], files: Sequence[str | os.PathLike[str]], *, side: str,
    knee: Knee, document: dict[str, Any] | None = None, frames: str | Registration = "auto",
    instants: int | None = None, femur: str | None = None, tibia: str | None = None,
    called: Mapping[str, str] | None = None,
) -> LegRecord:  # fmt: skip
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
    model = read_model(model_path)
    bones = find_knee(model, side, femur, tibia)
    given = sorted_files(model, bones, files, called)
    motion, pulls, reaction, external = map(given.get, _KINDS)
    time = common_times([x.table if x is external else x for x in given.values()], instants)
    shifts = frames if isinstance(frames, Registration) else registration(
        model, bones, knee, document or {}, frames)
    around = moved_around(model, bones, motion, time)
    movement = around.at(2)
    below = bodies_below(movement.joints, bones)
    frames_of = {bone: shifts.in_knee(movement.placed[body], bone, side)
                 for bone, body in ((TIBIA, bones.tibia), (FEMUR, bones.femur))}
    notes, doubts = [*shifts.notes], [*shifts.doubts, *bones.found.doubts]
    _check_columns(model, bones, below, motion, notes, doubts)
    mass, ground = 0.0, (np.zeros((len(time), 3)),) * 2
    if external is not None:
        *ground, said = forces.on_bodies(external, movement, below, time)
        doubts += said
    elif reaction is None:  # the contacts of the model, if it has some
        ground = forces.of_contacts(model, pulls, below, time)
        if not ground[0].any():
            notes.append("No external loads were given: none act on the leg.")
    if reaction is None:
        acting, mass = acting_on(ground, movement, around, below, frames_of[TIBIA])
    else:
        acting = {"joint reaction": _reaction(reaction, bones, time, shifts)}
        ground = (np.zeros((len(time), 3)),)
    muscles, quadriceps = forces.recorded_muscles(
        pulls, movement, bones, below, frames_of, shifts, time, notes)
    there = frames_of[FEMUR].after(frames_of[TIBIA].inverse())
    own = poses_of(Rigid(there.turn, there.shift / 1e3), "r")
    if reaction is not None and pulls is not None:
        if muscles.names:  # the reaction includes the muscles, which pull by themselves
            theirs = np.asarray(muscles.on_tibia(State({TIBIA: Pose.from_table(own)})))
            acting = {"besides muscles": acting["joint reaction"] - theirs.sum(axis=0).T}
        notes.append("Other loads than the muscles' are what the joint reaction leaves.")
    return LegRecord(time, own, acting, muscles, quadriceps, ground[0], shifts.same, mass,
                     tuple(notes), tuple(doubts))


def sorted_files(
    model: Model, bones: OsimKneeJoint, files: Sequence[str | os.PathLike[str]],
    called: Mapping[str, str] | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Tables of a movement by what they have, one of `_KINDS`; external loads with their table."""
    kinds: dict[str, Any] = {}
    called, muscles = called or {}, {e.name for e in model.muscles()}
    coordinates = coordinates_of(kinematics.read_joints(model))
    known = {*(c.name for c in coordinates), *model.bodies, *muscles}
    for name in called:
        if name not in known:
            expected = f"a coordinate, a muscle or a body of {model.name}"
            raise InputProblem("--called", "name", name, expected, known)
    flexion, on_tibia = flexion_coordinate(bones), f"_on_{bones.tibia}_in_".lower()
    for path in files:
        if Path(path).suffix.lower() == ".xml":
            kind, value = "external loads", forces.read_external_loads(path, model, called)
        else:
            value = read_storage(path).renamed(called)
            words = {last_word(name) for name in value.columns}
            has = (flexion in words, len(words & muscles) > 1,
                   any(on_tibia in name.lower() for name in value.columns))
            kind = next((one for one, there in zip(_KINDS, has, strict=False) if there), "")
            if not kind:
                near = nearest_name(flexion, words)
                so = f" (--called {flexion}={near})" if near else ""
                expected = (f"a table with the coordinate {flexion}{so}, with forces of the "
                            f"model's muscles, or with reactions on {bones.tibia}; forces of the "
                            "ground come with their .xml")
                found = ", ".join(sorted(words)[:_SHOWN]) + ", ..." * (len(words) > _SHOWN)
                raise InputProblem(path, "columns", found, expected, flexion if near else None)
        if kind in kinds:
            raise InputProblem(path, "file", f"a second table of {kind}", "one of each kind")
        kinds[kind] = value
    for some, needed in ((("coordinates",), f"a table with the coordinate {flexion}"),
                         (_KINDS[1:3], "a table of muscle forces, or one of joint reactions,")):
        if not {*some} & {*kinds}:
            raise InputProblem("FILES", some[0], "missing", f"{needed} among the files")
    return {kind: kinds[kind] for kind in _KINDS if kind in kinds}


def bodies_below(joints: Sequence[Joint], bones: OsimKneeJoint) -> set[str]:
    """Bodies of the leg below the knee: what joints other than the knee's join to the tibia."""
    found = {name for name in bones.rigid if bones.bone_of(name) == TIBIA}
    above = {GROUND, bones.patella, *bones.rigid} - found
    return connected(joints, found, lambda joint: joint not in bones.joints
                     and not {joint.parent, joint.child} & above)


def moved_around(model: Model, bones: OsimKneeJoint, table: Storage, time: np.ndarray) -> Movement:
    """The model at five instants about each of `(n,)`, along a first axis."""
    columns, flexion = coordinate_columns(model, table), flexion_coordinate(bones)
    known = coordinates_of(kinematics.read_joints(model))
    angles_rad(table, columns[flexion])
    for c in coordinates_of(bones.joints):
        values = table.columns[columns[c.name]] if c.name in columns else np.array([c.default])
        farthest = float(values[np.abs(values - c.default).argmax()])
        if not c.turns and abs(farthest - c.default) > _MOST_M:
            expected = (f"a translation of the knee within {_MOST_M:g} m of {c.default:g}, the "
                        "model's default; mm are suspected")
            raise InputProblem(table.file, columns[c.name], f"{farthest:g}", expected)
    steps = time + _STEP_S * np.arange(-2, 3)[:, None]
    values = dict(zip(columns, table.at(steps, list(columns.values())), strict=True))
    for c in known:
        if c.turns and table.in_degrees and c.name in values:
            values[c.name] = np.deg2rad(values[c.name])
        elif c.prescribed is not None and c.name not in values:
            values[c.name] = np.broadcast_to(evaluate(c.prescribed, [steps]), steps.shape)
    # Translations and small rotations of a knee follow its balance without inertia of their own.
    for name in {c.name for c in coordinates_of(bones.joints)} & {*values} - {flexion}:
        values[name] = np.broadcast_to(values[name][2], values[name].shape)
    return kinematics.moved(model, values)


def acting_on(
    ground: Sequence[np.ndarray], movement: Movement, around: Movement, below: set[str],
    frame: Rigid,
) -> tuple[dict[str, np.ndarray], float]:  # fmt: skip
    """What acts besides muscles, in the knee's tibia, by name; the mass of the leg, kg."""
    model, masses = movement.model, []
    gravity = np.array(model.root.point("gravity", "0 -9.80665 0"), float)
    for name in sorted(below):
        element, there = model.bodies[name], around.placed[name]
        center = np.array(element.point("mass_center"), float)
        inertia = (element.numbers("inertia", 6) if element.child("inertia") is not None else
                   [element.number(f"inertia_{two}", "0") for two in "xx yy zz xy xz yz".split()])
        inertia = np.array(inertia, float)[[[0, 3, 4], [3, 1, 5], [4, 5, 2]]]
        masses.append(MovingMass(
            element.number("mass", "0"), inertia, there.turn, there.point(center), _STEP_S))
    parts = {
        "ground": [ground],
        "weight": [mass.weight(gravity) for mass in masses],
        "inertia": [mass.inertia() for mass in masses],
    }
    inverse, found, none = frame.inverse(), {}, np.zeros_like(ground[0])
    for name, pairs in parts.items():
        force, moment = (sum((pair[k] for pair in pairs), none) for k in (0, 1))
        found[name] = wrench_in_frame(force, moment, inverse.turn, inverse.shift / 1e3)
        # A moment is a product of two vectors: a mirror, which the frame may be, turns its sign.
        found[name][:, 3:] *= np.sign(np.linalg.det(frame.turn))[:, None]
    return found, sum((mass.mass_kg for mass in masses), 0.0)


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
    for kind, (most, expected), values in zip("fmp", _REACTION, parts, strict=True):
        row, axis = np.unravel_index(np.abs(values).argmax(), values.shape)
        if abs(values[row, axis]) > most:
            found = f"{values[row, axis]:g}"
            raise InputProblem(table.file, ends[kind + "xyz"[axis]], found, expected)
    mirror = np.diag(MIRROR[bones.side])
    force, moment, point = parts * np.stack([mirror, mirror * mirror.prod(), mirror])[:, None]
    about = 1e3 * moment + np.cross(1e3 * point + shifts.tibia, force)
    return -np.concatenate([force, about], axis=1)


def _check_columns(
    model: Model, bones: OsimKneeJoint, below: set[str], table: Storage, notes: list[str],
    doubts: list[str],
) -> None:  # fmt: skip
    """Doubt units of time, and joints of the leg without columns; note single coordinates."""
    joints, columns = kinematics.read_joints(model), coordinate_columns(model, table)
    file, steps, absent = Path(table.file).name, np.diff(table.time), []
    bend = coordinates_of(bones.joints)[0]
    if bend.name in columns and bend.turns:
        change = np.abs(np.diff(table.columns[columns[bend.name]])) / steps
        fastest = float(change.max()) * (1.0 if table.in_degrees else np.rad2deg(1.0))
        if fastest > _FASTEST_DEG_S:
            doubts.append(f"{file}: {bend.name} turns by {fastest:,.0f} degrees/s: its times or "
                          "angles are in other units than s and those of the header.")
    if np.median(steps) >= _SLOWEST_S:
        doubts.append(f"{file}: rows are {np.median(steps):g} s apart: times in ms or percent are "
                      "suspected; inertia counts for nothing then.")
    known = {*columns, *(name for _, name, _ in kinematics.couplers(model)),
             *(c.name for c in coordinates_of(joints) if c.prescribed is not None)}
    on_way = {joint.name: joint for body in sorted(below) for joint in chain(joints, body)}
    for joint in on_way.values():
        free = [c.name for c in joint.coordinates if not c.locked]
        unknown = [name for name in free if name not in known]
        if joint in bones.joints or not unknown:
            continue
        if unknown != free:
            absent += unknown
        else:
            doubts.append(f"{file}: no column of {', '.join(free)}: taken at the model's defaults, "
                          "which decide how weight, inertia and ground act on the leg.")
    if absent:
        notes.append(f"At the model's defaults, for want of columns: {', '.join(absent)}.")
