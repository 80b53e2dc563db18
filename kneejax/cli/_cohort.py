"""Cohorts: what a worker does with a block of knees, the whole calibrated, and one made up."""

import contextlib
import functools
import io
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from kneejax import cohorts, files
from kneejax._whole_files import read_sealed, write_sealed
from kneejax.cli._deliver import deliver, write_results
from kneejax.cli._results_folder import DRAWS, KNEES, MARK, check_room, read_mark, replace_knee
from kneejax.cli.options.studies import Calibrate, CohortSynthesise
from kneejax.files.reading import format_yaml
from kneejax.geometry import COORDINATES, FREE_COORDINATES
from kneejax.inference import Calibration
from kneejax.numerics import MissingPackage, check_installed
from kneejax.parameters import UnsuitableData
from kneejax.report.cohort import cohort_answer
from kneejax.studies import Study, bootstrapped, run_side_by_side, stages_on_terminal

_PRIOR = """# What a cohort says of a knee of which nothing is measured: {}.
# In a study: prior: prior.yaml
"""
#: Files of a knee take about this; those of one with 22 parameters 0.4 MB.
_KNEE_MB = 0.25
#: What became of a knee of a task: why it has no answer, if it has none, and seconds.
Mark = Mapping[str, Any]


def compute(out: Path, svg: bool, task: "cohorts.Task") -> None:
    """Calibrate the knees of a task, or draw the data of one again and fit them, into the folder of
    a cohort's results, unless these are there; with `svg` each knee's figures are files too."""
    begun = time.perf_counter()
    if finished(task, out) is not None:
        return
    if task.draws is None:
        answers = _answers([member.study for member in task.members])
        share = (time.perf_counter() - begun) / len(answers)
        for member, answer in zip(task.members, answers, strict=True):
            folder = out / KNEES / member.name
            replace_knee(folder, functools.partial(_write, folder, task, answer, share, svg))
        return
    (member,) = task.members
    folder, failed, values = out / KNEES / member.name, "", np.zeros((0, 0))
    if read_mark(folder) is None:  # nothing to begin at: to be tried again, not kept
        raise UnsuitableData("its calibration was not finished")
    if (folder / "result.json").is_file():  # a knee without an answer has no draws
        answer = files.read_calibrated(folder / "result.json").of_structures(member.study.knee)
        try:
            values = bootstrapped(member.study, range(*task.draws), answer, task.by_blocks)
        except UnsuitableData as problem:
            failed = cohorts.reason(problem)
    stream, seconds = io.BytesIO(), time.perf_counter() - begun
    np.savez(stream, values=values, failed=failed, seconds=seconds)
    write_sealed(_draws_file(task, out), stream.getvalue(), task.fingerprint)


def _write(
    folder: Path, task: "cohorts.Task", answer: Calibration | Exception, seconds: float, svg: bool
) -> dict[str, Any]:
    """Write the answer of a knee; what its mark says of it."""
    begun, failed = time.perf_counter(), ""
    if isinstance(answer, Exception):
        failed = cohorts.reason(answer, named=False)
    else:
        write_results(answer, folder, svg=svg, figures=svg)
    took = seconds + time.perf_counter() - begun
    return {"task": task.fingerprint, "failed": failed, "seconds": took}


def _answers(studies: Sequence[Study]) -> list[Calibration | Exception]:
    """Answers of studies; where one brings all down, each by itself, so that others have theirs."""
    try:
        return run_side_by_side(studies)
    except (OSError, MemoryError):  # of a machine, not of a knee
        raise
    except Exception as problem:
        if len(studies) == 1:
            return [RuntimeError(cohorts.reason(problem))]
        return [answer for study in studies for answer in _answers([study])]


def finished(task: "cohorts.Task", out: Path) -> dict[str, Mark] | None:
    """What became of each knee of a task; None where any of them is still to be computed."""
    if task.draws is not None:
        if (data := read_sealed(_draws_file(task, out), task.fingerprint)) is None:
            return None  # nothing there, or something damaged
        with np.load(io.BytesIO(data), allow_pickle=False) as kept:
            return {task.names[0]: {x: kept[x] for x in ("values", "failed", "seconds")}}
    marks = {name: read_mark(out / KNEES / name) or {} for name in task.names}
    whole = all(mark.get("task") == task.fingerprint for mark in marks.values())
    return marks if whole else None


