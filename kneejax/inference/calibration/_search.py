"""The searches that move parameters: stages, procedures I to III, several starts."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from kneejax.inference.calibration._question import PROCEDURES, CalibrationProblem
from kneejax.inference.calibration._result import Ending, Iteration
from kneejax.inference.fit import Problem, Progress, SeveralKnees, fit_lanes, minimise_bounded
from kneejax.statics import Slopes

_MAX_EVALUATIONS = 200
# A search ends when this many accepted steps lower chi squared by less than this altogether.
_WINDOW, _INSIGNIFICANT = 6, 0.5
# Relative decrease of the objective, and relative step, that end a stage.
_RTOL, _ATOL = 1e-10, 1e-9
# Effect of a number, relative to the largest of all, below which poses hardly depend on it.
_SILENT = 1e-3
# Cycles that Anderson's extrapolation looks back on, and the relative decrease of the objective in
# a cycle that ends the search.
_MEMORY, _TOLERANCE = 6, 1e-6


@dataclasses.dataclass
class Trail:
    """What a search has done so far."""

    known: Slopes  # balances at the best values, one variant
    objective: float  # there
    history: list[Iteration]  # accepted steps
    counts: dict[str, int]  # evaluations by stage
    converged: bool = True  # whether the last stage ended by itself
    flat: bool = False  # whether it ended because further steps gained less than the noise
    reason: str = ""  # why it did not converge, where the search can tell
    progress: Progress | None = None  # told of each step
    # `Problem.squares` of each of them.
    squares: list[np.ndarray] = dataclasses.field(default_factory=list)

    @property
    def x(self) -> np.ndarray:
        """The best parameters and offsets, `(p,)`."""
        return self.known.values[0]

    @property
    def ending(self) -> Ending:
        """Why it ended."""
        if self.flat:
            return Ending.FLAT
        return Ending.CONVERGED if self.converged else Ending.STOPPED

    @property
    def evaluations(self) -> int:
        """Evaluations of all poses and their Jacobian."""
        return sum(self.counts.values())

    def weighed(self, problem: Problem) -> Trail:
        """The same with the weights of a problem without a prior or readings."""
        history = [
            dataclasses.replace(step, objective=float(squares @ problem.weights))
            for step, squares in zip(self.history, self.squares, strict=True)
        ]
        objective = problem.objective(self.known)
        return dataclasses.replace(self, history=history, objective=objective)

    def moved(self, problem: Problem, there: Slopes, stage: str) -> Trail:
        """The same, ended by itself where its problem has its best fit."""
        trail = dataclasses.replace(
            self, history=[*self.history], squares=[*self.squares], converged=True, flat=False,
            counts={**self.counts, stage: self.counts.get(stage, 0) + 1},
        )  # fmt: skip
        _move(problem, trail, there, problem.objective(there), stage)
        return trail


def run_procedure(
    one: CalibrationProblem, knees: SeveralKnees, procedure: str, starts: Sequence[Slopes],
    progress: Progress | None = None,
) -> list[Trail]:  # fmt: skip
    """Search by one of paper 1's procedures, or in stages of one's own, side by side where the
    search allows it, from balances at the first values, one variant a knee; `one` says between
    which bounds and how. Of a knee alone `progress` is told of each step and its errors."""
    by_turns = one.cycles > 1 and len(PROCEDURES[procedure]) > 1
    if len(knees) > 1 and (by_turns or one.method != "least_squares"):
        each = ((SeveralKnees.of([x]), [y]) for x, y in zip(knees.problems, starts, strict=True))
        return [run_procedure(one, knee, procedure, start, progress)[0] for knee, start in each]
    if by_turns:
        return [_by_turns(one, knees, procedure, starts[0], progress)]
    trails = [Trail(start, np.inf, [], {}) for start in starts]
    if len(knees) == 1:
        knees, trails[0].progress = SeveralKnees.of(knees.problems), progress
    _go_through(one, knees, procedure, trails)
    return trails


def _by_turns(
    one: CalibrationProblem, knees: SeveralKnees, procedure: str, start: Slopes,
    progress: Progress | None,
) -> Trail:  # fmt: skip
    """Cycles through the stages of one knee, until they no longer lower the objective."""
    (problem,), trail = knees.problems, Trail(start, np.inf, [], {}, progress=progress)
    knees, begun, ended, before = SeveralKnees.of([problem]), [], [], None
    for _ in range(one.cycles):
        reached, here = trail.objective, trail.x
        _go_through(one, knees, procedure, [trail])
        if trail.objective < 1e-16 * problem.cases.numbers:
            return trail
        if begun and reached - trail.objective <= _TOLERANCE * reached:
            if before is None and (anew := _taut_again(problem, trail, start)) is not None:
                before, begun, ended = trail, [], []
                trail = Trail(anew, np.inf, [], dict(trail.counts), progress=progress)
                continue
            if before is not None and before.objective <= trail.objective:
                return dataclasses.replace(before, counts=trail.counts)
            return trail
        begun.append(here)
        ended.append(trail.x)
        _accelerate(one, problem, trail, begun[-_MEMORY:], ended[-_MEMORY:])
    trail.converged = False
    return trail


def _go_through(
    one: CalibrationProblem, knees: SeveralKnees, procedure: str, trails: Sequence[Trail]
) -> None:
    """Once through all stages of a procedure."""
    several = PROCEDURES[procedure] or one.stages
    search = _stage if one.method == "least_squares" else _stage_by_lbfgsb
    for number, stage in enumerate(several, 1):
        chosen = [stage.frees(name) for name in knees.problems[0].selection.names]
        if any(chosen):
            free = np.array(chosen + [True] * len(knees.problems[0].offsets))
            name = f"{procedure}.{number}" if len(several) > 1 else procedure
            search(one, knees.with_data(stage.data), trails, free, name)
    if any(stage.data for stage in several):
        for problem, trail in zip(knees.problems, trails, strict=True):
            trail.objective = problem.objective(trail.known)


def _taut_again(problem: Problem, trail: Trail, start: Slopes) -> Slopes | None:
    """Balances with what poses hardly depend on, numbers of a ligament that went slack, as it was
    at the start: by turns it would stay slack. None where there is none, or no balance."""
    _, jacobian = problem.residual(trail.known)
    effect = np.linalg.norm(jacobian, axis=0) * np.abs(start.values[0])
    silent = effect < _SILENT * effect.max()
    found = problem.balance(np.where(silent, start.values[0], trail.x)[None], trail.known)
    return found if silent.any() and found.converged.all() else None


def _accelerate(
    one: CalibrationProblem, problem: Problem, trail: Trail, begun: list, ended: list
) -> None:
    """Go on where the cycles were heading; kept only where it lowers the objective.

    Alternating between coupled blocks converges linearly: near the answer of paper 1's twin the
    slowest error shrinks by 1.7 per cent a cycle. Anderson's extrapolation cures that, but not
    the crawl along bounds and round the bends of the valley before: there its guess is refused,
    and the last cycle's move is repeated as long as that helps, twice as far each time (the
    pattern move of Hooke and Jeeves 1961).
    """
    if len(begun) < 2:
        return

    def improves(trial: np.ndarray) -> bool:
        found = problem.balance(np.clip(trial, one.lower, one.upper)[None], trail.known)
        objective = problem.objective(found)
        trail.counts["acceleration"] = trail.counts.get("acceleration", 0) + 1
        lower = objective < trail.objective
        if lower:
            _move(problem, trail, found, objective, "acceleration")
        return lower

    if len(begun) > 2:
        # Where the cycles would stop if they were linear.
        moved = (np.array(ended) - np.array(begun)) / (one.upper - one.lower)
        mix, *_ = np.linalg.lstsq((moved[1:] - moved[:-1]).T, moved[-1], rcond=1e-12)
        if improves(ended[-1] - np.diff(ended, axis=0).T @ mix):
            return
    move, times = ended[-1] - begun[-1], 1.0
    while improves(ended[-1] + times * move):
        times *= 2.0


def _count(problem: Problem, trail: Trail, found: Slopes, stage: str) -> None:
    """One more evaluation; who watches is told how far off the knee still is."""
    trail.counts[stage] = trail.counts.get(stage, 0) + 1
    if trail.progress is not None:
        mm, deg = problem.rmse(found)
        errors = f"errors {mm:.3g} mm and {deg:.3g} deg"
        trail.progress(f"procedure {stage}, step {trail.counts[stage]}, {errors}", 0, 0)


def _move(problem: Problem, trail: Trail, found: Slopes, objective: float, stage: str) -> None:
    trail.known, trail.objective = found, objective
    trail.history.append(Iteration(stage, trail.evaluations, objective))
    trail.squares.append(problem.squares(found))


def _stage(
    one: CalibrationProblem, knees: SeveralKnees, trails: Sequence[Trail], free, name: str
) -> None:
    """A stage, of several knees at once; each ends by itself."""
    here = np.stack([trail.x for trail in trails])
    box = (np.where(free, bound, here) for bound in (one.lower, one.upper))
    reached: list[list[float]] = [[] for _ in trails]
    spare = max(knees.whole.cases.numbers - int(free.sum()), 1)
    for trail in trails:
        trail.flat = False

    def watch(rows: np.ndarray, found: Slopes, objective: np.ndarray, taken: np.ndarray):
        """Note each step; end where steps gain less than the noise (in units of chi squared): a
        valley that the data cannot tell from flat."""
        for k, row in enumerate(rows):
            trail, own = trails[row], found.take([k])
            _count(knees.problems[row], trail, own, name)
            if taken[k]:
                _move(knees.problems[row], trail, own, float(objective[k]), name)
                reached[row].append(trail.objective)
                steps = reached[row]
                gain = steps[-_WINDOW] - steps[-1] if len(steps) >= _WINDOW else np.inf
                trail.flat = bool(gain < _INSIGNIFICANT * min(steps[-1] / spare, one.noise.unit))
        return np.array([trails[row].flat for row in rows])

    fit = fit_lanes(
        knees.whole.balance, knees.whole.cases, together(trails), here, *box,
        most=_MAX_EVALUATIONS, far=True, rtol=_RTOL, atol=_ATOL, watch=watch,
    )  # fmt: skip
    for trail, converged in zip(trails, fit.converged, strict=True):
        trail.converged = trail.flat or bool(converged)


def together(trails: Sequence[Trail]) -> Slopes:
    """Where several searches are, one variant each."""
    fields = [field.name for field in dataclasses.fields(Slopes)]
    known = [trail.known for trail in trails]
    return Slopes(*(np.concatenate([getattr(one, name) for one in known]) for name in fields))


def _stage_by_lbfgsb(
    one: CalibrationProblem, knees: SeveralKnees, trails: Sequence[Trail], free, name: str
) -> None:
    """A stage of one knee."""
    (problem,), (trail,) = knees.problems, trails
    origin = trail.x

    def balance(values: np.ndarray) -> Slopes:
        x = origin.copy()
        x[free] = values
        return problem.balance(x[None], trail.known)

    def objective(values: np.ndarray) -> tuple[float, np.ndarray]:
        found = balance(values)
        residual, jacobian = problem.residual(found)
        value = float(residual @ residual)
        _count(problem, trail, found, name)
        if value < trail.objective:
            _move(problem, trail, found, value, name)
        return value, 2.0 * (residual @ jacobian)[free]

    # How far each parameter alone must move to move the poses as far as they are off; its ligament
    # may be slack at every pose.
    (residual, jacobian), width = problem.residual(trail.known), one.upper - one.lower
    effect = np.linalg.norm(jacobian, axis=0) * width
    effect = np.maximum(effect, 1e-3 * effect.max() or 1.0)
    scale = width * max(float(np.linalg.norm(residual)), 1e-6) / effect
    box = origin[free], one.lower[free], one.upper[free], scale[free]
    answer = minimise_bounded(objective, *box)
    if answer.converged:
        trail.known, trail.objective = balance(answer.x), answer.value
    trail.converged, trail.reason = answer.converged, answer.reason
