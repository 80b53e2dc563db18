"""Tables of tests that could be made: a flexion and a load a row."""

from __future__ import annotations

import os
from typing import NamedTuple

from kneejax.files._problem import InputProblem
from kneejax.files._tables import _number, _read_rows

#: Columns of a force and of a moment on the tibia, in its axes.
FORCE_COLUMNS = ("anterior_N", "superior_N", "lateral_N")
MOMENT_COLUMNS = ("adduction_Nmm", "internal_rotation_Nmm")
_FLEXION, _NAME = "flexion_deg", "name"
_COLUMNS = (_FLEXION, *FORCE_COLUMNS, *MOMENT_COLUMNS, _NAME)
# No test of a knee turns it with less, N mm; one that is given in N m would.
_NEWTON_METRES_BELOW = 100.0


class CandidateRow(NamedTuple):
    """One test of a table.

    Attributes:
        name: of the load, empty if the table gives none.
        flexion_deg: prescribed flexion.
        force_N: on the tibia at its origin: anterior, superior, lateral.
        moment_Nmm: on the tibia: adduction, internal rotation.
    """

    name: str
    flexion_deg: float
    force_N: tuple[float, float, float]
    moment_Nmm: tuple[float, float]


def read_candidates(path: str | os.PathLike[str]) -> tuple[CandidateRow, ...]:
    """Read the tests to choose from.

    Args:
        path: a CSV table with a column `flexion_deg`, and any of `anterior_N`, `superior_N`,
            `lateral_N`, `adduction_Nmm`, `internal_rotation_Nmm` and `name`. What is not given
            is zero.

    Returns:
        One entry a row.

    Raises:
        InputProblem: the file cannot be read, there are no rows, a column is unknown or missing, a
            cell is not a finite number, a flexion is out of range, a test stands there twice, or
            moments look like N m.

    Example:
        >>> import tempfile
        >>> from pathlib import Path
        >>> path = Path(tempfile.mkdtemp()) / "tests.csv"
        >>> _ = path.write_text("flexion_deg, anterior_N, name\\n30, 134, Lachman\\n")
        >>> read_candidates(path)[0].force_N
        (134.0, 0.0, 0.0)
    """
    file = os.fspath(path)
    header, rows = _read_rows(file, [_FLEXION])
    _check_header(file, header)
    tests: dict[tuple, int] = {}
    found = []
    for number, (line, cells) in enumerate(rows, 1):
        row, place = dict(zip(header, cells, strict=True)), f"row {number} (line {line})"
        values = {
            column: _number(file, f"{place}, {column}", cell)
            for column, cell in row.items()
            if column != _NAME
        }
        flexion = values[_FLEXION]
        if not -30 <= flexion <= 180:
            raise InputProblem(file, f"{place}, {_FLEXION}", f"{flexion:g}", "-30 to 180 degrees")
        force = tuple(values.get(column, 0.0) for column in FORCE_COLUMNS)
        moment = tuple(values.get(column, 0.0) for column in MOMENT_COLUMNS)
        first = tests.setdefault((flexion, force, moment), number)
        if first != number:
            raise InputProblem(file, place, f"the test of row {first} again", "every test once")
        found.append(CandidateRow(row.get(_NAME, "").strip(), flexion, force, moment))
    _check_moments(file, found)
    return tuple(found)


def _check_header(file: str, header: list[str]) -> None:
    for name in header:
        if name not in _COLUMNS:
            missing = [column for column in _COLUMNS if column not in header]
            raise InputProblem(file, "header", name, f"any of {', '.join(_COLUMNS)}", missing)
        if header.count(name) > 1:
            raise InputProblem(file, name, f"{header.count(name)} columns", "one of this name")


def _check_moments(file: str, tests: list[CandidateRow]) -> None:
    largest = max(abs(moment) for test in tests for moment in test.moment_Nmm)
    if 0 < largest < _NEWTON_METRES_BELOW:
        raise InputProblem(
            file,
            ", ".join(MOMENT_COLUMNS),
            f"at most {largest:g}",
            "moments in N mm; N m are suspected",
        )
