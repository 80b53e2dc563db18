"""Joints of an OpenSim model, and where its bodies are at coordinates: forward kinematics."""

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from kneejax.files.opensim.exact import Rigid, decimals, turn_about
from kneejax.files.opensim.model import GROUND, Model, describe, evaluate, function_of
from kneejax.files.opensim.xml import Element
from kneejax.files.tables.storage import Storage, last_word

#: Kinds of joint -> axes along or about which their coordinates go, in order: R rotation, T
#: translation. A custom joint states its own.
_AXES = {
    "WeldJoint": (),
    "PinJoint": ("Rz",),
    "SliderJoint": ("Tx",),
    "UniversalJoint": ("Rx", "Ry"),
    "BallJoint": ("Rx", "Ry", "Rz"),
    "GimbalJoint": ("Rx", "Ry", "Rz"),
    "PlanarJoint": ("Rz", "Tx", "Ty"),
    "FreeJoint": ("Rx", "Ry", "Rz", "Tx", "Ty", "Tz"),
}


class Coordinate(NamedTuple):
    """A coordinate of a joint."""

    name: str
    # rad or m; what a function of time has at its beginning, where one prescribes it
    default: float
    range: tuple[float, float] | None  # rad or m; None if the file states none
    locked: bool  # whether it cannot move
    clamped: bool  # whether it stays within its range
    turns: bool  # whether it is an angle
    prescribed: Element | None = None  # the function of time that prescribes it; None without

    @property
    def unit(self) -> tuple[float, str]:
        """Degrees in a rad or mm in a m, and what that unit is called."""
        return (180.0 / np.pi, "degrees") if self.turns else (1e3, "mm")


class Axis(NamedTuple):
    """A rotation or translation of a joint."""

    turns: bool  # whether it is a rotation
    direction: np.ndarray  # unit vector in the axes that the rotations before it have turned
    coordinates: tuple[str, ...]  # names of the function's arguments
    function: Element | None  # amount as a function of them; None for the coordinate itself


@dataclasses.dataclass(frozen=True, eq=False)
class Joint:
    """A joint between two bodies."""

    element: Element
    name: str
    kind: str  # its class, e.g. `CustomJoint`
    parent: str
    child: str
    parent_frame: Rigid  # from the joint's frame on the parent to the parent
    child_frame: Rigid  # likewise on the child
    coordinates: tuple[Coordinate, ...]
    axes: tuple[Axis, ...]  # in order, rotations first
    reverse: bool = False  # whether the axes state the parent's motion in the child

    @property
    def fixed(self) -> bool:
        """Whether nothing can move in it: a weld, or every coordinate locked."""
        return all(coordinate.locked for coordinate in self.coordinates)

    @property
    def ends(self) -> tuple[tuple[str, Rigid], tuple[str, Rigid]]:
        """Both bodies, and the joint's frame on each."""
        return (self.parent, self.parent_frame), (self.child, self.child_frame)

    @property
    def on_ground(self) -> bool:
        """Whether one of its bodies is the ground."""
        return GROUND in (self.parent, self.child)

    def other(self, body: str) -> str:
        """The body that it joins to this one; empty where it does not."""
        return {self.parent: self.child, self.child: self.parent}.get(body, "")

    def placement(self, values: Mapping[str, Any], shape: tuple[int, ...] | None) -> Rigid:
        """The motion from child to parent at coordinates, rad or m, of a shape (None: numbers)."""
        every = shape or ()
        turn, shift = np.broadcast_to(np.eye(3), (*every, 3, 3)), np.zeros((*every, 3))
        for axis in self.axes:
            arguments = [values.get(name, 0.0) for name in axis.coordinates]
            amount = arguments[0] if arguments else 0.0
            if axis.function is not None:
                amount = evaluate(axis.function, arguments)
            amount = np.broadcast_to(np.asarray(amount, float), every)
            if axis.turns:
                turn = turn @ turn_about(axis.direction, amount)
            else:
                shift = shift + amount[..., None] * axis.direction
        moved = Rigid(turn, decimals(shift) if shape is None else shift)
        moved = moved.inverse() if self.reverse else moved
        return self.parent_frame.after(moved).after(self.child_frame.inverse())

    def describe(self) -> list[str]:
        """Its coordinates and axes, a sentence each, for a report."""
        lines = []
        for coordinate in self.coordinates:
            scale, unit = coordinate.unit
            text = f"coordinate {coordinate.name}: default {coordinate.default * scale:.6g} {unit}"
            if coordinate.range is not None:
                text += ", range " + " to ".join(f"{x * scale:.6g}" for x in coordinate.range)
            text += ", locked" * coordinate.locked + ", clamped" * coordinate.clamped
            lines.append(text)
        for axis in self.axes:
            direction = " ".join(f"{x:.6g}" for x in axis.direction)
            amount = describe(axis.function) if axis.function is not None else "the coordinate"
            of = f" of {', '.join(axis.coordinates)}" if axis.coordinates else ""
            kind = "rotation about" if axis.turns else "translation along"
            lines.append(f"{kind} ({direction}): {amount}{of}")
        return lines


