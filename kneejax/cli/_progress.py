"""Progress of long work: a line on a terminal, nothing in a pipe."""

from __future__ import annotations

import contextlib
import functools
import threading
from collections.abc import Callable, Iterator

from tqdm import tqdm

from kneejax.statics import Progress


@contextlib.contextmanager
def stages_on_terminal() -> Iterator[Callable[[str, int, int], None]]:
    """Show what is computed and how many balances are done, as long as the block lasts.

    Yields:
        What is to be called with a stage's name, balances done and asked for; from any thread.
    """
    lock, shown = threading.Lock(), ""
    # disable=None: nothing where standard error is no terminal.
    with tqdm(unit=" balances", unit_scale=True, disable=None, leave=False) as bar:

        def show(what: str, done: int, total: int) -> None:
            nonlocal shown
            with lock:
                if what != shown:
                    shown = what
                    bar.reset(total)
                    bar.set_description(what)
                bar.total = total
                bar.update(max(done - bar.n, 0))

        yield show


@contextlib.contextmanager
def balances_on_terminal(what: str) -> Iterator[Progress]:
    """As `stages_on_terminal`, of one stage.

    Args:
        what: is computed, for the line.

    Yields:
        What the batch engine calls with balances done and asked for; from any thread.
    """
    with stages_on_terminal() as show:
        yield functools.partial(show, what)
