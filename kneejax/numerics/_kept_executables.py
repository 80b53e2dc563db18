"""What XLA has compiled, kept on disk by JAX: with a checksum, written whole, mended when damaged.

JAX takes what lies in its folder for whole, warns of an entry that it cannot read, and never
replaces it: a half-written file costs its compilation in every later run, and where entries are
packed without a checksum a flipped bit would be run.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

from kneejax._whole_files import write_whole

_SUM = "-sha256"


def check_executables() -> None:
    """Check entries of JAX's compilation cache from here on.

    Where a version of JAX keeps them in another way, it keeps them as it does.
    """
    try:
        from jax._src import compilation_cache as cache

        usual = cache.get_file_cache
        if getattr(usual, "checks", False):
            return

        def checked(path: str) -> Any:
            found = usual(path)
            return found and (_Checked(found[0], Path(path), cache.decompress_executable), path)

        checked.checks = True
        cache.get_file_cache = checked
    except (ImportError, AttributeError):
        pass


class _Checked:
    """A cache of JAX beside whose entries their checksums lie.

    An entry without one, from JAX without kneejax, gets it when it can be unpacked.
    """

    def __init__(self, cache: Any, folder: Path, unpack: Any):
        self._cache, self._folder, self._unpack = cache, folder, unpack

    def __getattr__(self, name: str) -> Any:
        return getattr(self._cache, name)

    def get(self, key: str) -> bytes | None:
        entry, file = self._cache.get(key), self._folder / f"{key}{_SUM}"
        if entry is None:
            return None
        try:
            if file.exists():
                sound = file.read_bytes() == _sum_of(entry)
            else:
                self._unpack(entry)
                sound = True
                write_whole(file, _sum_of(entry), at_once=True)
        except OSError:
            return entry
        except Exception:  # what cannot be unpacked, whatever it was packed with
            sound = False
        if not sound:
            self._forget(key)
        return entry if sound else None

    def put(self, key: str, entry: bytes) -> None:
        if self._cache.get(key) is not None:
            return
        if not getattr(self._cache, "eviction_enabled", True):
            # As JAX does, but whole.
            write_whole(self._folder / f"{key}-cache", entry, at_once=True)
        else:
            self._cache.put(key, entry)
        write_whole(self._folder / f"{key}{_SUM}", _sum_of(entry), at_once=True)

    def _forget(self, key: str) -> None:
        for end in ("-cache", _SUM):
            (self._folder / f"{key}{end}").unlink(missing_ok=True)


def _sum_of(entry: bytes) -> bytes:
    return hashlib.sha256(entry).hexdigest().encode()
