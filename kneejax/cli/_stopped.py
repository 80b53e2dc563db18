"""Ctrl-C before a command has begun: one line, not a traceback out of what is being imported."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Iterator

#: Exit status of what Ctrl-C stopped, as shells have it.
STOPPED = 130


@contextlib.contextmanager
def stopped_at_once() -> Iterator[None]:
    """Let Ctrl-C end the process at once, with one line: there is nothing to tidy up yet.

    An exception would be raised wherever the import is, also where Python can only print and
    forget it.
    """
    ours = threading.current_thread() is threading.main_thread()
    # Whoever has a handler of its own, or ignores Ctrl-C (nohup), keeps that.
    if not ours or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    signal.signal(signal.SIGINT, _end)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _end(*_) -> None:
    with contextlib.suppress(OSError, ValueError):
        if sys.stderr is not None:
            os.write(sys.stderr.fileno(), b"kneejax: stopped; no half-written files are left\n")
    os._exit(STOPPED)
