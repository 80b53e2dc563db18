"""What is to be computed: blocks of knees, each named by everything that its numbers depend on.

Knees of one structure stand in one block and are calibrated side by side. Blocks belong to the
plan: who computes them, in which order and on how many cores, changes no number. A task leaves its
results on disk; however often it is begun, the files are the same.
"""

import dataclasses
import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import jax
import numpy as np

from kneejax.cohorts._reading import Cohort, Member
from kneejax.files import InputProblems
from kneejax.files.reading import Mistakes
from kneejax.inference import versions
from kneejax.inference.bootstrap import check_curves, check_redrawn, curves_of
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


@dataclasses.dataclass(frozen=True, eq=False)
class Task:
    """Knees that are calibrated side by side, or draws of the bootstrap of one.

    Attributes:
        members: of one structure.
        fingerprint: of everything that their numbers depend on, the package's version among it.
        draws: the numbers of the first draw and of the one after the last; None of a calibration.
        by_blocks: whether these draw among the curves that were measured.
    """

    members: tuple[Member, ...]
    fingerprint: str
    draws: tuple[int, int] | None = None
    by_blocks: bool = False

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
    blocks = [
        tuple(members[first : first + block])
        for members in alike.values()
        for first in range(0, len(members), block)
    ]
    return tuple(Task(members, _fingerprint(members)) for members in blocks)


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
        for task in tasks for member in task.members for draws in lots
    )  # fmt: skip


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
        study = member.study
        with mistakes.gathered(member.place):
            check_redrawn(study.tests)
            if by_blocks:
                check_curves(curves_of(len(study.flexion_deg), study.tests))
    if mistakes:
        raise InputProblems(mistakes)


def structures(tasks: Sequence[Task]) -> int:
    """How many structures there are: each is compiled once."""
    return len({_structure(task.members[0].study) for task in tasks})


def in_process(tasks: Sequence[Task], work: Work) -> Iterator[Ended]:
    """Compute tasks one after the other; each is yielded when it has ended.

    A task that raises (a full disk, too little memory) is retried once at the end.

    Args:
        tasks: in order.
        work: of one task.
    """
    failed: list[Task] = []
    for last, some in ((False, tasks), (True, failed)):
        for task in some:
            try:
                work(task)
            except Exception as problem:
                if last:
                    yield task, reason(problem)
                else:
                    failed.append(task)
            else:
                yield task, ""


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
    words = [str(tree), [np.shape(leaf) for leaf in leaves], {x: plain[x] for x in _ALIKE}]
    words.append(study.limits)
    for test in study.tests:
        alike = {"observed": np.isfinite(test.observed).tolist(), "readings": bool(test.readings)}
        words.append(plain_test(test) | alike)
    pose = jax.tree.leaves(study.knee.reference_pose)
    flexion = np.asarray(study.flexion_deg, float)
    return _digest(json.dumps(words).encode(), flexion, *pose)


def _fingerprint(members: Sequence[Member]) -> str:
    parts: list[Any] = [versions()["kneejax"].encode()]
    for member in members:
        study = member.study
        leaves, tree = jax.tree.flatten((study.knee, study.knee_at_start))
        settings = study.settings()
        words = [member.name, study.title, str(tree)]
        words += [{k: x for k, x in settings.items() if k not in _ELSEWHERE}, study.truth]
        words += [[plain_test(test) for test in study.tests], settings["synthetic"]]
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
