"""Where a command prints, though nobody may read it, and what Ctrl-C does."""

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

#: Exit status of what Ctrl-C stopped, as shells have it.
STOPPED = 130


class Printed:
    """A stream that takes what is printed, also after the one below it has failed: a command whose
    output is cut short (`kneejax simulate ... | head`) still writes its files."""

    def __init__(self, stream: Any):
        self._stream = stream
        self.problem: OSError | None = None  # why the stream takes nothing any more

    def write(self, text: str) -> int:
        """As of any stream."""
        self._try(self._stream.write, text)
        return len(text)

    def flush(self) -> None:
        """Likewise."""
        self._try(self._stream.flush)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def _try(self, act: Callable[..., Any], *given: str) -> None:
        if self.problem is not None:
            return
        try:
            act(*given)
        except OSError as problem:
            self.problem = problem
            # Python flushes once more when it ends, and would complain.
            with contextlib.suppress(OSError, ValueError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), self._stream.fileno())


def open_standard_streams() -> bool:
    """Open closed standard streams, whose place a file would take; say whether there was stdout."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest number that is free
    there = sys.stdout is not None
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))
    return there


@contextlib.contextmanager
def stopped_at_once() -> Iterator[None]:
    """Let Ctrl-C end the process at once, with one line: there is nothing to tidy up yet. An
    exception would be raised within an import, where Python may only print and forget it."""
    def end(*_) -> None:
        with contextlib.suppress(OSError, ValueError):
            if sys.stderr is not None:
                os.write(sys.stderr.fileno(), b"kneejax: stopped; no half-written files are left\n")
        os._exit(STOPPED)

    # Whoever has a handler of its own, or ignores Ctrl-C (nohup), keeps that.
    usual = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    with interrupted(end) if usual else contextlib.nullcontext():
        yield


@contextlib.contextmanager
def uninterrupted() -> Iterator[None]:
    """Ctrl-C waits: what takes milliseconds is done whole."""
    pressed, usual = [], signal.getsignal(signal.SIGINT)
    with interrupted(lambda *given: pressed.append(given)):
        yield
    if pressed and callable(usual):
        usual(*pressed[0])


@contextlib.contextmanager
def interrupted(act: Callable[..., None]) -> Iterator[None]:
    """Meanwhile Ctrl-C does this; in another thread than the main one, nobody hears of it."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    usual = signal.signal(signal.SIGINT, act)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, usual)
