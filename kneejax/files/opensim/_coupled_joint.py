"""A model's knee of one coordinate: its other coordinates follow flexion along splines."""

from __future__ import annotations

import os
import re

import numpy as np

from kneejax.files.opensim._coupled_motion import CoupledMotion
from kneejax.files.opensim._edits import Edits
from kneejax.files.opensim._joints import Joint
from kneejax.files.opensim._knee import SIDES, OsimKneeJoint, find_knee
from kneejax.files.opensim._model import Model, read_model
from kneejax.files.opensim._movement import Rigid, moved
from kneejax.files.opensim._registration import Registration, flexion_coordinate, poses_of
from kneejax.files.opensim._spatial_transform import transform_axes
from kneejax.files.opensim._xml import Element
from kneejax.geometry import FEMUR, FREE_COORDINATES, Pose

_KIND = "CustomJoint"
#: Between the angles at which a model's flexion is compared with its coordinate, rad.
_SPAN = 0.5
_STRAIGHT_DEG = 1e-6
_BREAK_BEFORE = re.compile(rb"(?:\r\n|\r|\n)?[ \t]*\Z")
#: By which a force or a constraint says on which coordinate it acts.
_ON_COORDINATE = "coordinate", "dependent_coordinate_name"


def couple_knee(
    edits: Edits, bones: OsimKneeJoint, motion: CoupledMotion, shifts: Registration
) -> None:
    """Let a model's knee follow flexion as a motion does.

    Its joint keeps its frames and the coordinate that bends it; its other coordinates go, with
    what acts on them.

    Args:
        edits: of the model, to which the splices are added.
        bones: the model's knee.
        motion: in the frames of a knee.
        shifts: from the model's frames to those.

    Raises:
        InputProblem: the knee is not one CustomJoint, its flexion is not its coordinate but for
            sign and a constant, or something else depends on a coordinate that goes.
    """
    model, (joint, *others) = edits.model, bones.joints
    upwards = joint.child in bones.rigid and bones.rigid[joint.child][0] == FEMUR
    if others or joint.kind != _KIND or joint.reverse or upwards or bones.turned:
        found = ", ".join(f"{one.kind} {one.name}" for one in bones.joints)
        found += ", upwards" * upwards + ", with other axes" * bones.turned
        expected = f"one {_KIND} from femur to tibia, for its coordinates to follow flexion"
        raise model.file.problem(joint.element, "joint", found, expected)
    name = flexion_coordinate(model, bones)
    slope, constant = _flexion_of(model, bones, name)
    gone = {c.name for c in joint.coordinates if c.name != name}
    _take_out(edits, joint, gone)
    flexion_deg = _finer(motion.flexion_deg)
    knots = (np.deg2rad(flexion_deg) - constant) / slope
    order = np.argsort(knots)
    poses = np.column_stack([flexion_deg, motion.at(flexion_deg)])
    table = _between_frames(joint, bones, poses, shifts)[order]
    values = np.column_stack([np.deg2rad(table[:, :3]), 1e-3 * table[:, 3:]])
    columns = dict(zip(("flexion", *FREE_COORDINATES), values.T, strict=True))
    own = columns.pop("flexion") - (slope * knots[order] + constant)
    shift = float(np.mean(own))
    if np.rad2deg(np.abs(own - shift)).max() > _STRAIGHT_DEG:
        expected = "frames of the joint whose Z axis is that of the femur, for flexion about it"
        raise model.file.problem(joint.element, "frames", "turned", expected)
    transform = joint.element.child("SpatialTransform")
    assert transform is not None  # otherwise nothing would turn
    wrapped = any(e.tag == "function" for e in transform.walk())
    side = SIDES[bones.side]
    text = transform_axes(side, name, knots[order], columns, (slope, constant + shift), wrapped)
    edits.splices.append((*transform.inner, f"\n{text}\n        ".encode()))
    low, high = flexion_deg[[0, -1]]
    without = f"; without {', '.join(sorted(gone))}" if gone else ""
    edits.changes.append(
        f"{joint.name}: follows {name} along splines from {low:.4g} to {high:.4g} degrees{without}"
    )


