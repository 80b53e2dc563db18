"""`kneejax calibrate COHORT`: many knees, whoever computes them, and what they say together."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterator, Sequence

from tqdm import tqdm

from kneejax.cli._cohort_work import KNEES, CohortWork, finished
from kneejax.cli._parser import BAD_INPUT
from kneejax.cohorts import (
    Cohort,
    CohortProblems,
    KneeDone,
    Task,
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
from kneejax.files import (
    InputProblem,
    check_new,
    counted,
    write_netcdf,
    write_rows,
    write_text,
)
from kneejax.files.reading import format_yaml
from kneejax.numerics import MissingPackage

_PRIOR = """# What a cohort says of a knee of which nothing is measured: {}.
# In a study: prior: prior.yaml
"""
_MOST_JOBS, _MOST_SHARDS = 1024, 100_000


def run(arguments: argparse.Namespace) -> int:
    """Calibrate every knee of a cohort, and write what they say together."""
    shard = _shard(arguments.shard)
    _check_executor(arguments)
    try:
        cohort = read_cohort(arguments.study)
    except CohortProblems as every:
        return _refused(every)
    out, tasks = arguments.out, plan(cohort)
    for member in cohort.members:
        for new in ("knee.yaml", "result.json"):
            check_new(out / KNEES / member.name / new, member.study.knee_name)
    own = shard_of(tasks, *shard) if shard else tasks
    waiting = [task for task in own if finished(task, out) is None]
    _say_plan(cohort, tasks, own, waiting, arguments)
    done: dict[str, KneeDone] = {}
    work = CohortWork(out.resolve(), arguments.svg)
    with tqdm(
        total=sum(len(task.members) for task in waiting), unit=" knees", disable=None, leave=False
    ) as bar:
        for task, ended in _computed(waiting, work, arguments):
            done |= {one.name: one for one in ended}
            bar.update(len(task.members))
    # Other parts may have ended meanwhile.
    for task in tasks:
        done |= {one.name: one for one in finished(task, out) or ()}
    missing = [name for task in tasks for name in task.names if name not in done]
    if missing:
        print(
            f"{counted(len(done), 'knee')} done, {len(missing)} left to other parts: the last one "
            "writes the report"
        )
        return int(any(one.failed for one in done.values()))
    return _finish(cohort, done, arguments)


def _computed(
    tasks: Sequence[Task], work: CohortWork, arguments: argparse.Namespace
) -> Iterator[tuple[Task, Sequence[KneeDone]]]:
    if not tasks:
        return
    if arguments.scheduler is not None:
        workers = workers_of(arguments.scheduler)
    elif arguments.jobs is not None and arguments.jobs > 1:
        workers = local_workers(min(arguments.jobs, len(tasks)))
    else:
        yield from in_process(tasks, work)
        return
    with workers as client:
        if sys.stderr.isatty():
            print(f"workers: {dashboard_of(client)}", flush=True)
        yield from on_workers(client, tasks, work)


def _refused(every: CohortProblems) -> int:
    """Say all that is wrong, a line each."""
    for problem in every.problems:
        print(f"kneejax: {' '.join(problem.split())}", file=sys.stderr)
    count = len(every.problems)
    print(f"kneejax: {counted(count, 'mistake')}; nothing was computed", file=sys.stderr)
    return BAD_INPUT


def _shard(word: str | None) -> tuple[int, int] | None:
    if word is None:
        return None
    found = re.fullmatch(r"(\d+)/(\d+)", word)
    number, count = (int(found[1]), int(found[2])) if found else (0, 0)
    if not 1 <= number <= count <= _MOST_SHARDS:
        raise InputProblem("--shard", "part", word, "I/N with I from 1 to N, e.g. 3/20")
    return number, count


def _check_executor(arguments: argparse.Namespace) -> None:
    given = [name for name in ("jobs", "scheduler", "shard") if getattr(arguments, name)]
    if arguments.jobs is not None and not 1 <= arguments.jobs <= _MOST_JOBS:
        expected = f"a whole number from 1 to {_MOST_JOBS}"
        raise InputProblem("--jobs", "workers", str(arguments.jobs), expected)
    if len(given) > 1 and set(given) != {"jobs", "shard"}:
        expected = f"one of --scheduler and --{next(n for n in given if n != 'scheduler')}"
        raise InputProblem("--scheduler", "address", arguments.scheduler, expected)


def _say_plan(
    cohort: Cohort, tasks: Sequence[Task], own: Sequence[Task], waiting: Sequence[Task], arguments
) -> None:
    kinds = counted(structures(tasks), "structure")
    size = f"{counted(len(cohort), 'knee')} of {kinds} in {counted(len(tasks), 'task')}"
    print(f"{cohort.title}: {size}")
    if arguments.shard:
        print(f"part {arguments.shard}: {counted(len(own), 'task')}")
    if len(waiting) < len(own):
        print(f"{counted(len(own) - len(waiting), 'task')} of these finished already")
    sys.stdout.flush()


def _finish(cohort: Cohort, done: dict[str, KneeDone], arguments: argparse.Namespace) -> int:
    """Write what the knees say together, and say it."""
    from kneejax.report import cohort_exit_status, cohort_rows, cohort_text, write_cohort_report

    out = arguments.out
    answers = read_answers(cohort, done, out / KNEES)
    summary = summed_up(cohort.title, answers, parameter_units(answers, out / KNEES))
    write_rows(out / "cohort.csv", *cohort_rows(summary))
    files, missing = ["report.html", "cohort.csv"], ""
    if summary.populations:
        text = _PRIOR.format(cohort.title) + format_yaml(next_prior(summary))
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
    return cohort_exit_status(summary)
