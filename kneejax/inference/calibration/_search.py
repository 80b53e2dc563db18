"""The searches that move parameters: stages, procedures I to III, several starts."""

from __future__ import annotations

import dataclasses
import fnmatch
from collections.abc import Sequence

import numpy as np

from kneejax.inference.calibration._result import Ending, Iteration
from kneejax.inference.fit import Problem, Progress, SeveralKnees, fit_lanes
from kneejax.statics import Slopes


@dataclasses.dataclass(frozen=True)
class Stage:
    """A part of a search: what is free in it, and which data count.

    Attributes:
        parameters: names or wildcards of those that are free, all others stay where they are;
            empty for all. Constants between frames are free in every stage.
        data: names of tests, and `poses`; empty for all.

    Example:
        >>> Stage(("*.reference_strain",), ("poses",)).frees("ACL.reference_strain")
        True
    """

    parameters: tuple[str, ...] = ()
    data: tuple[str, ...] = ()

    def frees(self, name: str) -> bool:
        """Whether a parameter of the search is free in this stage."""
        patterns = [form for own in self.parameters for form in (own, f"{own}.*")]
        return not patterns or any(fnmatch.fnmatchcase(name, form) for form in patterns)


#: What a stage calls the passive motion.
POSES = "poses"
_LENGTHS = Stage(("*.reference_strain", "*.slack_length"))
#: The procedures of paper 1, and one whose stages are a study's own.
PROCEDURES = {
    "I": (Stage(("*.stiffness",)), _LENGTHS),
    "II": (_LENGTHS, Stage(("*.stiffness",))),
    "III": (Stage(),),
    "S": (),
}
#: Procedures where none are named.
USUAL_PROCEDURES = ("III",)


def procedures_of(named: Sequence[str], stages: Sequence[Stage]) -> tuple[str, ...]:
    """The procedures that are named; where none are, `S` if there are stages, `III` otherwise."""
    return tuple(named) or (("S",) if stages else USUAL_PROCEDURES)


#: How often I and II go through their stages where nobody says: once, as paper 1 did.
USUAL_CYCLES = 1
_MAX_EVALUATIONS = 200
# A search ends when this many accepted steps lower chi squared by less than this altogether.
_WINDOW, _INSIGNIFICANT = 6, 0.5
# Relative decrease of the objective, and relative step, that end a stage.
_RTOL, _ATOL = 1e-10, 1e-9
# Effect of a number, relative to the largest of all, below which poses hardly depend on it.
_SILENT = 1e-3
# Cycles that Anderson's extrapolation looks back on.
_MEMORY = 6


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
    problem: Problem,
    procedure: str,
    start: Slopes,
    lower: np.ndarray,
    upper: np.ndarray,
    cycles: int = USUAL_CYCLES,
    tolerance: float = 1e-6,
    method: str = "least_squares",
    stages: Sequence[Stage] = (),
    unit: float = np.inf,
    progress: Progress | None = None,
) -> Trail:
    """Search by one of paper 1's procedures, or in stages of one's own.

    Args:
        problem: what is fitted.
        procedure: `I` (stiffnesses, then slack lengths), `II` (the reverse), `III` (all) or `S`
            (`stages`).
        start: balances at the first values, one variant.
        lower: bounds.
        upper: bounds.
        cycles: how often I and II may be gone through.
        tolerance: relative decrease of the objective in a cycle that ends the search.
        method: of each stage, a key of `METHODS`.
        stages: of procedure S, gone through once.
        unit: what the objective rises by where chi squared rises by one, infinite where the noise
            is not stated: what a fit leaves, if that is less, tells when steps gain nothing.
        progress: told of each step and its errors.

    Returns:
        The trail.
    """
    trail, knees = Trail(start, np.inf, [], {}, progress=progress), SeveralKnees.of([problem])
    cycles = cycles if len(PROCEDURES[procedure]) > 1 else 1
    begun, ended, before = [], [], None
    for _ in range(cycles):
        reached, here = trail.objective, trail.x
        _go_through(knees, procedure, [trail], lower, upper, method, stages, unit)
        if cycles == 1 or trail.objective < 1e-16 * problem.cases.numbers:
            return trail
        if begun and reached - trail.objective <= tolerance * reached:
            if before is None and (anew := _taut_again(problem, trail, start)) is not None:
                before, begun, ended = trail, [], []
                trail = Trail(anew, np.inf, [], dict(trail.counts), progress=progress)
                continue
            if before is not None and before.objective <= trail.objective:
                return dataclasses.replace(before, counts=trail.counts)
            return trail
        begun.append(here)
        ended.append(trail.x)
        _accelerate(problem, trail, begun[-_MEMORY:], ended[-_MEMORY:], lower, upper)
    trail.converged = False
    return trail


