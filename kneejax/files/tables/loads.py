"""Tables of loads: beside poses, over time, in tests that could be made, in tests that were."""

__all__ = ["LabTable", "read_candidates", "read_lab_table", "read_loads", "read_loads_over_time"]

import math
import os
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from kneejax.files.reading import InputProblem, plain_number
from kneejax.files.tables.headers import MOST_MOMENT_NM, by_headers, factored, header_meaning
from kneejax.files.tables.tables import Table, assumed, column_range
from kneejax.geometry import CLINICAL, COLUMNS, OTHER_COLUMNS, convert_table
from kneejax.mechanics import NAMED_LOADS, load_called, load_opposite_to

#: What sounds like a load, so that leaving it out must be said.
_LOAD = re.compile(r"load|force|torque|moment|tension|_(N|Nm|Nmm|kN)$", re.IGNORECASE)
#: Names of columns that a table may have, beside those of parts.
_KNOWN = (*NAMED_LOADS, *COLUMNS, *OTHER_COLUMNS, "weight", "time_s")
#: Ways in which tables of `kneejax simulate` call a load, beside its name.
_ALSO = {re.sub("_N$", "_force_N", re.sub("_Nm$", "_moment_Nm", name)): name
         for name in NAMED_LOADS}
#: What was read of a part of the knee, as columns name it: `ACL.tension_N`, `medial.contact_N`.
_READING = re.compile(r"[\w.+-]+\.(tension_N|contact_N|strain)")
#: Column of the times of a table over time.
TIME = "time_s"
_CANDIDATE = ("flexion_deg", *NAMED_LOADS, "name")


def read_loads(
    path: str | os.PathLike[str], columns: Mapping[str, str] | None = None
) -> dict[str, np.ndarray]:
    """Read which loads acted while poses were measured.

    Args:
        path: a CSV table; of its columns those with the name of a load count
            (`kneejax.mechanics.NAMED_LOADS`).
        columns: name of a load -> column of the file, as `read_lab_table` takes it, for tables with
            other names.

    Returns:
        Name of a load -> its size in each row, in the unit of its name; empty without such a
        column.

    Raises:
        InputProblem: the file cannot be read, a cell is not a number or out of range, a column
            is called as loads were once called, or by another unit, or stands there twice.

    Warns:
        Assumption: columns that sound like a load and are not used.

    Example:
        >>> import tempfile
        >>> from pathlib import Path
        >>> path = Path(tempfile.mkdtemp()) / "poses.csv"
        >>> _ = path.write_text("flexion_deg, anterior_N\\n30, 134\\n")
        >>> read_loads(path)["anterior_N"].tolist()
        [134.0]
    """
    table, mapped = Table.read(path), {k: v for k, v in (columns or {}).items() if k in NAMED_LOADS}
    _name_columns(table, mapped)
    _refuse_older_names(table)
    _take_own_names(table, NAMED_LOADS.__contains__, mapped)
    sizes = table.numbers(table.named)
    used = {own for own, _ in table.named.values()}
    phrases = []
    for own in table.header:
        if own not in used and _LOAD.search(own) and not _is_reading(own):
            phrases.append(f"{own} is not used")
            if (meant := header_meaning(own)) is not None and meant.name in NAMED_LOADS:
                phrases[-1] += f", but would be by columns: {{{meant.name}: {factored(meant)}}}"
    assumed(table.file, phrases)
    return sizes


def _refuse_older_names(table: Table) -> None:
    """No column is called as loads were once called, or acts the other way."""
    used = {own for own, _ in table.named.values()}
    for name in table.header:
        meant = load_called(name) if name in COLUMNS else _meant(name)
        if meant not in (None, name) and name not in (*used, *_ALSO):
            expected = f"one of {', '.join(NAMED_LOADS)}"
            raise InputProblem(table.file, "header", name, expected, meant)


def _take_own_names(
    table: Table, known: Callable[[str], bool], mapped: Collection[str],
    ignore: Collection[str] = (),
) -> None:  # fmt: skip
    """Name columns that are called as the package calls them, but for what is `mapped` already;
    adds a mistake where two are of one thing."""
    found: dict[str, str] = {}
    for own in table.header:
        name = _ALSO.get(own, own)
        if own in ignore or name in mapped or not known(name):
            continue
        if name in found:
            said = own if found[name] == own else f"{found[name]} and {own}"
            table.wrong("header", said, f"one column of {name}, the other left out (ignore:)")
        found.setdefault(name, own)
    table.named.update({name: (own, 1.0) for name, own in found.items()})


