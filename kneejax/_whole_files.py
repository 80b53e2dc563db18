"""Files that are complete or absent, and files whose damage is noticed.

Everything that the package writes goes through `write_whole`: to a draft beside the file, synced
to the disk, renamed. While a run's results are gathered (`gathering`), its files go to a draft of
the whole folder instead, so that an earlier run's results stay until all the new ones are there.
"""

import contextlib
import hashlib
import json
import os
import uuid
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

#: Drafts of folders begin so; they lie in the folder itself, so that a rename is enough.
DRAFT = ".kneejax-draft-"
_CHECKSUM = "checksum"
#: Files that are synced side by side.
_AT_ONCE = 16
_SEAL = b"kneejax sha256 "
#: Folder -> the draft of its new files, and who may object to a file that is read or written.
_drafts: dict[Path, tuple[Path, Callable[[Path, bool], None]]] = {}


def write_whole(path: str | os.PathLike[str], data: bytes, *, at_once: bool = False) -> Path:
    """Write a file so that a reader sees the old one or the new one, never a part; the path.

    Below a folder that is being gathered it goes to the folder's draft, unless it is to go to its
    place `at_once`. Missing folders are made; an OSError's `filename` is the path.
    """
    place = Path(path) if at_once else _place(path, writing=True)
    in_draft = not at_once and any(part.startswith(DRAFT) for part in place.parts)
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        if in_draft:
            place.write_bytes(data)  # synced when the draft is complete
        else:
            _replace(place, data)
    except OSError as error:
        raise _named(error, path) from None
    return Path(path)


def written_place(path: str | os.PathLike[str]) -> Path:
    """Where a file that this run has written is: in a draft, or where it belongs."""
    place = _place(path, writing=False)
    return place if os.path.exists(place) else Path(path)  # of a name that is too long, too


def writing_place(folder: str | os.PathLike[str]) -> Path:
    """Where another program shall write what belongs into a folder."""
    return _place(folder, writing=True)


@contextlib.contextmanager
def gathering(folder: Path, draft: Path, object_to: Callable[[Path, bool], None]) -> Iterator[None]:
    """Let files of a folder that are written meanwhile go to a draft in it (`DRAFT`).

    `object_to` is called with a file's name in the folder, and whether it is to be written or read;
    it raises where that must not be.
    """
    home = Path(os.path.realpath(folder))
    _drafts[home] = draft, object_to
    try:
        yield
    finally:
        del _drafts[home]


def write_sealed(path: str | os.PathLike[str], data: bytes, key: str = "") -> None:
    """Keep bytes on disk for later, of the work with this key, at once, whatever is gathered."""
    write_whole(path, _seal(data, key) + data, at_once=True)


def read_sealed(path: str | os.PathLike[str], key: str = "") -> bytes | None:
    """What was kept of the work with this key, or None where there is nothing, anything else, or
    something damaged."""
    try:
        whole = Path(path).read_bytes()
    except OSError:
        return None
    length = len(_seal(b"", key))
    data = whole[length:]
    return data if whole[:length] == _seal(data, key) else None


def with_checksum(document: Mapping[str, Any]) -> dict[str, Any]:
    """What JSON can hold, with a field `checksum` that tells whether it was damaged."""
    return {**document, _CHECKSUM: _of_document(document)}


def undamaged(document: Any) -> dict[str, Any] | None:
    """What `with_checksum` was given; None where it is anything else, or was damaged."""
    if not isinstance(document, dict):
        return None
    rest = {name: one for name, one in document.items() if name != _CHECKSUM}
    return rest if document.get(_CHECKSUM) == _of_document(rest) else None


def write_checked(path: str | os.PathLike[str], document: Mapping[str, Any]) -> None:
    """Keep a JSON document on disk, at once, with its checksum."""
    write_whole(path, json_bytes(with_checksum(document)), at_once=True)


def json_bytes(document: Mapping[str, Any]) -> bytes:
    """A JSON document as a file holds it."""
    return (json.dumps(document, indent=1) + "\n").encode()


def read_json(path: str | os.PathLike[str]) -> Any:
    """A JSON document, or None where there is none that can be read."""
    try:
        return json.loads(Path(path).read_bytes())
    except (OSError, ValueError, RecursionError):
        return None


def checksum(data: bytes) -> str:
    """SHA-256 of bytes, as hexadecimal digits."""
    return hashlib.sha256(data).hexdigest()


def sync(paths: Sequence[Path], folders: Iterable[Path] = ()) -> None:
    """Wait until files are on the disk, all at once, hardly longer than for one, and folders know
    of theirs, where a system and its file system allow it; an OSError names the file."""
    if paths:
        with ThreadPoolExecutor(min(len(paths), _AT_ONCE)) as threads:
            for _ in threads.map(_sync, paths):
                pass
    for folder in folders if os.name != "nt" else ():
        with contextlib.suppress(OSError):
            _sync(folder, os.O_RDONLY)


def _sync(path: Path, flags: int = os.O_RDWR) -> None:
    try:
        handle = os.open(path, flags)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
    except OSError as error:
        raise _named(error, path) from None


def _named(error: OSError, path: str | os.PathLike[str]) -> OSError:
    """An error that names the file as a person knows it."""
    known = Path(*(part for part in Path(path).parts if not part.startswith(DRAFT)))
    return OSError(error.errno, error.strerror or str(error), os.fspath(known))


def _replace(path: Path, data: bytes) -> None:
    draft = path.with_name(f".{path.name[:64]}.{uuid.uuid4().hex[:8]}.tmp")
    try:
        with draft.open("xb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(draft, path)
    finally:
        draft.unlink(missing_ok=True)
    sync((), [path.parent])


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
