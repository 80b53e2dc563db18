"""Which bodies of an OpenSim model are the femur, the tibia and the patella, and their pose."""

import dataclasses
import itertools
import math
import re
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import NamedTuple

from kneejax.files.opensim import joints as kinematics
from kneejax.files.opensim.exact import Rigid, poses_of
from kneejax.files.opensim.joints import Joint, Movement, coordinates_of, read_joints
from kneejax.files.opensim.model import GROUND, Model
from kneejax.files.opensim.xml import Element
from kneejax.files.reading import InputProblem
from kneejax.geometry import FEMUR, PATELLA, TIBIA

SIDES = {"r": "right", "l": "left"}
_MARKS = {
    x: re.compile(rf"(?i:(?:^|[^a-z]){x}(?:$|[^a-z])|{side})|[a-z0-9]{x.upper()}$")
    for x, side in SIDES.items()}
_KNEE = re.compile(r"knee|tibiofemoral|femorotibial|(?:^|[^a-z])tf(?:$|[^a-z])", re.IGNORECASE)
_OTHER = re.compile(r"patell|menisc|(?:^|[^a-z])(?:pf|pat)(?:$|[^a-z])", re.IGNORECASE)
_PATELLA = re.compile(r"patell|kneecap", re.IGNORECASE)
_FEMUR = re.compile(r"femur|femor|thigh", re.IGNORECASE)
_TIBIA = re.compile(r"tibia|shank|shin|lower_?leg|crus", re.IGNORECASE)
_FOOT = re.compile(r"foot|calcn|calcan|talus|toes", re.IGNORECASE)
_ABOVE = re.compile(r"pelvis|hips?(?:$|[^a-z])|sacrum|torso", re.IGNORECASE)


@dataclasses.dataclass
class Found:
    """What a model gives for a knee besides its parts, gathered while it is read."""

    findings: list[str]  # what was taken as what, a sentence each
    unusual: list[str]  # what was taken otherwise than in most models
    doubts: list[str]  # what a person should look at
    notes: list[str]  # what else should be said of fibres
    patella: list[str]  # what was assumed or left out of it and the muscles
    outside: dict[str, str]  # name of a fibre -> why it does not belong to this knee
    unsupported: dict[str, str]  # likewise, why it cannot be read though it belongs to the knee
    answered: list[Element]  # elements of those that are not supported


class OsimKneeJoint(NamedTuple):
    """The knee of a model."""

    side: str  # `r` or `l`
    femur: str  # body whose frame is the femur's
    tibia: str
    joints: tuple[Joint, ...]  # between them, from the femur to the tibia
    # body -> (`femur`, `tibia` or `patella`, the motion from the body's to that bone's
    # coordinates), for the bones and what does not move against them
    rigid: dict[str, tuple[str, Rigid]]
    # bone -> the motion from its coordinates to the femur's at the coordinates' defaults
    in_femur: dict[str, Rigid]
    found: Found
    patella: str = ""  # its body; empty without one
    turned: bool = False  # whether the bones' axes are others than those of their bodies

    def bone_of(self, body: str) -> str:
        """`femur`, `tibia` or `patella`, of which a body is part; empty for another one."""
        return self.rigid.get(body, ("",))[0]

    @property
    def pose(self) -> tuple[float, ...]:
        """Of the tibia in the femur, in the order of `kneejax.geometry.COLUMNS`."""
        return tuple(poses_of(self.in_femur[TIBIA], self.side).tolist())


