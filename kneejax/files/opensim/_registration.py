"""From the frames of a model's bones to those of a knee: the same, or by landmarks."""

from __future__ import annotations

import hashlib
import os
from typing import Any, NamedTuple

import numpy as np

from kneejax.files.opensim._axes import anatomical
from kneejax.files.opensim._joints import moved, turning
from kneejax.files.opensim._knee import OsimKneeJoint, find_knee
from kneejax.files.opensim._model import Model, read_model
from kneejax.files.opensim._motions import MIRROR, Rigid, poses_of
from kneejax.files.reading import InputProblem
from kneejax.geometry import FEMUR, TIBIA
from kneejax.joints import condyle_axes
from kneejax.mechanics import Knee, condyle_points

#: Flexions between which a model's flexion axis is sought, degrees.
_BETWEEN = 20.0, 60.0
#: An axis farther from its name than this is said, degrees.
_ASKEW_DEG = 10.0
#: How frames may be registered.
FRAMES = "auto", "same", "landmarks"


class Registration(NamedTuple):
    """From a model's frames to a knee's, mm; of a left knee to those of its mirrored twin.

    Attributes:
        femur: a shift, `(3,)`.
        tibia: likewise.
        same: whether nothing is shifted.
        notes: what was done, a sentence each.
        doubts: what a person should look at.
    """

    femur: np.ndarray
    tibia: np.ndarray
    same: bool
    notes: tuple[str, ...]
    doubts: tuple[str, ...] = ()

    def in_knee(self, there: Rigid, bone: str, side: str) -> Rigid:
        """From the ground, m, to the frame of a knee's `femur` or `tibia`, mm, of a side `r` or
        `l`, where the model's bone is in the ground `there`."""
        shift = {FEMUR: self.femur, TIBIA: self.tibia}[bone]
        back = there.inverse()
        return Rigid(MIRROR[side] @ back.turn, 1e3 * back.shift @ MIRROR[side] + shift)


#: Of a knee that is in the model's frames.
SAME = Registration(np.zeros(3), np.zeros(3), True, ())


def registration(
    model: Model, bones: OsimKneeJoint, knee: Knee, document: dict[str, Any], frames: str
) -> Registration:
    """Register a model's bones to those of a knee, by one of `FRAMES`.

    Where the knee was made of this model, as its document says, the frames are the same. Otherwise
    axes are taken by their names, anterior, superior, lateral, and the middle of the model's
    flexion axis (from 20 to 60 degrees) comes to lie on the middle of the knee's flexion facets.
    Sizes are not changed.

    Raises:
        InputProblem: `frames` is none of them, or the model's axes are others.
    """
    axes, _ = anatomical(model, bones, [])
    if axes.turned:
        expected = "X anterior, Y superior, Z to the right, as this needs them"
        raise model.file.problem(bones.joints[0].element, "axes", axes.unusual[-1], expected)
    if frames not in FRAMES:
        raise InputProblem("--frames", "frames", frames, f"one of {', '.join(FRAMES)}", FRAMES)
    if frames == "same" or (frames == "auto" and _made_of(model, document)):
        why = "as asked for" if frames == "same" else f"as the knee was made of {model.name}"
        return SAME._replace(notes=(f"Frames: those of the model, {why}.",))
    own = condyle_axes(*condyle_points(knee)).points[1].mean(axis=0)
    reference = float(knee.reference_pose.to_table().ravel()[0])
    there = knee.reference_pose.placement.inverse()
    on_tibia = np.array([float(x) for x in there.apply(tuple(own))])
    axis, center, at = _flexion_axis(model, bones, reference)
    femur = own - 1e3 * center @ MIRROR[bones.side]
    tibia = on_tibia - 1e3 * at.inverse().point(center) @ MIRROR[bones.side]
    off = np.rad2deg(np.arccos(min(1.0, abs(axis[2]))))
    words = " and ".join(
        f"{bone} by ({', '.join(f'{x:.1f}' for x in shift)}) mm"
        for bone, shift in (("femur", femur), ("tibia", tibia))
    )
    notes = (
        "Frames: by landmarks: axes by their names; the middle of the model's flexion axis lies on "
        f"the middle of the knee's flexion facets, which shifts the {words}. Sizes stay.",
    )
    doubts = (
        f"The model's flexion axis is {off:.0f} degrees off its Z axis: axes by name are doubtful.",
    )
    return Registration(femur, tibia, False, notes, doubts if off > _ASKEW_DEG else ())


def registered(
    model_path: str | os.PathLike[str],
    side: str,
    knee: Knee,
    document: dict[str, Any],
    frames: str,
    bones: tuple[str, str] | None = None,
) -> Registration:
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


def flexion_coordinate(model: Model, bones: OsimKneeJoint) -> str:
    """The coordinate that bends a model's knee: the first angle of its joints.

    Raises:
        InputProblem: nothing turns there.
    """
    angles = turning(bones.joints)
    names = [c.name for joint in bones.joints for c in joint.coordinates if c.name in angles]
    if not names:
        joint = bones.joints[0]
        raise model.file.problem(joint.element, "coordinates", "none", "an angle of the knee")
    return names[0]


def flexions(model: Model, bones: OsimKneeJoint, name: str, values: np.ndarray) -> np.ndarray:
    """Flexion, degrees, at values of a coordinate, rad, `(n,)`."""
    there = moved(model, {name: values}).between(bones.femur, bones.tibia)
    return poses_of(there, bones.side)[:, 0]


def _made_of(model: Model, document: dict[str, Any]) -> bool:
    """Whether a knee says that it was imported from this model, or its patella was."""
    imported = document.get("imported_from", {})
    if imported:
        return imported.get("sha256") == hashlib.sha256(model.file.original).hexdigest()
    muscles = document.get("patella", {}).get("muscles", {}).values()
    sources = [str(one.get("source", "")) for one in muscles]
    return any(source.startswith(f"{model.name},") for source in sources)


def _flexion_axis(model: Model, bones: OsimKneeJoint, reference_deg: float):
    """Direction and middle of the flexion axis in the femur, m, and where the tibia is in the femur
    at a flexion."""
    name = flexion_coordinate(model, bones)
    sign = np.sign(np.diff(flexions(model, bones, name, np.array([0.0, 1e-3])))[0])
    degrees = np.deg2rad(np.array([*_BETWEEN, reference_deg]))
    there = moved(model, {name: sign * degrees}).between(bones.femur, bones.tibia)
    turn = there.at(1).after(there.at(0).inverse())
    skew = turn.turn - turn.turn.T
    axis = np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
    axis = axis / np.linalg.norm(axis)
    # A point that stays, nearest to the tibia's origin along the axis.
    still = np.linalg.lstsq(np.eye(3) - turn.turn, turn.shift, rcond=1e-6)[0]
    along = axis @ (there.shift[2] - still)
    return axis, still + along * axis, there.at(2)
