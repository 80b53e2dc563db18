"""Work dealt to all cores of the machine."""

from __future__ import annotations

import concurrent.futures
import functools
import os
from collections.abc import Callable, Iterable
from typing import TypeVar

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
