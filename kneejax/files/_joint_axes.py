"""Axis points and landmarks of a femur by coordinates, in YAML."""

from __future__ import annotations

import dataclasses
import os

import numpy as np

from kneejax.files._schema import Field
from kneejax.files._yaml import load_yaml

_SIDES = ("medial_mm", "lateral_mm")


@dataclasses.dataclass(frozen=True)
class AxisPoints:
    """Axis points of a femur.

    Attributes:
        points: medial and lateral point of the extension, then of the flexion axis, shape
            `(2, 2, 3)`, mm.
        epicondyles: medial, then lateral, shape `(2, 3)`, mm; None if the file has none.
    """

    points: np.ndarray
    epicondyles: np.ndarray | None


@dataclasses.dataclass(frozen=True)
class FemurLandmarks:
    """Landmarks of a femur, in its mesh's frame.

    Attributes:
        hip_center: centre of the femoral head, shape `(3,)`, mm; only roughly, if `head_within`
            is given.
        epicondyles: medial, then lateral, shape `(2, 3)`, mm.
        head_within: points of the mesh as near to `hip_center` as this, mm, are the femoral head;
            None if the centre is given.
    """

    hip_center: np.ndarray
    epicondyles: np.ndarray
    head_within: float | None


def read_axis_points(path: str | os.PathLike[str], side: str = "right") -> AxisPoints:
    """Read axis points: `extension`, `flexion` and, if known, `epicondyles`.

    Each has `medial_mm` and `lateral_mm`, three coordinates each, in the frame in which the femur's
    poses are measured: X anterior, Y superior, Z to the person's right.

    Args:
        path: a YAML file.
        side: `right`, or `left`: mirrored to the right.

    Returns:
        The points of a right knee.

    Raises:
        InputProblem: the file cannot be read, or a field is missing, unknown or no point.

    Example:
        >>> import tempfile, pathlib
        >>> path = pathlib.Path(tempfile.mkdtemp()) / "axes.yaml"
        >>> _ = path.write_text('''
        ... extension: {medial_mm: [6, 8, -21], lateral_mm: [1, 11, 23]}
        ... flexion: {medial_mm: [0, 2, -21], lateral_mm: [-2, 1, 24]}
        ... ''')
        >>> read_axis_points(path).points[1].tolist()
        [[0.0, 2.0, -21.0], [-2.0, 1.0, 24.0]]
    """
    whole = Field(os.fspath(path), "", load_yaml(path, "axis points"))
    whole.mapping(("extension", "flexion"), ("epicondyles",))
    points = np.stack([_both(whole[name], side) for name in ("extension", "flexion")])
    known = _both(whole["epicondyles"], side) if "epicondyles" in whole else None
    return AxisPoints(points, known)


def read_femur_landmarks(path: str | os.PathLike[str], side: str = "right") -> FemurLandmarks:
    """Read landmarks: `epicondyles`, and `hip_center_mm` or `femoral_head`.

    Args:
        path: a YAML file. `epicondyles` has `medial_mm` and `lateral_mm`; `femoral_head`, to fit a
            sphere to the mesh, has `near_mm` and `within_mm`.
        side: `right`, or `left`: mirrored to the right.

    Returns:
        The landmarks of a right knee.

    Raises:
        InputProblem: the file cannot be read, or a field is missing, unknown or no point.
    """
    whole = Field(os.fspath(path), "", load_yaml(path, "landmarks of a femur"))
    whole.mapping(("epicondyles",), ("hip_center_mm", "femoral_head"))
    if ("hip_center_mm" in whole) == ("femoral_head" in whole):
        raise whole.problem("hip_center_mm or femoral_head, one of both")
    epicondyles = _both(whole["epicondyles"], side)
    if "hip_center_mm" in whole:
        return FemurLandmarks(_point(whole["hip_center_mm"], side), epicondyles, None)
    head = whole["femoral_head"].mapping(("near_mm", "within_mm"))
    within = head["within_mm"].number(above=0)
    return FemurLandmarks(_point(head["near_mm"], side), epicondyles, within)


def _both(field: Field, side: str) -> np.ndarray:
    field.mapping(_SIDES)
    return np.stack([_point(field[name], side) for name in _SIDES])


def _point(field: Field, side: str) -> np.ndarray:
    return np.array(field.numbers(3)) * [1.0, 1.0, -1.0 if side == "left" else 1.0]
