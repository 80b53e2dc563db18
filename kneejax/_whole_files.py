"""Files that are complete or absent, and files whose damage is noticed.

Everything that the package writes goes through `write_whole`: to a draft beside the file, synced
to the disk, renamed. While a run's results are gathered (`gathering`), its files go to a draft of
the whole folder instead, so that an earlier run's results stay until all the new ones are there.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import uuid
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

#: Drafts of folders begin so; they lie in the folder itself, so that a rename is enough.
DRAFT = ".kneejax-draft-"
_CHECKSUM = "checksum"
_SEAL = b"kneejax sha256 "
#: Folder -> the draft of its new files, and who may object to a file that is read or written.
_drafts: dict[Path, tuple[Path, Callable[[Path, bool], None]]] = {}


def write_whole(path: str | os.PathLike[str], data: bytes, *, at_once: bool = False) -> None:
    """Write a file so that a reader sees the old one or the new one, never a part.

    Args:
        path: the file; missing folders are made. Below a folder that is being gathered it goes to
            the folder's draft.
        data: its content.
        at_once: whether it goes to its place nevertheless.

    Raises:
        OSError: the file cannot be written; `filename` is the path.
    """
    _write(path, Path(path) if at_once else _place(path, writing=True), data)


def written_place(path: str | os.PathLike[str]) -> Path:
    """Where a file that this run has written is: in a draft, or where it belongs.

    Args:
        path: where it belongs.
    """
    place = _place(path, writing=False)
    return place if place.exists() else Path(path)


def writing_place(folder: str | os.PathLike[str]) -> Path:
    """Where another program shall write what belongs into a folder.

    Args:
        folder: where it belongs.
    """
    return _place(folder, writing=True)


@contextlib.contextmanager
def gathering(folder: Path, draft: Path, object_to: Callable[[Path, bool], None]) -> Iterator[None]:
    """Let files of a folder that are written meanwhile go to a draft.

    Args:
        folder: where they belong.
        draft: a folder whose name begins with `DRAFT`, in `folder`.
        object_to: called with a file's name in the folder, and whether it is to be written or
            read; raises where that must not be.
    """
    home = Path(os.path.realpath(folder))
    _drafts[home] = draft, object_to
    try:
        yield
    finally:
        del _drafts[home]


def write_sealed(path: str | os.PathLike[str], data: bytes, key: str = "") -> None:
    """Keep bytes on disk for later; at once, whatever is being gathered.

    Args:
        path: the file.
        data: what is kept.
        key: of the work that it belongs to.

    Raises:
        OSError: as `write_whole`.
    """
    write_whole(path, _seal(data, key) + data, at_once=True)


def read_sealed(path: str | os.PathLike[str], key: str = "") -> bytes | None:
    """What was kept, or None where there is nothing, anything else, or something damaged.

    Args:
        path: the file.
        key: of the work that it must belong to.
    """
    try:
        whole = Path(path).read_bytes()
    except OSError:
        return None
    length = len(_seal(b"", key))
    data = whole[length:]
    return data if whole[:length] == _seal(data, key) else None


def with_checksum(document: Mapping[str, Any]) -> dict[str, Any]:
    """What JSON can hold, with a field `checksum` that tells whether it was damaged.

    Args:
        document: whatever JSON can hold.
    """
    return {**document, _CHECKSUM: _of_document(document)}


def undamaged(document: Any) -> dict[str, Any] | None:
    """What `with_checksum` was given; None where it is anything else, or was damaged.

    Args:
        document: as it was read.
    """
    if not isinstance(document, dict):
        return None
    rest = {name: one for name, one in document.items() if name != _CHECKSUM}
    return rest if document.get(_CHECKSUM) == _of_document(rest) else None


def write_checked(path: str | os.PathLike[str], document: Mapping[str, Any]) -> None:
    """Keep a JSON document on disk, at once, with its checksum.

    Args:
        path: the file.
        document: what it holds.

    Raises:
        OSError: as `write_whole`.
    """
    text = json.dumps(with_checksum(document), indent=1) + "\n"
    write_whole(path, text.encode(), at_once=True)


def read_json(path: str | os.PathLike[str]) -> Any:
    """A JSON document, or None where there is none that can be read.

    Args:
        path: the file.
    """
    try:
        return json.loads(Path(path).read_bytes())
    except (OSError, ValueError, RecursionError):
        return None


def checksum(data: bytes) -> str:
    """SHA-256 of bytes, as hexadecimal digits."""
    return hashlib.sha256(data).hexdigest()


def sync_folder(folder: Path) -> None:
    """Let the disk know what a folder holds, where a system can be asked to."""
    if os.name == "nt":
        return
    with contextlib.suppress(OSError):  # some file systems of networks refuse
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def _write(named: str | os.PathLike[str], path: Path, data: bytes) -> None:
    draft = path.with_name(f".{path.name[:64]}.{uuid.uuid4().hex[:8]}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with draft.open("xb") as stream:
                stream.write(data)
                stream.flush()
                os.fsync(stream.fileno())
            os.replace(draft, path)
        finally:
            draft.unlink(missing_ok=True)
        sync_folder(path.parent)
    except OSError as error:
        # The draft's name means nothing to a person.
        raise OSError(error.errno, error.strerror or str(error), os.fspath(named)) from None


def _place(path: str | os.PathLike[str], *, writing: bool) -> Path:
    if not _drafts:
        return Path(path)
    whole = Path(os.path.realpath(Path(path).parent)) / Path(path).name
    home = next((one for one in whole.parents if one in _drafts), None)
    if home is None:
        return Path(path)
    draft, object_to = _drafts[home]
    name = whole.relative_to(home)
    if name.parts[0].startswith(DRAFT):
        return whole
    if writing or not (draft / name).exists():
        object_to(name, writing)
    return draft / name


def _seal(data: bytes, key: str) -> bytes:
    return _SEAL + checksum(key.encode() + b"\n" + data).encode() + b"\n"


def _of_document(document: Mapping[str, Any]) -> str:
    return checksum(json.dumps(document, sort_keys=True).encode())
