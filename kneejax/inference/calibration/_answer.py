"""The answer of a calibration: estimates with their limits, the motion, and how well they fit."""

__all__ = ["motion_of"]

import dataclasses
from collections.abc import Mapping

import jax
import numpy as np

from kneejax.experiments import counts_like_poses, with_flips
from kneejax.experiments import evaluate as evaluate_mechanics
from kneejax.geometry import COLUMNS, COORDINATES, FREE_COORDINATES, TIBIA
from kneejax.inference.calibration._question import CalibrationProblem
from kneejax.inference.calibration._result import (
    Calibration,
    Estimate,
    Fault,
    Fit,
    FittedTest,
    Misfit,
    Motion,
    Starts,
    versions,
)
from kneejax.inference.calibration._search import Trail
from kneejax.inference.fit import Problem, named, on_bounds, slack_at, without_offsets
from kneejax.inference.intervals import IntervalKind, MaximumLikelihood
from kneejax.statics import Slopes

#: Times a stated noise beyond which a root mean square error of many poses is more than noise.
_BEYOND_NOISE = 1.5
#: Errors of a motion without noise, mm and degrees.
_ROUNDING = 1e-4
#: Root mean square errors that no measurement of a knee has, mm and degrees.
_LARGE = {"mm": 3.0, "deg": 5.0}
#: Rise of the objective, in units of what is left for each spare number, that tells two ends apart.
_APART = 3.84


def fit_of(
    one: CalibrationProblem, procedure: str, trail: Trail, likely: MaximumLikelihood | None
) -> Fit:
    """The answer of one procedure; `likely` is None of one that is there to compare."""
    problem, found = one.fitted, trail.known
    size = len(problem.selection)
    own = without_offsets(found, problem.offsets, problem.cases.posed)
    slack = slack_at(problem.knee, problem.selection, problem.cases, own)
    held = on_bounds(trail.x, one.lower, one.upper)
    numbers = np.stack([trail.x, one.start, one.lower, one.upper], axis=1).tolist()
    estimates = []
    for i, (name, unit) in enumerate(named(problem.selection, problem.offsets)):
        value, start, lower, upper = numbers[i]
        estimate = Estimate(name, unit, value, start, lower, upper, np.nan, bool(held[i]))
        if likely is not None:
            best = float(likely.best.values[0, i])
            interval = likely.intervals[i].beside(estimate.value, best)
            vague = interval.kind in (IntervalKind.NOT_DETERMINED, IntervalKind.ONE_SIDED)
            loose = slack.get(problem.selection.ligament(i)) if vague and i < size else None
            estimate = dataclasses.replace(
                estimate, low=interval.low, high=interval.high, interval=interval.kind,
                reason=interval.reason, slack=0.0 if loose is None else float(loose.mean()),
                standard_error=np.nan if estimate.at_bound else interval.standard_error,
            )  # fmt: skip
        estimates.append(estimate)
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


def starts_of(problem: Problem, answer: Fit, ends: np.ndarray, objectives: np.ndarray) -> Starts:
    """Where several starts ended, `(starts, p)`, and which ends are not the answer."""
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
    rows, knee = problem.cases.posed, problem.knee_at(found.values[0])
    state = jax.tree.map(lambda x: np.asarray(x)[rows], problem.state(found))
    table, status = np.array(state.tibia.to_table()), found.status[0][rows]
    table[:, 0] = problem.measured[:, 0]
    if not len(table):
        parts = len(knee.ligaments.names), len(knee.contact_names)
        return Motion(table, status, *(np.empty((0, count)) for count in parts))
    contact_points = np.moveaxis(found.contact_points[0, rows], 0, -1)
    mechanics = evaluate_mechanics(knee, state, contact_points)
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


def answer_of(
    one: CalibrationProblem, first: Slopes, fits: list[Fit], likely: MaximumLikelihood
) -> Calibration:
    """What is reported of one knee; seconds are those of all, and follow."""
    problem = one.fitted
    start_rmse, start_tests = rmse_of(problem, first), fitted_tests(problem, first)
    poses = int(problem.used[problem.cases.posed].sum())
    stated, counted = one.noise.stated, one.noise.counted
    poor = misfits(fits[0].rmse, start_rmse, stated, counted, poses)
    for own, before in zip(fits[0].tests, start_tests, strict=True):
        poor += misfits_of_test(own, before, stated, counted)
    knee, noise = problem.knee, map(float, likely.noise)
    return Calibration(
        title=one.title, knee=knee.name, measured=problem.measured,
        start=motion_of(problem, first), start_rmse=start_rmse, start_tests=start_tests,
        start_partial_objectives=squares_of(problem, first),
        start_objective=problem.objective(first), fits=tuple(fits),
        ligaments=knee.ligaments.names, contacts=knee.contact_names, truth=dict(one.truth),
        noise=dict(zip(FREE_COORDINATES, noise, strict=True)),
        noise_estimated=likely.noise_estimated, misfits=poor, weights=problem.weights,
        left_out=int((~problem.used).sum()), seconds={}, versions=versions(),
        settings=dict(one.settings),
    )  # fmt: skip


