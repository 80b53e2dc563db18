"""`kneejax calibrate COHORT`: many knees, whoever computes them, and what they say together."""

from __future__ import annotations

import contextlib
import functools
import sys
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from tqdm import tqdm

from kneejax.cli._cohort_work import CohortWork, draws_of, finished
from kneejax.cli._main import BAD_INPUT
from kneejax.cli._out import check_room
from kneejax.cli._results_folder import KNEES, MARK
from kneejax.cli.options import Calibrate
from kneejax.cohorts import (
    Cohort,
    CohortProblems,
    KneeDone,
    Task,
    Work,
    bootstraps,
    check_bootstraps,
    dashboard_of,
    in_process,
    local_workers,
    next_prior,
    on_workers,
    parameter_units,
    plan,
    read_answers,
    read_cohort,
    shard_of,
    structures,
    summed_up,
    to_dataset,
    workers_of,
)
from kneejax.files import check_new, counted, write_netcdf, write_rows, write_text
from kneejax.files.reading import format_yaml
from kneejax.numerics import MissingPackage

_PRIOR = """# What a cohort says of a knee of which nothing is measured: {}.
# In a study: prior: prior.yaml
"""
#: Files of a knee take about this; those of one with 22 parameters 0.4 MB.
_KNEE_MB = 0.25
#: Computes tasks, each yielded with what became of its knees when it has ended.
Compute = Callable[[Sequence[Task], Work], Iterator[tuple[Task, Sequence[KneeDone]]]]


def run(arguments: Calibrate) -> int:
    """Calibrate every knee of a cohort, and write what they say together."""
    shard = arguments.shard
    try:
        cohort, by_blocks = read_cohort(arguments.study), arguments.blocks
        if arguments.bootstrap:
            check_bootstraps(cohort, by_blocks)
    except CohortProblems as every:
        return _refused(every)
    out, tasks = arguments.out.resolve(), plan(cohort)
    for member in cohort.members:
        for new in ("knee.yaml", "result.json"):
            check_new(out / KNEES / member.name / new, member.study.knee_name)
    arguments.results.check_free("cohort.csv", "cohort.nc", "prior.yaml", "report.html")
    own = shard_of(tasks, *shard) if shard else tasks
    waiting = [name for task in own if finished(task, out) is None for name in task.names]
    check_room(out, _KNEE_MB * len(waiting), f"results of {counted(len(waiting), 'knee')}")
    _say_plan(cohort, tasks, own, arguments)
    work, count, lost = CohortWork(out, arguments.svg), arguments.bootstrap or 0, []
    rounds = (own, " knees"), (bootstraps(own, count, by_blocks), " fits")
    there = {name for task in tasks if finished(task, out) is not None for name in task.names}
    if any(finished(task, out) is None for some, _ in rounds for task in some):
        # From here on the folder is this cohort's, with what is there of it already.
        folders = {(KNEES, name) for name in there}
        arguments.results.begin(lambda name: tuple(name.split("/")[:2]) in folders)
    with _computer([task for some, _ in rounds for task in some], work, arguments) as compute:
        for some, unit in rounds:
            lost += _computed(compute, some, work, unit)
    every = [*tasks, *bootstraps(tasks, count, by_blocks)]
    # Other parts may have ended meanwhile.
    ended = [(task, finished(task, out)) for task in every]
    open_ = [task for task, done in ended if done is None]
    said = {one.name: one for one in reversed(lost)}  # what was first is the reason
    if any(not said.keys() & set(task.names) for task in open_):
        print(f"{counted(len(open_), 'task')} left to other parts: the last one writes the report")
        return int(bool(said))
    for one in said.values():
        print(f"{one.name}: {one.failed}")
    known = {one.name: one for task, done in ended if not task.draws for one in done or ()}
    arguments.results.holds = [f"{KNEES}/{name}/{MARK}" for name in known]
    return _finish(cohort, said | known, draws_of(every, out) if count else {}, arguments, lost)


