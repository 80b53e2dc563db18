"""Calibration: which ligaments make the model move as measured, and how sure that is."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from kneejax.experiments import MeasuredTest
from kneejax.inference.calibration._search import METHODS, USUAL_CYCLES, Stage, procedures_of
from kneejax.inference.fit import Noise, Problem, check_finite
from kneejax.mechanics import Knee, Load
from kneejax.parameters import Selection, UnsuitableData, start_within, stated_bounds


@dataclasses.dataclass(frozen=True, eq=False)
class CalibrationProblem:
    """What a calibration fits, between which bounds, and how it searches.

    Attributes:
        fitted: the problem of least squares.
        noise: of what was measured, by which squared errors weigh.
        start: values where the search begins, parameters, then constants between frames, `(p,)`.
        lower: bounds, `(p,)`.
        upper: bounds.
        procedures: any of `PROCEDURES`; the first is reported as the answer, and alone gets error
            bars.
        stages: of procedure `S`, in turn. Error bars are those of all data together.
        starts: number of starts of procedure III, besides the knee's own drawn from the prior, or
            between the bounds where there is none.
        seed: of those draws.
        method: one of `METHODS`; `lbfgsb` takes seconds for each step of a procedure.
        cycles: how often procedures I and II may go through their two steps.
        truth: values that made the data, where they were made.
        title: for the report.
        settings: recorded with the result.
    """

    fitted: Problem
    noise: Noise
    start: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    procedures: tuple[str, ...]
    stages: tuple[Stage, ...] = ()
    starts: int = 1
    seed: int = 0
    method: str = "least_squares"
    cycles: int = USUAL_CYCLES
    truth: Mapping[str, float] = dataclasses.field(default_factory=dict)
    title: str = "Calibration"
    settings: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    @classmethod
    def of(
        cls,
        knee: Knee,
        selection: Selection,
        measured: np.ndarray,
        *,
        bounds: Mapping[str, tuple[float, float]] | None = None,
        noise: Noise | None = None,
        offsets: tuple[str, ...] = (),
        loads: Sequence[Load] = (),
        tests: Sequence[MeasuredTest] = (),
        prior: Mapping[str, float] | None = None,
        **search: Any,
    ) -> CalibrationProblem:
        """Lay out what is fitted; data and bounds are held against the knee.

        Args:
            knee: gives everything that is not free, and the start of what is.
            selection: the free parameters.
            measured: `(n, 6)` in the order of `kneejax.geometry.COLUMNS`, degrees and mm; flexion
                is prescribed, the other five are compared. It may be empty where there are tests.
            bounds: by name; those of paper 1 for stiffness and reference strain by default.
            noise: of what was measured; estimated by default.
            offsets: free coordinates whose constant difference between measured and model frame is
                unknown too.
            loads: on the tibia while the poses were measured, each one for all or one per pose.
            tests: under load that were made; they count like poses, each by its deviation.
            prior: name, `*.quantity` or quantity -> standard deviation of a normal prior around
                the start's value.
            **search: the attributes from `procedures` on.

        Raises:
            UnknownParameter: a prior of what is not free.
            UnsuitableData: bounds that exclude the start, numbers that are not finite, an unknown
                method, or a prior or readings where nobody states the noise.
        """
        stages = search.get("stages", ())
        search["procedures"] = procedures_of(search.get("procedures", ()), stages)
        if search.get("method", "least_squares") not in METHODS:
            known = ", ".join(METHODS)
            raise UnsuitableData(f"unknown method {search['method']!r}: expected one of {known}")
        noise = noise or Noise.of()
        if prior or any(test.readings for test in tests):
            # What is not of a pose counts in a standard deviation of its own.
            noise = noise.as_stated()
            noise.check_stated("prior" if prior else "readings")
        weights = noise.first**-2.0
        fitted = Problem.of(
            knee, selection, measured, weights, offsets, loads, tests, noise.stated
        )
        check_finite(fitted.measured)
        _check_offsets(fitted)
        lower, upper = stated_bounds(knee, selection, bounds or {})
        start = start_within(knee, selection, lower, upper)
        # A frame is rarely off by more than 10 mm or 10 degrees.
        wide = np.full(len(offsets), 10.0)
        start, lower, upper = np.r_[start, 0.0 * wide], np.r_[lower, -wide], np.r_[upper, wide]
        if prior:
            fitted = fitted.with_prior(start, prior)
        fitted = fitted.stepping(start)
        return cls(fitted, noise, start, lower, upper, **search)

    def weighing(self, noise: np.ndarray) -> CalibrationProblem:
        """The same whose squares weigh by the noise that an answer left, `(5,)`, where it was
        estimated."""
        if self.noise.given or not self.noise.estimated:
            return self
        return dataclasses.replace(self, fitted=self.fitted.weighing(np.asarray(noise, float)))


def _check_offsets(problem: Problem) -> None:
    """Refuse constants between frames that absorb all that was measured."""
    poses = np.asarray(problem.cases.load_cases.flexion)[problem.cases.posed]
    angles = len(np.unique(np.round(poses, 12)))
    if problem.offsets and angles < 2:
        raise UnsuitableData(
            f"frame_offset: {', '.join(problem.offsets)} with {angles} measured "
            f"pose{'s' * (angles != 1)}; expected two poses or more, since an unknown constant "
            "absorbs a single one"
        )
