"""Tables: UTF-8 CSV with a header row and units in the names."""

__all__ = ["read_patella_poses", "read_poses", "write_poses", "write_rows"]

import csv
import dataclasses
import io
import math
import os
import re
import warnings
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Self

import numpy as np

from kneejax.files import reading
from kneejax.files.reading import InputProblem, Mistakes, counted, plain_number
from kneejax.files.tables.headers import METRES_BELOW, by_headers
from kneejax.geometry import BODIES, COLUMNS, CONVENTIONS, FEMORAL, PATELLA, convert_table
from kneejax.mechanics import NAMED_LOADS, RANGES, Range
from kneejax.parameters import Assumption
from kneejax.quantities import nearest_name

#: How a text begins that spreadsheets take for a formula (OWASP, CSV injection), with the wide
#: characters that some of them take for the same.
_FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n", "\uff1d", "\uff0b", "\uff0d", "\uff20")

#: How laboratories call columns of the patellofemoral joint.
_PATELLOFEMORAL = re.compile(r"(?:^|[^a-z])(?:pf|patell)", re.IGNORECASE)


def read_poses(
    path: str | os.PathLike[str], convention: str = FEMORAL,
    columns: Mapping[str, str] | None = None,
) -> np.ndarray:  # fmt: skip
    """Read poses from a CSV table.

    Args:
        path: the table; columns it does not need are ignored, except `convention`, which must
            then agree.
        convention: what the six columns mean, one of `kneejax.geometry.CONVENTIONS`.
        columns: column of the package (`flexion_deg`, ...) -> column of the file, for tables
            with other names; those of loads are `read_loads`'.

    Returns:
        Shape `(n, 6)`, degrees and mm, in the package's convention and the order of
        `kneejax.geometry.COLUMNS`.

    Raises:
        InputProblem: the file cannot be read, a column is missing, there are no rows, a cell is
            not a finite number or out of range, or the numbers look like metres or radians.

    Example:
        >>> import tempfile
        >>> from pathlib import Path
        >>> path = Path(tempfile.mkdtemp()) / "poses.csv"
        >>> _ = path.write_text(",".join(COLUMNS) + "\\n30, 1.5, 4, 2, -28, 0.5\\n")
        >>> read_poses(path).tolist()
        [[30.0, 1.5, 4.0, 2.0, -28.0, 0.5]]
    """
    file, names = os.fspath(path), {k: v for k, v in (columns or {}).items() if k in COLUMNS}
    check_convention(file, convention)
    for name in columns or ():
        if name not in (*COLUMNS, *NAMED_LOADS):
            expected = f"the package's columns {', '.join(COLUMNS)}"
            raise InputProblem(file, "columns", name, expected, (*COLUMNS, *NAMED_LOADS))
    read = Table.read(file)
    given = (x for x in COLUMNS if x in names or x in read.header)
    read.named.update({x: (names.get(x, x), 1.0) for x in given})
    phrases, _ = by_headers(read, known=COLUMNS, mapped=names)
    read.check_columns([read.named.get(name, (name,))[0] for name in COLUMNS])
    read.check_rows_convention(convention)
    table = np.stack([*read.numbers(COLUMNS).values()], axis=1)
    read.check_units(table)
    read.mistakes.check()
    assumed(file, phrases)
    return convert_table(table, convention, FEMORAL)


def read_patella_poses(path: str | os.PathLike[str], *, needed: bool = False) -> np.ndarray | None:
    """Read where the patella is from a table of poses.

    Args:
        path: the table.
        needed: whether a table without its columns is refused.

    Returns:
        Shape `(n, 6)`, degrees and mm, in the order of `kneejax.geometry.BODIES["patella"]`; None
        where the table has none of these columns.

    Raises:
        InputProblem: as `read_poses`; also where some of the columns are missing.
    """
    columns = [one.column for one in BODIES[PATELLA].values()]
    table = Table.read(path, columns if needed else ())
    if not {*columns} & {*table.header}:
        return None
    table.check_columns(columns)
    return np.stack([*table.numbers(columns).values()], axis=1)


