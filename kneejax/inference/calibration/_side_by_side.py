"""Calibrations of several knees at once: problems of one form are one batch of one search."""

__all__ = ["calibrate", "calibrate_side_by_side"]

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from kneejax.geometry import scales
from kneejax.inference.calibration._answer import answer_of, fit_of, starts_of
from kneejax.inference.calibration._question import CalibrationProblem, SeveralKnees
from kneejax.inference.calibration._result import Calibration, Fit
from kneejax.inference.calibration._search import Trail, run_procedure, together
from kneejax.inference.fit import (
    Problem,
    Progress,
    balances_of,
    best_offsets,
    fit_lanes,
    form_of,
    named,
)
from kneejax.inference.intervals import MaximumLikelihood, estimate
from kneejax.numerics import adding_up, lap, stopwatch
from kneejax.parameters import UnsuitableData
from kneejax.statics import Slopes

#: Chi squared, as the fit leaves it, by which a path to the same answer must fit better for it to
#: have found other balances.
_LOWER = 0.5
#: Standard deviations beyond which something blocks a search; the least stiffness, as a part of the
#: median one, below which a load case may be what does; and the most of all load cases that may.
_BLOCKED, _SOFT, _FEW = 4.0, 0.2, 0.15
#: How often steps through time are chosen anew for an answer.
_STEPPINGS = 2


def calibrate(problem: CalibrationProblem, *, progress: Progress | None = None) -> Calibration:
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
        form, noise = form_of(one.fitted), one.noise
        numbers = noise.stated, noise.ratio, one.lower, one.upper
        alike = (
            form, noise.given, *(x.tobytes() for x in numbers), one.procedures, one.stages,
            one.starts, one.seed, one.method, one.cycles,
        )  # fmt: skip
        forms.setdefault(place if form is None else alike, []).append((place, one))
    for members in forms.values():
        places, alike = zip(*members, strict=True)
        with stopwatch() as watch:
            answers = _with_short_steps(alike, progress or (lambda *_: None))
        seconds = adding_up({k: x / len(members) for k, x in watch.parts.items()})
        answers = [
            dataclasses.replace(one, seconds=seconds) if isinstance(one, Calibration) else one
            for one in answers
        ]
        found |= dict(zip(places, answers, strict=True))
    return [found[place] for place in range(len(problems))]


def _with_short_steps(members: Sequence[CalibrationProblem], progress: Progress) -> list:
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
        progress("shorter steps through time: again", 0, 0)
        members = (dataclasses.replace(one, fitted=there),)
        answers = _of_one_form(members, progress)
    return answers


def _with_restless(answer: Calibration, restless: Mapping[str, float]) -> Calibration:
    """With how far motions are from repeating themselves."""
    fit, *others = answer.fits
    tests = tuple(
        dataclasses.replace(own, restless=restless.get(own.test.name, 0.0)) for own in fit.tests
    )
    return dataclasses.replace(answer, fits=(dataclasses.replace(fit, tests=tests), *others))


def _of_one_form(members: Sequence[CalibrationProblem], progress: Progress) -> list:
    """Answers of knees whose problems have one form."""
    progress("first balances", 0, 0)
    knees = SeveralKnees.of(members)
    first = knees.whole.begin(np.stack([one.start for one in members]))
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
        some = knees.take(rows).each(Problem.with_used, first.converged[rows[0]])
        found |= dict(zip(rows, _answers(some, first.take(rows), progress), strict=True))
    return [found[row] for row in range(len(members))]


