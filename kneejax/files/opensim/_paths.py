"""Paths of an OpenSim model: their points, and what they wrap around, in the bones' frames."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable
from typing import Any

import numpy as np

from kneejax.files.opensim._exact import (
    ORIGIN,
    Point,
    Rigid,
    angles_xyz,
    decimals,
    degrees,
    millimetres,
    turn_xyz,
)
from kneejax.files.opensim._knee import OsimKneeJoint
from kneejax.files.opensim._model import Model
from kneejax.files.opensim._xml import Element
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
class OsimPoint:
    """A point of a path."""

    element: Element
    body: str  # that carries its frame
    frame: Rigid  # from the coordinates that it is stated in to the body's
    location: Point  # m, as stated

    def carrier_in_bone(self, knee: OsimKneeJoint) -> Rigid:
        """The motion from the coordinates that it is stated in to its bone's."""
        return knee.rigid[self.body][1].after(self.frame)

    def in_bone(self, knee: OsimKneeJoint) -> Point:
        """The point in its bone's frame, m."""
        return self.carrier_in_bone(knee).point(self.location)

    def in_bone_mm(self, knee: OsimKneeJoint) -> list[float]:
        """Likewise, mm."""
        return millimetres(self.in_bone(knee))

    def in_femur(self, knee: OsimKneeJoint) -> Point:
        """The point in the femur at the reference pose, m."""
        return knee.in_femur[knee.bone_of(self.body)].point(self.in_bone(knee))


@dataclasses.dataclass(frozen=True)
class OsimWrap:
    """A wrap object."""

    element: Element
    key: str  # its name; with `#2` if another one before it has the same
    body: str  # that carries it
    frame: Rigid  # from the carrier's coordinates to the body's
    active: bool  # whether the model uses it

    @property
    def side(self) -> str:
        """The side on which paths must pass a cylinder; empty where they take the shorter way."""
        around = self.element.tag == "WrapCylinder"
        return _SIDES.get(self.element.word("quadrant").lower(), "") if around else ""

    @property
    def unsupported(self) -> str:
        """Why it cannot be read; empty if it can."""
        if self.element.tag not in WRAP_KINDS:
            return f"its wrap object {self.key} is a {self.element.tag}"
        quadrant = self.element.word("quadrant")
        if quadrant.lower() not in _EVERYWHERE and not self.side:
            return f"its wrap object {self.key} is confined to the quadrant {quadrant}"
        return ""

    def carrier_in_bone(self, knee: OsimKneeJoint) -> Rigid:
        """The motion from the coordinates that it is stated in to its bone's."""
        return knee.rigid[self.body][1].after(self.frame)

    def document(self, model: Model, knee: OsimKneeJoint, file: str) -> dict[str, Any]:
        """The entry of a knee file, whose source is a model by this name.

        Raises:
            InputProblem: a size that is not positive, or numbers that are none.
        """
        kind, sizes = WRAP_KINDS[self.element.tag]
        carrier = self.carrier_in_bone(knee)
        center = carrier.point(self.element.point("translation"))
        turn = self.element.point("xyz_body_rotation")
        if carrier.turn is None:
            angles = [degrees(x) for x in turn]
        else:
            inner = angles_xyz(carrier.turn @ turn_xyz(turn))
            angles = [degrees(x) for x in decimals(inner)]
        document: dict[str, Any] = {
            "kind": kind,
            "bone": knee.bone_of(self.body),
            "center_mm": millimetres(center),
        }
        if any(angles):
            document["rotation_deg"] = angles
        for field, tag, count in sizes:
            values = self.element.numbers(tag, count)
            if min(values) <= 0:
                word = self.element.word(tag)
                raise self.element.problem(tag, word, "sizes above 0 m")
            lengths = millimetres(values)
            document[field] = lengths if count > 1 else lengths[0]
        if self.side:
            document["side"] = self.side
        source = f"{file}, {self.element.tag} {self.key} of {self.body}"
        return document | {"source": source}

    def deepest(
        self, model: Model, knee: OsimKneeJoint, points: Iterable[OsimPoint]
    ) -> tuple[float, OsimPoint | None]:
        """How deep inside it points lie at the reference pose, mm, and which is the deepest; zero
        and none where all lie outside."""
        obstacle = self.document(model, knee, "")
        to_obstacle = knee.in_femur[obstacle["bone"]].inverse()
        found = ((depth_inside(obstacle, 1e3 * np.array(to_obstacle.point(p.in_femur(knee)),
                                                        float)), p) for p in points)
        inside = [one for one in found if one[0] > 1e-9]
        return max(inside, key=lambda one: one[0]) if inside else (0.0, None)