def find_knee(
    model: Model, side: str, femur: str | None = None, tibia: str | None = None
) -> OsimKneeJoint:
    """Find the knee of a side by names of joints, unless `femur` and `tibia` are given."""
    file, joints, found = model.file.path, read_joints(model), Found([], [], [], [], [], {}, {}, [])
    findings, doubts = found.findings, found.doubts
    if side not in SIDES:
        raise InputProblem(file, "--side", side, "r or l")
    if (femur is None) != (tibia is None):
        given = "--femur" if femur is not None else "--tibia"
        raise InputProblem(file, given, femur or tibia, "--femur and --tibia together")
    if femur is not None and tibia is not None:
        options = ("--femur", femur), ("--tibia", tibia)
        for option, name in options:
            if model.named(name) in ("", GROUND):
                known = [body for body in model.bodies if body != GROUND]
                listed = ", ".join(known[:12]) + (", ..." if len(known) > 12 else "")
                raise InputProblem(file, option, name, f"a body of the model: {listed}", known)
        femur, tibia = (model.named(name) for _, name in options)
        up, down = chain(joints, femur), chain(joints, tibia)
        way = [j for j in up if j not in down] + [j for j in down[::-1] if j not in up]
        # Welds within the way belong to a bone; so do locked joints unless nothing else is left.
        knee = [j for j in way if not j.fixed] or [j for j in way if j.coordinates] or way
        carried = tibia != femur and tibia in {joint.parent for joint in up}
        otherwise = carried and not _carries_upwards(joints, knee, tibia, femur)
        if otherwise or _carries_upwards(joints, knee, femur, tibia):
            doubts.append(f"{femur} was given as the femur and {tibia} as the tibia; their names "
                          "or the model's joints say otherwise: have --femur and --tibia changed "
                          "places?")
    else:
        knee = _guess(model, joints, side, findings)
        femur, tibia = knee[0].parent, knee[-1].child
        if _carries_upwards(joints, knee, femur, tibia):
            femur, tibia, knee = tibia, femur, knee[::-1]
            found.unusual.append(f"{tibia} carries {femur} in this model, as their names say.")
    findings += [f"{femur} was taken as the femur.", f"{tibia} was taken as the tibia."]
    names = ", ".join(f"{joint.name} ({joint.kind})" for joint in knee)
    findings.append(f"Joint between them: {names}.")
    rigid: dict[str, tuple[str, Rigid]] = {}
    movement = kinematics.moved(model, {})
    for bone, body in ((FEMUR, femur), (TIBIA, tibia)):
        for other, (at, through) in _held(movement, body, knee).items():
            if other in rigid:
                both = f"{rigid[other][0]} and {bone}"
                expected = "bones that are not one rigid body"
                raise InputProblem(file, f"body {other}", both, expected)
            rigid[other] = bone, at
            if other != body:
                findings.append(f"{other} does not move against the {bone} ({through}).")
    patellae = [joint.child for joint in joints if joint.coordinates and joint.parent in rigid
                and _PATELLA.search(joint.child)]
    patella = patellae[0] if len(patellae) == 1 else ""
    if patella:
        findings.append(f"{patella} was taken as the patella.")
        rigid |= {body: (PATELLA, at) for body, (at, _) in _held(movement, patella, []).items()}
    elif patellae:
        doubts.insert(0, f"{len(patellae)} bodies may be the patella: {', '.join(patellae)}.")
    doubts += [f"Coordinate {c.name} is prescribed by a function of time: the reference pose takes "
               "its value at 0 s." for c in coordinates_of(knee) if c.prescribed is not None]
    in_femur = {FEMUR: Rigid(), TIBIA: movement.between(femur, tibia)}
    in_femur |= {PATELLA: movement.between(femur, patella)} if patella else {}
    return OsimKneeJoint(side, femur, tibia, tuple(knee), rigid, in_femur, found, patella)


def chain(joints: Iterable[Joint], body: str) -> list[Joint]:
    """Joints from a body upwards."""
    above, answer = {joint.child: joint for joint in joints}, []
    while body in above and above[body] not in answer:
        answer.append(above[body])
        body = above[body].parent
    return answer


def connected(
    joints: Iterable[Joint], bodies: Collection[str], through: Callable[[Joint], bool]
) -> set[str]:
    """Bodies, and all that hang together with them by joints that pass a condition."""
    found = [step for body in bodies for step in kinematics.reached(joints, body, through)]
    return {*bodies, *(other for *_, other in found)}


def beyond(joints: list[Joint], cut: list[Joint], body: str) -> set[str]:
    """A body and all that hangs together with it without some joints and without the ground."""
    return connected(joints, [body], lambda joint: not joint.on_ground and joint not in cut)


def is_between(joint: Joint) -> bool:
    """Whether a joint carries what is part of neither bone: a meniscus or a patella, by name."""
    return bool(re.search("menisc|patell|kneecap", f"{joint.name} {joint.child}", re.IGNORECASE))


def with_pelvis_and_foot(
    model: Model, knee: OsimKneeJoint, at: Mapping[str, float] | None = None
) -> OsimKneeJoint:
    """The knee with what its bones carry, at coordinates of hip and foot, degrees or mm."""
    joints = read_joints(model)
    # The femur carries the pelvis where the tibia carries the femur.
    standing = any(knee.bone_of(joint.child) == FEMUR for joint in knee.joints)
    parts: dict[str, list[tuple[Joint, str]]] = {}
    for bone, body in ((FEMUR, knee.femur), (TIBIA, knee.tibia)):
        way = itertools.takewhile(lambda j: j not in knee.joints, chain(joints, body))
        parts[bone] = [(joint, joint.parent) for joint in way]
        waiting = [name for name in knee.rigid if knee.bone_of(name) == bone]
        while waiting and (bone == TIBIA or standing):
            body = waiting.pop()
            carried = [(j, j.child) for j in joints if j.parent == body and j not in knee.joints
                       and j.child not in knee.rigid and not is_between(j)]
            parts[bone] += (new := [one for one in carried if one not in parts[bone]])
            waiting += [child for _, child in new]
    moving = [joint for found in parts.values() for joint, _ in found if joint.parent != GROUND]
    known = {c.name: c for c in coordinates_of(moving)}
    values = {}
    for name, value in (at or {}).items():
        if name not in known:
            expected = f"a coordinate of hip or foot: {', '.join(known) or 'the model has none'}"
            raise InputProblem(model.file.path, "--at", name, expected, known)
        scale, unit = known[name].unit
        lower, upper = (x * scale for x in known[name].range or (-math.inf, math.inf))
        if not lower <= value <= upper:
            expected = f"{lower:.6g} to {upper:.6g} {unit}, its range in the model"
            raise InputProblem(model.file.path, f"--at {name}", f"{value:g}", expected)
        values[name] = value / scale
    movement, rigid = kinematics.moved(model, values), dict(knee.rigid)
    for bone, body in ((FEMUR, knee.femur), (TIBIA, knee.tibia)):
        for _, other in parts[bone]:
            if other not in rigid and other in model.bodies:
                rigid[other] = bone, knee.rigid[body][1].after(movement.between(body, other))
    return knee._replace(rigid=rigid)


