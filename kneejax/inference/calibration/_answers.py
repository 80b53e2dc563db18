"""From where a search ended to what is reported of it."""

from __future__ import annotations

from collections.abc import Sequence

import jax
import numpy as np
from jax.typing import ArrayLike

from kneejax.experiments import evaluate as evaluate_mechanics
from kneejax.experiments import with_flips
from kneejax.geometry import FREE_COORDINATES, TIBIA, State
from kneejax.inference.calibration._quality import fitted_tests
from kneejax.inference.calibration._result import Estimate, Fit, Motion, Starts
from kneejax.inference.calibration._search import Trail, together
from kneejax.inference.fit import (
    Noise,
    Problem,
    SeveralKnees,
    offset_units,
    on_bounds,
    slack_at,
    without_offsets,
)
from kneejax.inference.intervals import Interval, IntervalKind, MaximumLikelihood, estimate, named
from kneejax.mechanics import Knee
from kneejax.statics import Slopes

#: Rise of the objective, in units of what is left for each spare number, that tells two ends apart.
_APART = 3.84


def estimates_of(
    knees: SeveralKnees,
    trails: Sequence[Trail],
    noise: Noise,
    lower: np.ndarray,
    upper: np.ndarray,
) -> list[MaximumLikelihood]:
    """The best fits near the answers of several knees, and how sure they are; constants between
    frames are values like others.

    Args:
        knees: what was fitted.
        trails: of the searches, one a knee.
        noise: as stated.
        lower: bounds, `(p,)`.
        upper: bounds.
    """
    first = knees.problems[0]
    names = named(first.selection) + offset_units(first.offsets)
    return estimate(knees.balance, knees.cases, together(trails), noise, lower, upper, names)


def fit_of(
    problem: Problem,
    procedure: str,
    trail: Trail,
    start: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    likely: MaximumLikelihood | None,
) -> Fit:
    """The answer of one procedure.

    Args:
        problem: what was fitted.
        procedure: its name.
        trail: of the search.
        start: parameters and offsets where it began.
        lower: bounds.
        upper: bounds.
        likely: how sure it is; None for a procedure that is there to compare.
    """
    found, size = trail.known, len(problem.selection)
    slack = _slack_ligaments(problem, found)
    held = on_bounds(trail.x, lower, upper)
    names = named(problem.selection) + offset_units(problem.offsets)
    estimates = []
    for i, (name, unit) in enumerate(names):
        interval = None
        if likely is not None:
            best = float(likely.best.values[0, i])
            interval = likely.intervals[i].beside(float(trail.x[i]), best)
        loose = slack.get(problem.selection.ligament(i), 0.0) if i < size else 0.0
        numbers = (trail.x[i], start[i], lower[i], upper[i])
        estimates.append(_estimate(name, unit, numbers, bool(held[i]), interval, loose))
    failed = int((~found.converged[0]).sum())
    correlation = np.full((size, size), np.nan)
    if likely is not None:
        correlation = likely.correlation[:size, :size]
    return Fit(
        procedure,
        tuple(estimates[:size]),
        objective_of(problem, found),
        partial_objectives_of(problem, found),
        rmse_of(problem, found),
        correlation,
        motion_of(problem, found),
        tuple(trail.history),
        {
            "residual": trail.evaluations,
            "jacobian": trail.evaluations,
            "equilibria": trail.evaluations * len(problem.cases.load_cases),
            **trail.counts,
        },
        bool(trail.converged and not failed),
        trail.reason,
        tuple(estimates[size:]),
        trail.ending,
        tests=fitted_tests(problem, found),
    )


def _estimate(name, unit, numbers, held, interval: Interval | None, loose) -> Estimate:
    value, start, lower, upper = map(float, numbers)
    if interval is None:
        return Estimate(name, unit, value, start, lower, upper, np.nan, held)
    vague = interval.kind in (IntervalKind.NOT_DETERMINED, IntervalKind.ONE_SIDED)
    return Estimate(
        name,
        unit,
        value,
        start,
        lower,
        upper,
        np.nan if held else interval.standard_error,
        held,
        loose if vague else 0.0,
        interval.low,
        interval.high,
        interval.kind,
        interval.reason,
    )


def starts_of(problem: Problem, answer: Fit, ends: np.ndarray, objectives: np.ndarray) -> Starts:
    """Where several starts ended, and which of them are not the answer.

    Args:
        problem: what was fitted.
        answer: the fit, with its limits.
        ends: parameters and offsets, `(starts, p)`.
        objectives: there.
    """
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
    """The poses of one fit that were measured as such, with the forces that hold them."""
    rows = problem.cases.posed
    state = jax.tree.map(lambda x: x[rows], problem.state(found))
    table = np.array(state.tibia.to_table())
    table[:, 0] = problem.measured[:, 0]
    knee = problem.knee_at(found.values[0])
    contact_points, status = problem.contact_points(found)[..., rows], found.status[0][rows]
    return motion_at(knee, table, state, contact_points, status)


def motion_at(
    knee: Knee, table: np.ndarray, state: State, contact_points: ArrayLike, status: ArrayLike
) -> Motion:
    """Poses with the forces that hold them.

    Args:
        knee: that was balanced.
        table: what is shown of the poses, degrees and mm, `(n, 6)`.
        state: the balances, `(n,)`.
        contact_points: parameters of the contact points, `(patches, 2, n)`.
        status: `Status` values, `(n,)`.
    """
    if not len(table):
        parts = len(knee.ligaments.names), len(knee.contact_names)
        return Motion(table, np.asarray(status), *(np.empty((0, count)) for count in parts))
    mechanics = evaluate_mechanics(knee, state, contact_points)
    return Motion(
        table,
        with_flips(status, mechanics),
        np.asarray(mechanics.tension),
        np.linalg.norm(np.asarray(mechanics.contact_force), axis=-1),
        knee,
        mechanics,
        {bone: np.asarray(pose.to_table()) for bone, pose in state.poses.items() if bone != TIBIA},
    )


def _slack_ligaments(problem: Problem, found: Slopes) -> dict[str, float]:
    """Ligament or group -> part of the poses at which it is slack."""
    own = without_offsets(found, problem.offsets, problem.cases.posed)
    slack = slack_at(problem.knee, problem.selection, problem.cases, own)
    return {name: float(np.mean(where)) for name, where in slack.items()}


def objective_of(problem: Problem, found: Slopes) -> float:
    """Weighted sum of squares of one fit, with what a prior says of the values."""
    residual, _ = problem.residual(found)
    return float(residual @ residual)


def partial_objectives_of(problem: Problem, found: Slopes) -> dict[str, float]:
    """Coordinate -> `Problem.squares`."""
    return dict(zip(FREE_COORDINATES, problem.squares(found).tolist(), strict=True))


def rmse_of(problem: Problem, found: Slopes) -> dict[str, float]:
    """Coordinate -> root mean square error of the poses; NaN without any."""
    rows = problem.cases.posed
    count = int(problem.used[rows].sum())
    sums = (problem.error(found)[:, rows] ** 2).sum(axis=1)
    means = sums / count if count else np.full(5, np.nan)
    return dict(zip(FREE_COORDINATES, np.sqrt(means).tolist(), strict=True))
