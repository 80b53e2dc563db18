"""Axis points of a femur, in YAML or CSV, and landmarks of femur and tibia, in YAML."""

__all__ = [
    "AxisPoints", "read_axis_points", "read_femur_landmarks", "read_tibia_landmarks",
    "write_axis_points",
]

import dataclasses
import itertools
import os
from pathlib import Path
from typing import Annotated

import numpy as np

from kneejax.files import reading
from kneejax.files.knee.parts import mirror
from kneejax.files.reading import InputProblem, Mistakes, Number, Part, checked, wrong
from kneejax.files.tables.tables import Table, write_rows
from kneejax.mechanics import RANGES

SIDES = ("medial", "lateral")
_AXES, _FURTHER = ("extension", "flexion"), "epicondyles"
_COORDINATES = ("anterior_mm", "superior_mm", "lateral_mm")
_COLUMNS = ("axis", "side", *_COORDINATES)
# Medial and lateral points of a knee in mm are farther apart; in metres they are not.
_METRES_BELOW = 1.0
Point = Annotated[tuple[float, float, float], reading.numbers_within(3, "scan_mm")]


class Pair(Part):
    """Two points of a knee."""

    medial_mm: Point  # with Z to the person's right
    lateral_mm: Point

    def points(self, side: str) -> np.ndarray:
        """Medial, then lateral point of a right knee, shape `(2, 3)`, mm."""
        return np.array([self.medial_mm, self.lateral_mm]) * mirror(side)


class Axes(Part):
    """All that a file of axis points may say."""

    extension: Pair
    flexion: Pair
    epicondyles: Pair | None = None


class Ball(Part):
    """A ball of bone, to which a sphere is fitted: what is within a distance of a place."""

    near_mm: Point
    within_mm: Number


def _check_one_of(part: Part, one: str, other: str) -> None:
    both = getattr(part, one) is not None
    if both == (getattr(part, other) is not None):
        raise wrong("both" if both else "neither", f"{one} or {other}, one of both")


class Malleoli(Part):
    """Both sides of the ankle, each a point or a ball of bone."""

    medial_mm: Point | None = None
    medial_ball: Ball | None = None
    lateral_mm: Point | None = None
    lateral_ball: Ball | None = None

    @reading.checks
    def _check_each(self, mistakes: Mistakes) -> None:
        for side in SIDES:
            _check_one_of(self, f"{side}_mm", f"{side}_ball")


class TibiaFields(Part):
    """Landmarks of the tibia."""

    plateau: Pair
    ankle_center_mm: Point | None = None
    malleoli: Malleoli | None = None  # whose middle it is instead

    @reading.checks
    def _check_ankle(self, mistakes: Mistakes) -> None:
        _check_one_of(self, "ankle_center_mm", "malleoli")


class Landmarks(Part):
    """All that a file of landmarks may say."""

    epicondyles: Pair
    hip_center_mm: Point | None = None
    femoral_head: Ball | None = None  # where to fit a sphere instead
    tibia: TibiaFields | None = None  # in the frame of its mesh


@dataclasses.dataclass(frozen=True)
class AxisPoints:
    """Axis points of a femur, mm."""

    # medial and lateral, of the extension, then of the flexion axis, `(2, 2, 3)`
    points: np.ndarray
    epicondyles: np.ndarray | None  # medial, then lateral, `(2, 3)`; None if the file has none


def read_axis_points(path: str | os.PathLike[str], side: str = "right") -> AxisPoints:
    """Read axis points: `extension`, `flexion` and, if known, `epicondyles`.

    A YAML file gives each axis `medial_mm` and `lateral_mm`, three coordinates each, in the frame
    in which the femur's poses are measured: X anterior, Y superior, Z to the person's right. A CSV
    table (ending in `.csv`) has a row per point with the columns `axis`, `side` (`medial` or
    `lateral`), `anterior_mm`, `superior_mm`, `lateral_mm`: by meaning, the same for both knees.

    Args:
        path: the file.
        side: `right`, or `left`: the points of a YAML file are mirrored to the right.

    Returns:
        The points of a right knee.

    Raises:
        InputProblem: the file cannot be read, a field, column or row is missing, unknown, no
            point, or there twice, or the points look like metres.

    Example:
        >>> import tempfile, pathlib
        >>> folder = pathlib.Path(tempfile.mkdtemp())
        >>> _ = (folder / "axes.yaml").write_text('''
        ... extension: {medial_mm: [6, 8, -21], lateral_mm: [1, 11, 23]}
        ... flexion: {medial_mm: [0, 2, -21], lateral_mm: [-2, 1, 24]}
        ... ''')
        >>> found = read_axis_points(folder / "axes.yaml")
        >>> found.points[1].tolist()
        [[0.0, 2.0, -21.0], [-2.0, 1.0, 24.0]]
        >>> write_axis_points(found, folder / "axes.csv")
        >>> bool((read_axis_points(folder / "axes.csv").points == found.points).all())
        True
    """
    is_table = Path(path).suffix.lower() == ".csv"
    if is_table:
        axes = _from_table(os.fspath(path))
    else:
        whole = checked(Axes, reading.load_yaml(path, "axis points"), os.fspath(path))
        axes = {name: pair.points(side) for name, pair in whole if pair is not None}
    for name, (medial, lateral) in axes.items():
        width = float(np.linalg.norm(lateral - medial))
        if width < _METRES_BELOW:
            found = f"medial and lateral point {width:.3g} mm apart"
            raise InputProblem(path, name, found, "points in mm; metres are suspected")
    return AxisPoints(np.stack([axes[name] for name in _AXES]), axes.get(_FURTHER))