@dataclasses.dataclass(frozen=True)
class Table:
    """A table as it was read, and what is wrong with its cells so far."""

    file: str  # from which it was read
    header: list[str]  # names of the columns
    rows: list[tuple[int, list[str]]]  # line number and cells of each row
    mistakes: Mistakes  # the first of each column
    # name of the package -> column that has it, and the factor that leads to its unit and sense;
    # any other name is that of a column itself
    named: dict[str, tuple[str, float]] = dataclasses.field(default_factory=dict)

    @classmethod
    def read(cls, path: str | os.PathLike[str], sought: Sequence[str] = ()) -> Self:
        """Read a table that has some columns; rows without any text are none."""
        file = os.fspath(path)
        text = reading.read_text(file, "a CSV table")
        reader = csv.reader(io.StringIO(text, newline=""), strict=True)
        try:
            lines = [(reader.line_num, cells) for cells in reader if any(map(str.strip, cells))]
        except csv.Error as error:
            place = f"line {reader.line_num}"
            raise InputProblem(file, place, str(error), "comma separated values") from None
        if not lines:
            raise InputProblem(file, "header", "empty", "names of columns, with commas between")
        header = [name.strip() for name in lines[0][1]]
        if len(header) == 1 and {*";\t"} & {*header[0]}:
            raise InputProblem(file, "header", header[0], "columns separated by commas")
        table = cls(file, header, lines[1:], Mistakes(file))
        table.seek(sought)
        if not table.rows:
            table.wrong("rows", "none", "at least one row under the header")
        table.check_rows(sought)
        return table

    def check_rows(self, sought: Sequence[str]) -> None:
        """Refuse rows that are longer or shorter than the header, with all mistakes."""
        for row, (_, cells) in enumerate(self.rows):
            if len(cells) != len(self.header):
                expected = f"{counted(len(self.header), 'cell')}, as in the header"
                self.wrong(self.place(row), counted(len(cells), "cell"), expected)
                self.seek([name for name in self.header if name not in sought])
                break
        self.mistakes.check()

    def check_times(self, name: str, times: np.ndarray) -> None:
        """Refuse times of a column that do not rise."""
        if (back := np.flatnonzero(np.diff(times) <= 0)).size:
            before, after = times[back[0] : back[0] + 2]
            expected = f"more than {before:g} s of the row before: times that rise"
            raise InputProblem(self.file, self.place(back[0] + 1, name), f"{after:g}", expected)

    def place(self, row: int, *column: str) -> str:
        """Where a cell stands, or a row."""
        return ", ".join((f"row {row + 1} (line {self.rows[row][0]})", *column))

    def wrong(self, place: str, value: Any, expected, nearest=None) -> None:
        """Add a mistake, as an `InputProblem` takes it."""
        self.mistakes.append(InputProblem(self.file, place, value, expected, nearest))

    def seek(self, columns: Sequence[str]) -> None:
        """Add what is wrong with needed columns: one of them twice, all that are missing."""
        columns = [*dict.fromkeys(columns)]
        for name in columns:
            if (count := self.header.count(name)) > 1:
                self.wrong(name, f"{count} columns", "one column of this name")
        missing = [name for name in columns if name not in self.header]
        # A column that is needed itself is no misspelling of another, nor is one of another joint.
        joint = {x: _PATELLOFEMORAL.search(x) is None for x in (*self.header, *missing)}
        near = {name: nearest_name(name, [x for x in self.header if x not in columns
                                          and joint[x] == joint[name]]) for name in missing}
        if missing:
            one = len(missing) == 1
            what = f"{'this column' if one else 'these columns'} among {', '.join(self.header)}"
            meant = ", ".join(y if one else f"{x} by {y}" for x, y in near.items() if y)
            self.wrong(", ".join(missing), "missing", what, meant or None)

    def check_columns(self, columns: Sequence[str]) -> None:
        """Refuse a table that lacks some columns, or has one of them twice, with all mistakes."""
        self.seek(columns)
        self.mistakes.check()

    def check_rows_convention(self, convention: str) -> None:
        """Refuse rows that say that they are of another convention."""
        for place, said in self.cells("convention") if "convention" in self.header else ():
            if said != convention:
                expected = f"{convention}, the convention asked for"
                if said in CONVENTIONS:
                    expected += f"; give --convention {said}, in a study convention: {said}"
                raise InputProblem(self.file, place, said, expected)

    def check_units(self, poses: np.ndarray, least_deg: float = 0.5) -> None:
        """Suspect metres and radians among poses `(n, 6)`; NaN where nothing is to be doubted."""
        names = [self.named.get(name, (name,))[0] for name in COLUMNS]
        shifts, turns = (np.abs(poses[:, own]) for own in (slice(3, 6), slice(1, 3)))
        largest = np.nanmax(shifts, initial=0.0)
        if 0 < largest < METRES_BELOW:
            doubted = [x for x, own in zip(names[3:], shifts.T, strict=True) if np.nansum(own)]
            what = "translations in mm; metres are suspected"
            self.wrong(", ".join(doubted), f"at most {largest:.3g}", what)
        flexion = poses[:, 0][np.isfinite(poses[:, 0])]
        if len(flexion) <= 3 or np.ptp(flexion) < least_deg or flexion.max() > 3.2:
            return
        if np.nanmax(turns, initial=0.0) <= 1.6 and np.any(flexion != np.round(flexion)):
            said = f"{flexion.min():.3g} to {flexion.max():.3g}"
            self.wrong(names[0], said, "angles in degrees; radians are suspected")

    def cells(self, name: str) -> list[tuple[str, str]]:
        """Place and text of each cell of a column."""
        column = self.header.index(name)
        return [(self.place(k, name), x[column].strip()) for k, (_, x) in enumerate(self.rows)]

    def numbers(self, names: Iterable[str]) -> dict[str, np.ndarray]:
        """Columns that are within the ranges of their names; raises what is wrong so far."""
        found = {name: self.column(name, column_range(name)) for name in names}
        self.mistakes.check()
        return found

    def column(self, name: str, allowed: Range | None = None, empty: bool = False) -> np.ndarray:
        """Numbers of a column, in the package's unit; NaN where a cell is empty or a mistake."""
        own, factor = self.named.get(name, (name, 1.0))
        values, good, k = np.full(len(self.rows), np.nan), True, self.header.index(own)
        for row, (_, cells) in enumerate(self.rows):
            x = plain_number(cell := cells[k].strip())
            if empty and cell.lower() in ("", "nan"):
                continue
            if x is None or not math.isfinite(x):
                expected = "a number" if x is None else "a finite number"
            elif allowed and not allowed.holds(factor * x):
                expected = allowed.expected(factor * x)
            else:
                values[row] = factor * x
                continue
            if good:
                self.wrong(self.place(row, own), cell, expected)
            good = False
        return values

    def sizes(self, name: str) -> np.ndarray:
        """The finite numbers of a column, whatever else stands in it."""
        numbers = [plain_number(cell) for _, cell in self.cells(name)]
        return np.array([x for x in numbers if x is not None and math.isfinite(x)] or [0.0])


