"""Joint files: the axis points of a simple joint, in readable YAML, and the joint for OpenSim."""

__all__ = ["JointExport", "JointFile", "export_joint", "format_joint", "read_joint", "write_joint"]

import dataclasses
import os
from typing import Annotated

import jax
import jax.numpy as jnp
import numpy as np

from kneejax.files import reading
from kneejax.files.knee.parts import mirror
from kneejax.files.opensim.coupled import transform_axes
from kneejax.files.opensim.model import simm_spline
from kneejax.files.reading import InputProblem, Part, Text, checked, entries, meaning, one_of, reads
from kneejax.geometry import FREE_COORDINATES, TIBIA, State
from kneejax.joints import INTERPOLATIONS, Joint, UnsuitableAxis, check_joint
from kneejax.mechanics import Range

_KIND = "joint"
_FLEXION = Range(-180.0, 180.0, "degrees")
Point = Annotated[tuple[float, float, float], reading.numbers_within(3, "point_mm")]


class Knot(Part):
    """The axis at one flexion: two points on each bone."""

    flexion_deg: Annotated[float, reads(reading.number, _FLEXION)] = meaning("at which")
    femoral_medial_mm: Point = meaning("on the femur")
    femoral_lateral_mm: Point = meaning("on the femur")
    tibial_medial_mm: Point = meaning("on the tibia")
    tibial_lateral_mm: Point = meaning("on the tibia")


_POINTS = tuple(Knot.model_fields)[1:]


class JointFields(Part):
    """All that a joint file may say."""

    kneejax: str = meaning("what the file is")
    name: Text = meaning("of the joint")
    side: Annotated[str, one_of(["right", "left"])] = meaning("of the knee")
    knots: Annotated[list[Knot], entries("knots")] = meaning("by flexion")
    interpolation: Annotated[str, one_of(INTERPOLATIONS)] = meaning("between knots", "linear")
    source: Text = meaning("where its numbers come from", "")
    notes: Text = meaning("anything else", "")


@dataclasses.dataclass(frozen=True)
class JointFile:
    """A joint and what its file says about it.

    Attributes:
        joint: as that of a right knee; a left one is mirrored.
        name: of the joint.
        side: `right` or `left`.
        source: where its numbers come from; may be empty.
        notes: anything else; may be empty.

    Example:
        >>> import kneejax as kj
        >>> pose = kj.Pose.from_table([0.0] * 6)
        >>> turning = kj.hinge([[0.0, 0.0, -40.0], [0.0, 0.0, 40.0]], pose)
        >>> JointFile(turning, "a hinge").side
        'right'
    """

    joint: Joint
    name: str
    side: str = "right"
    source: str = ""
    notes: str = ""


def read_joint(path: str | os.PathLike[str]) -> JointFile:
    """Read a joint file.

    Points of a left knee stand in the file with Z to the person's right, as in a knee file.

    Args:
        path: the file.

    Returns:
        The joint, as that of a right knee, and the file's words.

    Raises:
        InputProblem: the file cannot be read, a field is missing, unknown or not what it should
            be, flexion does not increase from knot to knot, or the points make no transverse axis.

    Example:
        >>> import tempfile, pathlib
        >>> path = pathlib.Path(tempfile.mkdtemp()) / "hinge.yaml"
        >>> axis = jnp.array([[[0.0, 0.0, -20.0], [0.0, 0.0, 20.0]]])
        >>> write_joint(JointFile(Joint(jnp.zeros(1), axis, axis), "hinge"), path)
        >>> read_joint(path).joint.femoral.tolist()
        [[[0.0, 0.0, -20.0], [0.0, 0.0, 20.0]]]
    """
    document = reading.load_yaml(path, "a joint file")
    kind = document.get("kneejax", "missing") if isinstance(document, dict) else _KIND
    if kind != _KIND:
        expected = f"{_KIND}: this is no file that kneejax joint fit wrote"
        raise InputProblem(path, "kneejax", kind, expected)
    whole = checked(JointFields, document, os.fspath(path))
    bends = jnp.deg2rad(jnp.asarray([knot.flexion_deg for knot in whole.knots]))
    points = np.array([[getattr(knot, name) for name in _POINTS] for knot in whole.knots])
    points = jnp.asarray(points * mirror(whole.side))
    joint = Joint(bends, points[:, :2], points[:, 2:], whole.interpolation)
    try:
        check_joint(joint)
    except UnsuitableAxis as error:
        raise InputProblem(path, f"knots, {error.field}", error.found, error.expected) from None
    return JointFile(joint, whole.name, whole.side, whole.source, whole.notes)


