"""Text and JSON files: read with every fault named, written completely or not at all."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path
from typing import Any

from kneejax._whole_files import write_whole, written_place
from kneejax.files.reading._problem import InputProblem
from kneejax.quantities import nearest_name

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
    except _NotPlain as error:
        raise InputProblem(path, "file", str(error), f"JSON: {kind}") from None


class _NotPlain(ValueError):
    """What JSON allows and no file of the package has."""


def _whole_number(digits: str) -> int:
    if len(digits) > LONGEST_NUMBER:
        raise _NotPlain(f"a number of {len(digits)} digits")
    return int(digits)


def _each_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        raise _NotPlain(f"the name {next(x for x in names if names.count(x) > 1)!r} twice")
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
