"""Axes of a model's bones, turned where they are unusual, and the way to a knee's frames."""

__all__ = ["registered"]

import hashlib
import os
import re
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from kneejax.files.opensim.exact import MIRROR, Rigid, poses_of
from kneejax.files.opensim.joints import coordinates_of, moved, read_joints
from kneejax.files.opensim.knee import SIDES, OsimKneeJoint, find_knee
from kneejax.files.opensim.ligaments import OsimLigament
from kneejax.files.opensim.model import GROUND, Model, read_model
from kneejax.files.reading import InputProblem
from kneejax.geometry import FEMUR, TIBIA
from kneejax.joints import condyle_axes
from kneejax.mechanics import Knee, condyle_points

_BENDS = re.compile(r"flex|bend|ext|knee_angle", re.IGNORECASE)
_COLLATERAL = {-1.0: re.compile(r"^[sd]?MCL|TCL", re.IGNORECASE),
               1.0: re.compile(r"^LCL|^FCL", re.IGNORECASE)}
#: Of the cosine between a direction and the axis it should have; fibres run less straight.
_ALONG, _ALONG_FIBRES = 0.7, 0.5
_LONG_MM, _FAR_MM = 40.0, 100.0
_WANTED = "X anterior, Y superior, Z to the person's right"
_OTHERWISE = f"kneejax takes {_WANTED}, and this model may mean other axes."
_BETWEEN = 20.0, 60.0  # flexions between which a model's flexion axis is sought, degrees
_ASKEW_DEG = 10.0  # an axis farther from its name than this is said, degrees
#: How frames may be registered.
FRAMES = "auto", "same", "landmarks"


class _Superior(NamedTuple):
    """A direction that should be Y, what says so, and the doubt where it is not."""

    direction: np.ndarray
    why: str
    doubt: str
    along: float = _ALONG


def anatomical(
    model: Model, knee: OsimKneeJoint, ligaments: list[OsimLigament]
) -> tuple[np.ndarray, str, list[str]]:
    """The rotation to a knee's axes, a sentence where it turns the model's, and doubts."""
    superior = [*_superior(model, knee, ligaments)]
    flexion, sense = _flexion_axis(model, knee)
    others = [one for one in superior if one.direction[1] < one.along]
    across = flexion is None or abs(flexion[2]) >= _ALONG
    if across and (len(others) < len(superior) or not superior):
        right = np.array([0.0, 0.0, 1.0]) if flexion is None else flexion * np.sign(flexion[2])
        votes = _votes(knee, ligaments, right, sense, flexion)
        if votes and max(votes.values()) < 0 and len(votes) > 1:
            return _turning(np.diag([-1.0, 1.0, -1.0]), votes)
        doubts = [one.doubt for one in others]
        doubts += [f"The {SIDES[knee.side]} knee's axes are taken as {_WANTED}, but {why} says "
                   "that Z is to the left: is the side right?"
                   for why, vote in votes.items() if vote < 0]
        return np.eye(3), "", doubts
    if flexion is not None and superior:
        up = np.sum([one.direction for one in superior], axis=0)
        # A knee that bends says little where its shank is upright already.
        y, line = _nearest(up), _nearest(flexion)
        votes = _votes(knee, ligaments, line, sense, flexion)
        sure = len(votes) > 1 and len({*votes.values()}) == 1
        if sure and y @ line == 0 and flexion @ line > 0.8:
            z = line * next(iter(votes.values()))
            why = ("flexion's axis", *(one.why for one in superior), *votes)
            return _turning(np.stack([np.cross(y, z), y, z]), why)
    found = [] if across or flexion is None else [f"flexion about {_word(flexion)}"]
    found += [f"{one.why} say that {_word(one.direction)} points upwards" for one in others]
    if across and all(one.direction[1] <= -one.along for one in superior):
        return np.eye(3), "", ["; ".join(found) + ": have femur and tibia changed places?"]
    raise knee.joints[0].element.problem("axes", "; ".join(found), f"bodies with {_WANTED}")


def _turning(rotation: np.ndarray, why: Iterable[str]) -> tuple[np.ndarray, str, list[str]]:
    names = ("anterior", "posterior"), ("superior", "inferior"), ("to the right", "to the left")
    words = ", ".join(f"{_word(np.abs(row))} {both[int(row.sum() < 0)]}"
                      for row, both in zip(rotation, names, strict=True))
    said = f"The model's axes are {words}, by {', '.join(why)}: they were turned to {_WANTED}."
    return rotation, said, []


def turned(knee: OsimKneeJoint, rotation: np.ndarray) -> OsimKneeJoint:
    """The knee with turned axes of all its bones."""
    if np.array_equal(rotation, np.eye(3)):
        return knee
    turn = Rigid(rotation)
    there = {bone: turn.after(x).after(turn.inverse()) for bone, x in knee.in_femur.items()}
    rigid = {body: (bone, turn.after(at)) for body, (bone, at) in knee.rigid.items()}
    return knee._replace(turned=True, rigid=rigid, in_femur=there)


