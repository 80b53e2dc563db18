"""Calibration: which ligaments make the model move as measured, and how sure that is."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import jax
import numpy as np

from kneejax.experiments import MeasuredTest, with_flips
from kneejax.experiments import evaluate as evaluate_mechanics
from kneejax.geometry import FREE_COORDINATES, TIBIA
from kneejax.inference.calibration._quality import fitted_tests
from kneejax.inference.calibration._result import Estimate, Fit, Motion, Starts
from kneejax.inference.calibration._search import (
    METHODS,
    USUAL_CYCLES,
    Stage,
    Trail,
    procedures_of,
)
from kneejax.inference.fit import (
    Noise,
    Problem,
    check_finite,
    named,
    on_bounds,
    slack_at,
    without_offsets,
)
from kneejax.inference.intervals import Interval, IntervalKind, MaximumLikelihood
from kneejax.mechanics import Knee, Load
from kneejax.parameters import Selection, UnsuitableData, start_within, stated_bounds
from kneejax.statics import Slopes


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
            if noise.estimated:
                what = "prior" if prior else "readings"
                raise UnsuitableData(
                    f"{what}: expected noise_mm and noise_deg too, against which it counts"
                )
        weights = noise.first**-2.0
        fitted = Problem.of(knee, selection, measured, weights, offsets, loads, tests, noise.stated)
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
        if not self.noise.weighs:
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


#: Rise of the objective, in units of what is left for each spare number, that tells two ends apart.
_APART = 3.84


def fit_of(
    problem: Problem, procedure: str, trail: Trail, start: np.ndarray, lower: np.ndarray,
    upper: np.ndarray, likely: MaximumLikelihood | None,
) -> Fit:  # fmt: skip
    """The answer of one procedure that began at parameters and offsets `start`; `likely` says how
    sure it is, None for a procedure that is there to compare."""
    found, size = trail.known, len(problem.selection)
    own = without_offsets(found, problem.offsets, problem.cases.posed)
    slack = slack_at(problem.knee, problem.selection, problem.cases, own)
    held = on_bounds(trail.x, lower, upper)
    estimates = []
    for i, (name, unit) in enumerate(named(problem.selection, problem.offsets)):
        value, begin, low, high = map(float, (trail.x[i], start[i], lower[i], upper[i]))
        one = Estimate(name, unit, value, begin, low, high, np.nan, bool(held[i]))
        if likely is not None:
            loose = slack.get(problem.selection.ligament(i)) if i < size else None
            interval = likely.intervals[i].beside(one.value, float(likely.best.values[0, i]))
            one = _with_interval(one, interval, 0.0 if loose is None else float(loose.mean()))
        estimates.append(one)
    correlation = np.full((size, size), np.nan)
    if likely is not None:
        correlation = likely.correlation[:size, :size]
    looks, cases = trail.evaluations, len(problem.cases.load_cases)
    counts = {"residual": looks, "jacobian": looks, "equilibria": looks * cases, **trail.counts}
    return Fit(
        procedure, tuple(estimates[:size]), problem.objective(found), squares_of(problem, found),
        rmse_of(problem, found), correlation, motion_of(problem, found), tuple(trail.history),
        counts, bool(trail.converged and found.converged[0].all()), trail.reason,
        tuple(estimates[size:]), trail.ending, tests=fitted_tests(problem, found),
    )  # fmt: skip


def _with_interval(one: Estimate, interval: Interval, loose: float) -> Estimate:
    vague = interval.kind in (IntervalKind.NOT_DETERMINED, IntervalKind.ONE_SIDED)
    return dataclasses.replace(
        one, low=interval.low, high=interval.high, interval=interval.kind, reason=interval.reason,
        standard_error=np.nan if one.at_bound else interval.standard_error,
        slack=loose if vague else 0.0,
    )  # fmt: skip


def starts_of(problem: Problem, answer: Fit, ends: np.ndarray, objectives: np.ndarray) -> Starts:
    """Where several starts ended, parameters and offsets `(starts, p)` with their objectives, and
    which of them are not the answer."""
    order = np.argsort(objectives)
    ends, objectives = ends[order], objectives[order]
    estimates = (*answer.estimates, *answer.offsets)
    spare = max(problem.counted_numbers - len(estimates), 1)
    rise = (objectives - answer.objective) / max(answer.objective / spare, 1e-300)
    low = np.array([e.low if np.isfinite(e.low) else e.lower for e in estimates])
    high = np.array([e.high if np.isfinite(e.high) else e.upper for e in estimates])
    outside = ((ends < low) | (ends > high)).any(axis=1)
    elsewhere = ~(rise <= _APART)
    return Starts(tuple(map(float, objectives)), ends, elsewhere, outside & ~elsewhere)


def motion_of(problem: Problem, found: Slopes) -> Motion:
    """The poses of one fit that were measured as such, with the forces that hold them.

    Args:
        problem: that was fitted.
        found: balances at its values, one variant.
    """
    rows, knee = problem.cases.posed, problem.knee_at(found.values[0])
    state = jax.tree.map(lambda x: x[rows], problem.state(found))
    table, status = np.array(state.tibia.to_table()), found.status[0][rows]
    table[:, 0] = problem.measured[:, 0]
    if not len(table):
        parts = len(knee.ligaments.names), len(knee.contact_names)
        return Motion(table, status, *(np.empty((0, count)) for count in parts))
    mechanics = evaluate_mechanics(knee, state, problem.contact_points(found)[..., rows])
    contact_forces = np.linalg.norm(np.asarray(mechanics.contact_force), axis=-1)
    others = {bone: np.asarray(x.to_table()) for bone, x in state.poses.items() if bone != TIBIA}
    return Motion(
        table, with_flips(status, mechanics), np.asarray(mechanics.tension), contact_forces, knee,
        mechanics, others,
    )  # fmt: skip


def squares_of(problem: Problem, found: Slopes) -> dict[str, float]:
    """Coordinate -> `Problem.squares`."""
    return dict(zip(FREE_COORDINATES, problem.squares(found).tolist(), strict=True))


def rmse_of(problem: Problem, found: Slopes) -> dict[str, float]:
    """Coordinate -> root mean square error of the poses; NaN without any."""
    rows = problem.cases.posed
    count = int(problem.used[rows].sum())
    sums = (problem.error(found)[:, rows] ** 2).sum(axis=1)
    means = sums / count if count else np.full(5, np.nan)
    return dict(zip(FREE_COORDINATES, np.sqrt(means).tolist(), strict=True))
