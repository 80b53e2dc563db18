"""Tables of OpenSim: .sto and .mot."""

__all__ = ["read_storage"]

import dataclasses
import os
import re
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.interpolate import make_interp_spline

from kneejax.files.reading import InputProblem, Mistakes, counted, plain_number, read_text
from kneejax.files.tables.tables import Table

_KIND = "an OpenSim table (.sto or .mot)"
#: Words of a header that count rows and columns, as OpenSim and as SIMM call them.
_COUNTS = ("nrows", "ncolumns", "datarows", "datacolumns")
_DEGREE = 5  # degree of the splines between rows: accelerations are continuous
#: Line of an old header -> whether angles are degrees.
_SENTENCES = {"angles are in degrees.": True, "angles are in radians.": False}
_VERSION = re.compile(r"\s*version(?:\s|=|$)", re.IGNORECASE)
#: No joint turns so little in a record of a movement, degrees; one given in radians does.
_RADIANS_BELOW = 3.2


@dataclasses.dataclass(frozen=True)
class Storage:
    """A table over time."""

    file: str  # from which it was read
    time: np.ndarray  # increasing, `(rows,)`, s
    columns: dict[str, np.ndarray]  # name -> values, `(rows,)`, as the file has them
    in_degrees: bool  # whether its angles are degrees
    unit_by: str = "as its header says"  # why they are, for errors

    def named(self, name: str, what: str = "a column") -> np.ndarray:
        """A column, `what` it is for the error where there is none: with the nearest name."""
        if name not in self.columns:
            expected = f"{what} of the {counted(len(self.columns), 'column')} of this table"
            raise InputProblem(self.file, "columns", name, expected, self.columns)
        return self.columns[name]

    def renamed(self, called: Mapping[str, str]) -> "Storage":
        """The same by other names: coordinate, muscle, body of reactions -> what this calls it."""
        back, columns = {own: name for name, own in called.items()}, {}
        for column, values in self.columns.items():
            for own, name in back.items():
                for word in ("on", "in"):
                    column = column.replace(f"_{word}_{own}_", f"_{word}_{name}_")
            columns[back.get(last_word(column), column)] = values
        return dataclasses.replace(self, columns=columns)

    def at(self, time: np.ndarray, names: Sequence[str], degree: int = _DEGREE) -> np.ndarray:
        """Columns at times `(...)`, s, by splines (of degree 1 where they jump): `(names, ...)`."""
        if not len(names):
            return np.zeros((0, *np.shape(time)))
        values = np.stack([self.named(name) for name in names], axis=1)
        most = len(self.time) - 1
        degree = min(degree, most - (most > 1 and most % 2 == 0))
        try:
            found = make_interp_spline(self.time, values, k=degree)(np.ravel(time))
        except np.linalg.LinAlgError:
            steps = np.diff(self.time)
            shown = f"steps from {steps.min():g} to {steps.max():g} s"
            raise InputProblem(self.file, "time", shown, "steps that are less unlike") from None
        return found.T.reshape(len(names), *np.shape(time))


