"""Landmarks of femur and tibia, in the frames of their meshes, in YAML."""

from __future__ import annotations

import dataclasses
import os

import numpy as np

from kneejax.files.joint._axes import SIDES, both_points, point
from kneejax.files.reading import Field, load_yaml
from kneejax.mechanics import RANGES

_KINDS = ("mm", "ball")
_REQUIRED, _OPTIONAL = ("epicondyles",), ("hip_center_mm", "femoral_head", "tibia")


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


@dataclasses.dataclass(frozen=True)
class TibiaLandmarks:
    """Landmarks of a tibia, in its mesh's frame.

    Attributes:
        plateau: medial, then lateral edge, shape `(2, 3)`, mm.
        ankle: the ankle's centre, shape `(1, 3)`, or the malleoli, medial, then lateral, whose
            middle it is, shape `(2, 3)`, mm; only roughly, where `ankle_within` is given.
        ankle_within: for each, points of the mesh as near to it as this, mm, are a ball of bone
            about it; None where the point itself is given.
    """

    plateau: np.ndarray
    ankle: np.ndarray
    ankle_within: tuple[float | None, ...]


def read_femur_landmarks(path: str | os.PathLike[str], side: str = "right") -> FemurLandmarks:
    """Read landmarks: `epicondyles`, and `hip_center_mm` or `femoral_head`.

    Args:
        path: a YAML file. `epicondyles` has `medial_mm` and `lateral_mm`; `femoral_head`, to fit a
            sphere to the mesh, has `near_mm` and `within_mm`. It may have a section `tibia`, see
            `read_tibia_landmarks`.
        side: `right`, or `left`: mirrored to the right.

    Returns:
        The landmarks of a right knee.

    Raises:
        InputProblem: the file cannot be read, or a field is missing, unknown or no point.
    """
    whole = _whole(path)
    _one_of(whole, "hip_center_mm", "femoral_head")
    epicondyles = both_points(whole["epicondyles"], side)
    if "hip_center_mm" in whole:
        return FemurLandmarks(point(whole["hip_center_mm"], side), epicondyles, None)
    hip, within = _ball(whole["femoral_head"], side)
    return FemurLandmarks(hip, epicondyles, within)


def read_tibia_landmarks(path: str | os.PathLike[str], side: str = "right") -> TibiaLandmarks:
    """Read the section `tibia` of landmarks: `plateau`, and `ankle_center_mm` or `malleoli`.

    Args:
        path: a YAML file. `plateau`, its edges, has `medial_mm` and `lateral_mm`. `malleoli` has
            them too, or `medial_ball` and `lateral_ball` with `near_mm` and `within_mm`, to fit
            spheres to the mesh.
        side: `right`, or `left`: mirrored to the right.

    Returns:
        The landmarks of a right knee.

    Raises:
        InputProblem: the file cannot be read, or a field is missing, unknown or no point.

    Example:
        >>> import tempfile, pathlib
        >>> path = pathlib.Path(tempfile.mkdtemp()) / "landmarks.yaml"
        >>> _ = path.write_text('''
        ... hip_center_mm: [0, 400, 0]
        ... epicondyles: {medial_mm: [0, 0, -40], lateral_mm: [0, 0, 40]}
        ... tibia:
        ...   plateau: {medial_mm: [0, 0, -36], lateral_mm: [0, 0, 36]}
        ...   malleoli:
        ...     medial_ball: {near_mm: [5, -370, -30], within_mm: 10}
        ...     lateral_mm: [-10, -380, 30]
        ... ''')
        >>> read_tibia_landmarks(path).ankle_within
        (10.0, None)
    """
    whole = _whole(path)
    if "tibia" not in whole:
        raise Field(whole.file, "tibia", "missing").problem("landmarks of the tibia")
    tibia = whole["tibia"].mapping(("plateau",), ("ankle_center_mm", "malleoli"))
    _one_of(tibia, "ankle_center_mm", "malleoli")
    plateau = both_points(tibia["plateau"], side)
    if "ankle_center_mm" in tibia:
        return TibiaLandmarks(plateau, point(tibia["ankle_center_mm"], side)[None], (None,))
    malleoli = tibia["malleoli"].mapping((), [f"{name}_{k}" for name in SIDES for k in _KINDS])
    found = []
    for name in SIDES:
        _one_of(malleoli, *(f"{name}_{kind}" for kind in _KINDS))
        if f"{name}_mm" in malleoli:
            found.append((point(malleoli[f"{name}_mm"], side), None))
        else:
            found.append(_ball(malleoli[f"{name}_ball"], side))
    return TibiaLandmarks(plateau, np.stack([p for p, _ in found]), tuple(w for _, w in found))


def _whole(path: str | os.PathLike[str]) -> Field:
    whole = Field(os.fspath(path), "", load_yaml(path, "landmarks"))
    return whole.mapping(_REQUIRED, _OPTIONAL)


def _one_of(field: Field, one: str, other: str) -> None:
    if (one in field) == (other in field):
        found = Field(field.file, field.path, "both" if one in field else "neither")
        raise found.problem(f"{one} or {other}, one of both")


def _ball(field: Field, side: str) -> tuple[np.ndarray, float]:
    """A place near the centre of a ball of bone, mm, and within how many mm it is the ball."""
    field.mapping(("near_mm", "within_mm"))
    return point(field["near_mm"], side), field["within_mm"].number(RANGES["within_mm"])
