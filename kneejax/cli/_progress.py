"""Progress of long work: a line on a terminal, nothing in a pipe."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator

from tqdm import tqdm

from kneejax.statics import Progress


@contextlib.contextmanager
def balances_on_terminal(what: str) -> Iterator[Progress]:
    """Show how many balances are done, as long as the block lasts.

    Args:
        what: is computed, for the line.

    Yields:
        What the batch engine calls with balances done and asked for; from any thread.
    """
    lock = threading.Lock()
    # disable=None: nothing where standard error is no terminal.
    with tqdm(desc=what, unit=" balances", unit_scale=True, disable=None, leave=False) as bar:

        def show(done: int, total: int) -> None:
            with lock:
                bar.total = total
                bar.update(max(done - bar.n, 0))

        yield show