def _answers(knees: SeveralKnees, first: Slopes, progress: Progress) -> list[Calibration]:
    """Answers of knees whose load cases that count are the same. A search may follow balances past
    the end of their branch: it goes on from a path to its answer, as tests are made, that fits
    better. A reading at a limit point lets no step pass: it goes on from a better fit found without
    it."""
    begin = [first.take([row]) for row in range(len(first.values))]
    knees, fits, sure = _fits(knees, begin, progress)
    answers = [answer_of(*each) for each in zip(knees.members, begin, fits, sure, strict=True)]
    anew = {}
    for row, (one, answer) in enumerate(zip(knees.members, answers, strict=True)):
        problem, objective = one.fitted, answer.fit.objective
        if (answer.misfits or problem.tests) and answer.fit.success:
            there = _continued(problem, first.knee[row], _values(answer))
            spare = max(problem.counted_numbers - problem.size, 1)
            lower = objective * (1.0 - _LOWER / spare)
            if problem.objective(there) < lower:
                anew[row] = there
                continue
            freed = _past_what_blocks(one, there, objective / spare)
            if freed is not None and problem.objective(freed) < lower:
                anew[row] = freed
    if not anew:
        return answers
    progress("a better fit is in sight: again", 0, 0)
    some, fits, sure = _fits(knees.take(list(anew)), list(anew.values()), progress)
    for row, one, *rest in zip(anew, some.members, fits, sure, strict=True):
        again, problem = answer_of(one, begin[row], *rest), knees.members[row].fitted
        # Its own noise, where that is estimated, would make any fit as good as another.
        there = _continued(problem, first.knee[row], _values(again))
        if problem.objective(there) < answers[row].fit.objective:
            answers[row] = again
    return answers


def _past_what_blocks(
    one: CalibrationProblem, there: Slopes, variance: float
) -> Slopes | None:
    """Balances where the fit ends that begins at the one without load cases near a limit point, or
    far off by the residuals' `variance`; None without such, or of a knee in motion, which has no
    limit points."""
    problem = one.fitted
    if problem.cases.passages:
        return None
    residual, _ = problem.residual(there)
    cases = np.flatnonzero(problem.used)
    largest = np.abs(residual[: 5 * len(cases)]).reshape(-1, 5).max(axis=1)
    off = ~(largest <= _BLOCKED * np.sqrt(min(variance, one.noise.unit)))
    if not off.any():
        return None
    units = np.array(scales(problem.cases.load_cases.of(problem.knee).free))
    # Of what the search followed past the end of its branch no stiffness is known.
    stiffness = np.nan_to_num(there.tangent[0][cases]) * units[:, None] * units
    least = np.linalg.eigvalsh(0.5 * (stiffness + stiffness.swapaxes(1, 2)))[:, 0]
    least[~there.converged[0][cases]] = 0.0
    found, plain = [], dataclasses.replace(one, method="least_squares")
    for far in (least < _SOFT * np.median(least), off):
        if not far.any() or far.mean() > _FEW:
            continue
        used, begin = problem.used.copy(), there
        used[cases[far]] = False
        for fitted in (problem.with_used(used), problem):
            alone = SeveralKnees.of([dataclasses.replace(plain, fitted=fitted)])
            (trail,) = run_procedure(alone, "III", [begin])
            begin = _continued(problem, there.knee[0], trail.x)
            found.append(begin)
    known = [one for one in found if np.isfinite(problem.objective(one))]
    return min(known, key=problem.objective, default=None)


def _values(answer: Calibration) -> np.ndarray:
    return np.array([one.value for one in (*answer.fit.estimates, *answer.fit.offsets)])


def _continued(problem: Problem, knee: int, values: np.ndarray) -> Slopes:
    """Balances of one knee at values, followed from its reference pose."""
    return dataclasses.replace(problem.begin(values[None]), knee=np.array([knee]))


