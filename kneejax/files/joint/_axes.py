"""Axis points of a femur by coordinates, in YAML or CSV."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path

import numpy as np

from kneejax.files.reading import Field, InputProblem, load_yaml
from kneejax.files.tables import cell_number, read_rows, write_rows
from kneejax.mechanics import RANGES

SIDES = ("medial", "lateral")
_AXES, _FURTHER = ("extension", "flexion"), "epicondyles"
_COORDINATES = ("anterior_mm", "superior_mm", "lateral_mm")
_COLUMNS = ("axis", "side", *_COORDINATES)
# Medial and lateral points of a knee in mm are farther apart; in metres they are not.
_METRES_BELOW = 1.0


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
    axes = _from_table(os.fspath(path)) if is_table else _from_yaml(os.fspath(path), side)
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
    rows = [
        [axis, side, *map(float, point)]
        for axis, pair in named.items()
        for side, point in zip(SIDES, pair, strict=True)
    ]
    write_rows(path, list(_COLUMNS), rows)


def _from_yaml(file: str, side: str) -> dict[str, np.ndarray]:
    whole = Field(file, "", load_yaml(file, "axis points")).mapping(_AXES, (_FURTHER,))
    return {name: both_points(whole[name], side) for name in whole.value}


def _from_table(file: str) -> dict[str, np.ndarray]:
    header, rows = read_rows(file, list(_COLUMNS))
    for name in header:
        if name not in _COLUMNS:
            raise InputProblem(file, "header", name, f"only {', '.join(_COLUMNS)}")
    known = (*_AXES, _FURTHER)
    points: dict[tuple[str, str], np.ndarray] = {}
    first: dict[tuple[str, str], int] = {}
    for number, (line, cells) in enumerate(rows, 1):
        row, place = dict(zip(header, cells, strict=True)), f"row {number} (line {line})"
        axis = _choice(file, f"{place}, axis", row["axis"], known)
        point = axis, _choice(file, f"{place}, side", row["side"], SIDES)
        if first.setdefault(point, number) != number:
            found = f"{' '.join(point)} again, as row {first[point]}"
            raise InputProblem(file, place, found, "every point once")
        points[point] = np.array(
            [cell_number(file, f"{place}, {c}", row[c], RANGES["scan_mm"]) for c in _COORDINATES]
        )
    given = {axis for axis, _ in points}
    for axis in known:
        for side in SIDES:
            if (axis in given or axis != _FURTHER) and (axis, side) not in points:
                among = ", ".join(" ".join(point) for point in points)
                raise InputProblem(file, f"{axis} {side}", "missing", f"this row beside {among}")
    return {
        axis: np.stack([points[axis, side] for side in SIDES]) for axis in known if axis in given
    }


def _choice(file: str, place: str, cell: str, known: tuple[str, ...]) -> str:
    word = cell.strip()
    if word not in known:
        raise InputProblem(file, place, word, f"one of {', '.join(known)}", known)
    return word


def both_points(field: Field, side: str) -> np.ndarray:
    """Medial, then lateral point of a field, of a right knee, shape `(2, 3)`, mm."""
    names = [f"{name}_mm" for name in SIDES]
    field.mapping(names)
    return np.stack([point(field[name], side) for name in names])


def point(field: Field, side: str) -> np.ndarray:
    """A point as that of a right knee, shape `(3,)`, mm."""
    mirror = [1.0, 1.0, -1.0 if side == "left" else 1.0]
    return np.array(field.numbers(3, RANGES["scan_mm"])) * mirror
