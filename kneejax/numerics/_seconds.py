"""Where the time of a calculation goes: parts that add up to the whole, and the programs made."""

__all__ = ["Programs", "adding_up", "counted_programs", "lap", "stopwatch"]

import contextlib
import dataclasses
import functools
import threading
import time
from collections.abc import Iterator, Mapping

import jax

#: Events of JAX that are tracing, lowering or compiling; each tells its duration as it ends.
_COMPILING = "/jax/core/compile/"
_COMPILED, _READ = "/jax/core/compile/backend_compile_duration", "/jax/compilation_cache/cache_hits"
COMPILE, OTHER, TOTAL = "compile", "other", "total"
#: Seconds from which on a program is called large.
_LARGE_S = 1.0
_running: "dict[int, list[Seconds]]" = {}
_counting: "list[Programs]" = []
#: Threads in which JAX has found a program in its cache and not told yet which.
_reading: set[int] = set()


class Seconds:
    """A stopwatch of one thread: what has passed under each name, and what JAX compiled meanwhile.

    Attributes:
        parts: name -> seconds, compiling aside, which is `compile`.
    """

    def __init__(self):
        """Begin now."""
        self.parts: dict[str, float] = {COMPILE: 0.0}
        self._since = time.perf_counter()
        self._spans: list[tuple[float, float]] = []

    def lap(self, name: str) -> None:
        """Count what has passed since the last lap under a name."""
        now = time.perf_counter()
        compiled = sum(end - begin for begin, end in self._spans)
        passed = now - self._since - compiled
        self.parts[name] = self.parts.get(name, 0.0) + passed
        self.parts[COMPILE] += compiled
        self._since, self._spans = now, []

    def compiled(self, duration: float) -> None:
        """Count what JAX has done until now; what lay within it counts once."""
        end = time.perf_counter()
        begin = max(end - duration, self._since)
        while self._spans and self._spans[-1][0] >= begin:
            self._spans.pop()
        if self._spans:
            begin = max(begin, self._spans[-1][1])
        self._spans.append((begin, end))


@contextlib.contextmanager
def stopwatch() -> Iterator[Seconds]:
    """Measure where the time goes until the block ends; what has no name by then is `other`.

    Example:
        >>> with stopwatch() as seconds:
        ...     lap("reading")
        >>> type(seconds).__name__
        'Seconds'
    """
    _listen()
    one, every = Seconds(), _running.setdefault(threading.get_ident(), [])
    every.append(one)
    try:
        yield one
    finally:
        one.lap(OTHER)
        every.remove(one)


def lap(name: str) -> None:
    """Count what has passed since the last lap under a name, in every stopwatch of this thread."""
    for one in _running.get(threading.get_ident(), ()):
        one.lap(name)


def adding_up(parts: Mapping[str, float]) -> dict[str, float]:
    """Parts of the time, and their sum as `total`.

    Args:
        parts: name -> seconds; a `total` among them is left out.

    Example:
        >>> adding_up({"compile": 4.0, "search": 1.5})
        {'total': 5.5, 'compile': 4.0, 'search': 1.5}
    """
    own = {name: value for name, value in parts.items() if name != TOTAL}
    return {TOTAL: sum(own.values()), **own}


@dataclasses.dataclass
class Programs:
    """Programs that JAX has made, in all threads.

    Attributes:
        compiled: name and seconds of each that XLA compiled, in order.
        read: how many were in the compilation cache.
    """

    compiled: list[tuple[str, float]] = dataclasses.field(default_factory=list)
    read: int = 0

    def summary(self) -> dict[str, float]:
        """How many were compiled, in how many seconds (those of threads side by side added), how
        many of them took a second and more, and how many were read."""
        seconds = [each for _, each in self.compiled]
        large = sum(each >= _LARGE_S for each in seconds)
        parts = {"compiled": len(seconds), "seconds": round(sum(seconds), 3)}
        return parts | {"large": large, "read": self.read}

    def sentence(self) -> str:
        """The same in words, with the names of those that took a second and more.

        Example:
            >>> Programs([("search", 12.3), ("add", 0.1), ("slopes", 2.0)], 4).sentence()
            '3 programs compiled in 14.4 s (search 12.3 s, slopes 2.0 s), 4 read from the cache'
        """
        large = sorted((x for x in self.compiled if x[1] >= _LARGE_S), key=lambda x: -x[1])
        named = ", ".join(f"{name} {seconds:.1f} s" for name, seconds in large)
        total = sum(seconds for _, seconds in self.compiled)
        count = len(self.compiled)
        words = f"{count} program{'s' * (count != 1)} compiled in {total:.1f} s"
        return f"{words}{f' ({named})' * bool(named)}, {self.read} read from the cache"


@contextlib.contextmanager
def counted_programs() -> Iterator[Programs]:
    """Count the programs that JAX compiles or reads until the block ends."""
    _listen()
    programs = Programs()
    _counting.append(programs)
    try:
        yield programs
    finally:
        _counting[:] = [one for one in _counting if one is not programs]


@functools.cache
def _listen() -> None:
    def read(event: str, **_: object) -> None:
        if event == _READ:
            _reading.add(threading.get_ident())

    def heard(event: str, duration: float, fun_name: str = "", **_: object) -> None:
        here = threading.get_ident()
        if event.startswith(_COMPILING):
            for one in _running.get(here, ()):
                one.compiled(duration)
        if event == _COMPILED:
            from_cache = here in _reading
            _reading.discard(here)
            for programs in _counting:
                if from_cache:
                    programs.read += 1
                else:
                    name = fun_name.removeprefix("jit(").removesuffix(")").strip("_")
                    programs.compiled.append((name, duration))

    jax.monitoring.register_event_listener(read)
    jax.monitoring.register_event_duration_secs_listener(heard)