def run_side_by_side(
    knees: SeveralKnees, procedure: str, starts: Sequence[Slopes], lower: np.ndarray,
    upper: np.ndarray, cycles: int = USUAL_CYCLES, method: str = "least_squares",
    stages: Sequence[Stage] = (), unit: float = np.inf, progress: Progress | None = None,
) -> list[Trail]:  # fmt: skip
    """As `run_procedure`, of several knees at once where the search allows it.

    Args:
        knees: what is fitted; and all others as there, one start a knee.

    Returns:
        A trail each.
    """
    several = PROCEDURES[procedure] or tuple(stages)
    if len(knees) == 1 or method != "least_squares" or cycles > 1 and len(several) > 1:
        search = {"method": method, "stages": stages, "unit": unit, "progress": progress}
        return [
            run_procedure(problem, procedure, start, lower, upper, cycles, **search)
            for problem, start in zip(knees.problems, starts, strict=True)
        ]
    trails = [Trail(start, np.inf, [], {}) for start in starts]
    _go_through(knees, procedure, trails, lower, upper, method, stages, unit)
    return trails


def _go_through(
    knees: SeveralKnees, procedure: str, trails: Sequence[Trail], lower, upper, method: str,
    stages: Sequence[Stage], unit: float,
) -> None:  # fmt: skip
    """Once through all stages of a procedure."""
    several = PROCEDURES[procedure] or tuple(stages)
    for number, stage in enumerate(several, 1):
        chosen = [stage.frees(name) for name in knees.problems[0].selection.names]
        if any(chosen):
            free = np.array(chosen + [True] * len(knees.problems[0].offsets))
            name = f"{procedure}.{number}" if len(several) > 1 else procedure
            own = knees.with_data(stage.data)
            METHODS[method](own, trails, free, lower, upper, name, unit)
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


def _accelerate(problem: Problem, trail: Trail, begun, ended, lower, upper) -> None:
    """Go on where the cycles were heading; kept only where it lowers the objective.

    Alternating between coupled blocks converges linearly: near the answer of paper 1's twin the
    slowest error shrinks by 1.7 per cent a cycle. Anderson's extrapolation cures that, but not
    the crawl along bounds and round the bends of the valley before: there its guess is refused,
    and the last cycle's move is repeated as long as that helps, twice as far each time (the
    pattern move of Hooke and Jeeves 1961).
    """
    if len(begun) < 2:
        return
    if len(begun) > 2 and _improves(
        problem, trail, np.clip(_anderson(begun, ended, upper - lower), lower, upper)
    ):
        return
    move, times = ended[-1] - begun[-1], 1.0
    while _improves(problem, trail, np.clip(ended[-1] + times * move, lower, upper)):
        times *= 2.0


def _anderson(begun, ended, width: np.ndarray) -> np.ndarray:
    """Where cycles from `begun` to `ended` would stop if they were linear: `(p,)`."""
    moved = (np.array(ended) - np.array(begun)) / width
    mix, *_ = np.linalg.lstsq((moved[1:] - moved[:-1]).T, moved[-1], rcond=1e-12)
    return ended[-1] - np.diff(ended, axis=0).T @ mix


def _improves(problem: Problem, trail: Trail, trial: np.ndarray) -> bool:
    """Move the trail to a trial point if the objective is lower there."""
    found = problem.balance(trial[None], trail.known)
    objective = problem.objective(found)
    trail.counts["acceleration"] = trail.counts.get("acceleration", 0) + 1
    lower = objective < trail.objective
    if lower:
        _move(problem, trail, found, objective, "acceleration")
    return lower


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
    knees: SeveralKnees, trails: Sequence[Trail], free, lower, upper, name: str, unit: float
) -> None:
    """A stage, of several knees at once; each ends by itself."""
    here = np.stack([trail.x for trail in trails])
    box = (np.where(free, bound, here) for bound in (lower, upper))
    reached: list[list[float]] = [[] for _ in trails]
    spare = max(knees.cases.numbers - int(free.sum()), 1)
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
                trail.flat = bool(gain < _INSIGNIFICANT * min(steps[-1] / spare, unit))
        return np.array([trails[row].flat for row in rows])

    fit = fit_lanes(
        knees.balance, knees.cases, together(trails), here, *box,
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
    knees: SeveralKnees, trails: Sequence[Trail], free, lower, upper, name: str, unit: float
) -> None:
    """A stage of one knee."""
    from kneejax.inference.fit import minimise_bounded

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

    scale = _telling_changes(problem, trail.known, upper - lower)
    answer = minimise_bounded(objective, origin[free], lower[free], upper[free], scale[free])
    if answer.converged:
        trail.known, trail.objective = balance(answer.x), answer.value
    trail.converged, trail.reason = answer.converged, answer.reason


def _telling_changes(problem: Problem, known: Slopes, width: np.ndarray) -> np.ndarray:
    """How far each parameter alone must move to move the poses as far as they are off, `(p,)`."""
    residual, jacobian = problem.residual(known)
    effect = np.linalg.norm(jacobian, axis=0) * width
    # The ligament of a parameter may be slack at every pose.
    effect = np.maximum(effect, 1e-3 * effect.max() or 1.0)
    return width * max(float(np.linalg.norm(residual)), 1e-6) / effect


#: How a stage is searched: with the exact Jacobian, or with the gradient alone (jaxopt).
METHODS = {"least_squares": _stage, "lbfgsb": _stage_by_lbfgsb}
