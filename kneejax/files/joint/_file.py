"""Joint files: the axis points of a simple joint, in readable YAML."""

from __future__ import annotations

import dataclasses
import os
from typing import Annotated

import jax.numpy as jnp
import numpy as np

from kneejax.files import reading
from kneejax.files.reading import InputProblem, Part, Text, checked, entries, meaning, one_of, reads
from kneejax.joints import INTERPOLATIONS, Joint, UnsuitableAxis, check_joint
from kneejax.mechanics import Range

_KIND = "joint"
_POINTS = ("femoral_medial_mm", "femoral_lateral_mm", "tibial_medial_mm", "tibial_lateral_mm")
_FLEXION = Range(-180.0, 180.0, "degrees")


Point = Annotated[tuple[float, float, float], reading.numbers_within(3, "point_mm")]


class Knot(Part):
    """The axis at one flexion: two points on each bone."""

    flexion_deg: Annotated[float, reads(reading.number, _FLEXION)] = meaning("at which")
    femoral_medial_mm: Point = meaning("on the femur")
    femoral_lateral_mm: Point = meaning("on the femur")
    tibial_medial_mm: Point = meaning("on the tibia")
    tibial_lateral_mm: Point = meaning("on the tibia")


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
    flexion = [knot.flexion_deg for knot in whole.knots]
    points = np.array([[getattr(knot, name) for name in _POINTS] for knot in whole.knots])
    points = points * _mirror(whole.side)
    joint = Joint(
        jnp.deg2rad(jnp.asarray(flexion)),
        jnp.asarray(points[:, :2]),
        jnp.asarray(points[:, 2:]),
        whole.interpolation,
    )
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
    joint = file.joint
    points = np.concatenate([joint.femoral, joint.tibial], axis=1) * _mirror(file.side)
    points = points + 0.0  # no minus before a zero
    degrees = np.rad2deg(np.asarray(joint.flexion))
    document = {"kneejax": _KIND, "name": file.name, "side": file.side}
    document |= {"interpolation": joint.interpolation}
    document["knots"] = [
        {"flexion_deg": float(degrees[i])}
        | {name: points[i, j].tolist() for j, name in enumerate(_POINTS)}
        for i in range(len(degrees))
    ]
    document |= {k: v for k, v in (("source", file.source), ("notes", file.notes)) if v}
    return reading.format_yaml(document)


def write_joint(file: JointFile, path: str | os.PathLike[str]) -> None:
    """Write a joint file, completely or not at all.

    Args:
        file: the joint and what to say about it.
        path: the file.

    Raises:
        InputProblem: it cannot be written.
    """
    reading.write_text(path, format_joint(file))


def _mirror(side: str) -> np.ndarray:
    return np.array([1.0, 1.0, -1.0 if side == "left" else 1.0])