def assumed(file: str, phrases: Sequence[str]) -> None:
    """Say what was assumed of a table's columns."""
    if phrases:
        warnings.warn(f"{file}: columns by their headers: {'; '.join(phrases)}", Assumption, 3)


def column_range(name: str) -> Range:
    """What may stand in a column; a load cell that reads nothing reads less as often."""
    if name in (COLUMNS[0], "weight", "time_s", *NAMED_LOADS):
        return RANGES[name]
    kinds = {".strain": "strain", "_N": "force_N", "_deg": "rotation_deg", "_mm": "point_mm"}
    return RANGES[next(kind for end, kind in kinds.items() if name.endswith(end))]


def write_poses(
    path: str | os.PathLike[str], table: np.ndarray, status: Sequence[Any] | None = None,
    converged: Sequence[bool] | None = None, stable: Sequence[bool] | None = None,
    convention: str = FEMORAL, doubts: Sequence[str] | None = None,
    patella: np.ndarray | None = None,
) -> None:  # fmt: skip
    """Write poses to a CSV table, completely or not at all.

    Args:
        path: the table.
        table: shape `(n, 6)`, degrees and mm, in the package's convention; NaN is written `nan`.
        status: a word for each row, or an object that has one as `word`.
        converged: one per row.
        stable: one per row.
        convention: what the six columns of the file shall mean. Any but the package's own is
            named in a further column `convention`.
        doubts: what is wrong with each row, in words and numbers.
        patella: its poses, `(n, 6)`, as `read_patella_poses` reads them.

    Raises:
        InputProblem: the convention is unknown or the file cannot be written.
        ValueError: lengths differ.

    Example:
        >>> import tempfile
        >>> from pathlib import Path
        >>> path = Path(tempfile.mkdtemp()) / "poses.csv"
        >>> write_poses(path, np.array([[30.0, 1.5, 4.0, 2.0, -28.0, 0.5]]), converged=[True])
        >>> print(path.read_text().splitlines()[1])
        30.0,1.5,4.0,2.0,-28.0,0.5,true
    """
    check_convention(os.fspath(path), convention)
    table = np.asarray(table, float).reshape(-1, len(COLUMNS))
    columns: dict[str, Any] = dict(
        zip(COLUMNS, convert_table(table, FEMORAL, convention).T, strict=True))
    if patella is not None:
        own = (one.column for one in BODIES[PATELLA].values())
        columns |= dict(zip(own, patella.T, strict=True))
    for name, flags in (("converged", converged), ("stable", stable)):
        columns[name] = flags if flags is None else [*map(bool, flags)]
    columns["status"] = None if status is None else [getattr(x, "word", x) for x in status]
    columns["doubt"] = doubts
    columns["convention"] = None if convention == FEMORAL else [convention] * len(table)
    columns = {name: x for name, x in columns.items() if x is not None}
    write_rows(path, [*columns], zip(*columns.values(), strict=True))


