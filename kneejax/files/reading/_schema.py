"""Checks of what stands in a file: one value at a time, each knowing its place."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

from kneejax.files.reading._problem import InputProblem, nearest_name

if TYPE_CHECKING:
    from kneejax.mechanics import Range

#: No seed and no count is larger.
MOST = 2**32 - 1
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_+-]*")


@dataclasses.dataclass(frozen=True)
class Field:
    """A value at a place in a file.

    Every method that reads the value raises `InputProblem` if it is not what was asked for.

    Attributes:
        file: the file.
        path: the place, e.g. `ligaments.ACL.stiffness_N`; empty for the whole file.
        value: what stands there.
    """

    file: str
    path: str
    value: Any

    def problem(self, expected: str, nearest: str | Iterable[str] | None = None) -> InputProblem:
        """The error that says what was expected here."""
        return InputProblem(self.file, self.path or "file", self.value, expected, nearest)

    def __getitem__(self, name: str) -> Field:
        return Field(self.file, f"{self.path}.{name}" if self.path else name, self.value[name])

    def __contains__(self, name: str) -> bool:
        return name in self.value

    def mapping(self, required: Sequence[str], optional: Sequence[str] = ()) -> Field:
        """This field, which must be a mapping with these fields and no others."""
        if not isinstance(self.value, dict):
            raise self.problem(f"a mapping with the fields {', '.join(required or optional)}")
        known = (*required, *optional)
        prefix = f"{self.path}." if self.path else ""
        for name, value in self.value.items():
            if name not in known:
                missing = [other for other in known if other not in self.value]
                raise InputProblem(
                    self.file,
                    f"{prefix}{name}",
                    value,
                    f"no such field, but one of {', '.join(known)}",
                    nearest_name(str(name), missing) or nearest_name(str(name), known),
                )
        for name in required:
            if name not in self.value:
                raise InputProblem(self.file, f"{prefix}{name}", "missing", "this field")
        return self

    def named(self, kind: str, empty: bool = False) -> list[tuple[str, Field]]:
        """Names and fields of a mapping whose names a person chooses; at least one."""
        if not isinstance(self.value, dict) or not (self.value or empty):
            raise self.problem(f"a mapping from a name to {kind}")
        for name in self.value:
            if not isinstance(name, str) or not _NAME.fullmatch(name):
                raise InputProblem(
                    self.file,
                    f"{self.path}.{name}",
                    name,
                    "a name of letters, digits, _, + or -, beginning with a letter",
                )
        return [(name, self[name]) for name in self.value]

    def items(self, kind: str, count: int | None = None) -> list[Field]:
        """Entries of a list; at least one, or as many as `count`."""
        wrong = count is not None and isinstance(self.value, list) and len(self.value) != count
        if not isinstance(self.value, list) or not self.value or wrong:
            raise self.problem(f"a list of {count} {kind}" if count else f"a list of {kind}")
        return [Field(self.file, f"{self.path}[{i}]", x) for i, x in enumerate(self.value)]

    def number(self, allowed: Range | None = None) -> float:
        """A finite number, within a range."""
        expected = f"a number {allowed}" if allowed else "a number"
        if isinstance(self.value, bool) or not isinstance(self.value, int | float):
            raise self.problem(expected)
        try:
            x = float(self.value)
        except OverflowError:
            raise self.problem(f"{expected}, finite") from None
        if not math.isfinite(x):
            raise self.problem(f"{expected}, finite")
        if allowed and not allowed.holds(x):
            raise self.problem(allowed.expected(x))
        return x

    def integer(self, at_least: int, at_most: int = MOST) -> int:
        """A whole number."""
        whole = isinstance(self.value, int) and not isinstance(self.value, bool)
        if not whole or not at_least <= self.value <= at_most:
            limits = f"at least {at_least}" if at_most == MOST else f"from {at_least} to {at_most}"
            raise self.problem(f"a whole number {limits}")
        return self.value

    def text(self) -> str:
        """A text that is not empty."""
        if not isinstance(self.value, str) or not self.value.strip():
            raise self.problem("a text")
        return self.value.strip()

    def choice(self, options: Iterable[str]) -> str:
        """One of several texts."""
        options = tuple(options)
        if not isinstance(self.value, str) or self.value not in options:
            raise self.problem(f"one of {', '.join(options)}", options)
        return self.value

    def boolean(self) -> bool:
        """True or false."""
        if not isinstance(self.value, bool):
            raise self.problem("true or false")
        return self.value

    def numbers(
        self, count: int | None = None, allowed: Range | None = None
    ) -> tuple[float, ...]:
        """A list of finite numbers, each within a range."""
        return tuple(item.number(allowed) for item in self.items("numbers", count))

    def interval(self, allowed: Range | None = None) -> tuple[float, float]:
        """Two finite numbers, the first below the second."""
        lower, upper = self.numbers(2, allowed)
        if lower >= upper:
            raise self.problem("a lower and a larger upper limit")
        return lower, upper

    def rows(
        self, columns: int | None = None, allowed: Range | None = None
    ) -> list[tuple[float, ...]]:
        """A rectangular table of finite numbers, a list of rows."""
        table = [row.numbers(columns, allowed) for row in self.items("rows of numbers")]
        if len({len(row) for row in table}) != 1:
            raise self.problem("rows of equal length")
        return table