def couple_model(
    model_path: str | os.PathLike[str],
    side: str,
    motion: CoupledMotion,
    shifts: Registration,
    bones: tuple[str, str] | None = None,
) -> bytes:
    """A model whose knee follows flexion as a motion does.

    Args:
        model_path: the model (.osim).
        side: `r` or `l`.
        motion: from `coupled_motion`, in the frames of a knee.
        shifts: from the model's frames to those, from `registered`.
        bones: bodies that are the femur and the tibia; by default found by names.

    Returns:
        The new model; the old one's bytes but for the knee's joint.

    Raises:
        InputProblem: see `couple_knee`.
    """
    edits = Edits(read_model(model_path))
    couple_knee(edits, find_knee(edits.model, side, *(bones or ())), motion, shifts)
    return edits.model.file.spliced(edits.splices)


def _flexion_of(model: Model, bones: OsimKneeJoint, name: str) -> tuple[float, float]:
    """Slope and constant of flexion, rad, over a coordinate."""
    angle = np.linspace(-_SPAN, _SPAN, 5)
    flexion = np.deg2rad(poses_of(moved(model, {name: angle}).between(bones.femur, bones.tibia),
                                  bones.side)[:, 0])  # fmt: skip
    slope = float(np.sign(flexion[-1] - flexion[0]))
    constant = float(np.mean(flexion - slope * angle))
    off = np.rad2deg(np.abs(flexion - slope * angle - constant).max())
    # Small rotations about other axes change it by their products.
    if off > 1.0:
        expected = "flexion that is the coordinate but for its sign and a constant"
        found = f"up to {off:.2g} degrees otherwise"
        raise model.file.problem(bones.joints[0].element, name, found, expected)
    return slope, round(constant, 12) + 0.0


def _finer(knots: np.ndarray) -> np.ndarray:
    """Knots with seven between each two: in frames far from the knee splines of the same knots
    would be others, by up to 0.2 micrometres at 0.4 m and knots 10 degrees apart."""
    count = len(knots)
    return np.interp(np.arange(8 * (count - 1) + 1) / 8.0, np.arange(count), knots)


def _between_frames(
    joint: Joint, bones: OsimKneeJoint, table: np.ndarray, shifts: Registration
) -> np.ndarray:
    """Poses of the joint's child frame in its parent frame, degrees and mm, by clinical meaning."""
    placement, count = Pose.from_table(table).placement, len(table)
    assert placement.rotation is not None  # a pose turns
    rows = [[np.broadcast_to(np.asarray(x), count) for x in row] for row in placement.rotation]
    turn = np.moveaxis(np.array(rows, float), -1, 0)
    place = table[:, 3:] + np.einsum("nij,j->ni", turn, shifts.tibia) - shifts.femur
    mirror = np.diag([1.0, 1.0, -1.0 if bones.side == "l" else 1.0])
    there = Rigid(mirror @ turn @ mirror, 1e-3 * place @ mirror)
    parent, child = Rigid.of(joint.parent_frame), Rigid.of(joint.child_frame)
    return poses_of(parent.inverse().after(there).after(child), bones.side)


def _take_out(edits: Edits, joint: Joint, gone: set[str]) -> None:
    """Coordinates that go, and the constraints and forces that act on them."""
    model = edits.model
    for element in model.elements():
        for child in element.children:
            asks = child.tag == "independent_coordinate_names" or child.tag.endswith("_coordinate")
            words = {word.rsplit("/", 1)[-1] for word in child.text.split()} if asks else set()
            if gone & words:
                expected = "a coordinate that stays: this one follows flexion from now on"
                raise model.file.problem(element, child.tag, ", ".join(gone & words), expected)
        own = element.tag == "Coordinate" and element.name in gone and _within(element, joint)
        on_it = {element.word(tag).rsplit("/", 1)[-1] for tag in _ON_COORDINATE} & gone
        if own or on_it:
            space = _BREAK_BEFORE.search(model.file.data, 0, element.start)
            start = space.start() if space else element.start
            edits.splices.append((start, element.end, b""))
            if not own:
                edits.changes.append(f"{element.tag} {element.name}: taken out")


def _within(element: Element, joint: Joint) -> bool:
    return any(one is joint.element for one in element.ancestors())
