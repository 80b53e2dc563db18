"""Bodies and frames of an OpenSim model: schema 3 has joints inside bodies, schema 4 sockets."""

from __future__ import annotations

import dataclasses
import functools
import os
import posixpath
import re
from collections.abc import Iterator
from decimal import Decimal

import numpy as np

from kneejax.files.opensim._numbers import read_decimal
from kneejax.files.opensim._xml import Element, XmlFile, parse_xml

KIND = "an OpenSim model"
GROUND = "ground"
_METRE = ("m", "meter", "meters", "metre", "metres")
_NEWTON = ("n", "newton", "newtons")
#: Elements that hold no part of the model in use.
_ASIDE = ("defaults", "ControllerSet", "MarkerSet", "ProbeSet")

#: Sets of what acts, and how what stands elsewhere is known to.
_ACTING = ("ForceSet", "ConstraintSet")
_SWITCHES = ("appliesForce", "isEnforced", "isDisabled")
_ACTS = re.compile("(Force|Constraint|Ligament|Spring|Muscle|Actuator)[0-9]*$")

Point = tuple[Decimal, Decimal, Decimal]
ORIGIN: Point = (Decimal(0), Decimal(0), Decimal(0))


@dataclasses.dataclass(frozen=True)
class Offset:
    """A rigid motion `x -> rotation x + translation` in metres; exact where nothing turns.

    Attributes:
        rotation: shape `(3, 3)`; None where nothing turns.
        translation: m.
    """

    rotation: np.ndarray | None = None
    translation: Point = ORIGIN

    @classmethod
    def of(cls, translation: Point, angles: Point) -> Offset:
        """The motion from a frame's coordinates, by its place and its X-Y-Z angles (rad)."""
        return cls(turn_xyz(angles) if any(angles) else None, translation)

    @property
    def matrix(self) -> np.ndarray:
        """The rotation, also where nothing turns."""
        return np.eye(3) if self.rotation is None else self.rotation

    def point(self, x: Point) -> Point:
        """Image of a point."""
        return _sum(self._turned(x, self.matrix), self.translation)

    def point_back(self, x: Point) -> Point:
        """The point whose image is `x`."""
        minus = _minus(self.translation)
        return self._turned(_sum(x, minus), self.matrix.T)

    def after(self, first: Offset) -> Offset:
        """This motion after `first`."""
        if self.rotation is None or first.rotation is None:
            rotation = self.rotation if first.rotation is None else first.rotation
        else:
            rotation = self.rotation @ first.rotation
        return Offset(rotation, self.point(first.translation))

    def inverse(self) -> Offset:
        """The motion that undoes this one."""
        back = None if self.rotation is None else self.rotation.T
        return Offset(back, self._turned(_minus(self.translation), self.matrix.T))

    def _turned(self, x: Point, matrix: np.ndarray) -> Point:
        if self.rotation is None:
            return x
        a, b, c = (Decimal(repr(float(value))) for value in matrix @ np.array(x, float))
        return a, b, c


