"""Text files as a whole: read with every fault named, written completely or not at all."""

from __future__ import annotations

import os
from pathlib import Path

from kneejax._whole_files import write_whole, written_place
from kneejax.files.reading._problem import InputProblem, nearest_name


def read_text(path: str | os.PathLike[str], kind: str) -> str:
    """Read a UTF-8 text file.

    Args:
        path: the file.
        kind: what it should be, for the error, e.g. `a knee file`.

    Returns:
        Its text, without a byte order mark.

    Raises:
        InputProblem: it does not exist, is a folder, cannot be read, is empty, is binary, or
            is not UTF-8.
    """
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


def read_bytes(path: str | os.PathLike[str], kind: str) -> bytes:
    """Read a file that is not empty.

    Args:
        path: the file.
        kind: what it should be, for the error.

    Returns:
        Its content.

    Raises:
        InputProblem: it does not exist, is a folder, cannot be read, or is empty.
    """
    path = Path(path)
    if path.is_dir():
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


def neighbour(path: Path) -> str | None:
    """A file beside it with nearly the same name."""
    if not path.parent.is_dir():
        return None
    return nearest_name(path.name, sorted(p.name for p in path.parent.iterdir()))
