"""`kneejax calibrate COHORT`: many knees, whoever computes them, and what they say together."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from tqdm import tqdm

from kneejax.cli._cohort_work import KNEES, CohortWork, finished
from kneejax.cli._parser import BAD_INPUT
from kneejax.cohorts import (
    Cohort,
    CohortProblems,
    KneeDone,
    Task,
    in_process,
    plan,
    read_cohort,
    shard_of,
    structures,
)
from kneejax.files import InputProblem, check_new, counted

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
    done = {one.name: one for task in own for one in finished(task, out) or ()}
    work = CohortWork(out.resolve(), arguments.svg)
    with tqdm(
        total=sum(len(task.members) for task in waiting), unit=" knees", disable=None, leave=False
    ) as bar:
        for task, ended in _computed(waiting, work, arguments):
            done |= {one.name: one for one in ended}
            bar.update(len(task.members))
    return _summed_up(cohort, tasks, done, arguments)


def _computed(
    tasks: Sequence[Task], work: CohortWork, arguments: argparse.Namespace
) -> Iterator[tuple[Task, Sequence[KneeDone]]]:
    return in_process(tasks, work)


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
    print(f"{cohort.title}: {counted(len(cohort), 'knee')} of {kinds} in {counted(len(tasks), 'task')}")
    if arguments.shard:
        print(f"part {arguments.shard}: {counted(len(own), 'task')}")
    if len(waiting) < len(own):
        print(f"{counted(len(own) - len(waiting), 'task')} of these finished already")
    sys.stdout.flush()


def _summed_up(cohort: Cohort, tasks, done, arguments: argparse.Namespace) -> int:
    failed = [one for one in done.values() if one.failed]
    for one in failed:
        print(f"{one.name}: {one.failed}")
    return 1 if failed else 0