def _draws_file(task: "cohorts.Task", out: Path) -> Path:
    first = 0 if task.draws is None else task.draws[0]
    return out / KNEES / task.names[0] / DRAWS / f"{first:07}.draws"


def run(arguments: Calibrate) -> int:
    """Calibrate every knee of a cohort, and write what they say together."""
    if arguments.scheduler or (arguments.jobs or 1) > 1:
        check_installed("distributed", "cohorts")
    count, by_blocks = arguments.bootstrap or 0, arguments.blocks
    try:
        cohort = cohorts.read_cohort(arguments.study)
        if count:
            cohorts.check_bootstraps(cohort, by_blocks)
    except files.InputProblems as every:
        mistakes = files.counted(len(every.problems), "mistake")
        end = ValueError(f"{mistakes}; nothing was computed")
        raise files.InputProblems([*every.problems, end]) from None
    out, tasks = arguments.out.resolve(), cohorts.plan(cohort)
    for member in cohort.members:
        for new in ("knee.yaml", "result.json"):
            files.check_new(out / KNEES / member.name / new, member.study.knee_name)
    arguments.results.check_free("cohort.csv", "cohort.nc", "prior.yaml", "report.html")
    part, parts = arguments.shard or (1, 1)
    own = tasks[part - 1 :: parts]
    rounds = [(own, " knees"), (cohorts.bootstraps(own, count, by_blocks), " fits")]
    waiting = _unfinished(own, out)
    knees = sum(map(len, waiting))
    check_room(out, _KNEE_MB * knees, f"results of {files.counted(knees, 'knee')}")
    kinds = files.counted(len({task.structure for task in tasks}), "structure")
    print(f"{cohort.title}: {files.counted(len(cohort.members), 'knee')} of {kinds} in "
          f"{files.counted(len(tasks), 'task')}")
    if arguments.shard:
        print(f"part {part}/{parts}: {files.counted(len(own), 'task')}")
    if len(waiting) < len(own):
        print(f"{files.counted(len(own) - len(waiting), 'task')} of these finished already")
    sys.stdout.flush()
    waiting += _unfinished(rounds[1][0], out)
    if waiting:
        # From here on the folder is this cohort's, with what is there of it already.
        kept = {(KNEES, x) for task in tasks if finished(task, out) for x in task.names}
        arguments.results.begin(lambda name: tuple(name.split("/")[:2]) in kept)
    failed: dict[str, Mark] = {}
    work = functools.partial(compute, out, arguments.svg)
    jobs, address = arguments.jobs or 1, arguments.scheduler
    apart = waiting and (jobs > 1 or address is not None)  # on workers, which stay for all rounds
    workers = cohorts.workers(min(jobs, len(waiting)), address) if apart else None
    with workers or contextlib.nullcontext() as client:
        if client is not None and sys.stderr.isatty():
            print(f"workers: {client.dashboard_link}", flush=True)
        for some, unit in rounds:
            some = _unfinished(some, out)
            with tqdm(total=sum(map(len, some)), unit=unit, disable=None, leave=False) as bar:
                for task, why in cohorts.computed(some, work, client):
                    for name in task.names if why and finished(task, out) is None else ():
                        failed.setdefault(name, {"failed": why, "seconds": 0.0})
                    bar.update(len(task))
    every_task = [*tasks, *cohorts.bootstraps(tasks, count, by_blocks)]
    # Other parts may have ended meanwhile.
    ended = {task: finished(task, out) for task in every_task}
    still_open = [task for task, marks in ended.items() if marks is None]
    if any(not failed.keys() & set(task.names) for task in still_open):
        left = files.counted(len(still_open), "task")
        print(f"{left} left to other parts: the last one writes the report")
        return int(bool(failed))
    for name, mark in failed.items():
        print(f"{name}: {mark['failed']}")
    known: dict[str, Mark] = {}
    drawn: dict[str, list[np.ndarray]] = {}
    for task, marks in ended.items():
        for name, mark in (marks or {}).items():
            if not task.draws:
                known[name] = mark
            elif mark["values"].size:
                drawn.setdefault(name, []).append(mark["values"])
    arguments.results.holds = [f"{KNEES}/{name}/{MARK}" for name in known]
    ends = failed | known
    answers = [cohorts.KneeAnswer.read(one, ends[one.name], out / KNEES / one.name)
               for one in cohort.members if one.name in ends]  # fmt: skip
    draws = {name: np.concatenate(parts) for name, parts in drawn.items()}
    summary = cohorts.summed_up(cohort.title, answers, draws)
    written, missing = [], ""
    if summary.populations:
        heading = _PRIOR.format(" ".join(summary.title.split()))
        files.write_text(out / "prior.yaml", heading + format_yaml(summary.next_prior()))
        written.append("prior.yaml")
    try:
        files.write_netcdf(out / "cohort.nc", summary.to_dataset())
        written.append("cohort.nc")
    except MissingPackage as problem:
        missing = str(problem)
    status = deliver(cohort_answer(summary, KNEES), arguments, [*written, f"{KNEES}/NAME/"])
    if missing:
        print(f"not written: {arguments.out}/cohort.nc: {missing}")
    return max(status, int(bool(failed)))


