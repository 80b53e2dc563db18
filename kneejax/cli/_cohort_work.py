"""What a worker does with a block of knees: calibrate, write each one's results, say it is done."""

from __future__ import annotations

import dataclasses
import io
import time
from collections.abc import Mapping, Sequence
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
        done = finished(task, self.out)
        if done is not None:
            return done
        if task.draws is not None:
            return [self._bootstrap(task, *task.members)]
        begun = time.perf_counter()
        answers = _answers([member.study for member in task.members])
        share = (time.perf_counter() - begun) / len(answers)
        pairs = zip(task.members, answers, strict=True)
        return [self._one(task, member, answer, share) for member, answer in pairs]

    def _one(
        self, task: Task, member: Member, answer: Calibration | Exception, seconds: float
    ) -> KneeDone:
        begun = time.perf_counter()
        folder, failed = self.out / KNEES / member.name, ""
        if isinstance(answer, Exception):
            failed = " ".join(str(answer).split())

        def write() -> dict[str, Any]:
            if not isinstance(answer, Exception):
                write_results(answer, folder, svg=self.svg, figures=self.svg)
            took = seconds + time.perf_counter() - begun
            return {"task": task.fingerprint, "failed": failed, "seconds": took}

        mark = replace_knee(folder, write)
        return KneeDone(member.name, failed, mark["seconds"])

    def _bootstrap(self, task: Task, member: Member) -> KneeDone:
        """Fit data of a knee that are drawn again; nothing for a knee without an answer."""
        begun, folder, failed = time.perf_counter(), self.out / KNEES / member.name, ""
        if read_mark(folder) is None:  # nothing to begin at: to be met again, not kept
            return KneeDone(member.name, "its calibration was not finished")
        values = np.zeros((0, 0))
        if (folder / "result.json").is_file():
            answer = read_calibrated(folder / "result.json").of_structures(member.study.knee)
            try:
                values = bootstrapped(
                    member.study, range(*task.draws or ()), answer, task.by_blocks
                )
            except UnsuitableData as problem:
                failed = " ".join(str(problem).split())
        stream = io.BytesIO()
        seconds = time.perf_counter() - begun
        np.savez(stream, values=values, failed=failed, seconds=seconds)
        write_sealed(draws_file(task, self.out), stream.getvalue(), task.fingerprint)
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


def draws_file(task: Task, out: Path) -> Path:
    """Where the draws of a bootstrap's task are kept."""
    first = 0 if task.draws is None else task.draws[0]
    return out / KNEES / task.names[0] / DRAWS / f"{first:07}.draws"


def finished(task: Task, out: Path) -> list[KneeDone] | None:
    """What became of the knees of a task; None where any of them is still to be computed."""
    if task.draws is not None:
        said = _said_of_draws(task, out)
        if said is None:
            return None
        return [KneeDone(task.names[0], str(said["failed"]), float(said["seconds"]))]
    done = []
    for name in task.names:
        said = read_mark(out / KNEES / name)
        if said is None or said.get("task") != task.fingerprint:
            return None
        done.append(KneeDone(name, str(said["failed"]), float(said["seconds"])))
    return done


def draws_of(tasks: Sequence[Task], out: Path) -> dict[str, np.ndarray]:
    """Knee -> draws of its bootstrap, `(draws, p)`, of the tasks that have ended."""
    found: dict[str, list[np.ndarray]] = {}
    for task in tasks:
        said = _said_of_draws(task, out)
        if said is not None and said["values"].size:
            found.setdefault(task.names[0], []).append(said["values"])
    return {name: np.concatenate(parts) for name, parts in found.items()}


def _said_of_draws(task: Task, out: Path) -> Mapping[str, Any] | None:
    """What a task of a bootstrap has left; None where there is nothing, or something damaged."""
    data = read_sealed(draws_file(task, out), task.fingerprint)
    if data is None:
        return None
    with np.load(io.BytesIO(data), allow_pickle=False) as kept:
        return {name: kept[name] for name in ("values", "failed", "seconds")}
