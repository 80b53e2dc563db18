"""What each parameter of a study does to the motion."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import time
from collections.abc import Callable, Iterator

import numpy as np

from kneejax.files.reading import Field, InputProblem
from kneejax.inference import (
    LocalSensitivity,
    MotionIndices,
    Sweeps,
    local_sensitivity,
    motion_indices,
    sweep,
)
from kneejax.inference.sensitivity import (
    USUAL_COUNT,
    USUAL_SAMPLES,
    index_ranges,
    step_widths,
    sweep_values,
)
from kneejax.mechanics import range_of_parameter
from kneejax.numerics import check_installed
from kneejax.parameters import stated
from kneejax.studies._poses import measured_poses
from kneejax.studies._questions import Sensitivity
from kneejax.studies._study import Study

_MOST_VALUES, _MOST_SAMPLES = 1000, 1_000_000  # of a sweep, of a method


@dataclasses.dataclass(frozen=True)
class Sensitivities:
    """What each parameter of a study does to the motion.

    Attributes:
        study: that was asked.
        question: what was asked, with the samples that were taken.
        measured: poses of the study, `(n, 6)`, degrees and mm.
        local: exact slopes.
        sweeps: one parameter at a time over a range.
        indices: global ones; None unless they were asked for.
        seconds: that each took: `local`, `sweeps`, `global`.
    """

    study: Study
    question: Sensitivity
    measured: np.ndarray
    local: LocalSensitivity
    sweeps: Sweeps
    indices: MotionIndices | None
    seconds: dict[str, float]


def check(study: Study, question: Sensitivity) -> None:
    """Refuse what cannot be answered; see `kneejax.studies.check`."""
    _check_used(question)
    knee, selection = study.knee_at_start, study.selection
    sweep_values(knee, _swept(study, question))
    for name, width in question.prior.items():
        allowed = range_of_parameter(name)
        Field("prior", name, width).number(allowed and allowed.spread)
    for name, ends in question.range.items():
        Field("range", name, list(ends)).interval(range_of_parameter(name))
    stated(selection, question.prior, "prior")
    values = np.asarray(selection.read(knee))
    step_widths(selection, values, question.scale, question.prior)
    if question.indices is None:
        return
    Field("seed", "seed", question.seed).integer(0)
    check_installed("SALib", "sensitivity")
    samples = _samples(question)
    Field("samples", "samples", samples).integer(0, _MOST_SAMPLES)
    index_ranges(
        knee, selection, study.limits, question.range, question.prior,
        method=question.indices, samples=samples,
    )  # fmt: skip


def answered(
    study: Study, question: Sensitivity, progress: Callable[[str, int, int], None] | None
) -> Sensitivities:
    """Sweep, differentiate, and if asked compute global indices; see `kneejax.run`."""
    measured = measured_poses(study)
    knee, parameters = study.knee_at_start, tuple(study.parameters)
    flexion, seconds = np.unique(measured[:, 0]), {}

    with _timed(seconds, "local"):
        local = local_sensitivity(
            knee, parameters, flexion, scale=question.scale, given=question.prior
        )
    with _timed(seconds, "sweeps"):
        sweeps = sweep(
            knee,
            _swept(study, question),
            flexion,
            progress=progress and functools.partial(progress, "sweeps"),
            failures=study.counted_failures,
        )
    indices = None
    if question.indices is not None:
        question = dataclasses.replace(question, samples=_samples(question))
        with _timed(seconds, "global"):
            indices = motion_indices(
                knee,
                parameters,
                measured,
                weights=study.weight_vector,
                offsets=tuple(study.frame_offset),
                bounds=study.limits,
                ranges=question.range,
                priors=question.prior,
                method=question.indices,
                samples=question.samples,
                seed=question.seed,
                progress=progress and functools.partial(progress, "indices"),
                failures=study.counted_failures,
            )
    return Sensitivities(study, question, measured, local, sweeps, indices, seconds)


def _samples(question: Sensitivity) -> int:
    usual = USUAL_SAMPLES.get(question.indices or "", 0)
    return usual if question.samples is None else question.samples


def _check_used(question: Sensitivity) -> None:
    """What would have no effect is a misunderstanding."""
    if question.indices is not None:
        return
    for name in ("range", "samples"):
        if getattr(question, name) not in ({}, None):
            expected = "global indices (--global sobol or morris)"
            raise InputProblem(name, "indices", "none", expected)
    if question.prior and question.scale == "percent":
        expected = "--scale prior, or global indices"
        raise InputProblem("prior", "scale", "percent", expected)


def _swept(study: Study, question: Sensitivity) -> dict[str, np.ndarray | None]:
    """Name or wildcard -> values, None for the usual ones."""
    asked = question.sweep or dict.fromkeys(study.parameters)
    return {name: None if ends is None else _line(name, ends) for name, ends in asked.items()}


def _line(name: str, ends: tuple[float, ...]) -> np.ndarray:
    field = Field("sweep", name, list(ends))
    if len(ends) not in (2, 3):
        raise field.problem("a first and a last value, and how many if not as many as usual")
    limits = Field("sweep", name, list(ends[:2])).interval(range_of_parameter(name))
    count = field.items("numbers")[2].integer(2, _MOST_VALUES) if ends[2:] else USUAL_COUNT
    return np.linspace(*limits, count)


@contextlib.contextmanager
def _timed(seconds: dict[str, float], what: str) -> Iterator[None]:
    begun = time.perf_counter()
    yield
    seconds[what] = time.perf_counter() - begun