def write_axis_points(axes: AxisPoints, path: str | os.PathLike[str]) -> None:
    """Write axis points as a CSV table, completely or not at all.

    Args:
        axes: the points.
        path: the table, ending in `.csv`.

    Raises:
        InputProblem: it cannot be written.
    """
    named = dict(zip(_AXES, axes.points, strict=True))
    if axes.epicondyles is not None:
        named[_FURTHER] = axes.epicondyles
    rows = [[axis, side, *map(float, point)] for axis, pair in named.items()
            for side, point in zip(SIDES, pair, strict=True)]
    write_rows(path, list(_COLUMNS), rows)


def _from_table(file: str) -> dict[str, np.ndarray]:
    table, known = Table.read(file, _COLUMNS), (*_AXES, _FURTHER)
    for name in table.header:
        if name not in _COLUMNS:
            raise InputProblem(file, "header", name, f"only {', '.join(_COLUMNS)}")
    columns = [table.column(name, RANGES["scan_mm"]) for name in _COORDINATES]
    words = [table.cells(name) for name in ("axis", "side")]
    for cells, options in zip(words, (known, SIDES), strict=True):
        for place, word in cells:
            if word not in options:
                table.wrong(place, word, options)
    table.mistakes.check()
    points: dict[tuple[str, str], int] = {}
    for row, ((_, axis), (_, side)) in enumerate(zip(*words, strict=True)):
        if (first := points.setdefault((axis, side), row)) != row:
            found = f"{axis} {side} again, as row {first + 1}"
            raise InputProblem(file, table.place(row), found, "every point once")
    given = {*_AXES, *(axis for axis, _ in points)}
    for axis, side in itertools.product([axis for axis in known if axis in given], SIDES):
        if (axis, side) not in points:
            among = ", ".join(" ".join(point) for point in points)
            raise InputProblem(file, f"{axis} {side}", "missing", f"this row beside {among}")
    each = np.stack(columns, axis=1)
    return {axis: each[[points[axis, side] for side in SIDES]] for axis in known if axis in given}


@dataclasses.dataclass(frozen=True)
class FemurLandmarks:
    """Landmarks of a femur, in its mesh's frame, mm."""

    hip_center: np.ndarray  # of the femoral head, `(3,)`; only roughly, if `head_within` is given
    epicondyles: np.ndarray  # medial, then lateral, `(2, 3)`
    head_within: float | None  # distance within which the mesh is the femoral head


@dataclasses.dataclass(frozen=True)
class TibiaLandmarks:
    """Landmarks of a tibia, in its mesh's frame, mm."""

    plateau: np.ndarray  # medial, then lateral edge, `(2, 3)`
    # the ankle's centre, `(1, 3)`, or both malleoli, whose middle it is, medial first, `(2, 3)`;
    # only roughly where `ankle_within` is given
    ankle: np.ndarray
    ankle_within: tuple[float | None, ...]  # for each, distance within which the mesh is a ball


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
    whole = checked(Landmarks, reading.load_yaml(path, "landmarks"), os.fspath(path))
    with reading.said_of(path):
        _check_one_of(whole, "hip_center_mm", "femoral_head")
    head = whole.femoral_head
    hip = np.array(whole.hip_center_mm if head is None else head.near_mm) * mirror(side)
    return FemurLandmarks(hip, whole.epicondyles.points(side), head and head.within_mm)


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
    tibia = checked(Landmarks, reading.load_yaml(path, "landmarks"), os.fspath(path)).tibia
    if tibia is None:
        raise InputProblem(path, "tibia", "missing", "landmarks of the tibia")
    pairs, both = [(tibia.ankle_center_mm, None)], tibia.malleoli
    if both is not None:
        pairs = [(both.medial_mm, both.medial_ball), (both.lateral_mm, both.lateral_ball)]
    ankle = [point if ball is None else ball.near_mm for point, ball in pairs]
    return TibiaLandmarks(tibia.plateau.points(side), np.array(ankle) * mirror(side),
                          tuple(ball and ball.within_mm for _, ball in pairs))
