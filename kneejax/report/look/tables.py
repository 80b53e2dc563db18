"""Numbers, words and tables for people: a table's columns are declared once and written everywhere.

A table becomes lines of a terminal, rows of a CSV file, a piece of a page, and records of JSON.
"""

__all__ = ["Table", "aligned", "json_safe", "wrapped"]

import dataclasses
import enum
import itertools
import math
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import PurePath
from typing import Any, Self, TypeVar

import numpy as np

from kneejax.quantities import quantity_of, unit_of_column

_Key = TypeVar("_Key")
_Value = TypeVar("_Value")

NONE = "-"
LINE_WIDTH = 98
#: Rows of a table that a terminal shows.
_MOST_ROWS = 200


def json_safe(value: Any) -> Any:
    """Turn arrays, numbers, paths and mappings into what JSON can hold; NaN becomes None.

    Args:
        value: anything.

    Returns:
        Dictionaries, lists, strings, numbers, booleans and None.
    """
    if isinstance(value, enum.Enum):
        return value.name.lower()
    if value is None or isinstance(value, str | int):
        return value
    if isinstance(value, Mapping):
        return {str(key): json_safe(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [json_safe(item) for item in value]
    if isinstance(value, set | frozenset):
        return sorted((json_safe(item) for item in value), key=str)
    if isinstance(value, PurePath):
        return value.as_posix()
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    return json_safe(np.asarray(value).tolist()) if hasattr(value, "__array__") else str(value)


def number(value: float, digits: int = 4) -> str:
    """So many significant digits, no needless exponents; a dash for NaN and None."""
    if value is None or math.isnan(value):
        return NONE
    if math.isinf(value):
        return "inf" if value > 0 else "-inf"
    if value == 0:
        return "0"
    size = math.floor(math.log10(abs(value)))
    if size < -4 or size > 7:
        return f"{value:.{digits - 1}e}"
    return f"{value:.{max(digits - 1 - size, 0)}f}"


def trimmed(value: float, digits: int = 4) -> str:
    """Write a number like `number`, without trailing zeros: for what a person has set."""
    text = number(value, digits)
    return text.rstrip("0").rstrip(".") if "." in text and "e" not in text else text


def short(value: float, sign: str = "") -> str:
    """A number with two or three digits, thousands set apart; with `+` also a positive sign."""
    if not np.isfinite(value):
        return "unknown"
    if abs(value) >= 1e6 or 0 < abs(value) < 1e-4:
        return f"{value:{sign}.1e}"
    return f"{value:{sign},.0f}" if abs(value) >= 99.5 else f"{value:{sign}.2g}"


def with_error(value: float, standard_error: float) -> tuple[str, str]:
    """Write an estimate and its standard error, two significant digits, with matching decimals."""
    known = standard_error is not None and math.isfinite(standard_error) and standard_error > 0
    if not known or not math.isfinite(value):
        return number(value), number(standard_error, 2)
    size = math.floor(math.log10(standard_error))
    whole = math.floor(math.log10(abs(value))) if value else 0
    decimals = min(max(1 - size, 3 - whole, 0), max(6 - whole, 0))
    error = f"{standard_error:.{decimals}f}"
    return f"{value:.{decimals}f}", error if float(error) else f"{standard_error:.1e}"


def change(before: float, after: float) -> str:
    """By how much something fell or rose, e.g. `99.4 % lower`; empty if that cannot be given."""
    if not (math.isfinite(before) and math.isfinite(after)) or before <= 0:
        return ""
    percent = 100 * (after / before - 1)
    if abs(percent) < 0.05:
        return "unchanged"
    shown = f"{abs(percent):.1f}"
    if shown == "100.0" and percent < 0:
        return "more than 99.9 % lower" if after > 0 else "100 % lower"
    return f"{shown} % {'lower' if percent < 0 else 'higher'}"


def listed(words: Sequence[str], most: int = 12) -> str:
    """Join words with commas; long lists end in a count: `a, b, c and 4 more`."""
    if len(words) <= most:
        return ", ".join(words)
    return f"{', '.join(words[:most])} and {len(words) - most} more"


def grouped(pairs: Iterable[tuple[_Key, _Value]]) -> dict[_Key, list[_Value]]:
    """Values by their keys, both in the order in which they come."""
    found: dict[_Key, list[_Value]] = {}
    for key, value in pairs:
        found.setdefault(key, []).append(value)
    return found


def runs(rows: np.ndarray, apart: int = 1) -> list[tuple[int, int]]:
    """First and last of each run of rows whose neighbours are at most so far apart."""
    parts = np.split(rows, np.flatnonzero(np.diff(rows) > apart) + 1)
    return [(int(part[0]), int(part[-1])) for part in parts if len(part)]


def plain(name: str) -> str:
    """A parameter's name in words: `ACL.reference_strain` becomes `ACL reference strain`."""
    return name.replace(".", " ").replace("_", " ")


def unit_after(name: str) -> str:
    """Unit of a parameter with a blank before it, empty for strains."""
    unit = quantity_of(name).unit
    return f" {unit}" if unit else ""


def aligned(rows: Sequence[Sequence[str]], words: Sequence[int] = (0,)) -> list[str]:
    """Columns two blanks apart; columns in `words` to the left, the others to the right."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return [
        "  ".join(text.ljust(width) if i in words else text.rjust(width)
                  for i, (text, width) in enumerate(zip(row, widths, strict=True))).rstrip()
        for row in rows
    ]


def wrapped(text: str, first: str = "") -> list[str]:
    """A paragraph in lines that a terminal holds.

    Args:
        text: the paragraph, in one line.
        first: what the first line begins with, e.g. `note: `; the others are indented by as much.

    Returns:
        Lines of at most `LINE_WIDTH` characters; none for an empty text.

    Example:
        >>> wrapped("Every pose is balanced.", "note: ")
        ['note: Every pose is balanced.']
    """
    return textwrap.wrap(text, LINE_WIDTH, initial_indent=first, subsequent_indent=" " * len(first),
                         break_on_hyphens=False)  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Column:
    """A column of a table: its name in files, with its unit, and the heading for people.

    `show` is a format such as `.2f`, a count of significant digits, or a function; whole numbers
    stand as they are, None and NaN are a dash. `words` stand to the left, numbers to the right: by
    default where all cells are words. What is not `shown` is in files only.
    """

    name: str
    label: str = ""
    show: Callable[[Any], str] | str = "4"
    words: bool | None = None
    shown: bool = True

    @property
    def heading(self) -> str:
        """What stands above the column: of `max_pressure_MPa` it is `max pressure, MPa`."""
        unit = unit_of_column(self.name)
        stem = self.name.removesuffix(f"_{unit}").replace("_", " ")
        return self.label or ", ".join(filter(None, (stem, unit.replace("2", "²"))))

    def text(self, value: Any) -> str:
        """A cell for people."""
        if callable(self.show):
            return self.show(value)
        if isinstance(value, bool):
            return "yes" if value else "no"
        if value is None or isinstance(value, str | int):
            return NONE if value is None else str(value)
        if self.show.isdigit():
            return number(value, int(self.show))
        if not math.isfinite(value):
            return NONE
        text = format(value, self.show)
        return text if text.strip("-0.") else text.lstrip("-")  # no -0.0


@dataclasses.dataclass(frozen=True)
class Table:
    """Rows under declared columns.

    Attributes:
        columns: in order, or their names.
        rows: cells in the order of the columns.
        title: above the table on a page.
        note: one sentence under the table: what its numbers hold for.
        spare: names of columns that a terminal hides, in order, until the table fits; those that
            only make sense together stand in one text.

    Example:
        >>> force = Column("force_N", "Force, N", ".0f")
        >>> forces = Table(("ligament", force), [["ACL", 12.3], ["PCL", 104.0]])
        >>> print(forces.terminal())
        ligament  Force
                      N
        ACL          12
        PCL         104
        >>> forces.records()[0]
        {'ligament': 'ACL', 'force_N': 12.3}
    """

    columns: Sequence[Any]
    rows: Sequence[Sequence[Any]]
    title: str = ""
    note: str = ""
    spare: Sequence[str] = ()

    def __post_init__(self):
        columns = [Column(one) if isinstance(one, str) else one for one in self.columns]
        for i, one in enumerate(columns):
            if one.words is None:
                words = all(isinstance(cell, str) for row in self.rows for cell in row[i : i + 1])
                columns[i] = dataclasses.replace(one, words=words and bool(self.rows))
        vars(self)["columns"] = columns

    @classmethod
    def of(
        cls, columns: Mapping[str | Column | Sequence[str], Any], title: str = "", note: str = "",
        *, show: Mapping[str, tuple[str, ...]] | None = None, spare: Sequence[str] = (),
    ) -> Self:  # fmt: skip
        """A table by its columns.

        Args:
            columns: column, or its name, -> its cells, or the one cell that all rows have; several
                names -> an array whose last axis they are.
            title: as of the table.
            note: likewise.
            show: name -> heading and, if not the usual one, format of what people see; what is not
                named is in files only. People see everything where this is left out.
            spare: as of the table.

        Example:
            >>> columns = {"test": "drawer", ("flexion_deg", "range_mm"): [[0.0, 6.1], [30.0, 9.8]]}
            >>> Table.of(columns).rows
            [['drawer', 0.0, 6.1], ['drawer', 30.0, 9.8]]
        """
        flat: dict[str | Column, Any] = {}
        for key, values in columns.items():
            if isinstance(key, str | Column):
                flat[key] = _cells(values)
                continue
            parts = np.moveaxis(np.asarray(values), -1, 0)
            flat |= {name: part.tolist() for name, part in zip(key, parts, strict=True)}
        count = next((len(x) for x in flat.values() if isinstance(x, list)), 1)
        lists = {key: x if isinstance(x, list) else [x] * count for key, x in flat.items()}
        heads = [key if isinstance(key, Column) else
                 Column(key, *(show or {}).get(key, ()), shown=show is None or key in show)
                 for key in lists]  # fmt: skip
        return cls(heads, [[*row] for row in zip(*lists.values(), strict=True)], title, note, spare)

    @property
    def names(self) -> list[str]:
        """Header of the CSV."""
        return [column.name for column in self.columns]

    @property
    def shown(self) -> list[Column]:
        """Columns that people see."""
        return [column for column in self.columns if column.shown]

    def cells(self) -> Iterator[list[str]]:
        """Rows of the shown columns as people read them."""
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(f"a row of {len(row)} cells under {len(self.columns)} columns")
            pairs = zip(self.columns, row, strict=True)
            yield [column.text(value) for column, value in pairs if column.shown]

    def terminal(self) -> str:
        """Lines for a terminal, columns two blanks apart, units on a line of their own."""
        hidden: set[str] = set()
        for names in ("", *self.spare):
            hidden |= {*names.split()}
            seen = [i for i, one in enumerate(self.shown) if one.name not in hidden]
            shown = [self.shown[i] for i in seen]
            heads = [column.heading.rpartition(", ") for column in shown]
            rows = [[name or unit for name, _, unit in heads]]
            if any(name for name, *_ in heads):
                rows.append([unit if name else "" for name, _, unit in heads])
            some = itertools.islice(self.cells(), _MOST_ROWS)
            rows += [[row[i].replace("\u00b1", "+-") for i in seen] for row in some]
            lines = aligned(rows, [i for i, column in enumerate(shown) if column.words])
            if max(map(len, lines)) <= LINE_WIDTH:
                break
        return "\n".join(lines)

    def text(self) -> str:
        """Title, lines and note for a terminal; the title alone without rows."""
        lines = [self.terminal()] if self.rows else []
        more = len(self.rows) - _MOST_ROWS
        lines += [f"... and {more} more rows"] * (more > 0)
        return "\n".join([*wrapped(self.title), *lines, *wrapped(self.note)])

    def records(self) -> list[dict[str, Any]]:
        """One dictionary a row for JSON; NaN and infinity are None."""
        return [dict(zip(self.names, json_safe(list(row)), strict=True)) for row in self.rows]


def _cells(values: Any) -> Any:
    values = values.tolist() if hasattr(values, "tolist") else values
    return list(values) if np.iterable(values) and not isinstance(values, str) else values