@contextlib.contextmanager
def _computer(tasks: Sequence[Task], work: CohortWork, arguments) -> Iterator[Compute]:
    """Who computes: this process, or workers that stay for all rounds."""
    waiting = [task for task in tasks if finished(task, work.out) is None]
    many = arguments.scheduler is not None or (arguments.jobs or 1) > 1
    if not (waiting and many):
        yield in_process
        return
    jobs = min(arguments.jobs or 1, len(waiting))
    here = arguments.scheduler is None
    with local_workers(jobs) if here else workers_of(arguments.scheduler) as client:
        if sys.stderr.isatty():
            print(f"workers: {dashboard_of(client)}", flush=True)
        yield functools.partial(on_workers, client)


def _computed(
    compute: Compute, tasks: Sequence[Task], work: CohortWork, unit: str
) -> list[KneeDone]:
    """Compute what is not there yet; the knees of which nothing is there for all that."""
    waiting = [task for task in tasks if finished(task, work.out) is None]
    lost: list[KneeDone] = []
    total = sum(map(_size, waiting))
    with tqdm(total=total, unit=unit, disable=None, leave=False) as bar:
        for task, ended in compute(waiting, work):
            if finished(task, work.out) is None:
                lost += ended
            bar.update(_size(task))
    return lost


def _size(task: Task) -> int:
    """Knees or draws of a task."""
    return task.draws[1] - task.draws[0] if task.draws else len(task.members)


def _refused(every: CohortProblems) -> int:
    """Say all that is wrong, a line each."""
    for problem in every.problems:
        print(f"kneejax: {' '.join(problem.split())}", file=sys.stderr)
    count = len(every.problems)
    print(f"kneejax: {counted(count, 'mistake')}; nothing was computed", file=sys.stderr)
    return BAD_INPUT


def _say_plan(cohort: Cohort, tasks: Sequence[Task], own: Sequence[Task], arguments) -> None:
    waiting = [task for task in own if finished(task, arguments.out) is None]
    kinds = counted(structures(tasks), "structure")
    size = f"{counted(len(cohort), 'knee')} of {kinds} in {counted(len(tasks), 'task')}"
    print(f"{cohort.title}: {size}")
    if arguments.shard:
        print(f"part {'/'.join(map(str, arguments.shard))}: {counted(len(own), 'task')}")
    if len(waiting) < len(own):
        print(f"{counted(len(own) - len(waiting), 'task')} of these finished already")
    sys.stdout.flush()


def _finish(
    cohort: Cohort,
    done: dict[str, KneeDone],
    draws: dict[str, np.ndarray],
    arguments: Calibrate,
    lost: Sequence[KneeDone],
) -> int:
    """Write what the knees say together, and say it."""
    from kneejax.report import cohort_exit_status, cohort_rows, cohort_text, write_cohort_report

    out = arguments.out
    answers = read_answers(cohort, done, out / KNEES)
    units = parameter_units(answers, out / KNEES)
    summary = summed_up(cohort.title, answers, units, draws)
    write_rows(out / "cohort.csv", *cohort_rows(summary))
    files, missing = ["report.html", "cohort.csv"], ""
    if summary.populations:
        text = _PRIOR.format(" ".join(cohort.title.split())) + format_yaml(next_prior(summary))
        write_text(out / "prior.yaml", text)
        files.append("prior.yaml")
    try:
        write_netcdf(out / "cohort.nc", to_dataset(summary))
        files.append("cohort.nc")
    except MissingPackage as problem:
        missing = str(problem)
    write_cohort_report(summary, out, KNEES, svg=arguments.svg)
    print(cohort_text(summary))
    print(f"written: {out}/{', '.join(files)}, {KNEES}/NAME/")
    if missing:
        print(f"not written: {out}/cohort.nc: {missing}")
    return max(cohort_exit_status(summary), int(bool(lost)))
