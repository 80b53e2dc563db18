"""What a person waits for: a line on a terminal or in a notebook, nothing in a pipe."""

__all__ = ["stages_on_terminal"]

import contextlib
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Literal

from tqdm import tqdm

from kneejax.numerics import compiling

#: Called with what is computed, how much of it is done and asked for; 0 and 0 where that cannot be
#: counted.
Stages = Callable[[str, int, int], None]
#: Of a call from Python: what is to be called, None for a line of its own, False for nothing.
Asked = Stages | Literal[False] | None
#: After so long a person wonders, s.
_PATIENCE_S = 0.5
_EVERY_S = 0.5
_WITHOUT_COUNT = "{desc}, {elapsed}"


@contextlib.contextmanager
def stages_on_terminal(what: str = "") -> Iterator[Stages]:
    """Show what is computed and how many balances are done, as long as the block lasts.

    Until a stage is named, and in commands that name none, the line shows how long it has taken,
    and once there was something to compile, that it is kept.

    Args:
        what: is computed, where no stage says so.

    Yields:
        What is to be called with a stage's name, balances done and asked for, or with what is done
        and no numbers (0, 0) where they cannot be counted; from any thread.
    """
    lock, over, shown = threading.Lock(), threading.Event(), ""
    # disable=None: nothing where standard error is no terminal.
    disable = False if _in_notebook() else None
    options = {"unit": " balances", "unit_scale": True, "disable": disable, "leave": False}
    with tqdm(bar_format=_WITHOUT_COUNT, delay=_PATIENCE_S, **options) as bar:

        def show(stage: str, done: int, total: int) -> None:
            nonlocal shown, what
            with lock:
                if not total:  # nothing to count: the line says what is done
                    what = stage
                    return
                if stage != shown:
                    shown, bar.bar_format, bar.delay = stage, None, 0.0
                    bar.reset(total)
                    bar.set_description(stage)
                bar.total = total
                bar.update(max(done - bar.n, 0))

        def wait() -> None:
            pause, compiles = _PATIENCE_S, False
            while not over.wait(pause):
                pause, compiles = _EVERY_S, compiles or bool(compiling())
                with lock:
                    if not shown:
                        bar.delay = 0.0  # what was shown is wiped out in the end
                        now = "compiling (kept for later runs) and computing"
                        now = now if compiles else "computing"
                        bar.set_description_str(f"{what}: {now}" if what else now)

        if not bar.disable:
            threading.Thread(target=wait, daemon=True).start()
        try:
            yield show
        finally:
            over.set()


def _in_notebook() -> bool:
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return hasattr(shell, "kernel")


@contextlib.contextmanager
def progress_of(progress: Asked, what: str) -> Iterator[Stages | None]:
    """What a call from Python tells while it computes; None for a line where there is a terminal or
    a notebook, False for nothing."""
    if progress is None:
        with stages_on_terminal(what) as show:
            yield show
    else:
        yield progress or None
