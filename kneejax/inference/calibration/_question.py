"""What a calibration asks of one knee, and what is made ready before it moves."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from kneejax.experiments import MeasuredTest
from kneejax.inference.calibration._search import METHODS, USUAL_CYCLES, Stage, procedures_of
from kneejax.inference.fit import DEFAULT_WEIGHTS, Problem, check_finite
from kneejax.inference.intervals import check_all_stated, stated_noise
from kneejax.mechanics import Knee, Load
from kneejax.parameters import Selection, UnsuitableData, select, start_within, stated_bounds


@dataclasses.dataclass(frozen=True, eq=False)
class Question:
    """What is asked of one knee; attributes are the arguments of `calibrate`, in their order."""

    knee: Knee
    measured: np.ndarray
    parameters: tuple[str, ...] = ("*.stiffness", "*.reference_strain")
    bounds: dict[str, tuple[float, float]] | None = None
    weights: np.ndarray | None = None
    procedures: Sequence[str] = ()
    stages: Sequence[Stage] = ()
    noise_mm: float | None = None
    noise_deg: float | None = None
    offsets: tuple[str, ...] = ()
    starts: int = 1
    seed: int = 0
    method: str = "least_squares"
    cycles: int = USUAL_CYCLES
    truth: Mapping[str, float] | None = None
    title: str = "Calibration"
    settings: Mapping[str, Any] | None = None
    loads: Sequence[Load] = ()
    tests: Sequence[MeasuredTest] = ()
    prior: Mapping[str, float] | None = None


@dataclasses.dataclass(frozen=True, eq=False)
class Ready:
    """A question whose names and numbers are known to be right.

    Attributes:
        question: as it was asked.
        problem: what is fitted.
        stated: standard deviations of the free coordinates, NaN where none is stated, `(5,)`.
        weights: of squared errors, `(5,)`.
        start: values where the search begins, parameters, then constants between frames, `(p,)`.
        lower: bounds.
        upper: bounds.
        procedures: that are run; the first gives the answer.
    """

    question: Question
    problem: Problem
    stated: np.ndarray
    weights: np.ndarray
    start: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    procedures: tuple[str, ...]


def ready(question: Question) -> Ready:
    """Check a question, and lay out what is fitted.

    Raises:
        UnknownParameter: as `calibrate`, and so do the others.
        UnsuitableData: likewise.
    """
    knee, tests = question.knee, question.tests
    procedures = procedures_of(question.procedures, question.stages)
    if question.method not in METHODS:
        known = ", ".join(METHODS)
        raise UnsuitableData(f"unknown method {question.method!r}: expected one of {known}")
    selection = select(knee, question.parameters)
    stated = stated_noise(question.noise_mm, question.noise_deg)
    weights = question.weights
    if question.prior or any(test.readings for test in tests):
        check_all_stated(stated, "prior" if question.prior else "readings")
        # One over the variances: against these, what is not of a pose counts in its own.
        counts = np.ones(5) if weights is None else np.asarray(weights, float) > 0
        weights = np.where(counts, stated**-2.0, 0.0)
    weights = DEFAULT_WEIGHTS if weights is None else np.asarray(weights, float)
    problem = Problem.of(
        knee, selection, question.measured, weights, question.offsets, question.loads, tests, stated
    )
    check_finite(problem.measured)
    check_offsets(problem)
    start, lower, upper = _box(knee, selection, question.bounds or {}, len(question.offsets))
    if question.prior:
        problem = problem.with_prior(start, question.prior)
    problem = problem.stepping(start)
    return Ready(question, problem, stated, weights, start, lower, upper, procedures)


def check_offsets(problem: Problem) -> None:
    """Refuse constants between frames that absorb all that was measured.

    Raises:
        UnsuitableData: fewer than two poses for each.
    """
    poses = np.asarray(problem.cases.load_cases.flexion)[problem.cases.posed]
    angles = len(np.unique(np.round(poses, 12)))
    if problem.offsets and angles < 2:
        raise UnsuitableData(
            f"frame_offset: {', '.join(problem.offsets)} with {angles} measured "
            f"pose{'s' * (angles != 1)}; expected two poses or more, since an unknown constant "
            "absorbs a single one"
        )


def _box(knee: Knee, selection: Selection, bounds, offsets: int) -> tuple[np.ndarray, ...]:
    """Start, lower and upper bounds of parameters, then of constants between frames."""
    lower, upper = stated_bounds(knee, selection, bounds)
    start = start_within(knee, selection, lower, upper)
    # A frame is rarely off by more than 10 mm or 10 degrees.
    wide = np.full(offsets, 10.0)
    return np.r_[start, 0.0 * wide], np.r_[lower, -wide], np.r_[upper, wide]
