"""Where the time of a calculation goes, by parts that add up to the whole."""

from __future__ import annotations

import contextlib
import functools
import threading
import time
from collections.abc import Iterator, Mapping

import jax

#: Events of JAX that are tracing, lowering or compiling; each tells its duration as it ends.
_COMPILING = "/jax/core/compile/"
COMPILE, OTHER, TOTAL = "compile", "other", "total"
_running: dict[int, list[Seconds]] = {}


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
    """Measure where the time goes until the block ends; what has no name by then is `other`."""
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


@functools.cache
def _listen() -> None:
    def heard(event: str, duration: float, **_: object) -> None:
        if event.startswith(_COMPILING):
            for one in _running.get(threading.get_ident(), ()):
                one.compiled(duration)

    jax.monitoring.register_event_duration_secs_listener(heard)