def _guess(model: Model, joints: list[Joint], side: str, findings: list[str]) -> list[Joint]:
    def words(joint: Joint) -> str:
        return " ".join((joint.name, joint.child, *(c.name for c in joint.coordinates)))

    moving = [joint for joint in joints if joint.coordinates]
    candidates = [j for j in moving if _KNEE.search(words(j)) and not _OTHER.search(words(j))]
    if not candidates:
        candidates = [j for j in moving
                      if any(map(_FEMUR.search, _welded(joints, j.parent, j)))
                      and any(map(_TIBIA.search, _welded(joints, j.child, j)))]
    marked = {s: [j for j in candidates if _side(j) == s] for s in SIDES}
    if marked["r"] or marked["l"]:
        if not marked[side]:
            (other,) = {*SIDES} - {side}
            names = ", ".join(joint.name for joint in marked[other])
            expected = f"a side the model has a knee of: {other} ({names})"
            expected += "; or give --femur and --tibia"
            raise InputProblem(model.file.path, "--side", side, expected)
        candidates = marked[side]
    elif candidates:
        findings.append("No name says which side the knee is of; it was taken as "
                        f"{SIDES[side]}, as asked.")
    carrying = [j for j in candidates if any(k.parent == j.child for k in joints)]
    candidates = carrying if len(candidates) > 1 and carrying else candidates
    # The candidates from the uppermost to the lowest, with what is between.
    for last in candidates:
        row = [last, *chain(joints, last.parent)]
        for k in range(len(row)):
            if all(c in row[: k + 1] for c in candidates):
                return row[k::-1]
    shown = "; ".join(f"{j.name}: {j.parent} to {j.child}" for j in (candidates or moving)[:12])
    many = f"{len(candidates)} joints that may be the knee" if candidates else "no joint of a knee"
    expected = f"one; say which bodies with --femur BODY --tibia BODY ({shown or 'no joint'})"
    raise InputProblem(model.file.path, "knee joint", many, expected)


def _side(joint: Joint) -> str:
    """The side that a joint's names speak of; empty if none or both."""
    words = (joint.name, joint.parent, joint.child, *(c.name for c in joint.coordinates))
    said = {s for s in SIDES if any(_MARKS[s].search(w) for w in words)}
    return said.pop() if len(said) == 1 else ""


def _carries_upwards(joints: list[Joint], knee: list[Joint], upper: str, lower: str) -> bool:
    """Whether the body above a knee's joints is the tibia, by the names of what hangs on both."""
    votes = 0
    for body, sign in ((upper, 1), (lower, -1)):
        for names, weight, parts in (
            (_welded(joints, body, knee[0]), 3, (_TIBIA, _FEMUR)),
            (beyond(joints, knee, body), 1, (_FOOT, _ABOVE)),
        ):
            down, up = (any(part.search(name) for name in names) for part in parts)
            votes += sign * weight * (down - up)
    return votes > 0


def _welded(joints: list[Joint], body: str, knee: Joint) -> set[str]:
    """A body and those welded to it."""
    return connected(joints, [body], lambda j: j is not knee and j.fixed) - {GROUND}


def _held(movement: Movement, bone: str, knee: list[Joint]) -> dict[str, tuple[Rigid, str]]:
    """Bodies that do not move against a bone -> the motion to the bone's coordinates, and why."""
    def fixed(joint: Joint) -> bool:
        return joint.fixed and joint not in knee and not joint.on_ground

    at = kinematics.placed(movement.joints, bone, movement.values, through=fixed)
    return {bone: (at[bone], "")} | {
        other: (at[other], f"{joint.kind} {joint.name}" + ", locked" * bool(joint.coordinates))
        for joint, _, other in kinematics.reached(movement.joints, bone, fixed)}