def _superior(
    model: Model, knee: OsimKneeJoint, ligaments: list[OsimLigament]
) -> Iterator[_Superior]:
    """Where hip and ankle lie, seen from the knee, and how long fibres run from the tibia."""
    joints = read_joints(model)
    for bone, sign, side in ((FEMUR, 1.0, "above"), (TIBIA, -1.0, "below")):
        places = [(joint, knee.rigid[body][1].point(frame.shift).astype(float))
                  for joint in joints for body, frame in joint.ends if knee.bone_of(body) == bone]
        own = [at for joint, at in places if joint in (knee.joints[0], knee.joints[-1])]
        middle = np.mean(own or [np.zeros(3)], axis=0)
        for joint in joints:
            if not joint.coordinates or joint.kind == "FreeJoint" or joint in knee.joints:
                continue
            near = [at for other, at in places if other is joint]
            far = [body for body, _ in joint.ends if body not in knee.rigid]
            if len(near) != 1 or not far or GROUND in far:
                continue
            # An ankle is one where something follows.
            if bone == TIBIA and not any(x.other(far[0]) for x in joints if x is not joint):
                continue
            way = 1e3 * (near[0] - middle)
            if np.linalg.norm(way) <= _FAR_MM:
                continue
            place = ", ".join(f"{x:.0f}" for x in 1e3 * near[0])
            yield _Superior(
                sign * way / np.linalg.norm(way), f"the places of {joint.name} and the knee",
                f"Joint {joint.name} lies at ({place}) mm in the {bone}'s frame, not {side} the "
                f"knee: {_OTHERWISE}")
    back, way = knee.in_femur[TIBIA].inverse(), np.zeros(3)
    for fibre in ligaments:
        first, last = (np.array(x, float) for x in (
            back.point(fibre.points[0].in_bone(knee)), fibre.points[-1].in_bone(knee)))
        length = float(np.linalg.norm(first - last))
        stretched = length / float(fibre.numbers["slack_length_mm"])
        # In a pose that no knee has, fibres are far from their own length and say nothing.
        if 1e3 * length >= _LONG_MM and 0.7 < stretched < 1.4:
            way += first - last
    if way.any():
        yield _Superior(way / np.linalg.norm(way), "the long fibres",
                        f"The long fibres do not run along Y: {_OTHERWISE}", _ALONG_FIBRES)


def _flexion_axis(model: Model, knee: OsimKneeJoint) -> tuple[np.ndarray | None, float]:
    """The axis of flexion, and what its coordinate does: 1 bends, -1 extends, 0 is not known."""
    every = [c for c in coordinates_of(knee.joints) if c.turns]
    named = [c for c in every if _BENDS.search(c.name)]
    if len(found := named if len(named) == 1 else every) != 1:
        return None, 0.0
    (bend,) = found
    # By this coordinate alone: nothing that is coupled to it follows.
    bent = {c.name: c.default for c in every} | {bend.name: bend.default + 0.1}
    there = moved(model, bent).between(knee.femur, knee.tibia)
    axis = _axis_of(there.turn @ knee.in_femur[TIBIA].turn.T)
    if not axis.any():
        return None, 0.0
    (low, high), sense = bend.range or (0.0, 0.0), 0.0
    if max(abs(low), abs(high)) > 1.5 * min(abs(low), abs(high)):
        sense = float(np.sign(low + high))  # a knee bends farther than it extends
    elif abs(bend.default) > np.deg2rad(10.0):
        sense = float(np.sign(bend.default))
    return axis, sense


def _votes(
    knee: OsimKneeJoint, ligaments: list[OsimLigament], line: np.ndarray, sense: float, flexion
) -> dict[str, float]:
    """Whether a direction points to the right (1) or to the left (-1): what says so -> sign."""
    votes = {}
    if sense and flexion is not None:
        # A tibia that bends turns about the axis that points to the left.
        votes["the sense in which it bends"] = -sense * float(np.sign(flexion @ line))
    ends = {
        side: [np.array(x.points[0].in_bone(knee), float) for x in ligaments if name.search(x.key)]
        for side, name in _COLLATERAL.items()}
    if all(ends.values()):
        out = np.mean(ends[1.0], axis=0) - np.mean(ends[-1.0], axis=0)
        cosine = out @ line / max(float(np.linalg.norm(out)), 1e-9)
        if abs(cosine) > _ALONG:
            right = 1.0 if knee.side == "r" else -1.0
            votes["the names of the collateral ligaments"] = right * float(np.sign(cosine))
    return votes


def _axis_of(turn: np.ndarray) -> np.ndarray:
    """The unit vector about which a rotation turns; zero where it hardly does."""
    axis = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    size = np.linalg.norm(axis)
    return axis / size if size >= 1e-3 else np.zeros(3)


def _nearest(direction: np.ndarray) -> np.ndarray:
    k = int(np.argmax(np.abs(direction)))
    return np.eye(3)[k] * np.sign(direction[k])


def _word(direction: np.ndarray) -> str:
    return "-" * bool(_nearest(direction).sum() < 0) + "XYZ"[int(np.argmax(np.abs(direction)))]


