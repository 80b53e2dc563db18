"""What is wrong with something a person gave, in one line; text and JSON files, read with every
fault named, written completely or not at all."""

__all__ = [
    "InputProblem", "InputProblems", "counted", "load_json", "neighbour", "plain_number",
    "read_bytes", "read_text", "write_bytes", "write_text", "wrong",
]

import json
import os
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from kneejax._whole_files import write_whole, written_place
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


#: A number as files and options have it: digits of ASCII, without underscores.
_NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")
_NOT_FINITE = re.compile(r"[-+]?(?:nan|inf|infinity)", re.IGNORECASE)
#: Characters of a number at most: more tell nothing, and take long to read.
LONGEST_NUMBER = 1000
#: What is said of lists and mappings that a reader cannot follow.
TOO_DEEP = "lists or mappings too deep in one another"


def read_text(path: str | os.PathLike[str], kind: str) -> str:
    """The text of a UTF-8 file, without a byte order mark; as `read_bytes`, and raises where the
    file is binary or not UTF-8."""
    data = read_bytes(path, kind)
    if b"\x00" in data:
        raise InputProblem(path, "file", "binary data", f"{kind}, which is text")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        where = f"byte {error.start} is {data[error.start]:#04x}"
        raise InputProblem(path, "file", where, f"{kind} in UTF-8") from None
    if not text.strip():
        raise InputProblem(path, "file", "empty", kind)
    return text


def load_json(path: str | os.PathLike[str], kind: str) -> Any:
    """Mappings, lists, texts, numbers, truth values and None of a JSON file; as `read_text`, raises
    also where it is no JSON, too deep, or has a name twice or a number of thousands of digits."""
    text = read_text(path, kind)
    try:
        return json.loads(text, object_pairs_hook=_each_once, parse_int=_whole_number)
    except json.JSONDecodeError as error:
        raise InputProblem(path, f"line {error.lineno}", error.msg, f"JSON: {kind}") from None
    except RecursionError:
        raise InputProblem(path, "file", TOO_DEEP, f"JSON: {kind}") from None
    except ValueError as error:  # what JSON allows and no file of the package has
        raise InputProblem(path, "file", str(error), f"JSON: {kind}") from None


def _whole_number(digits: str) -> int:
    if len(digits) > LONGEST_NUMBER:
        raise ValueError(f"a number of {len(digits)} digits")
    return int(digits)


def _each_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        raise ValueError(f"the name {next(x for x in names if names.count(x) > 1)!r} twice")
    return found


def read_bytes(path: str | os.PathLike[str], kind: str) -> bytes:
    """The content of a file that should be of a kind, as in `a knee file`, for the error; raises
    where it does not exist, is a folder, cannot be read, or is empty."""
    path = Path(path)
    if os.path.isdir(path):
        raise InputProblem(path, "file", "a folder", kind)
    place = written_place(path)
    try:
        data = place.read_bytes()
    except FileNotFoundError:
        raise InputProblem(path, "file", "missing", kind, neighbour(path)) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputProblem(path, "file", reason, f"{kind} that can be read") from None
    if not data:
        raise InputProblem(path, "file", "empty", kind)
    return data


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write a UTF-8 text file so that a reader sees the old one or the new one, never a part.

    Args:
        path: the file; missing folders are made.
        text: its content.

    Raises:
        InputProblem: the file cannot be written.

    Example:
        >>> import tempfile
        >>> path = Path(tempfile.mkdtemp()) / "new" / "note.txt"
        >>> write_text(path, "18.97 MPa")
        >>> path.read_text()
        '18.97 MPa'
    """
    write_bytes(path, text.encode("utf-8"))


def write_bytes(path: str | os.PathLike[str], data: bytes) -> None:
    """Write a file so that a reader sees the old one or the new one, never a part.

    Args:
        path: the file; missing folders are made.
        data: its content.

    Raises:
        InputProblem: the file cannot be written.

    Example:
        >>> import tempfile
        >>> path = Path(tempfile.mkdtemp()) / "new.osim"
        >>> write_bytes(path, b"<OpenSimDocument/>")
        >>> path.read_bytes()
        b'<OpenSimDocument/>'
    """
    try:
        write_whole(path, data)
    except OSError as error:
        raise InputProblem(path, "file", error.strerror or str(error), "a place to write") from None


def plain_number(text: str) -> float | None:
    """A number as people write it, which may be NaN or infinite; None where a text is none, as are
    `1_000`, digits of other scripts and hexadecimal.

    Example:
        >>> plain_number(" -2.5e1 "), plain_number("1_000"), plain_number("١٢")
        (-25.0, None, None)
    """
    text = text.strip()
    if _NUMBER.fullmatch(text) and len(text) <= LONGEST_NUMBER:
        return float(text)
    return float(text) if _NOT_FINITE.fullmatch(text) else None


def neighbour(path: Path) -> str | None:
    """A file beside it with nearly the same name."""
    try:
        return nearest_name(path.name, sorted(os.listdir(path.parent)))
    except (OSError, ValueError):
        return None