class Movement(NamedTuple):
    """A model that moves."""

    model: Model
    joints: tuple[Joint, ...]
    values: dict[str, np.ndarray]  # coordinate -> rad or m, one shape `(...)`
    placed: dict[str, Rigid]  # body -> where it is in the ground

    def between(self, first: str, second: str) -> Rigid:
        """Where a body is in another: from the second's coordinates to the first's."""
        return self.placed[first].inverse().after(self.placed[second])

    def at(self, row: int) -> "Movement":
        """At one of the instants along the first axis."""
        values = {name: x[row] for name, x in self.values.items()}
        placed = {name: there.at(row) for name, there in self.placed.items()}
        return Movement(self.model, self.joints, values, placed)


def reached(
    joints: Iterable[Joint], body: str, through: Callable[[Joint], bool] = lambda _: True
) -> Iterator[tuple[Joint, str, str]]:
    """Outwards, breadth first: a joint, the body it is reached from, the one it leads to."""
    seen, waiting = {body}, [body]
    while waiting:
        here = waiting.pop(0)
        for joint in joints:
            other = joint.other(here)
            if other and other not in seen and through(joint):
                seen.add(other)
                waiting.append(other)
                yield joint, here, other


def placed(
    joints: Iterable[Joint], body: str, values: Mapping[str, Any],
    shape: tuple[int, ...] | None = None, through: Callable[[Joint], bool] = lambda _: True,
) -> dict[str, Rigid]:  # fmt: skip
    """Where bodies are in one of them: at arrays of a shape, or exactly at numbers (None)."""
    still = () if shape is None else (np.broadcast_to(np.eye(3), (*shape, 3, 3)),
                                      np.zeros((*shape, 3)))
    found = {body: Rigid(*still)}
    for joint, here, other in reached(joints, body, through):
        step = joint.placement(values, shape)
        found[other] = found[here].after(step if other == joint.child else step.inverse())
    return found


def moved(model: Model, values: Mapping[str, Any]) -> Movement:
    """A model at coordinates, rad or m, of one shape; others at their defaults or coupled."""
    joints = read_joints(model)
    shape = np.shape(next(iter(values.values()))) if values else ()
    known = coordinates_of(joints)
    every = {c.name: values.get(c.name, c.default) for c in known}
    every = {name: np.broadcast_to(x, shape)
             for name, x in _followed(model, known, every, values).items()}
    # A body that no joint carries begins at the ground, as in OpenSim.
    carried = {joint.child for joint in joints}
    free = [joint.parent for joint in joints if joint.parent not in carried]
    found: dict[str, Rigid] = {}
    for body in (GROUND, *free, *model.bodies):
        if body not in found:
            found |= placed(joints, body, every, shape or None)
    return Movement(model, tuple(joints), every, found)


def coordinates_of(joints: Iterable[Joint]) -> list[Coordinate]:
    """All coordinates of joints."""
    return [coordinate for joint in joints for coordinate in joint.coordinates]


