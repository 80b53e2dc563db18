"""A model's knee of one coordinate: its secondary motion follows flexion along splines."""

__all__ = ["couple_model", "coupled_motion"]

import dataclasses
import os
from collections.abc import Mapping

import numpy as np

from kneejax.files.opensim.exact import MIRROR, Rigid, poses_of
from kneejax.files.opensim.frames import Registration, flexion_coordinate, flexions
from kneejax.files.opensim.knee import SIDES, OsimKneeJoint, find_knee
from kneejax.files.opensim.model import Model, read_model, simm_spline
from kneejax.files.opensim.xml import last_word, parse_xml
from kneejax.files.reading import InputProblem
from kneejax.geometry import FEMUR, FREE_COORDINATES, Pose

_APART_DEG = 10.0  # between knots where many poses share a flexion, degrees
#: Weight of a spline's bending beside a pose's distance, for knots between which no pose lies.
_STIFF = 1e-3
_FEWEST = 4
_KIND = "CustomJoint"
#: Between the angles at which a model's flexion is compared with its coordinate, rad.
_SPAN = 0.5
_STRAIGHT_DEG = 1e-6
#: By which a force or a constraint says on which coordinate it acts.
_ON_COORDINATE = "coordinate", "dependent_coordinate_name"
_AXIS = """          <TransformAxis name="{name}">
            <coordinates>{coordinate}</coordinates>
            <axis>{axis}</axis>
            {function}
          </TransformAxis>"""
# Coordinate -> axis of the transform, of a right knee and of a left one, Z to the person's right.
_AXES = {
    "flexion": ("rotation1", "0 0 1", "0 0 1"),
    "adduction": ("rotation2", "1 0 0", "-1 0 0"),
    "internal_rotation": ("rotation3", "0 1 0", "0 -1 0"),
    "anterior": ("translation1", "1 0 0", "1 0 0"),
    "superior": ("translation2", "0 1 0", "0 1 0"),
    "lateral": ("translation3", "0 0 1", "0 0 -1"),
}


@dataclasses.dataclass(frozen=True)
class CoupledMotion:
    """Splines of OpenSim's kind over flexion."""

    flexion_deg: np.ndarray  # knots, increasing, `(k,)`
    secondary: np.ndarray  # `FREE_COORDINATES` at the knots, degrees and mm, `(k, 5)`
    rms: np.ndarray  # what the splines leave of the poses, `(5,)`, likewise

    def at(self, flexion_deg: np.ndarray) -> np.ndarray:
        """The secondary motion at flexions `(n,)`, `(n, 5)`; straight beyond the knots."""
        return simm_spline(self.flexion_deg, self.secondary, flexion_deg)


def coupled_motion(
    poses: np.ndarray, file: str = "poses", knots_deg: np.ndarray | None = None
) -> CoupledMotion:
    """Splines of flexion through poses, or between them.

    Where flexion grows or falls from row to row, splines pass through every pose. Otherwise, as in
    a step of walking, which is bent to one angle several times, they are the nearest to all poses
    by least squares, with knots every 10 degrees.

    Args:
        poses: table rows, `(n, 6)`, degrees and mm.
        file: from which they come, for errors.
        knots_deg: of the splines, to compare several motions; by default as above.

    Raises:
        InputProblem: fewer than four flexions.

    Example:
        >>> flexion = np.array([0.0, 30.0, 60.0, 90.0])
        >>> table = np.column_stack([flexion, *[0.01 * flexion] * 5])
        >>> coupled_motion(table).at(np.array([45.0])).round(6).tolist()
        [[0.45, 0.45, 0.45, 0.45, 0.45]]
    """
    flexion, secondary = poses[:, 0], poses[:, 1:]
    steps = np.diff(flexion)
    ordered = (steps > 0).all() or (steps < 0).all()
    if len(np.unique(flexion)) < _FEWEST:
        found = f"{len(np.unique(flexion))} of them"
        raise InputProblem(file, "flexion_deg", found, f"{_FEWEST} or more different ones")
    if ordered and knots_deg is None:
        rows = np.argsort(flexion)
        return CoupledMotion(flexion[rows], secondary[rows], np.zeros(secondary.shape[1]))
    knots = knots_deg
    if knots is None:
        count = max(_FEWEST, 1 + round(float(np.ptp(flexion)) / _APART_DEG))
        knots = np.linspace(flexion.min(), flexion.max(), count)
    # Splines are linear in their values at the knots.
    by_value = simm_spline(knots, np.eye(len(knots)), flexion)
    bend = np.sqrt(_STIFF * len(flexion)) * np.diff(np.eye(len(knots)), 2, axis=0)
    wanted = np.vstack([secondary, np.zeros((len(bend), secondary.shape[1]))])
    values = np.linalg.lstsq(np.vstack([by_value, bend]), wanted, rcond=None)[0]
    rms = np.sqrt(np.mean((by_value @ values - secondary) ** 2, axis=0))
    return CoupledMotion(knots, values, rms)


