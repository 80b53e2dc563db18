"""A recorded movement before it is used: units, columns that are missing, which bodies it moves."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from kneejax.files.opensim._functions import UnknownFunction, evaluate, function_of
from kneejax.files.opensim._joints import Joint, couplers, read_joints
from kneejax.files.opensim._knee import OsimKneeJoint
from kneejax.files.opensim._model import GROUND, Model
from kneejax.files.opensim._movement import coordinate_columns, turning
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
    """Bodies of the leg below the knee: what joints other than the knee's join to the tibia.

    Args:
        joints: of the model, whichever of their two bodies is the parent.
        bones: the knee.
    """
    knee = {joint.name for joint in bones.joints}
    rigid = {name: bone for name, (bone, _) in bones.rigid.items()}
    above = {name for name, bone in rigid.items() if bone in (FEMUR, PATELLA)} | {GROUND}
    above |= {bones.femur, bones.patella}
    found = {name for name, bone in rigid.items() if bone == TIBIA} - above
    while True:
        ends = [{j.parent, j.child} for j in joints if j.name not in knee]
        more = set().union(*(both for both in ends if both & found)) - found - above
        if not more:
            return found
        found |= more


def check_tensions(model: Model, table: Storage) -> None:
    """Refuse a table of muscles whose numbers are no forces in N.

    Args:
        model: with the muscles.
        table: with a column for each.

    Raises:
        InputProblem: activations, negative tensions, or more than any muscle pulls with.
    """
    muscles = {e.name for e in model.elements() if e.tag.endswith("Muscle")}
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
    """Refuse translations of a knee that are in mm.

    Args:
        bones: the knee.
        table: of coordinates.

    Raises:
        InputProblem: a translation is larger than a knee.
    """
    angles, columns = turning(bones.joints), {last_word(name): name for name in table.columns}
    for name in {c.name for joint in bones.joints for c in joint.coordinates} - angles:
        if name in columns:
            values = table.columns[columns[name]]
            largest = float(values[np.abs(values).argmax()])
            if abs(largest) > _MOST_M:
                expected = f"a translation of the knee, at most {_MOST_M:g} m; mm are suspected"
                raise InputProblem(table.file, columns[name], f"{largest:g}", expected)


def check_reaction(
    table: Storage,
    force: np.ndarray,
    moment: np.ndarray,
    point: np.ndarray,
    columns: Mapping[str, str],
) -> None:
    """Refuse a joint reaction in other units than N, N m and m.

    Args:
        table: of reactions.
        force: `(n, 3)`; likewise the moment and the point.
        moment: N m.
        point: m.
        columns: of `fx`, `mx`, `px`, ...

    Raises:
        InputProblem: a number is larger than a knee's.
    """
    limits = (
        ("f", force, RANGES["force_N"].upper, "a force, N"),
        ("m", moment, _REACTION_NM, "a moment, N m; N mm are suspected"),
        ("p", point, _REACTION_M, "a point of the tibia, m; mm are suspected"),
    )
    for kind, values, most, expected in limits:
        row, axis = np.unravel_index(np.abs(values).argmax(), values.shape)
        if abs(values[row, axis]) > most:
            found = f"{values[row, axis]:g}"
            raise InputProblem(table.file, columns[kind + "xyz"[axis]], found, expected)


def record_doubts(
    model: Model, bones: OsimKneeJoint, below: set[str], table: Storage
) -> Iterator[str]:
    """What looks wrong in a table of coordinates.

    Args:
        model: that moves.
        bones: its knee.
        below: bodies below the knee.
        table: of coordinates.

    Yields:
        A sentence for times in another unit, and one for each joint that places the leg below the
        knee in space and of which no coordinate has a column.
    """
    file, columns = Path(table.file).name, coordinate_columns(model, table)
    steps = np.diff(table.time)
    angles = turning(bones.joints)
    for name in [c.name for joint in bones.joints for c in joint.coordinates][:1]:
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
    known = {*columns} | _stated(model)
    for joint in _that_place(model, bones, below):
        free = [c.name for c in joint.coordinates if not c.locked]
        if free and not known & {*free}:
            yield (
                f"{file}: no column of {', '.join(free)}: taken at the model's defaults, which "
                "decide how weight, inertia and ground act on the leg."
            )


def missing_words(
    model: Model, bones: OsimKneeJoint, below: set[str], table: Storage
) -> Iterator[str]:
    """Coordinates that a table leaves out of joints of which it has others, as of a movement in
    one plane; arguments as of `record_doubts`."""
    known = {*coordinate_columns(model, table)} | _stated(model)
    free = [[c.name for c in joint.coordinates if not c.locked]
            for joint in _that_place(model, bones, below)]  # fmt: skip
    missing = [name for names in free if known & {*names} for name in names if name not in known]
    if missing:
        yield f"At the model's defaults, for want of columns: {', '.join(missing)}."


def _that_place(model: Model, bones: OsimKneeJoint, below: set[str]) -> list[Joint]:
    """Joints but the knee's between the ground and the bodies below the knee."""
    above = {joint.child: joint for joint in read_joints(model)}
    own = {joint.name for joint in bones.joints}
    on_way: dict[str, Joint] = {}
    for body in sorted(below):
        while body in above and above[body].name not in on_way:
            on_way[above[body].name] = above[body]
            body = above[body].parent
    return [joint for name, joint in on_way.items() if name not in own]


def _stated(model: Model) -> set[str]:
    """Coordinates that follow others, or time, by functions of the model."""
    followers = {name for _, name, _ in couplers(model)}
    return followers | {c.name for joint in read_joints(model) for c in joint.coordinates
                        if c.prescribed}  # fmt: skip


def with_prescribed(
    model: Model, values: Mapping[str, np.ndarray], time: np.ndarray
) -> dict[str, np.ndarray]:
    """Coordinates of a table with those that it leaves out and the model prescribes over time.

    Args:
        model: with prescribed coordinates.
        values: coordinate -> rad or m, all of the shape of `time`.
        time: s.

    Raises:
        InputProblem: a function is not known.
    """
    found = dict(values)
    names = {c.name for joint in read_joints(model) for c in joint.coordinates if c.prescribed}
    for element in model.elements():
        if element.tag == "Coordinate" and element.name in names - {*values}:
            function = function_of(element)
            try:
                amount = 0.0 if function is None else evaluate(function, [time])
            except UnknownFunction as kind:
                expected = "a function that kneejax knows, or a column of this coordinate"
                raise model.file.problem(element, element.name, str(kind), expected) from None
            found[element.name] = np.broadcast_to(np.asarray(amount, float), time.shape)
    return found