def read_storage(path: str | os.PathLike[str]) -> Storage:
    """Read a table that OpenSim wrote or reads.

    Args:
        path: a .sto or .mot file: a header that ends with `endheader`, names of columns, rows.

    Returns:
        The table; of names such as `/forceset/soleus_r|tension` the whole.

    Raises:
        InputProblem: the file cannot be read, has no header or no column `time`, a cell is not a
            finite number, a row is too short or too long, or time does not increase.

    Example:
        >>> import tempfile
        >>> from pathlib import Path
        >>> path = Path(tempfile.mkdtemp()) / "walk.sto"
        >>> text = "walk\\ninDegrees=yes\\nendheader\\ntime\\tknee_angle_r\\n0\\t-5\\n0.1\\t-7\\n"
        >>> _ = path.write_text(text)
        >>> read_storage(path).columns["knee_angle_r"].tolist()
        [-5.0, -7.0]
    """
    file = os.fspath(path)
    lines = read_text(path, _KIND).splitlines()
    ends = [k for k, line in enumerate(lines) if line.strip().lower() == "endheader"]
    if not ends:
        raise InputProblem(file, "header", "no line endheader", _KIND)
    header, body = lines[: ends[0]], enumerate(lines[ends[0] + 1 :], ends[0] + 2)
    # Angles are in what the line inDegrees says, or as OpenSim reads what has none: degrees in a
    # motion of SIMM, a .mot without a version, and radians in any other table.
    degrees, unit_by = False, "as OpenSim reads a header without a line inDegrees=yes"
    if file.lower().endswith(".mot") and not any(_VERSION.match(line) for line in header):
        degrees = True
        unit_by = "as OpenSim reads a .mot whose header has neither version nor inDegrees"
    for line in header[::-1]:  # the first of them counts
        name, _, value = (x.strip() for x in line.partition("="))
        if name.lower() == "indegrees":
            degrees, unit_by = value.lower() == "yes", f"as inDegrees={value.lower()} says"
            if value.lower() not in ("yes", "no"):
                raise InputProblem(file, "inDegrees", value or "empty", "yes or no")
        elif line.strip().lower() in _SENTENCES:
            degrees, unit_by = _SENTENCES[line.strip().lower()], "as its header says"
    rows = [(number, line.split()) for number, line in body if line.strip()]
    if len(rows) < 3:
        found = counted(max(len(rows) - 1, 0), "row")
        raise InputProblem(file, "rows", found, "names of columns and two rows or more")
    (line, names), *rows = rows
    if names[0].lower() != "time":
        raise InputProblem(file, f"line {line}", names[0], "the column time first")
    table = Table(file, names, rows, Mistakes(file))
    table.check_columns(names)
    table.check_rows(names)
    time, *values = (table.column(name) for name in names)
    table.mistakes.check()
    # A header that counts rows or columns counts those that are there: nothing was cut off.
    there = dict(zip(_COUNTS, 2 * (len(rows), len(names)), strict=True))
    for words in (line.replace("=", " ").split() for line in header):
        kind = words[0].lower() if len(words) == 2 else ""
        if kind in there and plain_number(words[1]) != there[kind]:
            found = counted(there[kind], "row" if "rows" in kind else "column")
            raise InputProblem(file, words[0], words[1], f"{found}, as the file has")
    table.check_times(names[0], time)
    return Storage(file, time, dict(zip(names[1:], values, strict=True)), degrees, unit_by)


def angles_rad(table: Storage, name: str) -> np.ndarray:
    """A column of a knee's flexion, rad; refused where its header seems to say the other unit."""
    values = table.named(name)
    largest, shown = np.abs(values).max(), f"{values.min():.3g} to {values.max():.3g}"
    said, other = ("degrees", "radians") if table.in_degrees else ("radians", "degrees")
    moves = not table.in_degrees or np.ptp(values) >= 0.05
    if moves and table.in_degrees == (largest <= _RADIANS_BELOW):
        expected = f"{said}, {table.unit_by}; {other} are suspected"
        raise InputProblem(table.file, name, shown, expected)
    return np.deg2rad(values) if table.in_degrees else values


def common_times(tables: Sequence[Storage], count: int | None = None) -> np.ndarray:
    """Instants that all tables cover, s: `count` of them, or the rows of the coarsest table."""
    first, last = max(tables, key=lambda x: x.time[0]), min(tables, key=lambda x: x.time[-1])
    begin, end = float(first.time[0]), float(last.time[-1])
    if not begin < end:
        expected = f"times that overlap with {last.file}, which ends at {end:g} s"
        raise InputProblem(first.file, "time", f"from {begin:g} s", expected)
    if count is not None:
        return np.linspace(begin, end, count)
    inside = [x.time[(x.time >= begin) & (x.time <= end)] for x in tables]
    return min(inside, key=len)


def last_word(column: str) -> str:
    """A coordinate or muscle of a column, without path or quantity.

    Example:
        >>> last_word("/jointset/knee_r/knee_angle_r/value"), last_word("/soleus_r|tension")
        ('knee_angle_r', 'soleus_r')
    """
    name = re.sub(r"/value$", "", column).split("|", 1)[0]
    return name.rstrip("/").rsplit("/", 1)[-1]
