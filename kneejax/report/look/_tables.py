"""A table: its columns are declared once and written to a terminal, a CSV, a page and JSON."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from kneejax.report.look._json import json_safe
from kneejax.report.look._numbers import NONE, number
from kneejax.report.look._terminal import aligned


@dataclasses.dataclass(frozen=True)
class Column:
    """A column of a table.

    Attributes:
        name: in CSV and JSON, with its unit, e.g. `force_N`.
        label: heading for people; the name in words where it is empty.
        show: a cell as people read it; numbers with four digits, None and NaN a dash.
        words: whether cells are words, to the left; numbers stand to the right.
        shown: whether people see it; what is not shown is in files only.
    """

    name: str
    label: str = ""
    show: Callable[[Any], str] | None = None
    words: bool = False
    shown: bool = True

    @property
    def heading(self) -> str:
        """What stands above the column for people."""
        return self.label or _in_words(self.name)

    def text(self, value: Any) -> str:
        """A cell for people."""
        if self.show is not None:
            return self.show(value)
        if value is None:
            return NONE
        if isinstance(value, bool):
            return "yes" if value else "no"
        return value if isinstance(value, str) else number(value)


@dataclasses.dataclass(frozen=True)
class Table:
    """Rows under declared columns.

    Attributes:
        columns: in order.
        rows: cells in the order of the columns.
        title: above the table on a page.
        note: one sentence under the table: what its numbers hold for.

    Example:
        >>> force = Column("force_N", "Force, N", lambda value: f"{value:.0f}")
        >>> forces = Table((Column("ligament", words=True), force), [["ACL", 12.3], ["PCL", 104.0]])
        >>> print(forces.terminal())
        ligament  Force
                      N
        ACL          12
        PCL         104
        >>> forces.records()[0]
        {'ligament': 'ACL', 'force_N': 12.3}
    """

    columns: Sequence[Column]
    rows: Sequence[Sequence[Any]]
    title: str = ""
    note: str = ""

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
        words = [i for i, column in enumerate(self.shown) if column.words]
        heads = [column.heading.rpartition(", ") for column in self.shown]
        lines = [[name or unit for name, _, unit in heads]]
        if any(name for name, *_ in heads):
            lines.append([unit if name else "" for name, _, unit in heads])
        return "\n".join(aligned([*lines, *self.cells()], words))

    def records(self) -> list[dict[str, Any]]:
        """One dictionary a row for JSON; NaN and infinity are None."""
        return [dict(zip(self.names, json_safe(list(row)), strict=True)) for row in self.rows]


def _in_words(name: str) -> str:
    """`max_pressure_MPa` -> `max pressure, MPa`."""
    stem, _, unit = name.rpartition("_")
    units = ("N", "mm", "mm2", "MPa", "deg", "Nm", "Nmm", "s", "kg", "m")
    if stem and unit in units:
        return f"{stem.replace('_', ' ')}, {unit.replace('2', '²')}"
    return name.replace("_", " ")
