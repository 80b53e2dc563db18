"""A thread that always computes what was wanted last, and what may be computed meanwhile."""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any


class Superseded(Exception):
    """Something else is wanted by now."""


class Latest:
    """Whatever is wanted next ends what is computed, at its next chance.

    Attributes:
        lock: held while what is wanted changes.
        settled: set while nothing is left to compute.
    """

    def __init__(self, compute: Callable[[], None], failed: Callable[[], None]):
        """Compute in a thread when something is wanted; `failed` is called after any exception but
        `Superseded`, which the terminal shows."""
        self.lock, self.settled = threading.Condition(), threading.Event()
        self._compute, self._failed = compute, failed
        self._wanted = self._begun = 0
        self._ended = False
        self.aside = ThreadPoolExecutor(1)
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def want(self) -> None:
        """Have it computed again; whoever calls holds the lock."""
        self._wanted += 1
        self.settled.clear()
        self.lock.notify()

    def end(self) -> None:
        """End the threads."""
        with self.lock:
            self._ended = True
            self.lock.notify()
        self._thread.join()
        self.aside.shutdown()

    def go_on(self, *_: int) -> None:
        """Raise `Superseded` where that is so."""
        if self._superseded():
            raise Superseded

    def rest(self, seconds: float) -> None:
        """Wait; what is wanted earlier ends it."""
        with self.lock:
            self.lock.wait_for(self._superseded, seconds)
        self.go_on()

    def meanwhile(self, work: Callable[..., Any], *given: Any) -> Any:
        """Have something computed that calls `progress` now and then; what is wanted meanwhile does
        not wait for the rest of it."""
        begun = self._begun

        def go_on(*_: int) -> None:
            # The thread may have begun anew by then.
            if self._ended or begun != self._wanted:
                raise Superseded

        def done(_: Any) -> None:
            with self.lock:
                self.lock.notify()

        future = self.aside.submit(work, *given, progress=go_on)
        future.add_done_callback(done)
        with self.lock:
            self.lock.wait_for(lambda: future.done() or self._superseded())
        future.cancel()
        self.go_on()
        return future.result()

    def _superseded(self) -> bool:
        return self._ended or self._begun != self._wanted

    def _run(self) -> None:
        while True:
            with self.lock:
                self.lock.wait_for(self._superseded)
                if self._ended:
                    return
                self._begun = self._wanted
            try:
                self._compute()
            except Superseded:
                continue
            except Exception:  # the page lives on, the terminal says why
                traceback.print_exc()
                self._failed()
            with self.lock:
                if not self._superseded():
                    self.settled.set()