class Registration(NamedTuple):
    """From a model's frames to a knee's, mm; of a left knee to those of its mirrored twin."""

    femur: np.ndarray  # a shift, `(3,)`
    tibia: np.ndarray  # likewise
    same: bool  # whether nothing is shifted
    notes: tuple[str, ...]  # what was done, a sentence each
    doubts: tuple[str, ...] = ()  # what a person should look at

    def in_knee(self, there: Rigid, bone: str, side: str) -> Rigid:
        """From the ground, m, to a knee's bone, mm, of a side, where the model's is `there`."""
        shift = {FEMUR: self.femur, TIBIA: self.tibia}[bone]
        back = there.inverse()
        return Rigid(MIRROR[side] @ back.turn, 1e3 * back.shift @ MIRROR[side] + shift)


#: Of a knee that is in the model's frames.
SAME = Registration(np.zeros(3), np.zeros(3), True, ())


def registration(
    model: Model, bones: OsimKneeJoint, knee: Knee, document: dict[str, Any], frames: str
) -> Registration:
    """Shift a model's bones to a knee's, by one of `FRAMES`; sizes are not changed."""
    _, turning, _ = anatomical(model, bones, [])
    if turning:
        expected = "X anterior, Y superior, Z to the right, as this needs them"
        raise bones.joints[0].element.problem("axes", turning, expected)
    if frames not in FRAMES:
        raise InputProblem("--frames", "frames", frames, FRAMES)
    # A knee says that it was imported from this model, or its patella that it was.
    origin = document.get("imported_from", {})
    muscles = document.get("patella", {}).get("muscles", {}).values()
    made = any(str(x.get("source", "")).startswith(f"{model.name},") for x in muscles)
    if origin:
        made = origin.get("sha256") == hashlib.sha256(model.file.original).hexdigest()
    if frames == "same" or (frames == "auto" and made):
        why = "as asked for" if frames == "same" else f"as the knee was made of {model.name}"
        return SAME._replace(notes=(f"Frames: those of the model, {why}.",))
    own = condyle_axes(*condyle_points(knee)).points[1].mean(axis=0)
    reference = float(knee.reference_pose.to_table().ravel()[0])
    there = knee.reference_pose.placement.inverse()
    on_tibia = np.array([float(x) for x in there.apply(tuple(own))])
    name = flexion_coordinate(bones)
    sign = np.sign(np.diff(flexions(model, bones, name, np.array([0.0, 1e-3])))[0])
    degrees = sign * np.deg2rad(np.array([*_BETWEEN, reference]))
    there = moved(model, {name: degrees}).between(bones.femur, bones.tibia)
    turn = there.at(1).after(there.at(0).inverse())
    axis = _axis_of(turn.turn)
    # A point of the flexion axis, which stays, nearest to the tibia's origin along it.
    still = np.linalg.lstsq(np.eye(3) - turn.turn, turn.shift, rcond=1e-6)[0]
    center = still + axis @ (there.shift[2] - still) * axis
    femur = own - 1e3 * center @ MIRROR[bones.side]
    tibia = on_tibia - 1e3 * there.at(2).inverse().point(center) @ MIRROR[bones.side]
    off = np.rad2deg(np.arccos(min(1.0, abs(axis[2]))))
    words = " and ".join(f"{bone} by ({', '.join(f'{x:.1f}' for x in shift)}) mm"
                         for bone, shift in (("femur", femur), ("tibia", tibia)))
    note = ("Frames: by landmarks: axes by their names; the middle of the model's flexion axis "
            "lies on the middle of the knee's flexion facets, which shifts the "
            f"{words}. Sizes stay.")
    doubt = (f"The model's flexion axis is {off:.0f} degrees off its Z axis: axes by name are "
             "doubtful.")
    return Registration(femur, tibia, False, (note,), (doubt,) if off > _ASKEW_DEG else ())


def registered(
    model_path: str | os.PathLike[str], side: str, knee: Knee, document: dict[str, Any],
    frames: str, bones: tuple[str, str] | None = None,
) -> Registration:  # fmt: skip
    """Register a model to a knee once, for models that differ from it in how the knee moves.

    Args:
        model_path: the model (.osim).
        side: `r` or `l`.
        knee: to which it is registered.
        document: of the knee.
        frames: one of `FRAMES`.
        bones: bodies that are the femur and the tibia; by default found by names.

    Raises:
        InputProblem: the model cannot be read or has no such knee.
    """
    model = read_model(model_path)
    return registration(model, find_knee(model, side, *(bones or ())), knee, document, frames)


def flexion_coordinate(bones: OsimKneeJoint) -> str:
    """The coordinate that bends a model's knee, the first angle of its joints; raises without."""
    names = [c.name for c in coordinates_of(bones.joints) if c.turns]
    if not names:
        raise bones.joints[0].element.problem("coordinates", "none", "an angle of the knee")
    return names[0]


def flexions(model: Model, bones: OsimKneeJoint, name: str, values: np.ndarray) -> np.ndarray:
    """Flexion, degrees, at values of a coordinate, rad, `(n,)`."""
    there = moved(model, {name: values}).between(bones.femur, bones.tibia)
    return poses_of(there, bones.side)[:, 0]
