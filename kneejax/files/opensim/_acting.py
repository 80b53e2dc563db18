"""What acts on the knee of a model and was not read: every force and constraint, of any class."""

from __future__ import annotations

import collections
import dataclasses
from collections.abc import Collection, Iterable

from kneejax.files.opensim._joints import read_joints
from kneejax.files.opensim._knee import OsimKneeJoint, beyond, is_between
from kneejax.files.opensim._model import GROUND, Model
from kneejax.files.opensim._xml import Element
from kneejax.geometry import PATELLA

ACTS, IN_MOTION, DRIVEN, OFF, ELSEWHERE = (
    "acts on the knee", "acts on the knee in motion only", "acts on the knee when it is driven",
    "would act on the knee, switched off in the model", "does not act on this knee",
)  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Untaken:
    """A force or a constraint of a model that is no part of the imported knee.

    Attributes:
        element: in the file.
        how: one of the sentences above.
        on: the bodies and coordinates of the knee that it is attached to.
        muscle_or_patella: whether it goes with these.
    """

    element: Element
    how: str
    on: tuple[str, ...]
    muscle_or_patella: bool

    @property
    def name(self) -> str:
        """Its name, its class where it has none, and which coordinate a coupler drives."""
        drives = self.element.word("dependent_coordinate_name")
        return (self.element.name or self.element.tag) + (f" drives {drives}" if drives else "")


def untaken(model: Model, knee: OsimKneeJoint, taken: Iterable[Element]) -> list[Untaken]:
    """Forces and constraints that were not read.

    One acts on the knee if it joins bodies on two sides of its joints, of which one is the femur,
    the tibia, the patella or a meniscus, or if it names a coordinate of these joints. Its class
    does not matter: every word of it that is the name of a body, of a frame or contact geometry on
    one, or of a coordinate counts.

    Args:
        model: the model.
        knee: its bones.
        taken: elements that were read or about which everything has been said.
    """
    joints, known = read_joints(model), {id(element) for element in taken}
    own = {id(joint.element) for joint in knee.joints}
    between = [x for x in joints if is_between(x) and {x.parent, x.child} & {*knee.rigid}]
    cut = [*between, *(joint for joint in joints if id(joint.element) in own)]
    inner = {body for joint in between for body in beyond(joints, cut, joint.child)}
    parts: dict[str, int] = {}
    for body in [knee.femur, knee.tibia, *model.bodies]:
        if body not in parts:
            part = len(parts)
            parts |= {other: part for other in beyond(joints, cut, body) if other not in parts}
    ends = ((joint.parent, joint.child) for joint in joints)
    on_ground = [parts[x] for pair in ends if GROUND in pair for x in pair if x != GROUND]
    parts[GROUND] = joined = on_ground[0] if on_ground else parts[knee.femur]
    near = {*knee.rigid, *inner}
    bodies = _bodies(model)
    coordinates = {
        c.name for joint in cut for c in joint.coordinates
        if {joint.parent, joint.child} & near
    }  # fmt: skip
    answer = []
    for element in model.forces():
        if id(element) in known:
            continue
        on, asked = _attached(model, element, bodies, coordinates)
        sides = {parts[body] for body in on}
        alone = not any(child.tag.endswith("Path") for child in element.children) and len(on) == 1
        across = len(sides) > 1 or (alone and sides != {joined})
        how = ELSEWHERE
        if asked or (across and on & near):
            how = _how(model, element)
        patella = any(knee.rigid.get(body, ("",))[0] == PATELLA for body in on)
        said = tuple(sorted(on & near if across else set()) + sorted(asked))
        answer.append(Untaken(element, how, said, patella or element.tag.endswith("Muscle")))
    return answer


def listed(found: Collection[Untaken]) -> list[str]:
    """Things counted by class, with their names and what they are attached to.

    Example:
        >>> listed([])
        []
    """
    by_class = collections.defaultdict(list)
    for one in found:
        by_class[one.element.tag].append(one)
    lines = []
    for tag, many in sorted(by_class.items()):
        on = sorted({word for one in many for word in one.on})
        where = f", on {', '.join(on)}" if {*on} - {one.name for one in many} else ""
        lines.append(f"{tag} ({len(many)}): {', '.join(one.name for one in many)}{where}")
    return lines


def _bodies(model: Model) -> dict[str, str]:
    """Name of a body, or of a frame or a geometry on one -> the body."""
    found = {body: body for body in model.bodies}
    by_name = collections.defaultdict(set)
    for frame in model.frames.values():
        by_name[frame.name].add(model.place(frame)[0])
    for element in model.elements():
        if element.parent is None or element.parent.tag not in ("objects", "ContactGeometrySet"):
            continue
        if any(outer.tag == "ContactGeometrySet" for outer in element.ancestors()):
            word = element.word("body_name", "socket_frame", "socket_frame_connectee_name")
            frame = model.frame(word, element)
            if frame is not None:
                by_name[element.name].add(model.place(frame)[0])
    for name, places in by_name.items():
        if len(places) == 1:
            found.setdefault(name, *places)
    return found


def _attached(
    model: Model, element: Element, bodies: dict[str, str], coordinates: set[str]
) -> tuple[set[str], set[str]]:
    """Bodies and coordinates that anything within an element names."""
    on, asked = set(), set()
    for leaf in element.walk():
        if leaf.children or leaf.tag == "wrap_object":
            continue
        for word in leaf.text.split():
            last = word.rstrip("/").rsplit("/", 1)[-1]
            frame = model.frame(word, leaf.parent) if leaf.tag.startswith("socket_") else None
            if last in coordinates:
                asked.add(last)
            elif frame is not None:
                on.add(model.place(frame)[0])
            elif last in bodies:
                on.add(bodies[last])
    return on, asked


def _how(model: Model, element: Element) -> str:
    if not model.applied(element):
        return OFF
    if element.tag.endswith("Actuator"):
        return DRIVEN
    stiff = [e for e in element.walk() if "stiffness" in e.tag and not e.children]
    expressed = any("expression" in e.tag and e.text not in ("", "0") for e in element.walk())
    if stiff and not expressed and not any(_numbers(e.text) for e in stiff):
        return IN_MOTION
    return ACTS


def _numbers(text: str) -> bool:
    """Whether a text holds anything but zeros."""
    return any(word.strip("0.+-") for word in text.lower().split("e")[0].split())
