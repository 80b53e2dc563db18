"""What is to be computed: blocks of knees, each named by everything that its numbers depend on; and
who computes it: this process, or workers of Dask, on this machine or on a cluster.

Knees of one structure stand in one block and are calibrated side by side. Blocks belong to the
plan: who computes them, in which order and on how many cores, changes no number. A task leaves its
results on disk; however often it is begun, the files are the same. Workers are spawned, compute one
task at a time on a core of their own, and share compiled programs on disk.
"""

__all__ = ["Task", "bootstraps", "check_bootstraps", "computed", "plan", "reason", "workers"]

import contextlib
import dataclasses
import hashlib
import json
import logging
import os
import pickle
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import jax
import numpy as np

from kneejax.cohorts._reading import Cohort, Member
from kneejax.files import InputProblem, InputProblems
from kneejax.files.reading import Mistakes
from kneejax.inference import versions
from kneejax.inference.bootstrap import check_curves, check_redrawn, curves_of
from kneejax.numerics import check_installed
from kneejax.parameters import MEANING, UnsuitableData
from kneejax.studies import Study, plain_test

#: Knees of a block: more share what an evaluation costs by itself, fewer are lost with a worker.
BLOCK = 8
#: Draws of a bootstrap that are one task.
DRAWS = 100
#: Fields of a study of which knees that stand side by side must agree, beside their data's form.
_ALIKE = ("parameters", "procedures", "stages", "starts", "seed", "weights", "noise_mm",
          "noise_deg", "frame_offset", "method", "loads", "prior")  # fmt: skip
#: Fields that its numbers do not depend on, or that arrays say better.
_ELSEWHERE = ("title", "path", "knee", "measured", "tests", "synthetic")
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
    "distributed.nanny.pre-spawn-environ": dict.fromkeys(
        ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"),
    "distributed.worker.profile.enabled": False,
    # A worker that computes does not answer for as long as a program compiles.
    "distributed.comm.timeouts.connect": "60s",
    "distributed.scheduler.worker-ttl": None,
}


@dataclasses.dataclass(frozen=True, eq=False)
class Task:
    """Knees that are calibrated side by side, or draws of the bootstrap of one.

    Attributes:
        members: of one structure.
        fingerprint: of everything that their numbers depend on, the package's version among it.
        draws: the numbers of the first draw and of the one after the last; None of a calibration.
        by_blocks: whether these draw among the curves that were measured.
        structure: of the knees, which is compiled once.
    """

    members: tuple[Member, ...]
    fingerprint: str
    draws: tuple[int, int] | None = None
    by_blocks: bool = False
    structure: bytes = b""

    @property
    def names(self) -> tuple[str, ...]:
        """Of its knees."""
        return tuple(one.name for one in self.members)

    def __len__(self) -> int:
        """Knees or draws."""
        return self.draws[1] - self.draws[0] if self.draws else len(self.members)


#: Computes a task and writes its results; it must be importable by its name.
Work = Callable[[Task], None]
#: A task that has ended, and why it left no results; empty where it did.
Ended = tuple[Task, str]


def plan(cohort: Cohort, block: int = BLOCK) -> tuple[Task, ...]:
    """Divide a cohort into blocks.

    Args:
        cohort: that was read.
        block: knees of a block at most.

    Returns:
        The tasks, in the order in which their first knees stand.
    """
    alike: dict[bytes, list[Member]] = {}
    for member in cohort.members:
        alike.setdefault(_structure(member.study), []).append(member)
    blocks = [(structure, tuple(members[first : first + block]))
              for structure, members in alike.items()
              for first in range(0, len(members), block)]  # fmt: skip
    return tuple(Task(members, _fingerprint(members), structure=structure)
                 for structure, members in blocks)  # fmt: skip


def bootstraps(tasks: Sequence[Task], count: int, by_blocks: bool = False) -> tuple[Task, ...]:
    """Tasks that draw the data of others again and fit them, so many times for each knee.

    Args:
        tasks: calibrations, which must have ended.
        count: of draws of each knee.
        by_blocks: whether curves are drawn among those that were measured; otherwise the answers
            make the data, with their noise.
    """
    kind = "by blocks" if by_blocks else "bootstrap"
    lots = [(first, min(first + DRAWS, count)) for first in range(0, count, DRAWS)]
    return tuple(
        Task((member,), _digest(f"{task.fingerprint} {member.name} {kind} {draws}".encode()).hex(),
             draws, by_blocks)
        for task in tasks for member in task.members for draws in lots)  # fmt: skip