def _fits(
    knees: SeveralKnees, first: Sequence[Slopes], progress: Progress
) -> tuple[SeveralKnees, list[list[Fit]], list[MaximumLikelihood]]:
    """Knees with the noise known in the end, answers of each procedure from given balances, and how
    sure that of the first is, a knee each."""
    one, fits, sure = knees.members[0], [[] for _ in knees.members], []
    lower, upper = one.lower, one.upper
    for number, procedure in enumerate(one.procedures):
        begin, reached = list(first), []
        if one.starts > 1 and procedure == "III":
            if one.noise.estimated and not number:
                # Ends of several starts are compared with the noise that one of them leaves.
                trails = run_procedure(knees, procedure, begin, progress)
                left = one.noise.left(knees.whole.cases, together(trails), lower, upper)
                knees = knees.weighing(left) if one.noise.weighs else knees
            progress(f"procedure III, {one.starts} starts side by side", 0, 0)
            reached = [_from_several(own) for own in knees.members]
            best = [ends[np.argmin(objectives)] for ends, objectives in reached]
            every = zip(knees.members, first, best, strict=True)
            begin = [_continued(own.fitted, x.knee[0], values) for own, x, values in every]
        trails = run_procedure(knees, procedure, begin, progress)
        lap("search")
        if not number:
            progress(f"95 % limits of {len(lower)} numbers", 0, 0)
            # Constants between frames are values like others.
            names = named(one.fitted.selection, one.fitted.offsets)
            near, data = together(trails), knees.whole.cases
            sure = estimate(knees.whole.balance, data, near, one.noise, lower, upper, names)
            if procedure == "III":
                if one.noise.weighs:
                    knees = knees.weighing([likely.noise for likely in sure])
                for own, *where in zip(knees.members, first, trails, sure, strict=True):
                    _to_the_bottom(own, *where)
            lap("limits")
        for row, (own, trail) in enumerate(zip(knees.members, trails, strict=True)):
            fit = fit_of(own, procedure, trail, None if number else sure[row])
            if reached:
                ends, objectives = reached[row]
                known = np.isfinite(objectives)
                objectives[known] = _continued_objectives(own.fitted, ends[known])
                starts = starts_of(own.fitted, fit, ends, objectives)
                fit = dataclasses.replace(fit, starts=starts)
            fits[row].append(fit)
    return knees, fits, sure


def _to_the_bottom(
    one: CalibrationProblem, first: Slopes, trail: Trail, likely: MaximumLikelihood
) -> None:
    """Lead a trail on to the best fit, around which the limits are."""
    problem = one.fitted
    if one.noise.weighs:  # without a prior or readings
        trail.history = [
            dataclasses.replace(step, objective=float(squares @ problem.weights))
            for step, squares in zip(trail.history, trail.squares, strict=True)
        ]
        trail.objective = problem.objective(trail.known)
    if not (trail.converged and likely.converged):
        return
    there = _continued(problem, first.knee[0], likely.best.values[0])
    objective = problem.objective(there)
    if not (problem.used & ~there.converged[0]).any() and not objective > trail.objective:
        trail.flat = False
        trail.counts["III"] = trail.counts.get("III", 0) + 1
        trail.move(problem, there, objective, "III")


#: Evaluations of each of several starts.
_STEPS_OF_STARTS = 40


def _from_several(one: CalibrationProblem) -> tuple[np.ndarray, np.ndarray]:
    """Where the starts of one knee end, `(starts, p)`, and their objectives, infinite where one
    found no balance; they are drawn from what is believed, or between the bounds."""
    problem, shape = one.fitted, (one.starts - 1, len(one.start))
    size, prior = len(problem.selection), problem.cases.prior
    draws = np.random.default_rng(one.seed)
    more = draws.uniform(one.lower, one.upper, shape)
    if prior is not None:
        mean, deviation = prior
        believed = mean + deviation * draws.standard_normal(shape)
        more = np.where(np.isfinite(deviation), np.clip(believed, one.lower, one.upper), more)
        prior = mean[:size], deviation[:size]
    # The best constants between frames are known at every step; they need no start.
    data = dataclasses.replace(problem.cases, offsets=problem.offsets, prior=prior)
    balance = balances_of(problem.knee, problem.selection, data)
    values = np.vstack([one.start, more])[:, :size]
    fit = fit_lanes(
        balance, data, balance(values), values, one.lower[:size], one.upper[:size],
        most=_STEPS_OF_STARTS, far=True,
    )  # fmt: skip
    shifts = [best_offsets(data, fit.slopes.take([row])) for row in range(len(fit.values))]
    ends = np.hstack([fit.values, np.reshape(shifts, (len(shifts), -1))])
    reached = fit.chi2
    # A search may have followed balances past the end of their branch, as tests do not.
    known = np.flatnonzero(np.isfinite(reached))
    there = _continued_objectives(problem, ends[known])
    reached[known] = np.where(there < reached[known], there, reached[known])
    return ends, reached


def _continued_objectives(problem: Problem, values: np.ndarray) -> np.ndarray:
    """Of balances followed from the reference pose to values `(fits, p)`; infinite without."""
    if not len(values):
        return np.empty(0)
    residual, _ = problem.cases.residual(problem.begin(values))
    return np.nan_to_num(np.sum(residual**2, axis=1), nan=np.inf)
