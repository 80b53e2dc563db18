"""Ctrl-C before a command has begun: one line, not a traceback out of what is being imported."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from collections.abc import Iterator

#: Exit status of what Ctrl-C stopped, as shells have it.
STOPPED = 130


@contextlib.contextmanager
def stopped_at_once() -> Iterator[None]:
    """Let Ctrl-C end the process at once, with one line: there is nothing to tidy up yet.

    An exception would be raised wherever the import is, also where Python can only print and
    forget it.
    """
    # Whoever has a handler of its own, or ignores Ctrl-C (nohup), keeps that.
    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    try:
        signal.signal(signal.SIGINT, _end)
    except ValueError:  # not in the main thread, which alone hears of Ctrl-C
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _end(*_) -> None:
    with contextlib.suppress(OSError, ValueError):
        if sys.stderr is not None:
            os.write(sys.stderr.fileno(), b"kneejax: stopped; no half-written files are left\n")
    os._exit(STOPPED)
