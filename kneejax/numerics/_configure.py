"""What a program asks of JAX before anything is computed: cores, compiler, kept executables.

JAX takes what lies in its folder for whole, warns of an entry that it cannot read, and never
replaces it: a half-written file costs its compilation in every later run, and where entries are
packed without a checksum a flipped bit would be run.
"""

from __future__ import annotations

import concurrent.futures
import functools
import hashlib
import os
import warnings
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, TypeVar

import jax

from kneejax._whole_files import write_whole
from kneejax.numerics._compiled import use_shared_fusion
from kneejax.numerics._kept_programs import keep_programs

Part = TypeVar("Part")
Answer = TypeVar("Answer")


def on_all_cores(work: Callable[[Part], Answer], parts: Iterable[Part]) -> list[Answer]:
    """Do some work for each of several parts, on as many threads as this process has cores.

    Programs of JAX leave Python's lock while they compute. The threads stay for the next call:
    starting them took longer than evaluating 500 poses. Work must not deal out work itself.

    Args:
        work: of one part.
        parts: in any number.

    Returns:
        The answers in the order of the parts.

    Raises:
        Exception: what the first part that failed has raised, at once; likewise Ctrl-C. Parts that
            were not begun are dropped.

    Example:
        >>> on_all_cores(abs, [-1, 2, -3])
        [1, 2, 3]
    """
    parts = list(parts)
    if len(parts) < 2:
        return [work(part) for part in parts]
    futures = [_threads().submit(work, part) for part in parts]
    try:
        return [future.result() for future in futures]
    except BaseException:
        for future in futures:
            future.cancel()
        raise


@functools.cache
def _threads() -> concurrent.futures.ThreadPoolExecutor:
    return concurrent.futures.ThreadPoolExecutor(_own_cores(), "kneejax")


def _own_cores() -> int:
    """Cores that this process may use: those of its affinity, where the system knows of any."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


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


_CACHE = "jax_compilation_cache_dir"


def configure() -> None:
    """Prepare JAX for kneejax, in all of this process: call it before anything is computed.

    It switches float64 on, lets XLA fuse operations without copying shared values
    (`use_shared_fusion`, five times faster), and keeps programs between runs, as they are traced
    and as they are compiled: in `JAX_COMPILATION_CACHE_DIR` if that is set, otherwise in `kneejax`
    of the user's cache folder (`XDG_CACHE_HOME`, or `~/.cache`). What is damaged there is made
    again; what XLA compiled is machine code, so nobody else may write into that folder. `kneejax`
    on the command line begins with it; importing the package changes nothing. To call it again
    does no harm.

    Warns:
        RuntimeWarning: JAX has begun to compute without it. float64 holds from here on; arrays
            that exist stay as they are, and solves are slower.

    Example:
        >>> import kneejax as kj
        >>> kj.configure()  # doctest: +SKIP
    """
    jax.config.update("jax_enable_x64", True)
    # By name: jax makes these attributes, of which type checkers know nothing.
    # Set to nothing, it is not set: programs would be kept wherever a command is called.
    if not getattr(jax.config, _CACHE):
        base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
        jax.config.update(_CACHE, str(Path(base) / "kneejax"))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    check_executables()
    keep_programs(Path(getattr(jax.config, _CACHE)) / "traced")
    if not use_shared_fusion():
        warnings.warn(
            "kneejax.configure() comes too late: JAX has begun to compute. float64 is on from "
            "here, but solves stay slower and programs may not be kept; call it first",
            RuntimeWarning,
            stacklevel=2,
        )
