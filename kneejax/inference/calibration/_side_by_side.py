"""Calibrations of several knees at once: problems of one form are one batch of one search."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from kneejax.geometry import FREE_COORDINATES, scales
from kneejax.inference.calibration._answers import (
    chi_squared_unit,
    fit_of,
    motion_of,
    objective_of,
    partial_objectives_of,
    rmse_of,
    starts_of,
    sureties_of,
)
from kneejax.inference.calibration._calibrate import CalibrationProblem
from kneejax.inference.calibration._fitted_test import fitted_tests, misfits_of_test
from kneejax.inference.calibration._quality import misfits
from kneejax.inference.calibration._result import Calibration, Fit
from kneejax.inference.calibration._search import Trail, run_side_by_side
from kneejax.inference.calibration._versions import versions
from kneejax.inference.fit import Problem, Progress, SeveralKnees, form_of, several_starts
from kneejax.inference.intervals import Surety
from kneejax.numerics import adding_up, lap, stopwatch
from kneejax.parameters import UnsuitableData
from kneejax.statics import Slopes

#: Chi squared, as the fit leaves it, by which a path to the same answer must fit better for it to
#: have found other balances.
_LOWER = 0.5
#: Chi squared by which a fit must be better for the search to go on from it.
_FARTHER_DOWN = 0.1
#: Standard deviations beyond which something blocks a search; the least stiffness, as a part of the
#: median one, below which a load case may be what does; and the most of all load cases that may.
_BLOCKED, _SOFT, _FEW = 4.0, 0.2, 0.15
#: How often steps through time are chosen anew for an answer.
_STEPPINGS = 2


def calibrate(
    problem: CalibrationProblem, *, progress: Progress | None = None
) -> Calibration:
    """Identify parameters of a knee from measured poses, and from how far it gave under load.

    Args:
        problem: of one knee; `kneejax.Study.problem` makes one.
        progress: called now and then with what is computed and, of a search, how far off the knee
            still is.

    Returns:
        The `Calibration`.

    Raises:
        UnsuitableData: no pose that balances.

    Source: paper 1, sections 2.3 and 3.4.
    """
    (found,) = calibrate_side_by_side([problem], progress=progress)
    if isinstance(found, Exception):
        raise found
    return found


def calibrate_side_by_side(
    problems: Sequence[CalibrationProblem], *, progress: Progress | None = None
) -> list[Calibration | UnsuitableData]:
    """Calibrate several knees, those whose problems have one form in one batch.

    Args:
        problems: one a knee.
        progress: called now and then with what is computed.

    Returns:
        A `Calibration` each, or why there is none; those of one form share the seconds equally.
    """
    found: dict[int, Calibration | UnsuitableData] = {}
    forms: dict[object, list[tuple[int, CalibrationProblem]]] = {}
    for place, one in enumerate(problems):
        forms.setdefault(_form(place, one), []).append((place, one))
    for members in forms.values():
        places, alike = zip(*members, strict=True)
        with stopwatch() as watch:
            answers = _with_short_steps(alike, progress)
        seconds = adding_up({k: x / len(members) for k, x in watch.parts.items()})
        answers = [
            dataclasses.replace(one, seconds=seconds) if isinstance(one, Calibration) else one
            for one in answers
        ]
        found |= dict(zip(places, answers, strict=True))
    return [found[place] for place in range(len(problems))]


def _form(place: int, one: CalibrationProblem) -> object:
    """What problems have in common that are solved side by side."""
    form = form_of(one.fitted)
    if form is None:
        return place
    numbers = (one.stated, one.weights, one.lower, one.upper)
    return (
        form, *(x.tobytes() for x in numbers), one.procedures, one.stages, one.starts, one.seed,
        one.method, one.cycles,
    )  # fmt: skip


def _with_short_steps(members: Sequence[CalibrationProblem], progress: Progress | None) -> list:
    """Answers whose motions through time have steps that are short enough there too."""
    answers = _of_one_form(members, progress)
    if not members[0].fitted.cases.passages:
        return answers
    for left in reversed(range(_STEPPINGS + 1)):
        (one,), (answer,) = members, answers
        if not isinstance(answer, Calibration) or not answer.fit.success:
            break
        there = one.fitted.stepping(_values(answer))
        answers = [_with_restless(answer, there.restless)]
        if there.steps <= one.fitted.steps or not left:
            break
        _tell(progress, "shorter steps through time: once more")
        members = (dataclasses.replace(one, fitted=there),)
        answers = _of_one_form(members, progress)
    return answers


def _with_restless(answer: Calibration, restless: Mapping[str, float]) -> Calibration:
    """With how far motions are from repeating themselves."""
    fit = answer.fit
    tests = (
        dataclasses.replace(own, restless=restless.get(own.test.name, 0.0)) for own in fit.tests
    )
    fit = dataclasses.replace(fit, tests=tuple(tests))
    return dataclasses.replace(answer, fits=(fit, *answer.fits[1:]))


def _of_one_form(members: Sequence[CalibrationProblem], progress: Progress | None) -> list:
    """Answers of knees whose problems have one form."""
    _tell(progress, "first balances")
    knees = SeveralKnees.of([one.fitted for one in members])
    first = knees.begin(np.stack([one.start for one in members]))
    lap("start")
    found, sets = {}, {}
    for row, one in enumerate(members):
        try:
            one.fitted.balanced_by(first.take([row]))
        except UnsuitableData as problem:
            found[row] = problem
        else:
            sets.setdefault(first.converged[row].tobytes(), []).append(row)
    for rows in sets.values():
        # What has no balance counts for nothing; knees of one set of load cases go on together.
        some, at_start = knees.take(rows).with_used(first.converged[rows[0]]), first.take(rows)
        own = [
            dataclasses.replace(members[row], fitted=problem)
            for row, problem in zip(rows, some.problems, strict=True)
        ]
        found |= dict(zip(rows, _answers(some, own, at_start, progress), strict=True))
    return [found[row] for row in range(len(members))]


def _answers(
    knees: SeveralKnees,
    members: Sequence[CalibrationProblem],
    first: Slopes,
    progress: Progress | None,
) -> list[Calibration]:
    """Answers of knees whose load cases that count are the same.

    A search follows each balance from one step to the next, and may follow it past the end of its
    branch to another. Where tests were made or a fit is poor, a path leads to its answer as
    tests are made; if that fits better, the search goes on from there. A reading at a limit point
    lets no step pass that would take its balance away, and is then far off: where the fit without
    it leads to a better one with it, the search goes on from that.
    """
    begin = [first.take([row]) for row in range(len(members))]
    fits, sure = _fits(knees, members, begin, progress)
    answers = [
        _answer(one, start, *rest)
        for one, start, *rest in zip(members, begin, fits, sure, strict=True)
    ]
    anew = {}
    for row, answer in enumerate(answers):
        problem, objective = knees.problems[row], answer.fit.objective
        if (answer.misfits or problem.tests) and answer.fit.success:
            walked = _walked(problem, first.knee[row], _values(answer))
            spare = max(problem.counted_numbers - problem.size, 1)
            lower = objective * (1.0 - _LOWER / spare)
            if objective_of(problem, walked) < lower:
                anew[row] = walked
                continue
            freed = _past_what_blocks(problem, members[row], walked, objective / spare)
            if freed is not None and objective_of(problem, freed) < lower:
                anew[row] = freed
    if not anew:
        return answers
    _tell(progress, "a better fit is in sight: once more")
    rows = list(anew)
    own = [members[row] for row in rows]
    fits, sure = _fits(knees.take(rows), own, list(anew.values()), progress)
    for row, *rest in zip(rows, fits, sure, strict=True):
        again = _answer(members[row], begin[row], *rest)
        if again.fit.objective < answers[row].fit.objective:
            answers[row] = again
    return answers


def _past_what_blocks(
    problem: Problem, one: CalibrationProblem, there: Slopes, variance: float
) -> Slopes | None:
    """Balances where the fit ends that begins at the one without what may block the search: load
    cases near a limit point, or those that are far off.

    Args:
        problem: of one knee.
        one: the whole problem.
        there: balances at its answer.
        variance: of the residuals, as the fit leaves it.

    Returns:
        The best of them; None where nothing is far off, or a knee in motion is fitted, which has
        no limit points.
    """
    if problem.cases.passages:
        return None
    residual, _ = problem.residual(there)
    cases = np.flatnonzero(problem.cases.counted)
    largest = np.abs(residual[: 5 * len(cases)]).reshape(-1, 5).max(axis=1)
    off = ~(largest <= _BLOCKED * np.sqrt(min(variance, _unit(one))))
    if not off.any():
        return None
    units = np.array(scales(problem.cases.load_cases.of(problem.knee).free))
    # Of what the search followed past the end of its branch no stiffness is known.
    stiffness = np.nan_to_num(there.tangent[0][cases]) * units[:, None] * units
    least = np.linalg.eigvalsh(0.5 * (stiffness + stiffness.swapaxes(1, 2)))[:, 0]
    least[~there.converged[0][cases]] = 0.0
    found = []
    for far in (least < _SOFT * np.median(least), off):
        if not far.any() or far.mean() > _FEW:
            continue
        used, begin = problem.cases.counted.copy(), there
        used[cases[far]] = False
        for own in (problem.with_used(used), problem):
            knees = SeveralKnees.of([own])
            (trail,) = run_side_by_side(
                knees, "III", [begin], one.lower, one.upper, unit=_unit(one)
            )
            begin = _walked(problem, there.knee[0], trail.x)
            found.append(begin)
    known = [one for one in found if np.isfinite(objective_of(problem, one))]
    return min(known, key=lambda one: objective_of(problem, one), default=None)


def _values(answer: Calibration) -> np.ndarray:
    return np.array([one.value for one in (*answer.fit.estimates, *answer.fit.offsets)])


def _walked(problem: Problem, knee: int, values: np.ndarray) -> Slopes:
    """Balances of one knee at values, followed from its reference pose."""
    return dataclasses.replace(problem.begin(values[None]), knee=np.array([knee]))


def _fits(
    knees: SeveralKnees,
    members: Sequence[CalibrationProblem],
    first: Sequence[Slopes],
    progress: Progress | None,
) -> tuple[list[list[Fit]], list[Surety]]:
    """The answers of each procedure from given balances, and how sure that of the first is, a knee
    each."""
    one = members[0]
    lower, upper = one.lower, one.upper
    search = {"cycles": one.cycles, "method": one.method, "stages": one.stages,
              "unit": _unit(one), "progress": progress}  # fmt: skip
    fits, sure = [[] for _ in members], []
    every = range(len(members))
    for number, procedure in enumerate(one.procedures):
        begin, reached = list(first), []
        if one.starts > 1 and procedure == "III":
            _tell(progress, f"procedure III, {one.starts} starts side by side")
            reached = [_from_several(knees.problems[row], members[row]) for row in every]
            best = [ends[np.argmin(objectives)] for ends, objectives in reached]
            begin = [_walked(knees.problems[row], first[row].knee[0], best[row]) for row in every]
        trails = run_side_by_side(knees, procedure, begin, lower, upper, **search)
        lap("search")
        if not number:
            _tell(progress, f"95 % limits of {len(lower)} numbers")
            sure = sureties_of(knees, trails, one.stated, lower, upper)
            if procedure == "III":
                trails = _at_the_bottom(knees, first, trails, sure, (lower, upper), search)
            lap("limits")
        for row, trail in enumerate(trails):
            own = members[row]
            fit = fit_of(
                knees.problems[row], procedure, trail, own.start, own.lower, own.upper,
                None if number else sure[row],
            )  # fmt: skip
            if reached:
                starts = starts_of(knees.problems[row], fit, *reached[row])
                fit = dataclasses.replace(fit, starts=starts)
            fits[row].append(fit)
    return fits, sure


def _unit(one: CalibrationProblem) -> float:
    """What the objective rises by where chi squared of the stated noise does by one, if stated."""
    return chi_squared_unit(one.weights, np.asarray(one.stated, float)) or np.inf


def _at_the_bottom(knees: SeveralKnees, first, trails, sure, box, search) -> list[Trail]:
    """Trails that go on where the limits of their answers have found a better fit to the same."""
    found = list(trails)
    for row, (problem, surety) in enumerate(zip(knees.problems, sure, strict=True)):
        unit = chi_squared_unit(problem.weights, surety.noise)
        if not unit or not np.isfinite(surety.likeliest).all():
            continue
        if np.allclose(surety.likeliest, trails[row].x, rtol=1e-6, atol=1e-9):
            continue
        there = _walked(problem, first[row].knee[0], surety.likeliest)
        if not objective_of(problem, there) < trails[row].objective - _FARTHER_DOWN * unit:
            continue
        (again,) = run_side_by_side(knees.take([row]), "III", [there], *box, **search)
        if again.objective < trails[row].objective:
            found[row] = again
    return found


def _from_several(problem, one: CalibrationProblem) -> tuple[np.ndarray, np.ndarray]:
    """Where the starts of one knee end, and their objectives.

    Besides the knee's own they are drawn from what is believed, where there is a prior, otherwise
    between the bounds.
    """
    shape = one.starts - 1, len(one.start)
    draws = np.random.default_rng(one.seed)
    more = draws.uniform(one.lower, one.upper, shape)
    if problem.cases.prior is not None:
        mean, deviation = problem.cases.prior
        believed = mean + deviation * draws.standard_normal(shape)
        more = np.where(np.isfinite(deviation), np.clip(believed, one.lower, one.upper), more)
    ends, reached = several_starts(problem, np.vstack([one.start, more]), one.lower, one.upper)
    # A search may have followed balances past the end of their branch, as tests do not.
    known = np.flatnonzero(np.isfinite(reached))
    if len(known):
        residual, _ = problem.cases.residual(problem.begin(ends[known]))
        walked = np.sum(residual**2, axis=1)
        reached[known] = np.where(walked < reached[known], walked, reached[known])
    return ends, reached


def _answer(one: CalibrationProblem, first: Slopes, fits: list[Fit], surety: Surety) -> Calibration:
    """What is reported of one knee; seconds are those of all, and follow."""
    problem = one.fitted
    error = problem.error(first)
    start_rmse, start_tests = rmse_of(problem, error), fitted_tests(problem, first)
    poses = int(problem.used[problem.cases.posed].sum())
    poor = misfits(fits[0].rmse, start_rmse, one.stated, one.weights, poses)
    for own, before in zip(fits[0].tests, start_tests, strict=True):
        poor += misfits_of_test(own, before, one.stated, one.weights)
    return Calibration(
        title=one.title,
        knee=problem.knee.name,
        measured=problem.measured,
        start=motion_of(problem, first),
        start_rmse=start_rmse,
        start_partial_objectives=partial_objectives_of(problem, error),
        start_objective=objective_of(problem, first),
        start_tests=start_tests,
        fits=tuple(fits),
        ligaments=problem.knee.ligaments.names,
        contacts=problem.knee.contact_names,
        truth=dict(one.truth),
        noise=dict(zip(FREE_COORDINATES, map(float, surety.noise), strict=True)),
        noise_estimated=surety.noise_estimated,
        misfits=poor,
        weights=problem.weights,
        left_out=int((~problem.used).sum()),
        seconds={},
        versions=versions(),
        settings=dict(one.settings),
    )


def _tell(progress: Progress | None, what: str) -> None:
    if progress is not None:
        progress(what, 0, 0)
