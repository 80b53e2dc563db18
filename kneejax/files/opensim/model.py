"""A model: bodies and frames (schema 3 has joints inside bodies, schema 4 sockets), functions."""

__all__ = ["SMALLEST_MODEL"]

import math
import os
import posixpath
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import make_interp_spline

from kneejax.files.opensim.exact import Rigid
from kneejax.files.opensim.xml import Element, XmlFile, last_word, parse_xml
from kneejax.files.reading import InputProblem, plain_number

KIND = "an OpenSim model"
GROUND = "ground"
_UNITS = (
    ("length_units", ("m", "meter", "meters", "metre", "metres"), "m (metres)"),
    ("force_units", ("n", "newton", "newtons"), "N (newtons)"),
)
#: Elements that hold no part of the model in use.
_ASIDE = ("defaults", "ControllerSet", "MarkerSet", "ProbeSet")
#: How what acts is known where it stands in no set of forces or constraints.
_SWITCHES = ("appliesForce", "isEnforced", "isDisabled")
_ACTS = re.compile("(Force|Constraint|Ligament|Spring|Muscle|Actuator)[0-9]*$")


class Model:
    """A model with the places of its bodies' frames."""

    def __init__(self, file: XmlFile):
        self.file = file
        if file.root.tag != "OpenSimDocument":
            raise file.root.problem("", file.root.tag, f"{KIND}, an OpenSimDocument")
        word = file.root.get("Version", "")
        if not word.isdecimal() or not 20000 <= int(word) < 50000:
            expected = "schema 2, 3 or 4: a version from 20000 to 49999"
            raise file.root.problem("Version", word or "missing", expected)
        self.version = int(word)  # of the document, e.g. 40000
        found = file.root.child("Model")
        if found is None:
            kinds = ", ".join(child.tag for child in file.root.children) or "nothing"
            raise file.root.problem("content", kinds, f"{KIND}: an element Model")
        self.root = found
        self.notes: list[str] = []  # what was assumed on reading
        for tag, known, unit in _UNITS:
            word = found.word(tag)
            if not word:
                self.notes += [f"The model does not state {tag}: OpenSim's default, {unit}, was "
                               "assumed."]
            elif word.lower() not in known:
                raise found.problem(tag, word, unit)
        # Everything in the model but defaults, controllers and markers; of it bodies by name,
        # ground among them, and these and offset frames by the path of a component.
        aside = {element for top in found.iter(*_ASIDE) for element in top.iter("*")}
        self.elements: list[Element] = [x for x in found.iter("*") if x not in aside]
        self.bodies, self.frames = dict[str, Element](), dict[str, Element]()
        for element in self.elements:
            if element.tag in ("Body", "Ground"):
                self.bodies.setdefault(element.name or GROUND, element)
            if element.tag in ("Body", "Ground", "PhysicalOffsetFrame"):
                self.frames.setdefault(_path(element), element)
        if GROUND not in self.bodies:  # OpenSim has one whether the file does or not
            ground = found.makeelement("Ground", name=GROUND)
            self.bodies[GROUND] = self.frames[f"/{GROUND}"] = ground
        self._offsets: dict[Element, tuple[str, Rigid]] = {}
        self.joints: list | None = None  # what `read_joints` read, once it has

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
            if around[0] in ("ForceSet", "ConstraintSet") or (around[0] == "components" and acts):
                yield element

    def muscles(self) -> list[Element]:
        """Every muscle, of whatever class."""
        return [element for element in self.elements if element.tag.endswith("Muscle")]

    def named(self, name: str) -> str:
        """The body of a name, any case; empty if there is none."""
        by_lower = {known.lower(): known for known in self.bodies}
        return name if name in self.bodies else by_lower.get(name.lower(), "")

    def socket(self, owner: Element, name: str) -> tuple[str, Rigid]:
        """The body of a frame that a socket names, and the motion to it; raises without a frame."""
        tags = f"socket_{name}", f"socket_{name}_connectee_name"
        word = owner.word(*tags)
        frame = self.frame(word, owner)
        if frame is None:
            expected = f"a frame of the model ({len(self.bodies)} bodies)"
            nearest = tuple(self.bodies) if owner.last_word(*tags) else ()
            raise owner.problem(tags[0], word or "missing", expected, nearest)
        return self.place(frame)

    def frame(self, word: str, owner: Element) -> Element | None:
        """The frame of a path: absolute, relative to its owner, or known by its last word."""
        if not word:
            return None
        path = word if word.startswith("/") else posixpath.join(_path(owner), word)
        last = last_word(word)
        exact = self.frames.get(posixpath.normpath(path), self.bodies.get(last))
        same = [frame for frame in self.frames.values() if frame.name == last]
        return exact if exact is not None or len(same) != 1 else same[0]

    def place(self, frame: Element) -> tuple[str, Rigid]:
        """The body that carries a body, the ground or an offset frame, and the motion to it."""
        if frame not in self._offsets:
            offset = frame.tag == "PhysicalOffsetFrame"
            # An offset frame that hangs on itself ends at the ground.
            self._offsets[frame] = GROUND if offset else frame.name or GROUND, Rigid()
            if offset:
                body, outer = self.socket(frame, "parent")
                own = Rigid.of(frame.point("translation"), frame.point("orientation"))
                self._offsets[frame] = body, outer.after(own)
        return self._offsets[frame]

    def carrier(self, owner: Element, tag: str, socket: str) -> tuple[str, Rigid]:
        """As `socket`, of an element that may name a body by a tag, as in schema 3."""
        if owner.child(tag) is None:
            return self.socket(owner, socket)
        word = owner.word(tag)
        if word not in self.bodies:
            nearest = tuple(self.bodies) if word else ()
            raise owner.problem(tag, word or "missing", "a body of the model", nearest)
        return word, Rigid()


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
#: Kinds of function that are understood.
FUNCTIONS = (
    "Constant", "LinearFunction", "PolynomialFunction", "SimmSpline", "NaturalCubicSpline",
    "PiecewiseLinearFunction", "MultiplierFunction", "GCVSpline", "Sine",
)  # fmt: skip