def format_joint(file: JointFile) -> str:
    """The text of a joint file; `read_joint` gives the same numbers back, to rounding of degrees.

    Args:
        file: the joint and what to say about it.

    Returns:
        YAML.

    Example:
        >>> import kneejax as kj
        >>> pose = kj.Pose.from_table([0.0] * 6)
        >>> turning = kj.hinge([[0.0, 0.0, -40.0], [0.0, 0.0, 40.0]], pose)
        >>> "right" in format_joint(JointFile(turning, "a hinge"))
        True
    """
    joint, degrees = file.joint, np.rad2deg(np.asarray(file.joint.flexion))
    points = np.concatenate([joint.femoral, joint.tibial], axis=1) * mirror(file.side)
    points = points + 0.0  # no minus before a zero
    knots = [{"flexion_deg": float(bend)} | dict(zip(_POINTS, own.tolist(), strict=True))
             for bend, own in zip(degrees, points, strict=True)]
    document = {"kneejax": _KIND, "name": file.name, "side": file.side,
                "interpolation": joint.interpolation, "knots": knots, "source": file.source,
                "notes": file.notes}
    return reading.format_yaml({name: said for name, said in document.items() if said != ""})


def write_joint(file: JointFile, path: str | os.PathLike[str]) -> None:
    """Write a joint file, completely or not at all.

    Args:
        file: the joint and what to say about it.
        path: the file.

    Raises:
        InputProblem: it cannot be written.
    """
    reading.write_text(path, format_joint(file))


#: Splines leave less than this of every pose, degrees and mm.
TOLERANCE = 5e-7
#: The range of flexion in the file, degrees, unless calibration angles lie beyond it.
RANGE_DEG = (-10.0, 140.0)

# OpenSim takes knots nearer than 1e-7 rad for that far apart.
_NEAREST = 1.2e-7
_BLOCK = 512
_WIDEST_DEG, _RATIO, _HALVINGS = 4.0, 2.0, 5
_MODEL = """<?xml version="1.0" encoding="UTF-8"?>
<OpenSimDocument Version="40000">
  <Model name="{name}">
    <length_units>meters</length_units>
    <force_units>N</force_units>
    <Ground name="ground"/>
    <BodySet><objects>
      <Body name="{femur}"><mass>1</mass><mass_center>0 0 0</mass_center>
        <inertia>0.01 0.01 0.01 0 0 0</inertia></Body>
      <Body name="{tibia}"><mass>1</mass><mass_center>0 0 0</mass_center>
        <inertia>0.01 0.01 0.01 0 0 0</inertia></Body>
    </objects></BodySet>
    <JointSet><objects>
      <WeldJoint name="ground_{femur}">
        <socket_parent_frame>/ground</socket_parent_frame>
        <socket_child_frame>/bodyset/{femur}</socket_child_frame>
      </WeldJoint>
{joint}
    </objects></JointSet>
  </Model>
</OpenSimDocument>
"""
_JOINT = """      <CustomJoint name="knee_{s}">
        <!-- {note} -->
        <socket_parent_frame>/bodyset/{femur}</socket_parent_frame>
        <socket_child_frame>/bodyset/{tibia}</socket_child_frame>
        <coordinates>
          <Coordinate name="{coordinate}">
            <default_value>0</default_value>
            <range>{low!r} {high!r}</range>
            <clamped>true</clamped>
          </Coordinate>
        </coordinates>
        <SpatialTransform>
{axes}
        </SpatialTransform>
      </CustomJoint>"""


@dataclasses.dataclass(frozen=True)
class JointExport:
    """A joint as OpenSim reads it."""

    snippet: str  # the `CustomJoint`, between bodies `femur_r` and `tibia_r` (or `_l`)
    model: str  # a whole model of those two bodies and the joint
    flexion_deg: np.ndarray  # knots of the splines, `(n,)`
    # largest difference of splines and joint, `FREE_COORDINATES`, degrees and mm, `(5,)`
    error: np.ndarray