def check_bootstraps(cohort: Cohort, by_blocks: bool) -> None:
    """Refuse a bootstrap that some knee's data do not allow.

    Args:
        cohort: that was read.
        by_blocks: whether curves are to be drawn.

    Raises:
        InputProblems: every such knee, with its file and row.
    """
    mistakes = Mistakes()
    for member in cohort.members:
        tests, count = member.study.tests, len(member.study.flexion_deg)
        with mistakes.gathered(member.place):
            check_redrawn(tests)
            if by_blocks:
                check_curves(curves_of(count, tests))
    if mistakes:
        raise InputProblems(mistakes)


def computed(tasks: Sequence[Task], work: Work, client: Any = None) -> Iterator[Ended]:
    """Compute tasks: one after the other, or on workers in any order; each is yielded when it has
    ended.

    A task that raises (a full disk, too little memory), or whose worker dies, is retried once.

    Args:
        tasks: to be computed.
        work: of one task; results must lie where all workers see them.
        client: of `workers`; without one, this process computes.

    Raises:
        InputProblem: a worker runs another version of the package.
        SchedulerGone: there is no scheduler any more.
    """
    return _in_process(tasks, work) if client is None else _on_workers(client, tasks, work)


def _in_process(tasks: Sequence[Task], work: Work) -> Iterator[Ended]:
    failed: list[Task] = []
    for last, some in ((False, tasks), (True, failed)):
        for task in some:
            why = ""
            try:
                work(task)
            except Exception as problem:
                why = reason(problem)
            if why and not last:
                failed.append(task)
            else:
                yield task, why


def reason(problem: BaseException, named: bool = True) -> str:
    """Why a task has left no results, in one line.

    Args:
        problem: that ended it.
        named: whether the kind of error stands first; never that of unsuitable data.
    """
    words = " ".join(str(problem).split()) or "no further word"
    kind = "" if isinstance(problem, UnsuitableData) or not named else type(problem).__name__
    return f"{kind}: {words}" if kind else words


def _structure(study: Study) -> bytes:
    """What knees have in common that stand in one block."""
    leaves, tree = jax.tree.flatten(dataclasses.replace(study.knee, name="", side="right"))
    plain = study.settings()
    words = [str(tree), [np.shape(leaf) for leaf in leaves], {x: plain[x] for x in _ALIKE},
             study.limits]  # fmt: skip
    for test in study.tests:
        alike = {"observed": np.isfinite(test.observed).tolist(), "readings": bool(test.readings)}
        words.append(plain_test(test) | alike)
    pose = jax.tree.leaves(study.knee.reference_pose)
    flexion = np.asarray(study.flexion_deg, float)
    return _digest(json.dumps(words).encode(), flexion, *pose)


def _fingerprint(members: Sequence[Member]) -> str:
    parts: list[Any] = [versions()["kneejax"].encode()]
    for member in members:
        study, settings = member.study, member.study.settings()
        leaves, tree = jax.tree.flatten((study.knee, study.knee_at_start))
        words = [member.name, study.title, str(tree),
                 {k: x for k, x in settings.items() if k not in _ELSEWHERE}, study.truth,
                 [plain_test(test) for test in study.tests], settings["synthetic"]]  # fmt: skip
        # Of structures drawn as several fibres, answers say what their stiffness means.
        words += [MEANING] if study.knee.groups else []
        poses = b"" if study.measured is None else study.measured
        parts += [json.dumps(words).encode(), poses, *leaves]
    return _digest(*parts).hex()


def _digest(*parts: Any) -> bytes:
    """Of bytes and arrays."""
    found = hashlib.sha256()
    for part in parts:
        data = part if isinstance(part, bytes) else np.ascontiguousarray(part).tobytes()
        found.update(len(data).to_bytes(8, "little"))
        found.update(data)
    return found.digest()


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

    with config.set(_SETTINGS):
        if address is None:
            with _local_cluster(jobs) as cluster, Client(cluster) as client:
                yield client
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
            with client:
                yield client
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


def _on_workers(client: Any, tasks: Sequence[Task], work: Work) -> Iterator[Ended]:
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
