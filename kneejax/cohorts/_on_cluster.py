"""Tasks on workers of Dask: those of this machine, or of a cluster.

Workers are spawned, compute one task at a time on a core of their own, and share compiled programs
on disk. Which worker computes a task changes no number: a task is the same call everywhere.
"""

import contextlib
import logging
import os
import pickle
import time
from collections.abc import Iterator, Sequence
from typing import Any

from kneejax.cohorts._plan import Ended, Task, Work, reason
from kneejax.files import InputProblem
from kneejax.inference import versions
from kneejax.numerics import check_installed

#: Memory of a worker on this machine; one that needs more is started again.
_MEMORY = "3GiB"
#: All sockets are of this machine alone: what workers send is for nobody else.
_HERE = "127.0.0.1"
_PATIENCE_S = 20.0
#: How often workers are started and made ready, who may die meanwhile; the pause in between, s.
_TRIALS, _PAUSE_S = 5, 1.0
_SETTINGS = {
    # A death is answered for below, by the task that the worker was at and by no other.
    "distributed.scheduler.allowed-failures": 0,
    "distributed.scheduler.worker-saturation": 1.0,
    "distributed.worker.multiprocessing-method": "spawn",
    # Answers are files: nothing that a worker holds is worth moving or spilling.
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    # One thread a library, which must know before it is imported. Beside that nothing: whoever
    # gives memory back after each task asks for it again in the next one.
    "distributed.nanny.pre-spawn-environ": {
        name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    },
    "distributed.worker.profile.enabled": False,
    # A worker that computes does not answer for as long as a program compiles.
    "distributed.comm.timeouts.connect": "60s",
    "distributed.scheduler.worker-ttl": None,
}


class SchedulerGone(ConnectionError):
    """The scheduler of a cluster has ended, or cannot be reached any more."""

    def __str__(self) -> str:
        return "a scheduler that stays: it has gone; with another one the same command goes on"


@contextlib.contextmanager
def workers(jobs: int, address: str | None = None) -> Iterator[Any]:
    """A Dask client of workers on this machine, or of a cluster that runs already.

    Args:
        jobs: how many workers on this machine.
        address: of the cluster's scheduler, in their place.

    Raises:
        MissingPackage: Dask is not installed.
        InputProblem: workers die as they start, again and again; no scheduler answers at the
            address, or it has gone meanwhile.
    """
    check_installed("distributed", "cohorts")
    from dask import config
    from distributed import Client

    with config.set(_SETTINGS), contextlib.ExitStack() as opened:
        if address is None:
            cluster = opened.enter_context(_local_cluster(jobs))
            yield opened.enter_context(Client(cluster))
            return
        try:
            client = Client(address, timeout=_PATIENCE_S)
        except (OSError, ValueError, TimeoutError) as problem:
            words = " ".join(str(problem).split())[:60] or type(problem).__name__
            expected = f"the address of a Dask scheduler that answers ({words})"
            raise InputProblem("--scheduler", "address", address, expected) from None
        # Whether a scheduler has gone is reported below, in one line.
        logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
        try:
            yield opened.enter_context(client)
        except SchedulerGone as problem:
            raise InputProblem("--scheduler", "address", address, str(problem)) from None


def _local_cluster(jobs: int) -> Any:
    from distributed import LocalCluster

    for _ in range(_TRIALS):
        with contextlib.suppress(OSError, RuntimeError, TimeoutError):
            return LocalCluster(n_workers=jobs, threads_per_worker=1, processes=True,
                                memory_limit=_MEMORY, host=_HERE, dashboard_address=f"{_HERE}:0",
                                worker_dashboard_address=f"{_HERE}:0", silence_logs=50)  # fmt: skip
        time.sleep(_PAUSE_S)
    raise InputProblem("--jobs", "workers", str(jobs), "workers that start; they died at once")


def on_workers(client: Any, tasks: Sequence[Task], work: Work) -> Iterator[Ended]:
    """Compute tasks on workers; each is yielded when it has ended, in any order.

    A task that fails, or whose worker dies, is retried once.

    Args:
        client: of `workers`.
        tasks: to be computed.
        work: of one task; results must lie where all workers see them.

    Raises:
        InputProblem: a worker runs another version of the package.
        SchedulerGone: there is no scheduler any more.
    """
    from distributed import as_completed

    def submit(task: Task) -> Any:
        # A scheduler opens what it passes on, in a process whose JAX knows 32 bits alone: bytes
        # stay what they are.
        packed = pickle.dumps((work, task))
        return client.submit(_of_version, _version(), packed, pure=False, retries=0)

    try:
        _prepare(client)
        waiting = {submit(task): (task, True) for task in tasks}
        following = as_completed(list(waiting))
        for future in following:
            if future.cancelled():
                # Whoever comes to the same address does not know how workers are made ready.
                raise SchedulerGone
            task, first = waiting.pop(future)
            problem = future.exception() if future.status != "finished" else None
            if problem is not None and first:
                waiting[again := submit(task)] = task, False
                following.add(again)
            else:
                yield task, "" if problem is None else reason(problem)
    except Exception:
        if client.status == "running":
            raise
        raise SchedulerGone from None


def _of_version(expected: str, packed: bytes) -> None:
    """Compute a task for this version of the package; a worker that comes late may have another."""
    if (found := _version()) != expected:
        raise RuntimeError(f"a worker has kneejax {found}: expected {expected}, as the command")
    work, task = pickle.loads(packed)
    work(task)


def _version() -> str:
    return versions()["kneejax"]


def _prepare(client: Any) -> None:
    """Workers ready to compute, each one's core its own, of this version of the package."""
    from distributed import WorkerPlugin

    class Ready(WorkerPlugin):
        """Prepares JAX before the first task is unpacked; also of workers that come later."""

        name = "kneejax"

        def setup(self, worker: Any) -> None:
            from kneejax.numerics import collect_seldom, configure, share_memory_between_threads

            share_memory_between_threads()
            collect_seldom()
            if hasattr(os, "sched_setaffinity") and len(cores := os.sched_getaffinity(0)) > 1:
                # One core, so that JAX makes one thread; by a number that no other worker has.
                place = worker.name if isinstance(worker.name, int) else os.getpid()
                os.sched_setaffinity(0, {sorted(cores)[place % len(cores)]})
            configure()

    found: dict[str, str] = {}
    for left in reversed(range(_TRIALS)):
        try:
            client.register_plugin(Ready())
            found = client.run(_version)
            break
        except OSError:  # a worker has died meanwhile: another comes for it
            if not left or client.status != "running":
                raise
            time.sleep(_PAUSE_S)
    for worker, version in found.items():
        if version != _version():
            expected = f"workers with kneejax {_version()}, as here; {worker} has another"
            raise InputProblem("--scheduler", "version", version, expected)