def export_joint(file: JointFile) -> JointExport:
    """Write a joint as an OpenSim 4 CustomJoint with SimmSplines.

    Rotations follow each other about Z (minus flexion), X (adduction), Y (internal rotation), as in
    `kneejax.geometry.Pose`; translations are in femur axes, m. Knots crowd at the calibration
    angles, where a moving axis begins, ends or turns, since a cubic spline has no corners; their
    number is chosen by measuring what the splines leave.

    Args:
        file: the joint.

    Returns:
        The texts, and how well they meet the joint. `error` is above `TOLERANCE` only where corners
        are so sharp that OpenSim cannot resolve them.

    Example:
        >>> import kneejax as kj
        >>> pose = kj.Pose.from_table([0.0] * 6)
        >>> turning = kj.hinge([[0.0, 0.0, -40.0], [0.0, 0.0, 40.0]], pose)
        >>> found = export_joint(JointFile(turning, "a hinge"))
        >>> bool(found.error.max() < 0.01)
        True
    """
    bends = np.asarray(file.joint.flexion)
    low = min(np.deg2rad(RANGE_DEG[0]), bends[0] - np.deg2rad(10.0))
    high = max(np.deg2rad(RANGE_DEG[1]), bends[-1] + np.deg2rad(10.0))
    error = np.full(5, np.inf)
    for halving in range(_HALVINGS):
        last = error.max()
        knots = _knots(low, high, bends, np.deg2rad(_WIDEST_DEG) / 2**halving)
        values = _free(file.joint, knots)
        # The largest difference at three places of every interval, degrees and mm.
        places = (knots[:-1, None] + np.diff(knots)[:, None] * [0.2, 0.5, 0.8]).ravel()
        apart = np.abs(simm_spline(knots, values, places) - _free(file.joint, places))
        error = apart.max(axis=0) * np.r_[np.rad2deg([1.0, 1.0]), 1e3, 1e3, 1e3]
        if error.max() < TOLERANCE or error.max() > 0.7 * last:
            break
    s, bent = file.side[0], ", ".join(f"{x:.4g}" for x in np.rad2deg(bends))
    note = f"{_plain(file.name)}: a kneejax joint calibrated at {bent} degrees of flexion"
    names = {"femur": f"femur_{s}", "tibia": f"tibia_{s}"}
    columns = dict(zip(FREE_COORDINATES, values.T, strict=True))
    snippet = _JOINT.format(
        s=s, note=note, coordinate=f"knee_flexion_{s}", low=float(low), high=float(high),
        axes=transform_axes(file.side, f"knee_flexion_{s}", knots, columns), **names,
    )  # fmt: skip
    model = _MODEL.format(name=_plain(file.name) or "joint", joint=snippet, **names)
    return JointExport(snippet + "\n", model, np.rad2deg(knots), error)


def _knots(low: float, high: float, bends: np.ndarray, widest: float) -> np.ndarray:
    """Knots no wider apart than `widest`, ever nearer towards every bend."""
    ends = np.r_[low, bends, high] if len(bends) > 1 else np.array([low, high])
    knots = [ends]
    for i, (left, right) in enumerate(zip(ends, ends[1:], strict=False)):
        for end, sign, last in ((left, 1.0, i), (right, -1.0, len(ends) - 2 - i)):
            # From a bend distances double up to `widest`; the range's own ends are no bends.
            away = [widest if last < 1 else _NEAREST]
            while away[-1] < 0.5 * (right - left):
                away.append(away[-1] + min(away[-1] * (_RATIO - 1.0), widest))
            knots.append(end + sign * np.array(away[:-1]))
        knots.append(np.array([0.5 * (left + right)]))
    return np.unique(np.concatenate(knots))


_state = jax.jit(lambda joint, flexion: State({TIBIA: joint.pose(flexion)}).at(FREE_COORDINATES).T)


def _free(joint: Joint, flexion: np.ndarray) -> np.ndarray:
    """The five free coordinates as OpenSim has them, rad and m, shape `(n, 5)`."""
    # In blocks of one length: compiled once.
    blocks = np.pad(flexion, (0, -len(flexion) % _BLOCK), mode="edge").reshape(-1, _BLOCK)
    found = np.concatenate([np.asarray(_state(joint, block)) for block in blocks])
    return found[: len(flexion)] * [1.0, 1.0, 1e-3, 1e-3, 1e-3]


def _plain(text: str) -> str:
    """Text that may stand in a comment and in an attribute."""
    return "".join(c for c in text if c.isalnum() or c in " _.,()").strip()
