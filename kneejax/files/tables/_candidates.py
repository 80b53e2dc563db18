"""Tables of tests that could be made: a flexion and a load a row."""

from __future__ import annotations

import os
from typing import NamedTuple

from kneejax.files.reading import InputProblem
from kneejax.files.tables._tables import cell_number, read_rows
from kneejax.mechanics import NAMED_LOADS, RANGES, load_called, load_opposite_to

_FLEXION, _NAME = "flexion_deg", "name"
_COLUMNS = (_FLEXION, *NAMED_LOADS, _NAME)


class CandidateRow(NamedTuple):
    """One test of a table.

    Attributes:
        name: of the load, empty if the table gives none.
        flexion_deg: prescribed flexion.
        loads: name of a load (`kneejax.mechanics.NAMED_LOADS`) -> its size, all of them.
    """

    name: str
    flexion_deg: float
    loads: dict[str, float]


def read_candidates(path: str | os.PathLike[str]) -> tuple[CandidateRow, ...]:
    """Read the tests to choose from.

    Args:
        path: a CSV table with a column `flexion_deg`, and any of `lateral_N`, `anterior_N`,
            `compression_N`, `varus_Nm`, `internal_Nm` and `name`. What is not given is zero.

    Returns:
        One entry per row.

    Raises:
        InputProblem: the file cannot be read, there are no rows, a column is unknown or missing, a
            cell is not a number or out of range, or a test stands there twice.

    Example:
        >>> import tempfile
        >>> from pathlib import Path
        >>> path = Path(tempfile.mkdtemp()) / "tests.csv"
        >>> _ = path.write_text("flexion_deg, anterior_N, name\\n30, 134, Lachman\\n")
        >>> read_candidates(path)[0].loads["anterior_N"]
        134.0
    """
    file = os.fspath(path)
    header, rows = read_rows(file, [_FLEXION])
    _check_header(file, header)
    tests: dict[tuple[float, ...], int] = {}
    found = []
    for number, (line, cells) in enumerate(rows, 1):
        row, place = dict(zip(header, cells, strict=True)), f"row {number} (line {line})"
        values = {
            column: cell_number(file, f"{place}, {column}", cell, RANGES[column])
            for column, cell in row.items()
            if column != _NAME
        }
        loads = {name: values.get(name, 0.0) for name in NAMED_LOADS}
        first = tests.setdefault((values[_FLEXION], *loads.values()), number)
        if first != number:
            raise InputProblem(file, place, f"the test of row {first} again", "every test once")
        found.append(CandidateRow(row.get(_NAME, "").strip(), values[_FLEXION], loads))
    return tuple(found)


def _check_header(file: str, header: list[str]) -> None:
    for name in header:
        if name not in _COLUMNS:
            missing = [column for column in _COLUMNS if column not in header]
            known = f"any of {', '.join(_COLUMNS)}"
            meant = load_opposite_to(name)
            near = f"{meant} of the opposite sign" if meant else load_called(name) or missing
            raise InputProblem(file, "header", name, known, near)
        if header.count(name) > 1:
            raise InputProblem(file, name, f"{header.count(name)} columns", "one of this name")