def read_loads_over_time(
    path: str | os.PathLike[str], may_lead: Sequence[str] = COLUMNS
) -> tuple[np.ndarray, dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Read loads over time, and coordinates that are led.

    Args:
        path: a CSV table with a column `time_s` that rises; further columns have the name of a load
            (`kneejax.mechanics.NAMED_LOADS`) or of what is led.
        may_lead: names of columns that may be, in degrees or mm.

    Returns:
        Times, s; name of a load -> its sizes; column of what is led -> degrees or mm.

    Raises:
        InputProblem: the file cannot be read, a cell is no number or out of range, times that do
            not rise, fewer than two of them, or a column that is neither.

    Example:
        >>> import tempfile
        >>> from pathlib import Path
        >>> path = Path(tempfile.mkdtemp()) / "pull.csv"
        >>> _ = path.write_text("time_s, anterior_N\\n0, 0\\n0.1, 100\\n")
        >>> read_loads_over_time(path)[1]["anterior_N"].tolist()
        [0.0, 100.0]
    """
    table = Table.read(path, [TIME])
    _refuse_older_names(table)
    table.check_columns(table.header)
    sizes = table.numbers(name for name in table.header if name in NAMED_LOADS)
    led = [name for name in table.header if name in may_lead]
    for name in table.header:
        if name not in (TIME, *sizes, *led):
            raise InputProblem(table.file, "header", name, (TIME, *NAMED_LOADS, *may_lead))
    times, ways = table.column(TIME), table.numbers(led)
    table.check_times(TIME, times)
    if len(times) < 2:
        raise InputProblem(table.file, TIME, f"{times[0]:g}", "two times at least")
    return times, sizes, ways


class CandidateRow(NamedTuple):
    """One test of a table."""

    name: str  # of the load, empty if the table gives none
    flexion_deg: float  # prescribed
    loads: dict[str, float]  # name of a load (`kneejax.mechanics.NAMED_LOADS`) -> its size


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
    table = Table.read(path, ["flexion_deg"])
    for name in table.header:
        if name not in _CANDIDATE:
            near = _meant(name) or [column for column in _CANDIDATE if column not in table.header]
            expected = f"any of {', '.join(_CANDIDATE)}"
            raise InputProblem(table.file, "header", name, expected, near)
    table.check_columns(table.header)
    read = table.numbers(x for x in _CANDIDATE[:-1] if x in table.header)
    tests, found = {}, []
    named = table.cells("name") if "name" in table.header else [("", "")] * len(table.rows)
    for row, (_, name) in enumerate(named):
        values = dict.fromkeys(_CANDIDATE[:-1], 0.0) | {x: float(y[row]) for x, y in read.items()}
        if (first := tests.setdefault(tuple(values.values()), row)) != row:
            again = f"the test of row {first + 1} again"
            raise InputProblem(table.file, table.place(row), again, "every test once")
        found.append(CandidateRow(name, values.pop("flexion_deg"), values))
    return tuple(found)


class LabTable(NamedTuple):
    """A test under load as it was measured, in `n` rows."""

    flexion_deg: np.ndarray  # `(n,)`
    loads: dict[str, np.ndarray]  # name of a load -> its size in each row, `(n,)`
    # the five free coordinates, `(n, 5)`, degrees and mm, translations along the axes of Grood and
    # Suntay; NaN where a table has no such column
    observed: np.ndarray
    # what was read of parts of the knee, `PART.KIND` -> `(n,)`, N or strain, and of the patella,
    # its column -> degrees or mm along the femur's axes; NaN where a cell is empty
    readings: dict[str, np.ndarray] = {}
    weight: np.ndarray | None = None  # `(n,)`; None where a table has no such column
    time_s: np.ndarray | None = None  # likewise, s

    def take(self, rows: np.ndarray) -> "LabTable":
        """Some of the rows."""
        return LabTable(*(
            {name: sizes[rows] for name, sizes in x.items()} if isinstance(x, dict)
            else x if x is None else x[rows] for x in self))


def read_lab_table(
    path: str | os.PathLike[str], columns: Mapping[str, str] | None = None,
    flexion_deg: float | None = None, convention: str = CLINICAL, ignore: tuple[str, ...] = (), *,
    unloaded: bool = False, about: str = "",
) -> LabTable:  # fmt: skip
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
        about: what is tested, in words: a load without a direction, as `Applied Load (N)`, is that
            of a drawer, AP, torsion, IE, varus, VV or axial test, here or in the file's name.

    Raises:
        InputProblem: the file cannot be read; a column is missing, or sounds like a load and is
            not used; a cell is not a number or out of range; moments look like N mm, lengths like
            metres, angles like radians; `InputProblems` where several are.

    Warns:
        Assumption: columns that are recognised by their headers, `JCS Valgus [deg]`, and units
            that are judged by the size of numbers.

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
    table = Table.read(path)
    mapped, named = {*(columns or ())}, table.named
    sure = _name_columns(table, columns or {})
    _take_own_names(table, lambda name: name in _KNOWN or _is_reading(name), mapped, ignore)
    stated = [*named]
    about = f"{os.path.basename(table.file)} {about}"
    phrases, unused = by_headers(table, ignore, about, mapped=mapped)
    if flexion_deg is not None and COLUMNS[0] in named:
        own = named.pop(COLUMNS[0])[0]
        expected = f"no at_deg ({flexion_deg:g}) beside it, or {own} under ignore"
        table.wrong("header", own, expected)
    _check_header(table, mapped, flexion_deg, {*ignore, *unused}, unloaded)
    readings = [x for x in named if _is_reading(x)]
    read = {x: table.column(x, column_range(x), empty=x in COLUMNS[1:] or x in readings)
            for x in (*NAMED_LOADS, *COLUMNS, *readings, "weight", TIME) if x in named}
    loads = {x: read[x] for x in NAMED_LOADS if x in read}
    for name, size in loads.items():
        if name.endswith("_Nm") and np.abs(size).max(initial=0.0) > MOST_MOMENT_NM:
            own, _ = named[name]
            expected = f"N m, at most {MOST_MOMENT_NM:g}; N mm are suspected (0.001 * {own})"
            table.wrong(own, f"up to {np.abs(size).max():g}", expected)
    table.mistakes.check()
    absent = np.full(len(table.rows), np.nan)
    observed = np.stack([read.get(name, absent) for name in COLUMNS], axis=1)
    doubted = [name in stated and name not in sure for name in COLUMNS]
    table.check_units(np.where(doubted, observed, np.nan), least_deg=1.0)
    table.mistakes.check()
    assumed(table.file, phrases)
    if flexion_deg is not None:
        observed[:, 0] = flexion_deg
    table.check_rows_convention(convention)
    if convention != CLINICAL:
        if np.isnan(observed).any():
            without = f"without which {convention} cannot be converted"
            raise InputProblem(table.file, "header", "not all six columns of a pose",
                               f"all of {', '.join(COLUMNS)}, {without}")
        observed = convert_table(observed, convention, CLINICAL)
        # Rows of one flexion stay rows of one flexion, whatever the conversion rounds.
        observed[:, 0] = np.round(observed[:, 0], 6)
    return LabTable(observed[:, 0], loads, observed[:, 1:], {x: read[x] for x in readings},
                    read.get("weight"), read.get(TIME))


def _is_reading(name: str) -> bool:
    """Whether a column tells of a part of the knee, or of a bone other than the tibia."""
    return name in OTHER_COLUMNS or _READING.fullmatch(name) is not None


def _meant(name: str) -> str | None:
    """The load that a name once meant, or that acts the other way, in words."""
    opposite = load_opposite_to(name)
    return f"{opposite} of the opposite sign" if opposite else load_called(name)


def _check_header(
    table: Table, mapped: set[str], flexion_deg: float | None, ignore: set[str], unloaded: bool
) -> None:
    """A load, a coordinate and a flexion; nothing that sounds like a load is left over."""
    used = {column for column, _ in table.named.values()} | ignore
    # What is mapped counts as there: if it is not, that is a mistake of its own.
    there, loads_left = {*table.named, *mapped}, False
    for own in table.header:
        if own in used or not _LOAD.search(own):
            continue
        expected = "a column that is used (columns:) or left out on purpose (ignore:)"
        said = header_meaning(own)
        if said is not None and said.nameless:
            loads_left = True
            known = ", ".join(x for x in NAMED_LOADS if x.endswith(f"_{said.unit}"))
            expected = ("its direction: a test named drawer, AP, torsion, IE, varus, VV or axial, "
                        f'or "{own}" under columns, for one of {known}')
        meant = load_opposite_to(own)
        table.wrong("header", own, expected, f"columns: {{{meant}: -{own}}}" if meant else None)
    read = any(map(_is_reading, there))
    for what, known, spared in (("load", NAMED_LOADS, unloaded or loads_left),
                                ("coordinate", COLUMNS[1:], read)):
        if not spared and not there.intersection(known):
            table.wrong("header", f"no {what}", f"one of {', '.join(known)}")
    if flexion_deg is None and COLUMNS[0] not in there:
        expected = f"this column among {', '.join(table.header)}, or at_deg of the test"
        table.wrong(COLUMNS[0], "missing", expected)


def _name_columns(table: Table, columns: Mapping[str, str]) -> set[str]:
    """Name columns as a study maps them, and give the names whose factor it states."""
    found, sure = {}, set()
    for name, said in columns.items():
        factor, own = 1.0, said.strip()
        match = re.fullmatch(r"([-+.\w]+)\s*\*\s*(.+)", own)
        if name not in _KNOWN and not _is_reading(name):
            expected = f"one of {', '.join(_KNOWN)}, or such as ACL.tension_N"
            meant = load_opposite_to(name)
            table.wrong("columns", name, expected, f"{meant}: -{own}" if meant else _KNOWN)
            continue
        if match:
            factor, own = plain_number(match[1]), match[2]
            sure.add(name)
        elif own.startswith("-"):
            factor, own = -1.0, own[1:].strip()
        if factor and math.isfinite(factor):
            found[name] = own, factor
        else:
            expected = "a factor before the *, as in 0.001 * Torque [Nmm]"
            table.wrong(f"columns.{name}", said, expected)
    table.seek([own for own, _ in found.values()])
    table.named.update({x: own for x, own in found.items() if own[0] in table.header})
    return sure