def path_point(model: Model, element: Element) -> OsimPoint:
    """A point of a path with the body that carries it."""
    if element.child("body") is not None:
        body, frame = model.body_of(element, "body"), Rigid()
    else:
        body, frame = model.socket(element, "parent_frame")
    moving = element.tag == "MovingPathPoint"
    location = ORIGIN if moving else element.point("location")
    return OsimPoint(element, body, frame, location)


def path_objects(element: Element, name: str) -> list[Element]:
    """What a set of the path of a force holds."""
    path = element.child("GeometryPath")
    held = None if path is None else path.child(name)
    if held is None:
        return []
    objects = held.child("objects")
    return (held if objects is None else objects).children


def path_points(model: Model, element: Element) -> list[OsimPoint]:
    """The points of the path of a force."""
    return [path_point(model, e) for e in path_objects(element, "PathPointSet")]


def in_order(first: str, last: str) -> bool:
    """Whether one bone comes before another: femur, patella, tibia."""
    return _ORDER.index(first) < _ORDER.index(last)


def read_wraps(model: Model) -> list[OsimWrap]:
    """Every wrap object of a model, of any kind and body."""
    carriers, keys, answer = {*model.frames.values()}, Counted(), []
    for element in model.elements:
        outer = element.getparent()
        if not element.tag.startswith("Wrap") or outer.tag not in ("objects", "WrapObjectSet"):
            continue
        if not any(e.tag == "WrapObjectSet" for e in element.iterancestors()):
            continue
        carrier = next((e for e in element.iterancestors() if e in carriers), None)
        if carrier is not None:
            active = element.truth("active", True)
            answer.append(OsimWrap(element, keys(element.name), *model.place(carrier), active))
    return answer


def depth_inside(entry: dict[str, Any], point_mm: np.ndarray) -> float:
    """How deep inside an obstacle, an entry of a knee file, a point of its bone lies.

    In mm along the ray from its centre; negative outside. A cylinder ends at its length.
    """
    turn = turn_xyz(np.deg2rad(entry.get("rotation_deg", [0.0, 0.0, 0.0])))
    x = turn.T @ (point_mm - np.asarray(entry["center_mm"], float))
    if entry["kind"] == "cylinder":
        across = entry["radius_mm"] - float(np.hypot(x[0], x[1]))
        return min(across, entry["length_mm"] / 2.0 - abs(float(x[2])))
    sizes = np.asarray(entry.get("semi_axes_mm", entry.get("radius_mm")), float)
    fraction, distance = float(np.linalg.norm(x / sizes)), float(np.linalg.norm(x))
    return float(sizes.min()) if fraction == 0 else distance / fraction - distance


class Counted:
    """Names of a model, told apart: the second of a name becomes `name#2`."""

    def __init__(self):
        self._seen: dict[str, int] = {}

    def __call__(self, name: str, otherwise: str = "") -> str:
        """The name, or another one in the place of none, with its number from the second on."""
        self._seen[name] = count = self._seen.get(name, 0) + 1
        return (name or otherwise) + (f"#{count}" if count > 1 else "")


def file_names(keys: Iterable[str], prefix: str) -> list[str]:
    """Names that a knee file allows, each once."""
    answer: list[str] = []
    for key in keys:
        name = re.sub(r"[^A-Za-z0-9_+-]", "_", key)
        name = name if re.match(r"[A-Za-z]", name) else f"{prefix}{name}"
        stem, count = name, 1
        while name in answer:
            count += 1
            name = f"{stem}_{count}"
        answer.append(name)
    return answer
