"""Pelvis and foot of a model, held still against femur and tibia: what muscles and bands go to."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from kneejax.files.opensim._joints import Coordinate, Joint, read_joints
from kneejax.files.opensim._knee import OsimKneeJoint, is_between, placed
from kneejax.files.opensim._model import GROUND, Model
from kneejax.files.reading import InputProblem
from kneejax.geometry import FEMUR, TIBIA


def with_pelvis_and_foot(
    model: Model, knee: OsimKneeJoint, at: Mapping[str, float] | None = None
) -> OsimKneeJoint:
    """The knee with the bodies above the femur and below the tibia as parts of these bones.

    What comes from the pelvis begins at a point of the femur then, which is that of one pose of
    the hip.

    Args:
        model: the model.
        knee: its bones.
        at: coordinate of hip or foot -> its value, degrees or mm; the others have the model's
            defaults.

    Returns:
        The knee; its own bones and pose are what they were.

    Raises:
        InputProblem: a coordinate that no joint of hip or foot has, or one out of its range.
    """
    joints, own = read_joints(model), ((FEMUR, knee.femur), (TIBIA, knee.tibia))
    above = {joint.child: joint for joint in joints}
    upper = {bone: _chain(above, knee, body) for bone, body in own}
    # The femur carries the pelvis where the tibia carries the femur.
    standing = any(joint.child in knee.rigid and knee.rigid[joint.child][0] == FEMUR
                   for joint in knee.joints)  # fmt: skip
    lower = {FEMUR: _below(joints, knee, FEMUR) if standing else [],
             TIBIA: _below(joints, knee, TIBIA)}  # fmt: skip
    for name, value in (at or {}).items():
        moving = [joint for part in (upper, lower) for found in part.values() for joint in found]
        joint, coordinate = _asked(model, moving, name, value)
        set_to = dataclasses.replace(coordinate, default=value / _unit(joint, name)[0])
        others = (set_to if x is coordinate else x for x in joint.coordinates)
        above[joint.child] = dataclasses.replace(above[joint.child], coordinates=tuple(others))
    rigid = dict(knee.rigid)
    for bone, body in own:
        turn = knee.rigid[body][1]
        further = [x.parent for x in upper[bone]] + [x.child for x in lower[bone]]
        for other in further:
            if other not in rigid and other in model.bodies:
                rigid[other] = bone, turn.after(_motion(model, above, body, other))
    return dataclasses.replace(knee, rigid=rigid)


def posed(at: Mapping[str, float] | None) -> str:
    """Where hip and foot are, in words that follow what is there; empty at the defaults.

    Example:
        >>> posed({"hip_flexion_r": 30.0})
        ' at hip_flexion_r=30'
    """
    return f" at {', '.join(f'{name}={value:g}' for name, value in at.items())}" if at else ""


def standing(where: str) -> str:
    """A sentence on the ends of what comes from pelvis or foot, which are `posed` somewhere."""
    return (
        "Pelvis and foot stand where the model's default coordinates have them"
        + (f", but for{where.removeprefix(' at')}" if where else "")
        + ": what comes from there begins or ends at a fixed point of the femur or the tibia."
    )


def _chain(above: dict[str, Joint], knee: OsimKneeJoint, body: str) -> list[Joint]:
    """Joints from a bone upwards, as far as the knee's."""
    answer: list[Joint] = []
    while body in above and above[body] not in answer:
        if any(above[body].element is joint.element for joint in knee.joints):
            break
        answer.append(above[body])
        body = above[body].parent
    return answer


def _below(joints: list[Joint], knee: OsimKneeJoint, own: str) -> list[Joint]:
    """Joints of what a bone carries, from the bone on, without those of the knee."""
    answer: list[Joint] = []
    waiting = [name for name, (bone, _) in knee.rigid.items() if bone == own]
    while waiting:
        at = waiting.pop()
        for joint in joints:
            if is_between(joint) or any(joint.element is x.element for x in knee.joints):
                continue
            if joint.parent == at and joint.child not in knee.rigid and joint not in answer:
                answer.append(joint)
                waiting.append(joint.child)
    return answer


def _motion(model: Model, above: dict[str, Joint], bone: str, body: str):
    """From a body's coordinates to a bone's."""
    return placed(model, above, bone).inverse().after(placed(model, above, body))


def _asked(model: Model, joints: list[Joint], name: str, value: float) -> tuple[Joint, Coordinate]:
    """The coordinate of a name, which may have this value."""
    known = {x.name: (j, x) for j in joints if j.parent != GROUND for x in j.coordinates}
    if name not in known:
        expected = f"a coordinate of hip or foot: {', '.join(known) or 'the model has none'}"
        raise InputProblem(model.file.path, "--at", name, expected, known)
    joint, coordinate = known[name]
    scale, unit = _unit(joint, name)
    if coordinate.range is not None:
        lower, upper = (x * scale for x in coordinate.range)
        if not lower <= value <= upper:
            expected = f"{lower:.6g} to {upper:.6g} {unit}, its range in the model"
            raise InputProblem(model.file.path, f"--at {name}", f"{value:g}", expected)
    return joint, coordinate


def _unit(joint: Joint, name: str) -> tuple[float, str]:
    """Degrees in a rad or mm in a m, and what that unit is called."""
    if any(axis.turns and name in axis.coordinates for axis in joint.axes):
        return 180.0 / np.pi, "degrees"
    return 1e3, "mm"
