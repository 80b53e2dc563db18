"""Tables of tests under load: what acted and what was read, a row each."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from kneejax.files.reading import InputProblem, plain_number
from kneejax.files.tables._tables import cell_number, pose_range, read_rows
from kneejax.geometry import CLINICAL, COLUMNS, CONVENTIONS, OTHER_COLUMNS, convert_table
from kneejax.mechanics import NAMED_LOADS, RANGES, Range, load_opposite_to

#: What sounds like a load, so that leaving it out must be said.
_LOAD = re.compile(r"load|force|torque|moment|tension|_(N|Nm|Nmm|kN)$", re.IGNORECASE)
#: Moments of which no knee has had more, N m; N mm are a thousand times as large.
_MOST_MOMENT_NM = 100.0
#: Names of columns that a table may have, beside those of parts.
_KNOWN = (*NAMED_LOADS, *COLUMNS, *OTHER_COLUMNS, "weight", "time_s")
#: Ways in which tables of `kneejax simulate` call a load, beside its name.
_ALSO = {name.replace("_N", "_force_N"): name for name in NAMED_LOADS if name.endswith("_N")}
_ALSO |= {name.replace("_Nm", "_moment_Nm"): name for name in NAMED_LOADS if name.endswith("_Nm")}


#: What was read of a part of the knee, as columns name it: `ACL.tension_N`, `medial.contact_N`.
_READING = re.compile(r"[\w.+-]+\.(tension_N|contact_N|strain)")


class LabTable(NamedTuple):
    """A test under load as it was measured.

    Attributes:
        flexion_deg: of each row, `(n,)`.
        loads: name of a load -> its size in each row, `(n,)`.
        observed: the five free coordinates of each row, `(n, 5)`, degrees and mm, translations
            along the axes of Grood and Suntay; NaN where a table has no such column.
        readings: what was read of parts of the knee, `PART.KIND` -> `(n,)`, N or strain, and of
            the patella, its column -> degrees or mm along the femur's axes; NaN where a cell is
            empty.
        weight: of each row, `(n,)`; None where a table has no such column.
        time_s: of each row, s; likewise.
    """

    flexion_deg: np.ndarray
    loads: dict[str, np.ndarray]
    observed: np.ndarray
    readings: dict[str, np.ndarray] = {}
    weight: np.ndarray | None = None
    time_s: np.ndarray | None = None

    def take(self, rows: np.ndarray) -> LabTable:
        """Some of the rows."""
        return LabTable(
            self.flexion_deg[rows],
            {name: sizes[rows] for name, sizes in self.loads.items()},
            self.observed[rows],
            {name: sizes[rows] for name, sizes in self.readings.items()},
            *(x if x is None else x[rows] for x in (self.weight, self.time_s)),
        )


def read_lab_table(
    path: str | os.PathLike[str],
    columns: Mapping[str, str] | None = None,
    flexion_deg: float | None = None,
    convention: str = CLINICAL,
    ignore: tuple[str, ...] = (),
    *,
    unloaded: bool = False,
) -> LabTable:
    """Read a test under load from a CSV table.

    Args:
        path: the table, with `flexion_deg`, any loads (`kneejax.mechanics.NAMED_LOADS`), any of
            the other columns of a pose, of the patella's (`patella_tilt_deg`), and of what was
            read of parts (`ACL.tension_N`, `LCL.strain`, `medial.contact_N`); a column `weight`
            weighs rows, one `time_s` says when each was seen.
        columns: name of such a column -> column of the file, for tables with other names; a minus
            in front turns its sense round, a factor may stand before it as in
            `0.001 * Torque [Nmm]`.
        flexion_deg: of all rows, for a table without that column.
        convention: of the translations. Any but `grood-suntay` needs all six columns of a pose.
        ignore: columns that sound like loads and shall not count.
        unloaded: whether the table may be of a motion without loads.

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
    file = os.fspath(path)
    named = _named(file, dict(columns or {}))
    table = _Readings(file, *read_rows(file, [column for column, _ in named.values()]))
    for own in table.header:
        name = _ALSO.get(own, own)
        if own not in ignore and (name in _KNOWN or _is_reading(name)):
            named.setdefault(name, (own, 1.0))
    _check_header(table, named, flexion_deg, ignore, unloaded)
    loads = _loads(table, named)
    observed = np.full((len(table.rows), len(COLUMNS)), np.nan)
    for place, name in enumerate(COLUMNS):
        if name in named:
            observed[:, place] = table.column(*named[name], _range(name), empty=place > 0)
    if flexion_deg is not None:
        observed[:, 0] = flexion_deg
    observed = _clinical(table, observed, convention)
    readings = {
        name: table.column(*place, _range(name), empty=True)
        for name, place in named.items()
        if _is_reading(name)
    }
    weight, time_s = (
        table.column(*named[name], RANGES[name]) if name in named else None
        for name in ("weight", "time_s")
    )
    return LabTable(observed[:, 0], loads, observed[:, 1:], readings, weight, time_s)


