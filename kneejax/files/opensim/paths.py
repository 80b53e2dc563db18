"""Paths of an OpenSim model: their points, and what they wrap around, in the bones' frames."""

import collections
import dataclasses
import re
from collections.abc import Iterable
from typing import Any

import numpy as np

from kneejax.files.opensim import exact
from kneejax.files.opensim.knee import OsimKneeJoint
from kneejax.files.opensim.model import Model
from kneejax.files.opensim.xml import Element
from kneejax.geometry import FEMUR, PATELLA, TIBIA

#: Kind of element -> (kind of obstacle, its sizes: field, tag, how many numbers).
WRAP_KINDS: dict[str, tuple[str, tuple[tuple[str, str, int], ...]]] = {
    "WrapSphere": ("sphere", (("radius_mm", "radius", 1),)),
    "WrapCylinder": ("cylinder", (("radius_mm", "radius", 1), ("length_mm", "length", 1))),
    "WrapEllipsoid": ("ellipsoid", (("semi_axes_mm", "dimensions", 3),)),
}
_EVERYWHERE = ("", "all", "unassigned")
#: Quadrant of a cylinder -> side on which paths pass.
_SIDES = {"x": "+x", "+x": "+x", "-x": "-x", "y": "+y", "+y": "+y", "-y": "-y"}
_ORDER = FEMUR, PATELLA, TIBIA


@dataclasses.dataclass(frozen=True)
class _Carried:
    element: Element
    body: str
    frame: exact.Rigid  # from the coordinates that it is stated in to the body's

    def carrier_in_bone(self, knee: OsimKneeJoint) -> exact.Rigid:
        """From the coordinates that it is stated in to its bone's."""
        return knee.rigid[self.body][1].after(self.frame)


@dataclasses.dataclass(frozen=True)
class OsimPoint(_Carried):
    """A point of a path."""

    location: exact.Point  # m, as stated

    def in_bone(self, knee: OsimKneeJoint) -> exact.Point:
        """The point in its bone's frame, m."""
        return self.carrier_in_bone(knee).point(self.location)

    def in_femur(self, knee: OsimKneeJoint) -> np.ndarray:
        """The point in the femur at the reference pose, m."""
        return knee.in_femur[knee.bone_of(self.body)].point(self.in_bone(knee)).astype(float)


@dataclasses.dataclass(frozen=True)
class OsimWrap(_Carried):
    """A wrap object."""

    key: str  # its name; with `#2` if another one before it has the same
    active: bool  # whether the model uses it

    @property
    def side(self) -> str:
        """The side on which paths must pass a cylinder; empty where they take the shorter way."""
        quadrant = self.element.word("quadrant").lower()
        return _SIDES.get(quadrant, "") if self.element.tag == "WrapCylinder" else ""

    @property
    def unsupported(self) -> str:
        """Why it cannot be read; empty if it can."""
        if self.element.tag not in WRAP_KINDS:
            return f"its wrap object {self.key} is a {self.element.tag}"
        quadrant = self.element.word("quadrant")
        if quadrant.lower() not in _EVERYWHERE and not self.side:
            return f"its wrap object {self.key} is confined to the quadrant {quadrant}"
        return ""

    def document(self, knee: OsimKneeJoint, file: str) -> dict[str, Any]:
        """The entry of a knee file; raises where a size is not positive."""
        kind, sizes = WRAP_KINDS[self.element.tag]
        carrier, turn = self.carrier_in_bone(knee), self.element.point("xyz_body_rotation")
        if carrier.turns:
            turn = exact.decimals(exact.angles_xyz(carrier.turn @ exact.turn_xyz(turn)))
        center = exact.millimetres(carrier.point(self.element.point("translation")))
        document: dict[str, Any] = {
            "kind": kind, "bone": knee.bone_of(self.body), "center_mm": center}
        angles = [exact.degrees(x) for x in turn]
        document |= {"rotation_deg": angles} if any(angles) else {}
        for field, tag, count in sizes:
            values = self.element.numbers(tag, count)
            if min(values) <= 0:
                raise self.element.problem(tag, self.element.word(tag), "sizes above 0 m")
            lengths = exact.millimetres(values)
            document[field] = lengths if count > 1 else lengths[0]
        document |= {"side": self.side} if self.side else {}
        return document | {"source": f"{file}, {self.element.tag} {self.key} of {self.body}"}

    def deepest(
        self, knee: OsimKneeJoint, points: Iterable[OsimPoint]
    ) -> tuple[float, OsimPoint] | None:
        """Depth of the deepest point inside it, mm, and the point; None where all lie outside."""
        entry, found = self.document(knee, ""), None
        back = knee.in_femur[entry["bone"]].inverse()
        turn = exact.turn_xyz(np.deg2rad(entry.get("rotation_deg", [0.0, 0.0, 0.0])))
        for point in points:
            x = turn.T @ (1e3 * back.point(point.in_femur(knee)) - np.asarray(entry["center_mm"]))
            if entry["kind"] == "cylinder":
                across = entry["radius_mm"] - float(np.hypot(x[0], x[1]))
                depth = min(across, entry["length_mm"] / 2.0 - abs(float(x[2])))
            else:
                sizes = np.broadcast_to(entry.get("semi_axes_mm") or entry["radius_mm"], 3)
                part, size = float(np.linalg.norm(x / sizes)), float(np.linalg.norm(x))
                depth = float(sizes.min()) if part == 0 else size / part - size
            if depth > (found[0] if found else 1e-9):
                found = depth, point
        return found