def couple_model(
    model_path: str | os.PathLike[str], side: str, motion: CoupledMotion, shifts: Registration,
    bones: tuple[str, str] | None = None,
) -> bytes:  # fmt: skip
    """A model whose knee follows flexion as a motion does.

    Args:
        model_path: the model (.osim).
        side: `r` or `l`.
        motion: from `coupled_motion`, in the frames of a knee.
        shifts: from the model's frames to those, from `registered`.
        bones: bodies that are the femur and the tibia; by default found by names.

    Returns:
        The new model, in which all but the knee's joint stays.

    Raises:
        InputProblem: the knee is not one CustomJoint, its flexion is not its coordinate but for
            sign and a constant, or something else depends on a coordinate that goes.
    """
    model = read_model(model_path)
    couple_knee(model, find_knee(model, side, *(bones or ())), motion, shifts)
    return model.file.written()


def couple_knee(
    model: Model, bones: OsimKneeJoint, motion: CoupledMotion, shifts: Registration
) -> list[str]:
    """As `couple_model`, in a model that was read; a sentence for each change."""
    joint, *others = bones.joints
    upwards = bones.bone_of(joint.child) == FEMUR
    if others or joint.kind != _KIND or joint.reverse or upwards or bones.turned:
        found = ", ".join(f"{one.kind} {one.name}" for one in bones.joints)
        found += ", upwards" * upwards + ", with other axes" * bones.turned
        expected = f"one {_KIND} from femur to tibia, for its coordinates to follow flexion"
        raise joint.element.problem("joint", found, expected)
    name = flexion_coordinate(bones)
    # Flexion, rad, is slope times the coordinate and a constant; small rotations about other axes
    # change it by their products.
    angle = np.linspace(-_SPAN, _SPAN, 5)
    flexion = np.deg2rad(flexions(model, bones, name, angle))
    slope = float(np.sign(flexion[-1] - flexion[0]))
    rest = flexion - slope * angle
    constant = round(float(np.mean(rest)), 12) + 0.0
    if (off := np.rad2deg(np.abs(rest - np.mean(rest)).max())) > 1.0:
        expected = "flexion that is the coordinate but for its sign and a constant"
        raise joint.element.problem(name, f"up to {off:.2g} degrees otherwise", expected)
    gone, found = {c.name for c in joint.coordinates if c.name != name}, []
    for element in model.elements:
        for child in element.children:
            asks = child.tag == "independent_coordinate_names" or child.tag.endswith("_coordinate")
            words = {*map(last_word, child.content.split())} if asks else set()
            if gone & words:
                expected = "a coordinate that stays: this one follows flexion from now on"
                raise element.problem(child.tag, ", ".join(gone & words), expected)
        own = element.tag == "Coordinate" and element.name in gone
        own = own and joint.element in element.iterancestors()
        if own or {element.last_word(tag) for tag in _ON_COORDINATE} & gone:
            found.append((element, own))
    for element, _ in found:
        element.take_out()
    changes = [f"{element.tag} {element.name}: taken out" for element, own in found if not own]
    # Knots with seven between each two: in frames far from the knee splines of the same knots
    # would be others, by up to 0.2 micrometres at 0.4 m and knots 10 degrees apart.
    count = len(motion.flexion_deg)
    flexion_deg = np.interp(np.arange(8 * count - 7) / 8.0, np.arange(count), motion.flexion_deg)
    knots = (np.deg2rad(flexion_deg) - constant) / slope
    order = np.argsort(knots)
    # Poses of the joint's child frame in its parent frame, by clinical meaning.
    secondary, mirror = motion.at(flexion_deg), MIRROR[bones.side]
    placement = Pose.from_table(np.column_stack([flexion_deg, secondary])).placement
    assert placement.rotation is not None  # a pose turns
    rows = [[np.broadcast_to(x, len(order)) for x in row] for row in placement.rotation]
    turn = np.moveaxis(np.array(rows, float), -1, 0)
    place = secondary[:, 2:] + turn @ shifts.tibia - shifts.femur
    there = Rigid(mirror @ turn @ mirror, 1e-3 * place @ mirror)
    there = joint.parent_frame.inverse().after(there).after(joint.child_frame)
    table = poses_of(there, bones.side)[order]
    values = np.column_stack([np.deg2rad(table[:, :3]), 1e-3 * table[:, 3:]])
    columns = dict(zip(FREE_COORDINATES, values.T[1:], strict=True))
    own = values[:, 0] - (slope * knots[order] + constant)
    shift = float(np.mean(own))
    if np.rad2deg(np.abs(own - shift)).max() > _STRAIGHT_DEG:
        expected = "frames of the joint whose Z axis is that of the femur, for flexion about it"
        raise joint.element.problem("frames", "turned", expected)
    transform = joint.element.child("SpatialTransform")
    assert transform is not None  # otherwise nothing would turn
    wrapped = any(e.tag == "function" for e in transform.iter())
    text = transform_axes(
        SIDES[bones.side], name, knots[order], columns, (slope, constant + shift), wrapped)
    text = f"<SpatialTransform>\n{text}\n        </SpatialTransform>"
    new = parse_xml("", "axes", text.encode()).root
    transform[:] = new[:]
    transform.text = new.text
    low, high = flexion_deg[[0, -1]]
    without = f"; without {', '.join(sorted(gone))}" if gone else ""
    follows = f"follows {name} along splines from {low:.4g} to {high:.4g} degrees"
    return [*changes, f"{joint.name}: {follows}{without}"]


def transform_axes(
    side: str, coordinate: str, knots: np.ndarray, columns: Mapping[str, np.ndarray],
    flexion: tuple[float, float] = (1.0, 0.0), wrapped: bool = False,
) -> str:  # fmt: skip
    """Axes of a SpatialTransform by values at knots `(n,)`, rad or m; flexion: slope, constant."""
    axes, named = [], "" if wrapped else ' name="function"'
    for name, (axis, right, left) in _AXES.items():
        if name == "flexion":
            numbers = f"{-flexion[0]:.17g} {-flexion[1] + 0.0:.17g}"
            kind, text = "LinearFunction", f"<coefficients>{numbers}</coefficients>"
        else:
            x, y = (" ".join(repr(float(one)) for one in row) for row in (knots, columns[name]))
            kind, text = "SimmSpline", f"<x>{x}</x><y>{y}</y>"
        function = f"<{kind}{named}>{text}</{kind}>"
        function = f"<function>{function}</function>" if wrapped else function
        axes.append(_AXIS.format(name=axis, coordinate=coordinate, function=function,
                                 axis=left if side == "left" else right))
    return "\n".join(axes)
