"""Wrap objects of an OpenSim model, in the frames of the knee's bones."""

from __future__ import annotations

import dataclasses
from decimal import Decimal
from typing import Any

import numpy as np

from kneejax.files.opensim._knee import OsimKneeJoint
from kneejax.files.opensim._model import Model, Offset, Point, angles_xyz, turn_xyz
from kneejax.files.opensim._numbers import METRES_TO_MM, degrees, shifted
from kneejax.files.opensim._xml import Element

#: Kind of element -> (kind of obstacle, its sizes: field, tag, how many numbers).
WRAP_KINDS: dict[str, tuple[str, tuple[tuple[str, str, int], ...]]] = {
    "WrapSphere": ("sphere", (("radius_mm", "radius", 1),)),
    "WrapCylinder": ("cylinder", (("radius_mm", "radius", 1), ("length_mm", "length", 1))),
    "WrapEllipsoid": ("ellipsoid", (("semi_axes_mm", "dimensions", 3),)),
}
_EVERYWHERE = ("", "all", "unassigned")
#: Quadrant of a cylinder -> side on which paths pass.
_SIDES = {"x": "+x", "+x": "+x", "-x": "-x", "y": "+y", "+y": "+y", "-y": "-y"}


@dataclasses.dataclass(frozen=True)
class OsimWrap:
    """A wrap object.

    Attributes:
        element: in the file.
        key: its name; with `#2` if another one before it has the same.
        body: that carries it, as the file says; its offset frame's if it is on one.
        frame: from the carrier's coordinates to the body's.
        active: whether the model uses it.
    """

    element: Element
    key: str
    body: str
    frame: Offset
    active: bool


def read_wraps(model: Model) -> list[OsimWrap]:
    """Every wrap object of a model, of any kind and body.

    Args:
        model: the model.
    """
    answer, seen = [], {}
    for element in model.elements():
        if element.parent is None or not element.tag.startswith("Wrap"):
            continue
        if not any(e.tag == "WrapObjectSet" for e in element.ancestors()):
            continue
        if element.parent.tag not in ("objects", "WrapObjectSet"):
            continue
        carrier = next((e for e in element.ancestors() if id(e) in _carriers(model)), None)
        if carrier is None:
            continue
        seen[element.name] = seen.get(element.name, 0) + 1
        count = seen[element.name]
        key = element.name if count == 1 else f"{element.name}#{count}"
        body, frame = model.place(carrier)
        active = model.truth(element, "active", True)
        answer.append(OsimWrap(element, key, body, frame, active))
    return answer


def unsupported(wrap: OsimWrap) -> str:
    """Why a wrap object cannot be read; empty if it can."""
    if wrap.element.tag not in WRAP_KINDS:
        return f"its wrap object {wrap.key} is a {wrap.element.tag}"
    quadrant = wrap.element.word("quadrant")
    if quadrant.lower() not in _EVERYWHERE and not side_of(wrap):
        return f"its wrap object {wrap.key} is confined to the quadrant {quadrant}"
    return ""


def side_of(wrap: OsimWrap) -> str:
    """The side on which paths must pass a cylinder; empty where they take the shorter way."""
    around = wrap.element.tag == "WrapCylinder"
    return _SIDES.get(wrap.element.word("quadrant").lower(), "") if around else ""


def wrap_document(model: Model, wrap: OsimWrap, knee: OsimKneeJoint, source: str) -> dict[str, Any]:
    """A wrap object as an entry of a knee file.

    Args:
        model: the model.
        wrap: one without an `unsupported` property, on one of the knee's bones.
        knee: its bones.
        source: of the entry.

    Raises:
        InputProblem: a size that is not positive, or numbers that are none.
    """
    kind, sizes = WRAP_KINDS[wrap.element.tag]
    bone, _ = knee.rigid[wrap.body]
    carrier = carrier_in_bone(wrap, knee)
    center = carrier.point(model.point(wrap.element, "translation"))
    turn = model.point(wrap.element, "xyz_body_rotation")
    document: dict[str, Any] = {
        "kind": kind,
        "bone": bone,
        "center_mm": [shifted(x, METRES_TO_MM) for x in center],
        "rotation_deg": rotation_deg(carrier, turn),
    }
    for field, tag, count in sizes:
        values = model.numbers(wrap.element, tag, count)
        if min(values) <= 0:
            word = wrap.element.word(tag)
            raise model.file.problem(wrap.element, tag, word, "sizes above 0 m")
        lengths = [shifted(x, METRES_TO_MM) for x in values]
        document[field] = lengths if count > 1 else lengths[0]
    if not any(document["rotation_deg"]):
        del document["rotation_deg"]
    if side := side_of(wrap):
        document["side"] = side
    return document | {"source": source}


def carrier_in_bone(wrap: OsimWrap, knee: OsimKneeJoint) -> Offset:
    """The motion from the coordinates that a wrap object is stated in to its bone's."""
    return knee.rigid[wrap.body][1].after(wrap.frame)


def rotation_deg(carrier: Offset, turn: Point) -> list[float]:
    """Angles of a wrap object in its bone, degrees.

    Args:
        carrier: from the coordinates that it is stated in to its bone's.
        turn: its angles there, rad.
    """
    if carrier.rotation is None:
        return [degrees(x) for x in turn]
    angles = angles_xyz(carrier.rotation @ turn_xyz(turn))
    return [degrees(Decimal(repr(float(x)))) for x in angles]


def depth_inside(entry: dict[str, Any], point_mm) -> float:
    """How deep inside an obstacle a point lies, mm along the ray from its centre.

    Args:
        entry: the obstacle, as in a knee file.
        point_mm: shape `(3,)`, in the frame of the obstacle's bone.

    Returns:
        The depth below the surface; negative outside. A cylinder ends at its length.
    """
    turn = turn_xyz(np.deg2rad(entry.get("rotation_deg", [0.0, 0.0, 0.0])))
    x = turn.T @ (np.asarray(point_mm, float) - np.asarray(entry["center_mm"], float))
    if entry["kind"] == "cylinder":
        across = entry["radius_mm"] - float(np.hypot(x[0], x[1]))
        return min(across, entry["length_mm"] / 2.0 - abs(float(x[2])))
    sizes = np.asarray(entry.get("semi_axes_mm", entry.get("radius_mm")), float)
    fraction, distance = float(np.linalg.norm(x / sizes)), float(np.linalg.norm(x))
    return float(sizes.min()) if fraction == 0 else distance / fraction - distance


def _carriers(model: Model) -> set[int]:
    return {id(frame) for frame in model.frames.values()}
