"""A recorded movement before it is used: units, columns that are missing, which bodies it moves."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from kneejax.files.opensim._functions import evaluate
from kneejax.files.opensim._joints import (
    Joint,
    coordinate_columns,
    coordinates_of,
    couplers,
    read_joints,
    turning,
)
from kneejax.files.opensim._knee import OsimKneeJoint, chain, connected
from kneejax.files.opensim._model import GROUND, Model
from kneejax.files.reading import InputProblem, counted
from kneejax.files.tables import Storage, last_word
from kneejax.geometry import FEMUR, PATELLA, TIBIA
from kneejax.mechanics import RANGES

#: Activations and controls are no larger: a table of forces is.
_ACTIVATION = 1.5
#: Part of the largest tension by which filters may push one below zero.
_RINGING = 0.05
#: A knee's bones are no farther from where its joint has them, m.
_MOST_M = 0.3
#: No knee bends faster, degrees/s: twice a kick's.
_FASTEST_DEG_S = 3000.0
#: Rows of a record of a movement are nearer to each other, s.
_SLOWEST_S = 1.0
#: Of a joint reaction, N m and m: no person's knee holds more, and its point lies on the tibia.
_REACTION_NM, _REACTION_M = 1000.0, 1.0


def bodies_below(joints: tuple[Joint, ...], bones: OsimKneeJoint) -> set[str]:
    """Bodies of the leg below the knee: what joints other than the knee's join to the tibia,
    whichever of their two bodies is the parent."""
    knee = {joint.name for joint in bones.joints}
    above = {name for name in bones.rigid if bones.bone_of(name) in (FEMUR, PATELLA)}
    above |= {GROUND, bones.femur, bones.patella}
    found = {name for name in bones.rigid if bones.bone_of(name) == TIBIA} - above
    return connected(joints, found, lambda joint: joint.name not in knee
                     and not {joint.parent, joint.child} & above)


def check_tensions(model: Model, table: Storage) -> None:
    """Refuse a table of muscles whose numbers are no forces in N: activations, negative tensions,
    or more than any muscle pulls with."""
    muscles = {e.name for e in model.muscles()}
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
        expected = f"muscle forces, {RANGES['tension_N']}"
        raise InputProblem(table.file, most, f"{high:g}", expected)


def check_movement(bones: OsimKneeJoint, table: Storage) -> None:
    """Refuse translations of a knee that differ more from the model's defaults than a knee's do:
    in mm."""
    angles, columns = turning(bones.joints), {last_word(name): name for name in table.columns}
    for c in coordinates_of(bones.joints):
        if c.name in columns and c.name not in angles:
            values = table.columns[columns[c.name]]
            farthest = float(values[np.abs(values - c.default).argmax()])
            if abs(farthest - c.default) > _MOST_M:
                expected = (f"a translation of the knee within {_MOST_M:g} m of {c.default:g}, the "
                            "model's default; mm are suspected")
                raise InputProblem(table.file, columns[c.name], f"{farthest:g}", expected)


def check_reaction(table: Storage, parts: np.ndarray, columns: Mapping[str, str]) -> None:
    """Refuse a joint reaction in other units than N, N m and m: force, moment and point,
    `(3, n, 3)`, from the columns of `fx`, `mx`, `px`, ..."""
    limits = (
        ("f", RANGES["force_N"].upper, "a force, N"),
        ("m", _REACTION_NM, "a moment, N m; N mm are suspected"),
        ("p", _REACTION_M, "a point of the tibia, m; mm are suspected"),
    )
    for (kind, most, expected), values in zip(limits, parts, strict=True):
        row, axis = np.unravel_index(np.abs(values).argmax(), values.shape)
        if abs(values[row, axis]) > most:
            found = f"{values[row, axis]:g}"
            raise InputProblem(table.file, columns[kind + "xyz"[axis]], found, expected)


def record_doubts(
    model: Model, bones: OsimKneeJoint, below: set[str], table: Storage
) -> Iterator[str]:
    """What looks wrong in a table of coordinates: times in another unit, and each joint that places
    the leg below the knee in space and of which no coordinate has a column."""
    file, columns = Path(table.file).name, coordinate_columns(model, table)
    steps = np.diff(table.time)
    angles = turning(bones.joints)
    for name in [c.name for c in coordinates_of(bones.joints)][:1]:
        if name in columns and name in angles:
            change = np.abs(np.diff(table.columns[columns[name]])) / steps
            fastest = float(change.max()) * (1.0 if table.in_degrees else np.rad2deg(1.0))
            if fastest > _FASTEST_DEG_S:
                yield (
                    f"{file}: {name} turns by {fastest:,.0f} degrees/s: its times or angles are in "
                    "other units than s and those of the header."
                )
    if np.median(steps) >= _SLOWEST_S:
        yield (
            f"{file}: rows are {np.median(steps):g} s apart: times in ms or percent are suspected; "
            "inertia counts for nothing then."
        )
    for free, missing in _missing(model, bones, below, table):
        if free and free == missing:
            yield (
                f"{file}: no column of {', '.join(free)}: taken at the model's defaults, which "
                "decide how weight, inertia and ground act on the leg."
            )


def missing_words(
    model: Model, bones: OsimKneeJoint, below: set[str], table: Storage
) -> Iterator[str]:
    """Coordinates that a table leaves out of joints of which it has others, as of a movement in
    one plane."""
    found = [name for free, missing in _missing(model, bones, below, table) if free != missing
             for name in missing]
    if found:
        yield f"At the model's defaults, for want of columns: {', '.join(found)}."


def _missing(
    model: Model, bones: OsimKneeJoint, below: set[str], table: Storage
) -> Iterator[tuple[list[str], list[str]]]:
    """Of each joint but the knee's between the ground and the bodies below the knee, coordinates
    that are free, and those of them which neither the table nor the model states."""
    joints = read_joints(model)
    known = {*coordinate_columns(model, table), *(name for _, name, _ in couplers(model)),
             *(c.name for c in coordinates_of(joints) if c.prescribed is not None)}
    own = {joint.name for joint in bones.joints}
    on_way = {joint.name: joint for body in sorted(below) for joint in chain(joints, body)}
    for name, joint in on_way.items():
        free = [c.name for c in joint.coordinates if not c.locked]
        if name not in own:
            yield free, [c for c in free if c not in known]


def with_prescribed(
    model: Model, values: Mapping[str, np.ndarray], time: np.ndarray
) -> dict[str, np.ndarray]:
    """Coordinates of a table, rad or m, of the shape of `time`, s, with those that it leaves out
    and the model prescribes over time."""
    found = dict(values)
    for c in coordinates_of(read_joints(model)):
        if c.prescribed is not None and c.name not in values:
            amount = np.asarray(evaluate(c.prescribed, [time]), float)
            found[c.name] = np.broadcast_to(amount, time.shape)
    return found
