"""What a worker does with a block of knees: calibrate, write each one's results, say it is done."""

from __future__ import annotations

import dataclasses
import io
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from kneejax._whole_files import read_sealed, write_sealed
from kneejax.cli._calibration_files import write_results
from kneejax.cli._results_folder import DRAWS, KNEES, read_mark, replace_knee
from kneejax.cohorts import KneeDone, Member, Task
from kneejax.files import read_calibrated
from kneejax.inference import Calibration
from kneejax.parameters import UnsuitableData
from kneejax.studies import Study, bootstrapped, run_side_by_side


@dataclasses.dataclass(frozen=True)
class CohortWork:
    """Computes tasks of a cohort into a folder.

    Attributes:
        out: of the cohort's results.
        svg: whether each knee's figures are files too, as PNG and SVG; its page holds them.
    """

    out: Path
    svg: bool = False

    def __call__(self, task: Task) -> list[KneeDone]:
        """Calibrate the knees of a task, unless their results are there."""
        if (done := finished(task, self.out)) is not None:
            return done
        if task.draws is not None:
            return [self._bootstrap(task, *task.members)]
        begun = time.perf_counter()
        answers = _answers([member.study for member in task.members])
        share = (time.perf_counter() - begun) / len(answers)
        return [
            self._one(task, member, answer, share)
            for member, answer in zip(task.members, answers, strict=True)
        ]

    def _one(
        self, task: Task, member: Member, answer: Calibration | Exception, seconds: float
    ) -> KneeDone:
        begun, folder = time.perf_counter(), self.out / KNEES / member.name
        failed = " ".join(str(answer).split()) if isinstance(answer, Exception) else ""

        def write() -> dict[str, Any]:
            if not isinstance(answer, Exception):
                write_results(answer, folder, svg=self.svg, figures=self.svg)
            took = seconds + time.perf_counter() - begun
            return {"task": task.fingerprint, "failed": failed, "seconds": took}

        return KneeDone(member.name, failed, replace_knee(folder, write)["seconds"])

    def _bootstrap(self, task: Task, member: Member) -> KneeDone:
        """Fit data of a knee that are drawn again; nothing for a knee without an answer."""
        begun, folder, failed = time.perf_counter(), self.out / KNEES / member.name, ""
        if read_mark(folder) is None:  # nothing to begin at: to be tried again, not kept
            return KneeDone(member.name, "its calibration was not finished")
        values = np.zeros((0, 0))
        if (folder / "result.json").is_file():
            answer = read_calibrated(folder / "result.json").of_structures(member.study.knee)
            try:
                draws = range(*task.draws or ())
                values = bootstrapped(member.study, draws, answer, task.by_blocks)
            except UnsuitableData as problem:
                failed = " ".join(str(problem).split())
        stream, seconds = io.BytesIO(), time.perf_counter() - begun
        np.savez(stream, values=values, failed=failed, seconds=seconds)
        write_sealed(_draws_file(task, self.out), stream.getvalue(), task.fingerprint)
        return KneeDone(member.name, failed, seconds)


def _answers(studies: Sequence[Study]) -> list[Calibration | Exception]:
    """Answers of studies; where one brings all down, each by itself, so that others have theirs.

    Raises:
        OSError: of a machine, not of a knee; and so is MemoryError.
    """
    try:
        return run_side_by_side(studies)
    except (OSError, MemoryError):
        raise
    except Exception as problem:
        if len(studies) == 1:
            words = " ".join(str(problem).split())
            return [RuntimeError(f"{type(problem).__name__}: {words}")]
        return [answer for study in studies for answer in _answers([study])]


def finished(task: Task, out: Path) -> list[KneeDone] | None:
    """What became of the knees of a task; None where any of them is still to be computed."""
    if task.draws is not None:
        if (kept := _kept_draws(task, out)) is None:
            return None
        return [KneeDone(task.names[0], str(kept["failed"]), float(kept["seconds"]))]
    marks = [read_mark(out / KNEES / name) or {} for name in task.names]
    if any(mark.get("task") != task.fingerprint for mark in marks):
        return None
    pairs = zip(task.names, marks, strict=True)
    return [KneeDone(name, str(x["failed"]), float(x["seconds"])) for name, x in pairs]


def draws_of(tasks: Sequence[Task], out: Path) -> dict[str, np.ndarray]:
    """Knee -> draws of its bootstrap, `(draws, p)`, of the tasks that have ended."""
    found: dict[str, list[np.ndarray]] = {}
    for task in tasks:
        kept = None if task.draws is None else _kept_draws(task, out)
        if kept is not None and kept["values"].size:
            found.setdefault(task.names[0], []).append(kept["values"])
    return {name: np.concatenate(parts) for name, parts in found.items()}


def _draws_file(task: Task, out: Path) -> Path:
    first = 0 if task.draws is None else task.draws[0]
    return out / KNEES / task.names[0] / DRAWS / f"{first:07}.draws"


def _kept_draws(task: Task, out: Path) -> dict[str, np.ndarray] | None:
    """What a task of a bootstrap has left; None where there is nothing, or something damaged."""
    data = read_sealed(_draws_file(task, out), task.fingerprint)
    if data is None:
        return None
    with np.load(io.BytesIO(data), allow_pickle=False) as kept:
        return {name: kept[name] for name in ("values", "failed", "seconds")}
