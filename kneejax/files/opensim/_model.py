"""Bodies and frames of an OpenSim model: schema 3 has joints inside bodies, schema 4 sockets."""

from __future__ import annotations

import os
import posixpath
import re
from collections.abc import Iterator
from pathlib import Path

from kneejax.files.opensim._exact import Rigid
from kneejax.files.opensim._xml import Element, XmlFile, parse_xml

KIND = "an OpenSim model"
GROUND = "ground"
_UNITS = (
    ("length_units", ("m", "meter", "meters", "metre", "metres"), "m (metres)"),
    ("force_units", ("n", "newton", "newtons"), "N (newtons)"),
)
#: Elements that hold no part of the model in use.
_ASIDE = ("defaults", "ControllerSet", "MarkerSet", "ProbeSet")
#: Sets of what acts, and how what stands elsewhere is known to.
_ACTING = ("ForceSet", "ConstraintSet")
_SWITCHES = ("appliesForce", "isEnforced", "isDisabled")
_ACTS = re.compile("(Force|Constraint|Ligament|Spring|Muscle|Actuator)[0-9]*$")


class Model:
    """A model with the places of its bodies' frames.

    Attributes:
        file: the parsed file.
        root: the element Model.
        version: of the document, e.g. 40000.
        elements: everything in the model but defaults, controllers and markers.
        bodies: name -> element; ground among them.
        frames: path of a component -> element, of bodies and offset frames.
        notes: what was assumed on reading.
        joints: what `read_joints` read, once it has.
    """

    def __init__(self, file: XmlFile):
        self.file = file
        if file.root.tag != "OpenSimDocument":
            raise file.root.problem("", file.root.tag, f"{KIND}, an OpenSimDocument")
        word = file.root.get("Version", "")
        if not word.isdecimal() or not 20000 <= int(word) < 50000:
            expected = "schema 2, 3 or 4: a version from 20000 to 49999"
            raise file.root.problem("Version", word or "missing", expected)
        self.version = int(word)
        found = file.root.child("Model")
        if found is None:
            kinds = ", ".join(child.tag for child in file.root.children) or "nothing"
            raise file.root.problem("content", kinds, f"{KIND}: an element Model")
        self.root = found
        self.notes: list[str] = []
        for tag, known, unit in _UNITS:
            word = found.word(tag)
            if not word:
                self.notes.append(
                    f"The model does not state {tag}: OpenSim's default, {unit}, was assumed."
                )
            elif word.lower() not in known:
                raise found.problem(tag, word, unit)
        self.elements: list[Element] = []
        waiting = [found]
        while waiting:
            self.elements.append(element := waiting.pop())
            waiting += [c for c in reversed(element.children) if c.tag not in _ASIDE]
        self.bodies: dict[str, Element] = {}
        self.frames: dict[str, Element] = {}
        for element in self.elements:
            if element.tag in ("Body", "Ground"):
                self.bodies.setdefault(element.name or GROUND, element)
            if element.tag in ("Body", "Ground", "PhysicalOffsetFrame"):
                self.frames.setdefault(_path(element), element)
        if GROUND not in self.bodies:  # OpenSim has one whether the file does or not
            ground = found.makeelement("Ground", name=GROUND)
            self.bodies[GROUND] = self.frames[f"/{GROUND}"] = ground
        self._offsets: dict[Element, tuple[str, Rigid]] = {}
        self.joints: list | None = None

    @property
    def name(self) -> str:
        """The file's name, without folders."""
        return self.file.path.name

    def forces(self) -> Iterator[Element]:
        """Every force and every constraint, of whatever class."""
        for element in self.elements:
            if not element.tag[:1].isupper() or element is self.root:  # properties are small
                continue
            around = [outer.tag for outer in element.iterancestors() if outer.tag != "objects"]
            acts = _ACTS.search(element.tag) or element.child(*_SWITCHES) is not None
            if around[0] in _ACTING or (around[0] == "components" and acts):
                yield element

    def muscles(self) -> list[Element]:
        """Every muscle, of whatever class."""
        return [element for element in self.elements if element.tag.endswith("Muscle")]

    def named(self, name: str) -> str:
        """The body of a name, any case; empty if there is none."""
        by_lower = {known.lower(): known for known in self.bodies}
        return name if name in self.bodies else by_lower.get(name.lower(), "")

    def socket(self, owner: Element, name: str) -> tuple[str, Rigid]:
        """The body of a frame that an element's socket names, and the motion from the frame's
        coordinates to the body's; InputProblem if there is no such frame."""
        tag = f"socket_{name}"
        tags = tag, f"{tag}_connectee_name"
        frame = self.frame(owner.word(*tags), owner)
        if frame is None:
            expected = f"a frame of the model ({len(self.bodies)} bodies)"
            nearest = tuple(self.bodies) if owner.last_word(*tags) else ()
            word = owner.word(*tags) or "missing"
            raise owner.problem(tag, word, expected, nearest)
        return self.place(frame)

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

    def place(self, frame: Element) -> tuple[str, Rigid]:
        """The body that carries a body, the ground or an offset frame, and the motion to it."""
        if frame not in self._offsets:
            self._offsets[frame] = GROUND, Rigid()  # a frame that hangs on itself ends here
            if frame.tag == "PhysicalOffsetFrame":
                body, outer = self.socket(frame, "parent")
                own = Rigid.of(frame.point("translation"), frame.point("orientation"))
                self._offsets[frame] = body, outer.after(own)
            else:
                self._offsets[frame] = frame.name or GROUND, Rigid()
        return self._offsets[frame]

    def body_of(self, owner: Element, tag: str) -> str:
        """The body that an element of schema 3 names; InputProblem if there is none."""
        word = owner.word(tag)
        if word not in self.bodies:
            nearest = tuple(self.bodies) if word else ()
            raise owner.problem(tag, word or "missing", "a body of the model", nearest)
        return word


def read_model(path: str | os.PathLike[str], data: bytes | None = None) -> Model:
    """Read an OpenSim model, in m and N, of a schema that is known, from a file or its bytes."""
    return Model(parse_xml(path, KIND, data))


def _path(element: Element) -> str:
    """The component path, e.g. /bodyset/femur or /jointset/knee/femur_offset."""
    names = []
    for here in (element, *element.iterancestors()):
        if here.tag == "Model":
            break
        if here.name or here.tag.endswith("Set"):
            names.append(here.name or here.tag.lower())
        elif here.tag == "Ground":
            names.append(GROUND)
    return "/" + "/".join(reversed(names))


#: A right knee of one hinge and one fibre, for examples: in schema 4, in metres and newtons.
SMALLEST_MODEL = Path(__file__).with_name("smallest.osim").read_text(encoding="utf-8")
