"""Joint files: the axis points of a simple joint, in readable YAML."""

from __future__ import annotations

import dataclasses
import os

import jax.numpy as jnp
import numpy as np

from kneejax.files.reading import Field, InputProblem, format_yaml, load_yaml, write_text
from kneejax.joints import INTERPOLATIONS, Joint, UnsuitableAxis, check_joint
from kneejax.mechanics import RANGES, Range

_KIND = "joint"
_FIELDS = ("kneejax", "name", "side", "knots")
_FURTHER = ("interpolation", "source", "notes")
_POINTS = ("femoral_medial_mm", "femoral_lateral_mm", "tibial_medial_mm", "tibial_lateral_mm")
_SIDES = ("right", "left")
_FLEXION = Range(-180.0, 180.0, "degrees")


@dataclasses.dataclass(frozen=True)
class JointFile:
    """A joint and what its file says about it.

    Attributes:
        joint: as that of a right knee; a left one is mirrored.
        name: of the joint.
        side: `right` or `left`.
        source: where its numbers come from; may be empty.
        notes: anything else; may be empty.
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
    whole = Field(os.fspath(path), "", load_yaml(path, "a joint file"))
    kind = whole.value.get("kneejax", "missing") if isinstance(whole.value, dict) else _KIND
    if kind != _KIND:
        expected = f"{_KIND}: this is no file that kneejax joint fit wrote"
        raise InputProblem(path, "kneejax", kind, expected)
    whole.mapping(_FIELDS, _FURTHER)
    side = whole["side"].choice(_SIDES)
    knots = [knot.mapping(("flexion_deg", *_POINTS)) for knot in whole["knots"].items("knots")]
    flexion = [knot["flexion_deg"].number(_FLEXION) for knot in knots]
    inside = RANGES["point_mm"]
    points = np.array([[knot[name].numbers(3, inside) for name in _POINTS] for knot in knots])
    points = points * _mirror(side)
    interpolation = "linear"
    if "interpolation" in whole:
        interpolation = whole["interpolation"].choice(INTERPOLATIONS)
    joint = Joint(
        jnp.deg2rad(jnp.asarray(flexion)),
        jnp.asarray(points[:, :2]),
        jnp.asarray(points[:, 2:]),
        interpolation,
    )
    try:
        check_joint(joint)
    except UnsuitableAxis as error:
        raise InputProblem(path, f"knots, {error.field}", error.found, error.expected) from None
    source, notes = (whole[name].text() if name in whole else "" for name in ("source", "notes"))
    return JointFile(joint, whole["name"].text(), side, source, notes)


def format_joint(file: JointFile) -> str:
    """The text of a joint file; `read_joint` gives the same numbers back, to rounding of degrees.

    Args:
        file: the joint and what to say about it.

    Returns:
        YAML.
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
    return format_yaml(document)


def write_joint(file: JointFile, path: str | os.PathLike[str]) -> None:
    """Write a joint file, completely or not at all.

    Args:
        file: the joint and what to say about it.
        path: the file.

    Raises:
        InputProblem: it cannot be written.
    """
    write_text(path, format_joint(file))


def _mirror(side: str) -> np.ndarray:
    return np.array([1.0, 1.0, -1.0 if side == "left" else 1.0])
