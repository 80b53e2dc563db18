"""The calibration that a study asks for."""

from __future__ import annotations

import contextlib
import dataclasses
import threading
from collections.abc import Sequence

import numpy as np

from kneejax.experiments import evaluate
from kneejax.files import Calibrated
from kneejax.geometry import FREE_COORDINATES, Pose
from kneejax.inference import Calibration, Question, calibrate_side_by_side
from kneejax.inference.bootstrap import bootstrap, bootstrap_by_blocks
from kneejax.inference.fit import Progress
from kneejax.numerics import adding_up, lap, stopwatch
from kneejax.parameters import UnsuitableData
from kneejax.studies._poses import measured_poses
from kneejax.studies._study import Study


def calibrated(study: Study, progress: Progress | None = None) -> Calibration:
    """Calibrate; see `kneejax.run`."""
    # XLA compiles without holding Python: what comes last gets ready beside the search.
    threading.Thread(target=_get_ready, args=(study,)).start()
    with stopwatch() as watch:
        question = _question(study)
        lap("data")
        (result,) = calibrate_side_by_side([question], progress=progress)
    if isinstance(result, Exception):
        raise result
    return dataclasses.replace(result, seconds=adding_up(watch.parts))


def run_side_by_side(studies: Sequence[Study]) -> list[Calibration | Exception]:
    """Calibrate what several studies ask, those of one form in lanes of one search.

    Args:
        studies: one a knee.

    Returns:
        A `Calibration` each, or what its data explain that there is none.
    """
    questions: list[Question | Exception] = []
    for study in studies:
        try:
            questions.append(_question(study))
        except UnsuitableData as problem:
            questions.append(problem)
    asked = [question for question in questions if isinstance(question, Question)]
    found = iter(calibrate_side_by_side(_of_one_name(asked)))
    return [
        _named(next(found), q.knee.name) if isinstance(q, Question) else q for q in questions
    ]


def bootstrapped(
    study: Study, draws: Sequence[int], answer: Calibrated, by_blocks: bool = False
) -> np.ndarray:
    """Draw the data of a study again, and fit them from its answer.

    Args:
        study: that was calibrated.
        draws: numbers of the draws.
        answer: what its result.json says.
        by_blocks: whether curves are drawn among those that were measured; otherwise the answer
            makes the data, with its noise.

    Returns:
        Values of each draw, `(draws, p)`, parameters, then constants between frames; NaN where its
        fit did not converge.
    """
    values = [answer.found[name] for name in study.selection.names]
    shifts = [answer.frame_offset[name] for name in tuple(study.frame_offset)]  # pyright: ignore
    values += shifts
    if by_blocks:
        return bootstrap_by_blocks(_question(study), values, draws, study.seed)
    noise = [answer.noise[name] for name in FREE_COORDINATES]
    return bootstrap(_question(study), values, noise, draws, study.seed)


def _of_one_name(questions: Sequence[Question]) -> list[Question]:
    """Names steer compiling: knees that differ in nothing else share their programs."""
    names = {(question.knee.name, question.knee.side) for question in questions}
    if len(names) < 2:
        return list(questions)
    return [
        dataclasses.replace(one, knee=dataclasses.replace(one.knee, name="knee", side="right"))
        for one in questions
    ]


def _named(answer: Calibration | Exception, name: str) -> Calibration | Exception:
    return dataclasses.replace(answer, knee=name) if isinstance(answer, Calibration) else answer


def _question(study: Study) -> Question:
    """What a study asks of its knee; synthetic poses take a motion of it.

    Raises:
        UnsuitableData: the knee that should make the data does not balance.
    """
    noise_mm, noise_deg = study.noise
    return Question(
        study.knee_at_start,
        measured_poses(study),
        tuple(study.parameters),
        bounds=dict(study.bounds),
        weights=study.weight_vector,
        procedures=tuple(study.procedures),
        stages=tuple(study.stages),
        noise_mm=noise_mm,
        noise_deg=noise_deg,
        offsets=tuple(study.frame_offset),
        starts=study.starts,
        seed=study.seed,
        method=study.method,
        truth=study.truth,
        title=study.title,
        settings=study.settings(),
        loads=study.acting,
        tests=tuple(study.tests),
        prior=dict(study.prior),
    )


def _get_ready(study: Study) -> None:
    """Compile the mechanics of as many poses."""
    poses = len(study.flexion_deg)
    contact_points = np.zeros((study.knee.patch_count, 2, poses))
    # Whatever may be wrong here is met again, and said, where the result is needed.
    with contextlib.suppress(Exception):
        evaluate(study.knee, Pose.from_table(np.zeros((poses, 6))), contact_points)
