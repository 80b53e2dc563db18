"""Joints of an OpenSim model: coordinates, axes, and where the child stands at their defaults."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from decimal import Decimal
from typing import Any

import numpy as np

from kneejax.files.opensim._functions import (
    FUNCTIONS,
    UnknownFunction,
    describe,
    evaluate,
    function_of,
)
from kneejax.files.opensim._model import Model, Offset, turn_about
from kneejax.files.opensim._xml import Element

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
_UNIT = {"x": np.eye(3)[0], "y": np.eye(3)[1], "z": np.eye(3)[2]}


@dataclasses.dataclass(frozen=True)
class Coordinate:
    """A coordinate of a joint.

    Attributes:
        name: its name.
        default: rad or m; what a function of time has at its beginning, where one prescribes it.
        range: rad or m; None if the file states none.
        locked: whether it cannot move.
        clamped: whether it stays within its range.
        prescribed: whether a function of time prescribes it.
    """

    name: str
    default: float
    range: tuple[float, float] | None
    locked: bool
    clamped: bool
    prescribed: bool = False


@dataclasses.dataclass(frozen=True)
class Axis:
    """A rotation or translation of a joint.

    Attributes:
        turns: whether it is a rotation.
        direction: unit vector in the axes that the rotations before it have turned.
        coordinates: names of the function's arguments.
        function: amount as a function of them; None for the coordinate itself.
    """

    turns: bool
    direction: np.ndarray
    coordinates: tuple[str, ...]
    function: Element | None


@dataclasses.dataclass(frozen=True)
class Joint:
    """A joint between two bodies.

    Attributes:
        element: in the file.
        kind: e.g. `CustomJoint`.
        parent: body.
        child: body.
        parent_frame: from the joint's frame on the parent to the parent.
        child_frame: likewise on the child.
        coordinates: in order.
        axes: in order, rotations first.
        reverse: whether the axes state the parent's motion in the child.
    """

    element: Element
    kind: str
    parent: str
    child: str
    parent_frame: Offset
    child_frame: Offset
    coordinates: tuple[Coordinate, ...]
    axes: tuple[Axis, ...]
    reverse: bool = False

    @property
    def name(self) -> str:
        """Its name."""
        return self.element.name

    @property
    def fixed(self) -> bool:
        """Whether nothing can move in it: a weld, or every coordinate locked."""
        return all(coordinate.locked for coordinate in self.coordinates)

    def placement(self, model: Model) -> Offset:
        """The motion from the child's to the parent's coordinates, at the coordinates' defaults.

        Args:
            model: the model, for errors.

        Raises:
            InputProblem: an axis has a function that is not supported, or its numbers are wrong.
        """
        values = {coordinate.name: coordinate.default for coordinate in self.coordinates}
        rotation, shift = np.eye(3), np.zeros(3)
        for axis in self.axes:
            amount = float(self.amount(axis, values, model))
            if axis.turns:
                rotation = rotation @ turn_about(axis.direction, amount)
            else:
                shift = shift + amount * axis.direction
        moved = Offset(
            None if np.array_equal(rotation, np.eye(3)) else rotation,
            tuple(Decimal(repr(float(x))) for x in shift),
        )
        if self.reverse:
            moved = moved.inverse()
        return self.parent_frame.after(moved).after(self.child_frame.inverse())

    def describe(self) -> list[str]:
        """Its coordinates and axes, a sentence each, for a report."""
        turning = {name for axis in self.axes if axis.turns for name in axis.coordinates}
        lines = []
        for coordinate in self.coordinates:
            angle = coordinate.name in turning
            scale, unit = (180.0 / np.pi, "degrees") if angle else (1e3, "mm")
            text = f"coordinate {coordinate.name}: default {coordinate.default * scale:.6g} {unit}"
            if coordinate.range is not None:
                lower, upper = (x * scale for x in coordinate.range)
                text += f", range {lower:.6g} to {upper:.6g}"
            for word in ("locked", "clamped"):
                text += f", {word}" if getattr(coordinate, word) else ""
            lines.append(text)
        for axis in self.axes:
            direction = " ".join(f"{x:.6g}" for x in axis.direction)
            amount = describe(axis.function) if axis.function is not None else "the coordinate"
            of = f" of {', '.join(axis.coordinates)}" if axis.coordinates else ""
            kind = "rotation about" if axis.turns else "translation along"
            lines.append(f"{kind} ({direction}): {amount}{of}")
        return lines

    def amount(self, axis: Axis, values: Mapping[str, Any], model: Model) -> Any:
        """How far an axis turns or shifts, rad or m.

        Args:
            axis: one of the joint's.
            values: coordinate -> its value, rad or m, a number or an array.
            model: the model, for errors.
        """
        arguments = [values.get(name, 0.0) for name in axis.coordinates]
        if axis.function is None:
            return arguments[0] if arguments else 0.0
        return _value(model, axis.function, arguments, self.name)


def _value(model: Model, function: Element, arguments: list, of: str) -> Any:
    try:
        return evaluate(function, arguments)
    except UnknownFunction as kind:
        expected = f"one of the functions that are supported: {', '.join(FUNCTIONS)}"
        raise model.file.problem(function, f"function of {of}", str(kind), expected) from None
    except ValueError as error:
        expected = "the numbers of this kind of function"
        raise model.file.problem(function, "numbers", str(error), expected) from None


def couplers(model: Model) -> Iterator[tuple[Element, str, tuple[str, ...]]]:
    """Constraints by which a coordinate follows others.

    Args:
        model: the model.

    Yields:
        The constraint, the coordinate that follows, and those that it follows.
    """
    for element in model.elements():
        if element.tag == "CoordinateCouplerConstraint" and model.applied(element):
            leading = tuple(model.word(element, "independent_coordinate_names").split())
            yield element, model.word(element, "dependent_coordinate_name"), leading


def follow(model: Model, values: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """Values of coordinates where couplers hold.

    Args:
        model: the model.
        values: coordinate -> rad or m, at its default where it is not given.
        given: coordinates that were said; these follow nothing.

    Returns:
        `values`, those that follow others renewed.
    """
    values, known = dict(values), list(couplers(model))
    for _ in known:  # one may follow another
        for element, name, leading in known:
            function = function_of(element)
            if name in given or name not in values or function is None:
                continue
            arguments = [values.get(one, 0.0) for one in leading]
            scale = float(model.numbers(element, "scale_factor", 1, "1")[0])
            values[name] = scale * _value(model, function, arguments, element.name)
    return values


def read_joints(model: Model) -> list[Joint]:
    """Every joint of a model.

    Args:
        model: the model.

    Raises:
        InputProblem: a joint names a body or frame that does not exist, or its numbers are not
            numbers.
    """
    if model.joints is None:
        model.joints = _read(model)
    return [*model.joints]


def _read(model: Model) -> list[Joint]:
    joints = [
        _joint(model, element)
        for element in model.elements()
        if element.tag.endswith("Joint") and element.tag != "Joint"
    ]
    if not any(True for _ in couplers(model)):
        return joints
    every = [c for joint in joints for c in joint.coordinates]
    fixed = {c.name: c.default for c in every if c.prescribed or c.locked}
    values = follow(model, {c.name: c.default for c in every}, fixed)
    return [
        dataclasses.replace(
            joint,
            coordinates=tuple(
                dataclasses.replace(c, default=float(values[c.name])) for c in joint.coordinates
            ),
        )
        for joint in joints
    ]


def _joint(model: Model, element: Element) -> Joint:
    outer = next((e for e in element.ancestors() if e.tag == "Body"), None)
    if element.child("parent_body") is not None and outer is not None:
        parent, child = model.body_of(element, "parent_body"), outer.name
        parent_frame, child_frame = (
            Offset.of(model.point(element, place), model.point(element, turn))
            for place, turn in (
                ("location_in_parent", "orientation_in_parent"), ("location", "orientation"),
            )
        )  # fmt: skip
    else:
        parent, parent_frame = model.socket(element, "parent_frame")
        child, child_frame = model.socket(element, "child_frame")
    listed = element.inside("coordinates") or element.inside("CoordinateSet", "objects")
    coordinates = tuple(_coordinate(model, c) for c in listed if c.tag == "Coordinate")
    return Joint(
        element,
        element.tag,
        parent,
        child,
        parent_frame,
        child_frame,
        coordinates,
        _axes(model, element, coordinates),
        model.truth(element, "reverse", False),
    )


def _coordinate(model: Model, element: Element) -> Coordinate:
    limits = None
    if model.word(element, "range"):
        lower, upper = model.numbers(element, "range", 2)
        limits = float(lower), float(upper)
    default = float(model.numbers(element, "default_value", 1, "0")[0])
    locked, function = model.truth(element, "locked", False), function_of(element)
    prescribed = model.truth(element, "prescribed", False) and function is not None and not locked
    if prescribed:
        assert function is not None
        default = float(_value(model, function, [0.0], element.name))
    return Coordinate(
        element.name, default, limits, locked, model.truth(element, "clamped", False), prescribed
    )


def _axes(model: Model, element: Element, coordinates: tuple[Coordinate, ...]) -> tuple[Axis, ...]:
    if element.tag in _AXES:
        pairs = zip(_AXES[element.tag], coordinates, strict=False)
        return tuple(Axis(a[0] == "R", _UNIT[a[1]], (c.name,), None) for a, c in pairs)
    answer = []
    for axis in element.inside("SpatialTransform"):
        if axis.tag != "TransformAxis":
            continue
        direction = np.array(model.point(axis, "axis"), float)
        size = float(np.linalg.norm(direction))
        function, names = function_of(axis), tuple(axis.word("coordinates").split())
        if size == 0:
            if function is None and not names:
                continue
            raise model.file.problem(axis, "axis", axis.word("axis") or "missing", "a direction")
        if function is not None or names:
            turns = axis.name.lower().startswith("rotation")
            answer.append(Axis(turns, direction / size, names, function))
    return tuple(sorted(answer, key=lambda axis: not axis.turns))