def turn_about(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rotation about a unit axis by an angle in rad, shape `(3, 3)` (Rodrigues)."""
    x, y, z = axis
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * skew + (1.0 - np.cos(angle)) * skew @ skew


def turn_xyz(angles) -> np.ndarray:
    """`Rx(a0) Ry(a1) Rz(a2)`, the body-fixed X-Y-Z sequence, from angles in rad."""
    x, y, z = (turn_about(axis, float(a)) for axis, a in zip(np.eye(3), angles, strict=True))
    return x @ y @ z


def angles_xyz(rotation: np.ndarray) -> np.ndarray:
    """Angles of the body-fixed X-Y-Z sequence, rad, shape `(3,)`."""
    middle = np.arctan2(rotation[0, 2], np.hypot(rotation[0, 0], rotation[0, 1]))
    first = np.arctan2(-rotation[1, 2], rotation[2, 2])
    return np.array([first, middle, np.arctan2(-rotation[0, 1], rotation[0, 0])])


class Model:
    """A model with the places of its bodies' frames.

    Attributes:
        file: the parsed file.
        root: the element Model.
        version: of the document, e.g. 40000.
        bodies: name -> element; ground among them.
        notes: what was assumed on reading.
        defaults: class -> element of `<defaults>`, whose values hold where an object has none.
        joints: what `read_joints` read, once it has.
    """

    def __init__(self, file: XmlFile):
        self.file = file
        self.version = _version(file)
        found = file.root.child("Model")
        if found is None:
            kinds = ", ".join(child.tag for child in file.root.children) or "nothing"
            raise file.problem(file.root, "content", kinds, f"{KIND}: an element Model")
        self.root = found
        self.notes: list[str] = []
        self.defaults = {element.tag: element for element in found.inside("defaults")}
        self._check_units()
        self.bodies: dict[str, Element] = {}
        self.frames: dict[str, Element] = {}
        for element in self.elements():
            if element.tag in ("Body", "Ground"):
                self.bodies.setdefault(element.name or GROUND, element)
            if element.tag in ("Body", "Ground", "PhysicalOffsetFrame"):
                self.frames.setdefault(_path(element), element)
        if GROUND not in self.bodies:  # OpenSim has one whether the file does or not
            ground = Element("Ground", {"name": GROUND}, found, found.line)
            self.bodies[GROUND] = self.frames[f"/{GROUND}"] = ground
        self._offsets: dict[int, tuple[str, Offset]] = {}
        self.joints: list | None = None

    def word(self, owner: Element, tag: str, default: str = "") -> str:
        """Text of a child, of the class's child in `<defaults>`, or `default`."""
        usual = self.defaults.get(owner.tag)
        return owner.word(tag) or (usual.word(tag) if usual is not None else "") or default

    def applied(self, force: Element) -> bool:
        """Whether a force acts or a constraint holds; some are switched off."""
        return (
            self.truth(force, "appliesForce", True)
            and self.truth(force, "isEnforced", True)
            and not self.truth(force, "isDisabled", False)
        )

    @functools.cached_property
    def _every(self) -> list[Element]:
        found, waiting = [], [self.root]
        while waiting:
            found.append(element := waiting.pop())
            waiting += [c for c in reversed(element.children) if c.tag not in _ASIDE]
        return found

    def elements(self) -> Iterator[Element]:
        """Everything in the model but defaults, controllers and markers."""
        return iter(self._every)

    def forces(self) -> Iterator[Element]:
        """Every force and every constraint, of whatever class."""
        for element in self.elements():
            around = [outer.tag for outer in element.ancestors() if outer.tag != "objects"]
            if not element.tag[:1].isupper() or not around:  # properties are written small
                continue
            acts = _ACTS.search(element.tag) or element.child(*_SWITCHES) is not None
            if around[0] in _ACTING or (around[0] == "components" and acts):
                yield element

    def named(self, name: str) -> str:
        """The body of a name, any case; InputProblem's list of names is for the caller."""
        by_lower = {known.lower(): known for known in self.bodies}
        return name if name in self.bodies else by_lower.get(name.lower(), "")

    def socket(self, owner: Element, name: str) -> tuple[str, Offset]:
        """The body of a frame that an element is connected to, and the frame's place on it.

        Args:
            owner: the element.
            name: of the socket, e.g. `parent_frame`.

        Returns:
            The body, and the motion from the frame's coordinates to the body's.

        Raises:
            InputProblem: there is no such frame.
        """
        tag = f"socket_{name}"
        word = owner.word(tag, f"{tag}_connectee_name")
        frame = self.frame(word, owner)
        if frame is None:
            expected = f"a frame of the model ({len(self.bodies)} bodies)"
            last = word.rstrip("/").rsplit("/", 1)[-1]
            raise self.file.problem(
                owner, tag, word or "missing", expected, _like(last, self.bodies)
            )
        return self.place(frame)

    def place(self, frame: Element) -> tuple[str, Offset]:
        """The body that carries a frame, and the motion from the frame's coordinates to its.

        Args:
            frame: a body, the ground, or an offset frame.
        """
        if id(frame) not in self._offsets:
            self._offsets[id(frame)] = GROUND, Offset()  # a frame that hangs on itself ends here
            if frame.tag == "PhysicalOffsetFrame":
                body, outer = self.socket(frame, "parent")
                own = Offset.of(self.point(frame, "translation"), self.point(frame, "orientation"))
                self._offsets[id(frame)] = body, outer.after(own)
            else:
                self._offsets[id(frame)] = frame.name or GROUND, Offset()
        return self._offsets[id(frame)]

    def body_of(self, owner: Element, tag: str) -> str:
        """The body that a schema 3 element names.

        Args:
            owner: the element.
            tag: the child with the name.
        """
        word = owner.word(tag)
        if word not in self.bodies:
            raise self.file.problem(
                owner, tag, word or "missing", "a body of the model", _like(word, self.bodies)
            )
        return word

    def numbers(self, owner: Element, tag: str, count: int, default: str = "") -> list[Decimal]:
        """Numbers of a child.

        Args:
            owner: the element.
            tag: the child.
            count: how many there must be.
            default: what is read if the child is absent or empty.

        Raises:
            InputProblem: they are not as many finite numbers.
        """
        word = self.word(owner, tag, default)
        try:
            values = [read_decimal(part) for part in word.split()]
        except (ValueError, ArithmeticError):
            values = []
        if len(values) != count:
            what = "a number" if count == 1 else f"{count} numbers"
            raise self.file.problem(owner, tag, word or "missing", what)
        return values

    def point(self, owner: Element, tag: str, default: str = "0 0 0") -> Point:
        """Three numbers of a child; likewise."""
        x, y, z = self.numbers(owner, tag, 3, default)
        return x, y, z

    def truth(self, owner: Element, tag: str, default: bool) -> bool:
        """A yes or no of a child."""
        word = self.word(owner, tag).lower()
        if word in ("true", "1"):
            return True
        if word in ("false", "0"):
            return False
        if word:
            raise self.file.problem(owner, tag, word, "true or false")
        return default

    def frame(self, word: str, owner: Element) -> Element | None:
        """The frame of a path: absolute, relative to its owner, or known by its last word."""
        if not word:
            return None
        path = word if word.startswith("/") else posixpath.join(_path(owner), word)
        exact = self.frames.get(posixpath.normpath(path))
        if exact is not None:
            return exact
        last = word.rstrip("/").rsplit("/", 1)[-1]
        if last in self.bodies:
            return self.bodies[last]
        same = [frame for frame in self.frames.values() if frame.name == last]
        return same[0] if len(same) == 1 else None

    def _check_units(self) -> None:
        for tag, known, unit in (
            ("length_units", _METRE, "m (metres)"), ("force_units", _NEWTON, "N (newtons)"),
        ):  # fmt: skip
            word = self.root.word(tag)
            if not word:
                self.notes.append(
                    f"The model does not state {tag}: OpenSim's default, {unit}, was assumed."
                )
            elif word.lower() not in known:
                raise self.file.problem(self.root, tag, word, unit)


def read_model(path: str | os.PathLike[str], data: bytes | None = None) -> Model:
    """Read an OpenSim model.

    Args:
        path: the file.
        data: its bytes, if they are at hand.

    Raises:
        InputProblem: it cannot be read, is not well-formed XML, not an OpenSim model, of a schema
            that is not known, or in other units than m and N.
    """
    return Model(parse_xml(path, KIND, data))


def _version(file: XmlFile) -> int:
    if file.root.tag != "OpenSimDocument":
        raise file.problem(file.root, "", file.root.tag, f"{KIND}, an OpenSimDocument")
    word = file.root.attributes.get("Version", "")
    if not word.isdecimal() or not 20000 <= int(word) < 50000:
        expected = "schema 2, 3 or 4: a version from 20000 to 49999"
        raise file.problem(file.root, "Version", word or "missing", expected)
    return int(word)


def _path(element: Element) -> str:
    """The component path, e.g. /bodyset/femur or /jointset/knee/femur_offset."""
    names = []
    for here in (element, *element.ancestors()):
        if here.tag == "Model":
            break
        if here.name or here.tag.endswith("Set"):
            names.append(here.name or here.tag.lower())
        elif here.tag == "Ground":
            names.append(GROUND)
    return "/" + "/".join(reversed(names))


def _like(word: str, names) -> tuple[str, ...]:
    return tuple(names) if word else ()


def _sum(a: Point, b: Point) -> Point:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _minus(a: Point) -> Point:
    return -a[0], -a[1], -a[2]
