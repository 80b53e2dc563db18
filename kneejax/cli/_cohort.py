"""`kneejax calibrate COHORT`: many knees, whoever computes them, and what they say together."""

from __future__ import annotations

import contextlib
import functools
import sys
from collections.abc import Callable, Iterator, Sequence

from tqdm import tqdm

from kneejax.cli._cohort_work import CohortWork, draws_of, finished
from kneejax.cli._deliver import deliver
from kneejax.cli._main import BAD_INPUT
from kneejax.cli._out import check_room
from kneejax.cli._results_folder import KNEES, MARK
from kneejax.cli.options import Calibrate
from kneejax.cohorts import (
    CohortProblems,
    CohortSummary,
    KneeDone,
    Task,
    Work,
    bootstraps,
    check_bootstraps,
    in_process,
    local_workers,
    next_prior,
    on_workers,
    plan,
    read_answers,
    read_cohort,
    shard_of,
    structures,
    summed_up,
    to_dataset,
    workers_of,
)
from kneejax.files import check_new, counted, write_netcdf, write_text
from kneejax.files.reading import format_yaml
from kneejax.numerics import MissingPackage, check_installed

_PRIOR = """# What a cohort says of a knee of which nothing is measured: {}.
# In a study: prior: prior.yaml
"""
#: Files of a knee take about this; those of one with 22 parameters 0.4 MB.
_KNEE_MB = 0.25
#: Computes tasks, each yielded with what became of its knees when it has ended.
Compute = Callable[[Sequence[Task], Work], Iterator[tuple[Task, Sequence[KneeDone]]]]


def run(arguments: Calibrate) -> int:
    """Calibrate every knee of a cohort, and write what they say together."""
    shard = arguments.shard or (1, 1)
    if arguments.scheduler or (arguments.jobs or 1) > 1:
        check_installed("distributed", "cohorts")
    try:
        cohort, by_blocks = read_cohort(arguments.study), arguments.blocks
        if arguments.bootstrap:
            check_bootstraps(cohort, by_blocks)
    except CohortProblems as every:
        for problem in every.problems:
            print(f"kneejax: {' '.join(problem.split())}", file=sys.stderr)
        count = counted(len(every.problems), "mistake")
        print(f"kneejax: {count}; nothing was computed", file=sys.stderr)
        return BAD_INPUT
    out, tasks = arguments.out.resolve(), plan(cohort)
    for member in cohort.members:
        for new in ("knee.yaml", "result.json"):
            check_new(out / KNEES / member.name / new, member.study.knee_name)
    arguments.results.check_free("cohort.csv", "cohort.nc", "prior.yaml", "report.html")
    own = shard_of(tasks, *shard)
    waiting = _unfinished(own, out)
    knees = sum(map(len, waiting))
    check_room(out, _KNEE_MB * knees, f"results of {counted(knees, 'knee')}")
    kinds = counted(structures(tasks), "structure")
    size = f"{counted(len(cohort.members), 'knee')} of {kinds} in {counted(len(tasks), 'task')}"
    print(f"{cohort.title}: {size}")
    if arguments.shard:
        print(f"part {'/'.join(map(str, shard))}: {counted(len(own), 'task')}")
    if len(waiting) < len(own):
        print(f"{counted(len(own) - len(waiting), 'task')} of these finished already")
    sys.stdout.flush()
    work, count = CohortWork(out, arguments.svg), arguments.bootstrap or 0
    rounds = [(own, " knees"), (bootstraps(own, count, by_blocks), " fits")]
    waiting += _unfinished(rounds[1][0], out)
    if waiting:
        # From here on the folder is this cohort's, with what is there of it already.
        kept = {(KNEES, x) for task in tasks if finished(task, out) for x in task.names}
        arguments.results.begin(lambda name: tuple(name.split("/")[:2]) in kept)
    lost: list[KneeDone] = []
    with _computer(waiting, arguments) as compute:
        for some, unit in rounds:
            some = _unfinished(some, out)
            with tqdm(total=sum(map(len, some)), unit=unit, disable=None, leave=False) as bar:
                for task, done in compute(some, work):
                    lost += [] if finished(task, out) else done
                    bar.update(len(task))
    every_task = [*tasks, *bootstraps(tasks, count, by_blocks)]
    # Other parts may have ended meanwhile.
    ended = {task: finished(task, out) for task in every_task}
    failed = {one.name: one for one in reversed(lost)}  # what was first is the reason
    still_open = [task for task, done in ended.items() if done is None]
    if any(not failed.keys() & set(task.names) for task in still_open):
        left = counted(len(still_open), "task")
        print(f"{left} left to other parts: the last one writes the report")
        return int(bool(failed))
    for one in failed.values():
        print(f"{one.name}: {one.failed}")
    known = {one.name: one for task, done in ended.items() if not task.draws for one in done or ()}
    arguments.results.holds = [f"{KNEES}/{name}/{MARK}" for name in known]
    answers = read_answers(cohort, failed | known, out / KNEES)
    draws = draws_of(every_task, out) if count else {}
    return max(_finish(summed_up(cohort.title, answers, draws), arguments), int(bool(lost)))


def _unfinished(tasks: Sequence[Task], out) -> list[Task]:
    return [task for task in tasks if finished(task, out) is None]


@contextlib.contextmanager
def _computer(waiting: Sequence[Task], arguments: Calibrate) -> Iterator[Compute]:
    """Who computes: this process, or workers that stay for all rounds."""
    jobs, address = arguments.jobs or 1, arguments.scheduler
    if not waiting or (jobs < 2 and address is None):
        yield in_process
        return
    with workers_of(address) if address else local_workers(min(jobs, len(waiting))) as client:
        if sys.stderr.isatty():
            print(f"workers: {client.dashboard_link}", flush=True)
        yield functools.partial(on_workers, client)


def _finish(summary: CohortSummary, arguments: Calibrate) -> int:
    """Write what the knees say together, and say it."""
    from kneejax.report.cohort import cohort_answer

    out, files, missing = arguments.out, [], ""
    if summary.populations:
        text = _PRIOR.format(" ".join(summary.title.split())) + format_yaml(next_prior(summary))
        write_text(out / "prior.yaml", text)
        files.append("prior.yaml")
    try:
        write_netcdf(out / "cohort.nc", to_dataset(summary))
        files.append("cohort.nc")
    except MissingPackage as problem:
        missing = str(problem)
    status = deliver(cohort_answer(summary, KNEES), arguments, [*files, f"{KNEES}/NAME/"])
    if missing:
        print(f"not written: {out}/cohort.nc: {missing}")
    return status
