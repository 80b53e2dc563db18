"""What every command on a study begins with: its knee, its start and what was measured."""

from __future__ import annotations

import dataclasses
import json

import numpy as np

from kneejax.cli._given import knee_with, parameters_named_in
from kneejax.files import Study, load_knee, read_measured, read_study, study_path
from kneejax.inference import synthetic_motion
from kneejax.mechanics import Knee
from kneejax.parameters import QUANTITIES, select


@dataclasses.dataclass(frozen=True)
class StudyProblem:
    """A study, ready to be asked something.

    Attributes:
        study: as read.
        knee: the study's knee, with its fixed values and its start.
        measured: shape `(n, 6)`, degrees and mm; measured, or made by the knee itself.
        truth: parameter -> value that made synthetic data; empty for measured data.
    """

    study: Study
    knee: Knee
    measured: np.ndarray
    truth: dict[str, float]


def study_and_knee(name: str) -> tuple[Study, Knee]:
    """A study and its knee with the values that stay fixed; nothing is computed yet.

    Args:
        name: study file or bundled study.

    Returns:
        Both.

    Raises:
        InputProblem: a file cannot be read or a field is at fault.
        UnknownParameter: the study names a parameter that its knee does not have.
    """
    study = read_study(study_path(name))
    knee = knee_with(load_knee(study.knee), study.overrides, study.path)
    made = study.synthetic.parameters if study.synthetic else {}
    bounded = [name for name in study.bounds if name not in QUANTITIES]
    with parameters_named_in(study.path):
        select(knee, study.parameters)
        for named in (*made, *study.start, *bounded):
            select(knee, [named])
    return study, knee


def with_measurement(study: Study, knee: Knee, *, calibrated: bool) -> StudyProblem:
    """A study with what was measured; synthetic data take a motion of the knee.

    Args:
        study: as read.
        knee: with the values that stay fixed.
        calibrated: whether a calibration follows; its program then makes synthetic data.

    Returns:
        The `StudyProblem`.

    Raises:
        InputProblem: a file cannot be read or a field is at fault.
        UnknownParameter: the study names a parameter that its knee does not have.
        UnsuitableData: the knee that should make the data does not balance.
    """
    truth: dict[str, float] = {}
    if study.synthetic is not None:
        truth = dict(study.synthetic.parameters)
        measured = synthetic_motion(
            knee,
            truth,
            np.asarray(study.synthetic.flexion_deg),
            study.parameters if calibrated else None,
            noise_mm=study.synthetic.noise_mm,
            noise_deg=study.synthetic.noise_deg,
            seed=study.synthetic.seed,
        )
    else:
        measured = read_measured(study)
    return StudyProblem(study, knee_with(knee, study.start, study.path), measured, truth)


def study_settings(study: Study) -> dict:
    """Everything needed to run a study again, as plain numbers and words."""
    return json.loads(json.dumps(dataclasses.asdict(study), default=_plain))


def _plain(value):
    return value.tolist() if isinstance(value, np.ndarray) else str(value)