def function_of(owner: Element) -> Element | None:
    """The function of an axis, a coordinate or a constraint: its class begins with a capital."""
    held = owner.child("function", "prescribed_function", "coupled_coordinates_function")
    inside = (owner if held is None else held).children
    return next((child for child in inside if child.tag[:1].isupper()), None)


def evaluate(function: Element, arguments: Sequence[Any]) -> Any:
    """A function's value, rad or m, at values of its coordinates, numbers or `(n,)`."""
    x, kind = arguments[0] if arguments else 0.0, function.tag
    if kind not in FUNCTIONS:
        inner = (*FUNCTIONS, "TransformAxis")
        owners = (e for e in function.iterancestors() if e.name and e.tag not in inner)
        expected = f"one of the functions that are supported: {', '.join(FUNCTIONS)}"
        raise function.problem(f"function of {next(owners).name}", kind, expected)
    inner = function_of(function)
    factor = evaluate(inner, arguments) if inner is not None else 1.0
    try:
        if kind == "Constant":
            return function.number("value", "0")
        if kind == "LinearFunction":
            # OpenSim 2 and 3 call them coefficients too; the constant comes last.
            *slopes, constant = _numbers(function, "coefficients", 2)
            return sum(a * b for a, b in zip(slopes, arguments, strict=False)) + constant
        if kind == "PolynomialFunction":
            return np.polyval(_numbers(function, "coefficients", 1), x)
        if kind == "MultiplierFunction":
            if inner is None:
                raise ValueError("no function to multiply")
            return function.number("scale", "1") * factor
        if kind == "Sine":
            size, rate, phase, middle = (function.number(*one) for one in (
                ("amplitude", "1"), ("omega", "1"), ("phase", "0"), ("offset", "0")))
            return size * np.sin(rate * np.asarray(x) + phase) + middle
        knots, values = (_numbers(function, name, 2) for name in ("x", "y"))
        if len(knots) != len(values):
            raise ValueError(f"{len(knots)} values of x and {len(values)} of y")
        if kind == "GCVSpline":
            return _natural(function, knots, values, x)
        return (_linear if kind == "PiecewiseLinearFunction" else simm_spline)(knots, values, x)
    except InputProblem:
        raise
    except ValueError as error:
        expected = "the numbers of this kind of function"
        raise function.problem("numbers", str(error), expected) from None


