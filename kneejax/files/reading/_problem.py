"""What is wrong with something a person gave, in one line."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any

from kneejax.quantities import nearest_name

#: Characters of a value, of a place and of what is expected that are shown at most.
_LONGEST_VALUE, _LONGEST_FIELD, _LONGEST_EXPECTED = 60, 200, 1500
#: Binary digits of the largest whole number that is written out.
_LONGEST_INTEGER = 1000


class InputProblem(ValueError):
    """A bad input: `FILE: field: value: expected ...`, always in one line.

    Attributes:
        file: the file (or the option) the input came from.
        field: the place in it, e.g. `ligaments.ACL.stiffness_N`.
        value: what stands there; a text is shown as it is, anything else by its `repr`.
        expected: what should stand there, without the word "expected"; or, to begin with, the names
            of which one should.
        nearest: the nearest known name, or None; to begin with also the known names, of which the
            one most like `value` is suggested if any is, as it is of those expected.

    Example:
        >>> from kneejax import InputProblem
        >>> print(InputProblem("knee.yaml", "side", "rigth", "right or left", "right"))
        knee.yaml: side: rigth: expected right or left; did you mean right?
    """

    def __init__(
        self, file: str | os.PathLike[str], field: str, value: Any, expected: str | Collection[str],
        nearest: str | Iterable[str] | None = None,
    ):  # fmt: skip
        """Make the line."""
        if not isinstance(expected, str):
            expected, nearest = f"one of {', '.join(expected)}", nearest or expected
        if nearest is not None and not isinstance(nearest, str):
            nearest = nearest_name(value, nearest) if isinstance(value, str) else None
        self.file = os.fspath(file)
        self.field = field
        self.value = value
        self.expected = expected
        self.nearest = nearest
        suggestion = "" if nearest is None else f"; did you mean {nearest}?"
        parts = (str(field), _LONGEST_FIELD), (expected, _LONGEST_EXPECTED)
        place, expected = (_cut(_in_one_line(text), most) for text, most in parts)
        line = f"{self.file}: {place}: {_shown(value)}: expected {expected}{suggestion}"
        super().__init__(_in_one_line(line))

    def __reduce__(self):
        arguments = (self.file, self.field, self.value, self.expected, self.nearest)
        return type(self), arguments


class InputProblems(InputProblem):
    """Several mistakes of one input, a line each.

    Attributes:
        problems: every mistake; the attributes of the whole are those of the first `InputProblem`.
    """

    def __init__(self, problems: Sequence[ValueError]):
        """Keep the mistakes in their order."""
        self.problems = tuple(problems)
        ValueError.__init__(self, "\n".join(map(str, problems)))
        first = next((one for one in problems if isinstance(one, InputProblem)), None)
        for name in ("file", "field", "value", "expected", "nearest"):
            setattr(self, name, getattr(first, name, ""))

    def __reduce__(self):
        return type(self), (self.problems,)


def wrong(
    value: Any, expected: str | Collection[str], nearest: str | Iterable[str] | None = None,
    at: str = "",
) -> InputProblem:  # fmt: skip
    """The error that says what was expected of a value, whose file its reader knows."""
    return InputProblem("", at, value, expected, nearest)


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
    """The beginning of a value; what is not shown is not written out either."""
    pieces, text = (value,) if isinstance(value, str) else _pieces(value), ""
    for piece in pieces:
        text += piece[: 10 * _LONGEST_VALUE]
        if len(text) > 2 * _LONGEST_VALUE:
            break
    return _cut(_in_one_line(text.strip()), _LONGEST_VALUE) or "empty"


def _pieces(value: Any) -> Iterator[str]:
    """A value as `repr` writes it, piece by piece."""
    if isinstance(value, list | tuple | Mapping):
        named = isinstance(value, Mapping)
        opening, closing = "{}" if named else "[]" if isinstance(value, list) else "()"
        yield opening
        for number, one in enumerate(value):
            yield ", " if number else ""
            yield from _pieces(one)
            if named:
                yield ": "
                yield from _pieces(value[one])
        yield ",)" if isinstance(value, tuple) and len(value) == 1 else closing
    elif isinstance(value, str | bytes):
        yield repr(value[: 10 * _LONGEST_VALUE])
    elif isinstance(value, int) and value.bit_length() > _LONGEST_INTEGER:
        yield f"a number of about {int(value.bit_length() * 0.30103)} digits"
    else:
        yield repr(value)


def _cut(text: str, most: int) -> str:
    return text if len(text) <= most else text[: most - 3] + "..."


def _in_one_line(text: str) -> str:
    return "".join(c if c.isprintable() else " " for c in " ".join(text.split()))