@dataclasses.dataclass(frozen=True)
class OsimPath:
    """A fibre or a muscle over the knee."""

    element: Element
    key: str  # its name; with `#2` if another one before it has the same
    points: tuple[OsimPoint, ...]  # from the first of two bones to the last: femur, patella, tibia
    wrap: OsimWrap | None = None  # what it goes around; None if nothing

    def ends(self, knee: OsimKneeJoint, begin: int = 0, end: int = -1) -> tuple[Any, Any, dict]:
        """Bone and place, mm, of a point near each end; what a knee file says of those between."""
        places = [(knee.bone_of(one.body), exact.millimetres(one.in_bone(knee)))
                  for one in self.points[begin : len(self.points) + end + 1]]
        via = [{"bone": bone, "point_mm": place} for bone, place in places[1:-1]]
        return places[0], places[-1], {"via_points": via} if via else {}


def path_objects(element: Element, name: str) -> list[Element]:
    """What a set of the path of a force holds."""
    inside = f"GeometryPath[1]/{name}[1]"
    return element.xpath(f"{inside}/objects[1]/* | {inside}[not(objects)]/*")


def path_points(model: Model, element: Element) -> list[OsimPoint]:
    """The points of the path of a force, with the bodies that carry them."""
    return [
        OsimPoint(point, *model.carrier(point, "body", "parent_frame"),
                  exact.ORIGIN if point.tag == "MovingPathPoint" else point.point("location"))
        for point in path_objects(element, "PathPointSet")]


def in_order(first: str, last: str) -> bool:
    """Whether one bone comes before another: femur, patella, tibia."""
    return _ORDER.index(first) < _ORDER.index(last)


def read_wraps(model: Model) -> list[OsimWrap]:
    """Every wrap object of a model, of any kind and body."""
    carriers, keys, answer = {*model.frames.values()}, Counted(), []
    for element in model.elements:
        if not element.tag.startswith("Wrap") or not element.xpath(
                "parent::WrapObjectSet | parent::objects[ancestor::WrapObjectSet]"):
            continue
        carrier = next((e for e in element.iterancestors() if e in carriers), None)
        if carrier is not None:
            active = element.truth("active", True)
            answer.append(OsimWrap(element, *model.place(carrier), keys(element.name), active))
    return answer


class Counted(collections.Counter):
    """Names of a model, told apart: the second of a name becomes `name#2`."""

    def __call__(self, name: str, otherwise: str = "") -> str:
        """The name, or another one in the place of none, with its number from the second on."""
        self[name] += 1
        return (name or otherwise) + (f"#{self[name]}" if self[name] > 1 else "")


def by_file_name(items: Iterable[Any], prefix: str) -> dict[str, Any]:
    """Fibres, muscles or obstacles by names that a knee file allows, each once."""
    answer: dict[str, Any] = {}
    for item in items:
        name = re.sub(r"[^A-Za-z0-9_+-]", "_", item.key)
        name = name if re.match(r"[A-Za-z]", name) else f"{prefix}{name}"
        stem, count = name, 1
        while name in answer:
            count += 1
            name = f"{stem}_{count}"
        answer[name] = item
    return answer
