"""Tables of tests under load: what acted and what was read, a row each."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from kneejax.files.reading import InputProblem, nearest_name
from kneejax.files.tables._tables import cell_number, read_rows
from kneejax.geometry import CLINICAL, COLUMNS, CONVENTIONS, convert_table
from kneejax.mechanics import NAMED_LOADS, RANGES

#: What sounds like a load, so that leaving it out must be said.
_LOAD = re.compile(r"load|force|torque|moment|tension|_(N|Nm|Nmm|kN)$", re.IGNORECASE)
#: Moments of which no knee has had more, N m; N mm are a thousand times as large.
_MOST_MOMENT_NM = 100.0
#: Ways in which tables of `kneejax simulate` call a load, beside its name.
_ALSO = {name.replace("_N", "_force_N"): name for name in NAMED_LOADS if name.endswith("_N")}
_ALSO |= {name.replace("_Nm", "_moment_Nm"): name for name in NAMED_LOADS if name.endswith("_Nm")}
#: What follows from the rest of a row.
_FREE = COLUMNS[1:]


class LabTable(NamedTuple):
    """A test under load as it was measured.

    Attributes:
        flexion_deg: of each row, `(n,)`.
        loads: name of a load -> its size in each row, `(n,)`.
        observed: the five free coordinates of each row, `(n, 5)`, degrees and mm, translations
            along the axes of Grood and Suntay; NaN where a table has no such column.
    """

    flexion_deg: np.ndarray
    loads: dict[str, np.ndarray]
    observed: np.ndarray


def read_lab_table(
    path: str | os.PathLike[str],
    columns: Mapping[str, str] | None = None,
    flexion_deg: float | None = None,
    convention: str = CLINICAL,
    ignore: tuple[str, ...] = (),
) -> LabTable:
    """Read a test under load from a CSV table.

    Args:
        path: the table, with `flexion_deg`, any loads (`kneejax.mechanics.NAMED_LOADS`) and any of
            the other columns of a pose.
        columns: name of a load or of a pose's column -> column of the file, for tables with other
            names; a minus in front turns its sense round, a factor may stand before it as in
            `0.001 * Torque [Nmm]`.
        flexion_deg: of all rows, for a table without that column.
        convention: of the translations. Any but `grood-suntay` needs all six columns of a pose.
        ignore: columns that sound like loads and shall not count.

    Raises:
        InputProblem: the file cannot be read; a column is missing, or sounds like a load and is
            not used; a cell is not a number or out of range; moments look like N mm.

    Example:
        >>> import tempfile
        >>> from pathlib import Path
        >>> path = Path(tempfile.mkdtemp()) / "drawer.csv"
        >>> _ = path.write_text("Applied Load,Posterior\\n90,-4.5\\n")
        >>> named = {"anterior_N": "Applied Load", "anterior_mm": "-Posterior"}
        >>> read = read_lab_table(path, named, flexion_deg=30.0)
        >>> read.loads["anterior_N"].tolist(), read.observed[0, 2].item()
        ([90.0], 4.5)
    """
    file, named = os.fspath(path), _named(os.fspath(path), dict(columns or {}))
    header, rows = read_rows(file, [column for column, _ in named.values()])
    for own in header:
        name = _ALSO.get(own, own)
        if name in (*NAMED_LOADS, *COLUMNS) and name not in named:
            named[name] = own, 1.0
    used = {column for column, _ in named.values()}
    loads = [name for name in named if name in NAMED_LOADS]
    for own in header:
        if own not in used and own not in ignore and _LOAD.search(own):
            expected = "a column that is used (columns:) or left out on purpose (ignore:)"
            raise InputProblem(file, "header", own, expected)
    if not loads:
        near = nearest_name("load", header)
        raise InputProblem(file, "header", "no load", f"one of {', '.join(NAMED_LOADS)}", near)
    if not any(name in named for name in _FREE):
        raise InputProblem(file, "header", "no coordinate", f"one of {', '.join(_FREE)}")
    if flexion_deg is None and COLUMNS[0] not in named:
        expected = f"this column among {', '.join(header)}, or flexion_deg of the test"
        raise InputProblem(file, COLUMNS[0], "missing", expected)

    def column(name: str, allowed, empty: bool) -> np.ndarray:
        own, factor = named[name]
        place = header.index(own)
        return np.array([
            _cell(file, f"row {number} (line {line}), {own}", cells[place], factor, allowed, empty)
            for number, (line, cells) in enumerate(rows, 1)
        ])  # fmt: skip

    sizes = {name: column(name, RANGES[name], False) for name in loads}
    for name, size in sizes.items():
        if name.endswith("_Nm") and np.abs(size).max() > _MOST_MOMENT_NM:
            expected = (
                f"N m, at most {_MOST_MOMENT_NM:g}; N mm are suspected (0.001 * {named[name][0]})"
            )
            raise InputProblem(file, named[name][0], f"up to {np.abs(size).max():g}", expected)
    observed = np.full((len(rows), len(COLUMNS)), np.nan)
    for place, name in enumerate(COLUMNS):
        if name in named:
            allowed = RANGES["rotation_deg" if place < 3 else "point_mm"]
            observed[:, place] = column(name, allowed, place > 0)
    if flexion_deg is not None:
        observed[:, 0] = flexion_deg
    observed = _clinical(file, observed, convention, header, rows)
    return LabTable(observed[:, 0], sizes, observed[:, 1:])


def _named(file: str, columns: dict[str, str]) -> dict[str, tuple[str, float]]:
    """Name -> column of the file and the factor that it is multiplied with."""
    known, found = (*NAMED_LOADS, *COLUMNS), {}
    for name, said in columns.items():
        if name not in known:
            raise InputProblem(file, "columns", name, f"one of {', '.join(known)}", known)
        factor, own = 1.0, said.strip()
        if match := re.fullmatch(r"([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*\*\s*(.+)", own):
            factor, own = float(match[1]), match[2]
        elif own.startswith("-"):
            factor, own = -1.0, own[1:].strip()
        found[name] = own, factor
    return found


def _cell(file: str, place: str, cell: str, factor: float, allowed, empty: bool) -> float:
    """A number in the package's sense and unit; NaN of a cell that may be empty and is."""
    if empty and cell.strip().lower() in ("", "nan"):
        return np.nan
    value = factor * cell_number(file, place, cell)
    if not allowed.holds(value):
        raise InputProblem(file, place, cell.strip(), allowed.expected(value))
    return value


def _clinical(file: str, table: np.ndarray, convention: str, header, rows) -> np.ndarray:
    if "convention" in header:
        said = {cells[header.index("convention")].strip() for _, cells in rows}
        if said != {convention}:
            expected = f"{convention} in every row, as this test says"
            raise InputProblem(file, "convention", ", ".join(sorted(said)), expected, CONVENTIONS)
    if convention == CLINICAL:
        return table
    if np.isnan(table).any():
        expected = f"all of {', '.join(COLUMNS)}, without which {convention} cannot be converted"
        raise InputProblem(file, "header", "not all six columns of a pose", expected)
    return convert_table(table, convention, CLINICAL)