def describe(function: Element) -> str:
    """A function of any kind in a few words, for a report."""
    if function.tag == "Constant":
        return f"constant {function.number('value', '0'):g}"
    if function.tag in ("LinearFunction", "PolynomialFunction"):
        return f"{function.tag} {function.word('coefficients')}"
    if function.tag == "MultiplierFunction":
        inner = function_of(function)
        what = describe(inner) if inner is not None else "nothing"
        return f"{function.number('scale', '1'):g} times {what}"
    count = len(function.word("x").split())
    return f"{function.tag} through {count} points" if count else function.tag


def simm_spline(knots: np.ndarray, values: np.ndarray, x: Any) -> Any:
    """Cubic splines of SIMM and OpenSim, with the same knots.

    Twice continuously differentiable; the third derivative in the first and last interval is that
    of the cubic through the first and last four points; straight outside, and between knots that do
    not increase, or are two. Knots `(n,)`, values `(n, ...)` (then `(n,)`), `x` of any shape.

    Source: Forsythe, Malcolm and Moler, Computer Methods for Mathematical Computations (1977).
    """
    if len(knots) == 2 or np.any(np.diff(knots) <= 0):
        return _linear(knots, values, x)
    ends = []
    for k in (slice(4), slice(-4, None)):
        x4, third = knots[k], values[k]
        for order in range(1, 4):  # divided differences
            apart = (x4[order:] - x4[:-order]).reshape(-1, *[1] * (values.ndim - 1))
            third = np.diff(third, axis=0) / apart
        ends.append([(3, 6.0 * third[0] if len(knots) > 3 else np.zeros(values.shape[1:]))])
    spline = make_interp_spline(knots, values, k=3, bc_type=tuple(ends))
    inside = np.clip(x, knots[0], knots[-1])
    beyond = np.reshape(x - inside, (*np.shape(x), *[1] * (values.ndim - 1)))
    return spline(inside) + beyond * spline(inside, 1)


def _natural(function: Element, knots: np.ndarray, values: np.ndarray, x: Any) -> Any:
    """The natural spline of degree `2 half_order - 1`; outside of degree `half_order - 1`."""
    if float(function.word("error_variance", default="0")) > 0:
        raise ValueError("error_variance above 0: a spline that misses its points")
    half = min(int(function.word("half_order", default="3")), len(knots) // 2)
    ends = [(order, 0.0) for order in range(half, 2 * half - 1)]
    bounds = (ends, ends) if ends else None
    spline = make_interp_spline(knots, values, k=2 * half - 1, bc_type=bounds)
    inside = np.clip(x, knots[0], knots[-1])
    beyond = np.asarray(x) - inside
    return sum(spline(inside, i) * beyond**i / math.factorial(i) for i in range(half))


def _linear(knots: np.ndarray, values: np.ndarray, x: Any) -> Any:
    i = np.clip(np.searchsorted(knots, x, side="right") - 1, 0, len(knots) - 2)
    width = knots[i + 1] - knots[i]
    slope = np.where(width > 0, values[i + 1] - values[i], 0.0) / np.where(width > 0, width, 1.0)
    return values[i] + (x - knots[i]) * slope


def _numbers(function: Element, tag: str, at_least: int) -> np.ndarray:
    numbers = np.array([plain_number(word) for word in function.word(tag).split()], float)
    if len(numbers) < at_least or not np.isfinite(numbers).all():
        raise ValueError(f"{tag}: {function.word(tag) or 'missing'}")
    return numbers
