"""What a worker does with a block of knees: calibrate, write each knee's results, say it is done."""

from __future__ import annotations

import dataclasses
import json
import time
from pathlib import Path

from kneejax.cli._calibration_files import write_results
from kneejax.cohorts import KneeDone, Member, Task
from kneejax.files import InputProblem, write_text
from kneejax.files.reading import read_text
from kneejax.inference import Calibration
from kneejax.studies import run_side_by_side

#: Folders of the knees, in that of the cohort's results.
KNEES = "knees"
#: In a knee's folder, written last: which task wrote it.
MARK = "task.json"


@dataclasses.dataclass(frozen=True)
class CohortWork:
    """Computes tasks of a cohort into a folder.

    Attributes:
        out: of the cohort's results.
        svg: whether figures are written as SVG too.
    """

    out: Path
    svg: bool = False

    def __call__(self, task: Task) -> list[KneeDone]:
        """Calibrate the knees of a task, unless their results are there."""
        done = finished(task, self.out)
        if done is not None:
            return done
        begun = time.perf_counter()
        for member in task.members:
            (self.out / KNEES / member.name / MARK).unlink(missing_ok=True)
        answers = run_side_by_side([member.study for member in task.members])
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
            write_results(answer, folder, self.svg)
        done = KneeDone(member.name, failed, seconds + time.perf_counter() - begun)
        mark = {"task": task.fingerprint, "failed": failed, "seconds": done.seconds}
        write_text(folder / MARK, json.dumps(mark) + "\n")
        return done


def finished(task: Task, out: Path) -> list[KneeDone] | None:
    """What became of the knees of a task; None where any of them is still to be computed."""
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