def _loads(table: _Readings, named: Mapping[str, tuple[str, float]]) -> dict[str, np.ndarray]:
    """Load -> its size in each row; moments that can only be N mm are refused."""
    loads = {
        name: table.column(*named[name], RANGES[name]) for name in NAMED_LOADS if name in named
    }
    for name, size in loads.items():
        if name.endswith("_Nm") and np.abs(size).max() > _MOST_MOMENT_NM:
            own, _ = named[name]
            expected = f"N m, at most {_MOST_MOMENT_NM:g}; N mm are suspected (0.001 * {own})"
            raise InputProblem(table.file, own, f"up to {np.abs(size).max():g}", expected)
    return loads


def _is_reading(name: str) -> bool:
    """Whether a column tells of a part of the knee, or of a bone other than the tibia."""
    return name in OTHER_COLUMNS or _READING.fullmatch(name) is not None


def _range(name: str) -> Range:
    """What may stand in a column of a pose or a reading."""
    if name.endswith("_N"):
        return RANGES["force_N"]  # a load cell that reads nothing reads less as often
    return RANGES["strain"] if name.endswith(".strain") else pose_range(name)


class _Readings(NamedTuple):
    """A file's header, and line number and cells of each row."""

    file: str
    header: list[str]
    rows: list[tuple[int, list[str]]]

    def column(self, own: str, factor: float, allowed: Range, empty: bool = False) -> np.ndarray:
        """A column in the package's sense and unit; NaN of a cell that may be empty and is."""
        place, values = self.header.index(own), []
        for number, (line, cells) in enumerate(self.rows, 1):
            cell, where = cells[place], f"row {number} (line {line}), {own}"
            if empty and cell.strip().lower() in ("", "nan"):
                values.append(np.nan)
                continue
            values.append(factor * cell_number(self.file, where, cell))
            if not allowed.holds(values[-1]):
                expected = allowed.expected(values[-1])
                raise InputProblem(self.file, where, cell.strip(), expected)
        return np.array(values)


def _check_header(
    table: _Readings, named, flexion_deg: float | None, ignore, unloaded: bool
) -> None:
    """A load, a coordinate and a flexion; nothing that sounds like a load is left over."""
    file, header = table.file, table.header
    used = {column for column, _ in named.values()}
    for own in header:
        if own not in used and own not in ignore and _LOAD.search(own):
            expected = "a column that is used (columns:) or left out on purpose (ignore:)"
            meant = load_opposite_to(own)
            near = f"columns: {{{meant}: -{own}}}" if meant else None
            raise InputProblem(file, "header", own, expected, near)
    read = any(_is_reading(name) for name in named)
    for what, known in (("load", tuple(NAMED_LOADS)), ("coordinate", COLUMNS[1:])):
        spared = unloaded if what == "load" else read
        if not spared and not any(name in named for name in known):
            raise InputProblem(file, "header", f"no {what}", f"one of {', '.join(known)}")
    if flexion_deg is None and COLUMNS[0] not in named:
        expected = f"this column among {', '.join(header)}, or at_deg of the test"
        raise InputProblem(file, COLUMNS[0], "missing", expected)


def _named(file: str, columns: dict[str, str]) -> dict[str, tuple[str, float]]:
    """Name -> column of the file and the factor that it is multiplied with."""
    found = {}
    for name, said in columns.items():
        if name not in _KNOWN and not _is_reading(name):
            expected = f"one of {', '.join(_KNOWN)}, or such as ACL.tension_N"
            meant = load_opposite_to(name)
            near = f"{meant}: -{said.strip()}" if meant else _KNOWN
            raise InputProblem(file, "columns", name, expected, near)
        factor, own = 1.0, said.strip()
        if match := re.fullmatch(r"([-+.\w]+)\s*\*\s*(.+)", own):
            stated, own = plain_number(match[1]), match[2]
            if stated is None or not math.isfinite(stated) or stated == 0.0:
                expected = "a factor before the *, as in 0.001 * Torque [Nmm]"
                raise InputProblem(file, f"columns.{name}", said, expected)
            factor = stated
        elif own.startswith("-"):
            factor, own = -1.0, own[1:].strip()
        found[name] = own, factor
    return found


def _clinical(table: _Readings, observed: np.ndarray, convention: str) -> np.ndarray:
    """Poses along the axes of Grood and Suntay."""
    file, header = table.file, table.header
    if "convention" in header:
        said = {cells[header.index("convention")].strip() for _, cells in table.rows}
        if said != {convention}:
            expected = f"{convention} in every row, as this test says"
            raise InputProblem(file, "convention", ", ".join(sorted(said)), expected, CONVENTIONS)
    if convention == CLINICAL:
        return observed
    if np.isnan(observed).any():
        expected = f"all of {', '.join(COLUMNS)}, without which {convention} cannot be converted"
        raise InputProblem(file, "header", "not all six columns of a pose", expected)
    found = convert_table(observed, convention, CLINICAL)
    # Rows of one flexion stay rows of one flexion, whatever the conversion rounds.
    found[:, 0] = np.round(found[:, 0], 6)
    return found