def misfits(
    rmse: Mapping[str, float], start_rmse: Mapping[str, float], stated: np.ndarray,
    counted: np.ndarray, poses: int,
) -> tuple[Misfit, ...]:  # fmt: skip
    """Coordinates in which a fit is poor; `stated` noise is NaN where there is none, `(5,)`."""
    # A root mean square of so few scatters by 1 / sqrt(2 n); twice that is more than luck.
    scatter = 1.0 + float(np.sqrt(2.0 / max(poses, 1)))
    beyond = more_than_luck(poses)
    found = []
    for row, name in enumerate(FREE_COORDINATES):
        own, before, noise = rmse[name], start_rmse[name], float(stated[row])
        if not (counted[row] and np.isfinite(own)):
            continue
        unit = COLUMNS[row + 1].rsplit("_", 1)[1]
        # Below a noise that is known, the start was near by luck.
        worse = own > scatter * before + _ROUNDING and not own <= noise
        if worse:
            found.append(Misfit(name, Fault.WORSE_THAN_START, own, before))
        elif own > beyond * noise:
            found.append(Misfit(name, Fault.BEYOND_NOISE, own, noise))
        elif own > max(_LARGE[unit], np.nan_to_num(noise)):
            found.append(Misfit(name, Fault.LARGE, own, _LARGE[unit]))
    return tuple(found)


def more_than_luck(numbers: int) -> float:
    """Times the noise that a root mean square of so many numbers exceeds once in a thousand."""
    # `scipy.special` at the top would be part of every start.
    from scipy.special import chdtri

    count = max(numbers, 1)
    return max(_BEYOND_NOISE, float(np.sqrt(chdtri(count, 1e-3) / count)))


def fitted_tests(problem: Problem, found: Slopes) -> tuple[FittedTest, ...]:
    """Every test of a problem beside what one fit gives."""
    cases, data = problem.cases, problem.cases.readings
    read: dict[str, np.ndarray] = {}
    if data is not None:
        error = data.error(cases, found)[0][0]
        value = np.where(data.counted(cases), data.target + error, np.nan)
        for place, name in enumerate(data.names):
            own = data.name == place
            read[name] = np.full(len(cases.load_cases), np.nan)
            read[name][data.case[own]] = value[own]
    seen, target = cases.seen, cases.target
    error = np.where(seen, cases.error(found)[0][0], np.nan)
    return tuple(
        FittedTest(
            test,
            np.where(seen[rows], target[rows], np.nan),
            target[rows] + error[rows],
            found.status[0][rows],
            {name: read[name][rows] for name in test.readings},
        )
        for test, rows in zip(problem.tests, problem.rows_of_tests(), strict=True)
    )


def misfits_of_test(
    own: FittedTest, before: FittedTest, stated: np.ndarray, counted: np.ndarray
) -> tuple[Misfit, ...]:
    """Coordinates of a test in which a fit is poor, by the rules of poses."""
    for row, name in enumerate(FREE_COORDINATES):
        sd = own.test.sd_mm if COORDINATES[name].unit == "mm" else own.test.sd_deg
        stated = np.where(np.arange(5) == row, sd, stated) if sd is not None else stated
    stated = own.test.scatter * stated
    fitted, start = ({x: one.rmse(x) for x in FREE_COORDINATES} for one in (own, before))
    found = misfits(fitted, start, stated, counted, len(own.test.flexion_deg))
    beyond = []
    for name in own.test.readings:
        more = own.test.scatter if counts_like_poses(name) else 1.0
        rmse, noise = own.rmse(name), more * float(own.test.sd_of(name))
        if rmse > more_than_luck(len(own.test.flexion_deg)) * noise:
            beyond.append(Misfit(name, Fault.BEYOND_NOISE, rmse, noise))
    return tuple(dataclasses.replace(one, test=own.test.name) for one in (*found, *beyond))
