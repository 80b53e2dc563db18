"""Who computes the tasks: this process, workers on this machine, or a cluster.

A task is a function call without an answer that matters: it writes its results and says so on
disk. Whoever computes it, and however often it is begun, the files are the same.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence

from kneejax.cohorts._plan import Task


@dataclasses.dataclass(frozen=True)
class KneeDone:
    """What became of a knee of a task.

    Attributes:
        name: of the knee.
        failed: why there is no answer, in a sentence; empty where there is one.
        seconds: that it took, its share of the task's.
    """

    name: str
    failed: str = ""
    seconds: float = 0.0


#: Computes a task and writes its results; it must be importable by its name.
Work = Callable[[Task], Sequence[KneeDone]]


def in_process(tasks: Sequence[Task], work: Work) -> Iterator[tuple[Task, Sequence[KneeDone]]]:
    """Compute tasks one after the other; each is yielded when it has ended.

    What ends a task without an answer (a full disk, too little memory) is met once more at the
    end; what ends it again is said of its knees.

    Args:
        tasks: in order.
        work: of one task.
    """
    again = []
    for task in tasks:
        try:
            yield task, work(task)
        except Exception:
            again.append(task)
    for task in again:
        try:
            yield task, work(task)
        except Exception as problem:
            yield task, lost(task, problem)


def lost(task: Task, problem: BaseException) -> list[KneeDone]:
    """What is said of the knees of a task that has ended without an answer twice."""
    words = " ".join(str(problem).split()) or "no further word"
    return [KneeDone(name, f"{type(problem).__name__}: {words}") for name in task.names]
