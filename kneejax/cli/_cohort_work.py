"""What a worker does with a block of knees: calibrate, write each one's results, say it is done."""

from __future__ import annotations

import dataclasses
import io
import json
import time
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from kneejax.cli._calibration_files import write_results
from kneejax.cohorts import KneeDone, Member, Task
from kneejax.files import InputProblem, read_calibrated, write_bytes, write_text
from kneejax.files.reading import read_text
from kneejax.inference import Calibration
from kneejax.parameters import UnsuitableData
from kneejax.studies import Study, bootstrapped, run_side_by_side

#: Folders of the knees, in that of the cohort's results.
KNEES = "knees"
#: In a knee's folder, written last: which task wrote it.
MARK = "task.json"


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
        for member in task.members:
            (self.out / KNEES / member.name / MARK).unlink(missing_ok=True)
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
        else:
            write_results(answer, folder, svg=self.svg, figures=self.svg)
        done = KneeDone(member.name, failed, seconds + time.perf_counter() - begun)
        mark = {"task": task.fingerprint, "failed": failed, "seconds": done.seconds}
        write_text(folder / MARK, json.dumps(mark) + "\n")
        return done

    def _bootstrap(self, task: Task, member: Member) -> KneeDone:
        """Fit data of a knee that are drawn again; nothing for a knee without an answer."""
        begun, folder, failed = time.perf_counter(), self.out / KNEES / member.name, ""
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
        said = {"task": task.fingerprint, "failed": failed, "seconds": seconds}
        np.savez(stream, values=values, **said)
        write_bytes(draws_file(task, self.out), stream.getvalue())
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
    return out / KNEES / task.names[0] / "bootstrap" / f"{first:07}.npz"


def finished(task: Task, out: Path) -> list[KneeDone] | None:
    """What became of the knees of a task; None where any of them is still to be computed."""
    if task.draws is not None:
        said = _said_of_draws(draws_file(task, out))
        if said is None or str(said["task"]) != task.fingerprint:
            return None
        return [KneeDone(task.names[0], str(said["failed"]), float(said["seconds"]))]
    done = []
    for name in task.names:
        mark = out / KNEES / name / MARK
        if not mark.is_file():
            return None
        try:
            said = json.loads(read_text(mark, "what a task has left"))
        except (InputProblem, json.JSONDecodeError):
            return None
        if not isinstance(said, dict) or said.get("task") != task.fingerprint:
            return None
        done.append(KneeDone(name, str(said["failed"]), float(said["seconds"])))
    return done


def draws_of(tasks: Sequence[Task], out: Path) -> dict[str, np.ndarray]:
    """Knee -> draws of its bootstrap, `(draws, p)`, of the tasks that have ended."""
    found: dict[str, list[np.ndarray]] = {}
    for task in tasks:
        said = _said_of_draws(draws_file(task, out))
        if said is not None and said["values"].size:
            found.setdefault(task.names[0], []).append(said["values"])
    return {name: np.concatenate(parts) for name, parts in found.items()}


def _said_of_draws(path: Path) -> Mapping[str, Any] | None:
    """What a task of a bootstrap has left; None where there is nothing, or something broken."""
    if not path.is_file():
        return None
    try:
        with np.load(path) as kept:
            return {name: kept[name] for name in ("values", "task", "failed", "seconds")}
    except (OSError, ValueError, KeyError, zipfile.BadZipFile):
        return None