def write_rows(
    path: str | os.PathLike[str], header: Sequence[str], rows: Iterable[Sequence[Any]]
) -> None:
    """Write a CSV table, completely or not at all.

    Args:
        path: the table.
        header: names of the columns, with units.
        rows: one sequence per row; floats keep all digits, NaN is written `nan`, truth values
            `true` and `false`, None as an empty cell. A text that a spreadsheet would take for a
            formula has an apostrophe before it.

    Raises:
        InputProblem: the file cannot be written.
        ValueError: a row is longer or shorter than the header.

    Example:
        >>> import tempfile
        >>> from pathlib import Path
        >>> path = Path(tempfile.mkdtemp()) / "forces.csv"
        >>> write_rows(path, ["ligament", "force_N"], [["ACL", 12.5]])
        >>> path.read_text().splitlines()
        ['ligament,force_N', 'ACL,12.5']
    """
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow([_cell(name) for name in header])
    for row in rows:
        cells = [_cell(value) for value in row]
        if len(cells) != len(header):
            raise ValueError(f"a row of {len(cells)} cells under a header of {len(header)}")
        writer.writerow(cells)
    reading.write_text(path, stream.getvalue())


def check_convention(file: str, convention: str) -> None:
    """Refuse a convention that is none."""
    if convention not in CONVENTIONS:
        raise InputProblem(file, "convention", convention, CONVENTIONS)


def _cell(value: Any) -> Any:
    if hasattr(value, "item"):  # NumPy and JAX numbers
        value = value.item()
    if isinstance(value, bool):
        return "true" if value else "false"
    if not isinstance(value, str):
        return value
    # Python 3.11 leaves a carriage return unquoted, and the row would end there.
    value = value.replace("\r\n", "\n").replace("\r", "\n")
    # A spreadsheet would compute it; a number that came as text is one all the same.
    is_number = math.isfinite(plain_number(value) or 0.0) and plain_number(value) is not None
    formula = len(value) > 1 and value.startswith(_FORMULA) and not is_number
    return f"'{value}" if formula else value
