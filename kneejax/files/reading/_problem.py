"""What is wrong with something a person gave, in one line."""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterable
from typing import Any

_LONGEST_VALUE = 60


class InputProblem(ValueError):
    """A bad input: `FILE: field: value: expected ...`, always in one line.

    Attributes:
        file: the file (or the option) the input came from.
        field: the place in it, e.g. `ligaments.ACL.stiffness_N`.
        value: what stands there.
        expected: what should stand there.
        nearest: the nearest known name, or None.
    """

    def __init__(
        self,
        file: str | os.PathLike[str],
        field: str,
        value: Any,
        expected: str,
        nearest: str | Iterable[str] | None = None,
    ):
        """Make the line.

        Args:
            file: the file (or the option) the input came from.
            field: the place in it.
            value: what stands there; a text is shown as it is, anything else by its `repr`.
            expected: what should stand there, without the word "expected".
            nearest: a name to suggest, or the known names, of which the one most like `value` is
                suggested if any is.
        """
        if nearest is not None and not isinstance(nearest, str):
            nearest = nearest_name(str(value), nearest)
        self.file = os.fspath(file)
        self.field = field
        self.value = value
        self.expected = expected
        self.nearest = nearest
        suggestion = "" if nearest is None else f"; did you mean {nearest}?"
        super().__init__(
            _in_one_line(f"{self.file}: {field}: {_shown(value)}: expected {expected}{suggestion}")
        )

    def __reduce__(self):
        arguments = (self.file, self.field, self.value, self.expected, self.nearest)
        return type(self), arguments


def nearest_name(word: str, known: Iterable[str]) -> str | None:
    """The known name most like a word.

    Args:
        word: what a person wrote.
        known: names that exist.

    Returns:
        The name, or None if nothing is like it.

    Example:
        >>> nearest_name("stifness_N", ["stiffness_N", "slack_length_mm"])
        'stiffness_N'
    """
    by_lower = {name.lower(): name for name in known}
    found = difflib.get_close_matches(word.lower(), by_lower, n=1, cutoff=0.6)
    return by_lower[found[0]] if found else None


def counted(count: int, noun: str) -> str:
    """A number of things in words.

    Args:
        count: how many.
        noun: one of them; its plural adds an s.

    Returns:
        The number and the noun, in the plural unless there is one.

    Example:
        >>> counted(1, "fibre"), counted(0, "pose")
        ('1 fibre', '0 poses')
    """
    return f"{count} {noun}{'' if count == 1 else 's'}"


def _shown(value: Any) -> str:
    text = _in_one_line(value if isinstance(value, str) else repr(value))
    if not text:
        return "empty"
    return text if len(text) <= _LONGEST_VALUE else text[: _LONGEST_VALUE - 3] + "..."


def _in_one_line(text: str) -> str:
    return "".join(c if c.isprintable() else " " for c in " ".join(text.split()))