def coordinate_columns(model: Model, table: Storage) -> dict[str, str]:
    """Coordinate of a model -> the column of a table that has it."""
    known = {c.name for c in coordinates_of(read_joints(model))}
    return {last_word(name): name for name in table.columns if last_word(name) in known}


def couplers(model: Model) -> Iterator[tuple[Element, str, tuple[str, ...]]]:
    """Constraints that hold, the coordinate that follows others by each, and those others."""
    for element in model.elements:
        if element.tag == "CoordinateCouplerConstraint" and element.applied:
            leading = tuple(element.word("independent_coordinate_names").split())
            yield element, element.word("dependent_coordinate_name"), leading


def read_joints(model: Model) -> list[Joint]:
    """Every joint of a model, its coordinates at defaults that obey the couplers."""
    if model.joints is None:
        joints = [_joint(model, element) for element in model.elements
                  if element.tag.endswith("Joint") and element.tag != "Joint"]
        every = coordinates_of(joints)
        values = _followed(model, every, {c.name: c.default for c in every}, ())
        model.joints = [dataclasses.replace(joint, coordinates=tuple(
            c._replace(default=float(values[c.name])) for c in joint.coordinates))
            for joint in joints]
    return model.joints


def _followed(
    model: Model, coordinates: Iterable[Coordinate], values: Mapping[str, Any], given: Iterable[str]
) -> dict[str, Any]:
    """Coordinates, rad or m, where couplers hold; what is given, locked or prescribed stays."""
    values, fixed = dict(values), {
        *given, *(c.name for c in coordinates if c.locked or c.prescribed is not None)}
    known = [(*one, function_of(one[0])) for one in couplers(model) if one[1] not in fixed]
    for element, name, leading, function in known * len(known):  # one may follow another
        if name in values and function is not None:
            arguments = [values.get(one, 0.0) for one in leading]
            values[name] = element.number("scale_factor", "1") * evaluate(function, arguments)
    return values


def _joint(model: Model, element: Element) -> Joint:
    outer = next(element.iterancestors("Body"), None)
    if element.child("parent_body") is not None and outer is not None:
        parent, child = model.carrier(element, "parent_body", "")[0], outer.name
        parent_frame, child_frame = (
            Rigid.of(element.point(f"location{where}"), element.point(f"orientation{where}"))
            for where in ("_in_parent", ""))
    else:
        parent, parent_frame = model.socket(element, "parent_frame")
        child, child_frame = model.socket(element, "child_frame")
    listed = element.xpath("(coordinates[1] | CoordinateSet[1]/objects[1])/Coordinate")
    axes = []
    if element.tag in _AXES:
        axes = [Axis(kind == "R", np.eye(3)["xyz".index(along)], (c.name,), None)
                for (kind, along), c in zip(_AXES[element.tag], listed, strict=False)]
    for axis in element.findall("SpatialTransform[1]/*") if element.tag not in _AXES else ():
        function, names = function_of(axis), tuple(axis.word("coordinates").split())
        if axis.tag != "TransformAxis" or (function is None and not names):
            continue
        direction = np.array(axis.point("axis"), float)
        size = float(np.linalg.norm(direction))
        if size == 0:
            raise axis.problem("axis", axis.word("axis") or "missing", "a direction")
        turns = axis.name.lower().startswith("rotation")
        axes.append(Axis(turns, direction / size, names, function))
    axes.sort(key=lambda axis: not axis.turns)
    angles = {name for axis in axes if axis.turns for name in axis.coordinates}
    coordinates = []
    for c in listed:
        lower, upper = map(float, c.numbers("range", 2, "0 0"))
        default, locked = c.number("default_value", "0"), c.truth("locked", False)
        prescribed = not locked and c.truth("prescribed", False)
        function = function_of(c) if prescribed else None
        if function is not None:
            default = float(evaluate(function, [0.0]))
        coordinates.append(Coordinate(
            c.name, default, (lower, upper) if c.word("range") else None, locked,
            c.truth("clamped", False), c.name in angles, function))
    return Joint(element, element.name, element.tag, parent, child, parent_frame, child_frame,
                 tuple(coordinates), tuple(axes), element.truth("reverse", False))