def _unfinished(tasks: "Sequence[cohorts.Task]", out: Path) -> "list[cohorts.Task]":
    return [task for task in tasks if finished(task, out) is None]


_SOURCE = "made up: kneejax cohort synthesise"
#: Bounds that hold what the distributions draw.
_BOUNDS = {"stiffness": [300.0, 30000.0], "reference_strain": [-0.25, 0.25]}
_COMMENT = """A made-up knee: its size and shape are its own, its ligaments are those of the bundled
knee. What made its data stands in truth.csv."""


def make_up(arguments: CohortSynthesise) -> int:
    """Make up a cohort and write its files."""
    out, count = arguments.out, arguments.knees
    spread = cohorts.Spread(noise_mm=arguments.noise_mm, noise_deg=arguments.noise_deg)
    rows, truth, redrawn, names = [], [], 0, []
    with stages_on_terminal("made-up knees") as progress:
        for made in cohorts.synthesise(count, arguments.seed, arguments.knee, spread):
            rows.append(_written(made, out))
            truth += [[made.name, "size", made.size]]
            truth += [[made.name, name, value] for name, value in made.truth.items()]
            redrawn, names = redrawn + made.redrawn, [test.name for test in made.tests]
            progress("made-up knees", len(rows), count)
    columns = [f"{name}.file" for name in names]
    files.write_rows(out / "truth.csv", ["knee", "parameter", "value"], truth)
    files.write_rows(out / "knees.csv", ["name", "side", "knee", "measured.file", *columns], rows)
    mm, deg = spread.noise_mm, spread.noise_deg
    study: dict[str, Any] = {
        "title": "Made-up knee", "knee": "four_ligament",
        "parameters": ["*.stiffness", "*.reference_strain"], "bounds": _BOUNDS,
        "procedures": ["III"],
        "weights": {"mm": mm**-2, "deg": deg**-2},  # one over the variances
        "noise_mm": mm, "noise_deg": deg, "measured": {"file": "", "source": _SOURCE},
        "tests": [{"name": name, "file": "", "source": _SOURCE, "sd_mm": mm, "sd_deg": deg}
                  for name in names]}  # fmt: skip
    document = {"title": f"{count} made-up knees, seed {arguments.seed}", "study": study,
                "knees": "knees.csv"}  # fmt: skip
    # Last of all: without it the folder is no cohort.
    files.write_text(out / "cohort.yaml", format_yaml(document))
    print(f"{count} made-up knees of {arguments.knee}, seed {arguments.seed}")
    if redrawn:
        print(f"drawn again, since they had no balance somewhere: {redrawn}")
    print(f"written: {out}/cohort.yaml, knees.csv, truth.csv, knees/, data/")
    print(f"next: kneejax calibrate {out}")
    return 0


def _written(made: "cohorts.MadeUpKnee", out: Path) -> list[str]:
    """Write a knee and its data; its row of the table."""
    knee, passive = f"knees/{made.name}.yaml", f"data/{made.name}_passive.csv"
    files.write_knee(made.document, out / knee, _COMMENT)
    files.write_poses(out / passive, made.passive)
    row = [made.name, "right", knee, passive]
    for test in made.tests:
        row.append(f"data/{made.name}_{test.name.replace(' ', '_')}.csv")
        places = [FREE_COORDINATES.index(name) for name in test.coordinates]
        observed = [f"{name}_{COORDINATES[name].unit}" for name in test.coordinates]
        columns = [test.flexion_deg, *test.loads.values(), *test.observed[:, places].T]
        rows = np.column_stack(columns).tolist()
        files.write_rows(out / row[-1], ["flexion_deg", *test.loads, *observed], rows)
    return row
