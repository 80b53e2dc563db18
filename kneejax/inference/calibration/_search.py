"""The searches that move parameters: stages, procedures I to III, by Jacobian or gradient."""

__all__ = ["run_procedure"]

import dataclasses
from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from kneejax.inference.calibration._question import (
    PROCEDURES,
    CalibrationProblem,
    SeveralKnees,
)
from kneejax.inference.calibration._result import Ending, Iteration
from kneejax.inference.fit import Problem, Progress, fit_lanes
from kneejax.numerics import imported
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

    def move(self, problem: Problem, found: Slopes, objective: float, stage: str) -> None:
        """Take a step."""
        self.known, self.objective = found, objective
        self.history.append(Iteration(stage, self.evaluations, objective))
        self.squares.append(problem.squares(found))


def run_procedure(
    knees: SeveralKnees, procedure: str, starts: Sequence[Slopes], progress: Progress | None = None
) -> list[Trail]:
    """Search by one of paper 1's procedures, or in stages of one's own, side by side where the
    search allows it, from balances at the first values, one variant a knee. Of a knee alone
    `progress` is told of each step and its errors."""
    one, alone = knees.members[0], len(knees.members) == 1
    by_turns = one.cycles > 1 and len(PROCEDURES[procedure]) > 1
    if not alone and (by_turns or one.method != "least_squares"):
        each = ((SeveralKnees.of([x]), [y]) for x, y in zip(knees.members, starts, strict=True))
        return [run_procedure(knee, procedure, start, progress)[0] for knee, start in each]
    knees = SeveralKnees.of(knees.members) if alone else knees
    if by_turns:
        return [_by_turns(knees, procedure, starts[0], progress)]
    told = progress if alone else None
    trails = [Trail(start, np.inf, [], {}, progress=told) for start in starts]
    _go_through(knees, procedure, trails)
    return trails


def _by_turns(
    knees: SeveralKnees, procedure: str, start: Slopes, progress: Progress | None
) -> Trail:
    """Cycles through the stages of one knee, until they no longer lower the objective."""
    (one,), trail = knees.members, Trail(start, np.inf, [], {}, progress=progress)
    begun, ended, before = [], [], None
    for _ in range(one.cycles):
        reached, here = trail.objective, trail.x
        _go_through(knees, procedure, [trail])
        if trail.objective < 1e-16 * one.fitted.cases.numbers:
            return trail
        if begun and reached - trail.objective <= _TOLERANCE * reached:
            if before is None and (anew := _taut_again(one.fitted, trail, start)) is not None:
                before, begun, ended = trail, [], []
                trail = Trail(anew, np.inf, [], dict(trail.counts), progress=progress)
                continue
            if before is not None and before.objective <= trail.objective:
                return dataclasses.replace(before, counts=trail.counts)
            return trail
        begun.append(here)
        ended.append(trail.x)
        _accelerate(one, trail, begun[-_MEMORY:], ended[-_MEMORY:])
    trail.converged = False
    return trail


def _go_through(knees: SeveralKnees, procedure: str, trails: Sequence[Trail]) -> None:
    """Once through all stages of a procedure."""
    one = knees.members[0]
    several = PROCEDURES[procedure] or one.stages
    search = _stage if one.method == "least_squares" else _stage_by_lbfgsb
    for number, stage in enumerate(several, 1):
        chosen = [stage.frees(name) for name in one.fitted.selection.names]
        if any(chosen):
            free = np.array(chosen + [True] * len(one.fitted.offsets))
            name = f"{procedure}.{number}" if len(several) > 1 else procedure
            search(knees.each(Problem.with_data, stage.data), trails, free, name)
    if any(stage.data for stage in several):
        for own, trail in zip(knees.members, trails, strict=True):
            trail.objective = own.fitted.objective(trail.known)


def _taut_again(problem: Problem, trail: Trail, start: Slopes) -> Slopes | None:
    """Balances with what poses hardly depend on as at the start, or None: it would stay slack."""
    _, jacobian = problem.residual(trail.known)
    effect = np.linalg.norm(jacobian, axis=0) * np.abs(start.values[0])
    silent = effect < _SILENT * effect.max()
    found = problem.balance(np.where(silent, start.values[0], trail.x)[None], trail.known)
    return found if silent.any() and found.converged.all() else None


def _accelerate(one: CalibrationProblem, trail: Trail, begun: list, ended: list) -> None:
    """Go on where the cycles were heading, if that lowers the objective: alternating between
    coupled blocks converges linearly, by 1.7 per cent a cycle on paper 1's twin. Anderson's
    extrapolation cures that but for the crawl along bounds and bends, where the last move is
    repeated, twice as far each time (the pattern move of Hooke and Jeeves 1961)."""
    if len(begun) < 2:
        return

    def improves(trial: np.ndarray) -> bool:
        problem = one.fitted
        found = problem.balance(np.clip(trial, one.lower, one.upper)[None], trail.known)
        objective = problem.objective(found)
        trail.counts["acceleration"] = trail.counts.get("acceleration", 0) + 1
        lower = objective < trail.objective
        if lower:
            trail.move(problem, found, objective, "acceleration")
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


def _stage(knees: SeveralKnees, trails: Sequence[Trail], free, name: str) -> None:
    """A stage, of several knees at once; each ends by itself."""
    one = knees.members[0]
    here = np.stack([trail.x for trail in trails])
    box = (np.where(free, bound, here) for bound in (one.lower, one.upper))
    reached: list[list[float]] = [[] for _ in trails]
    spare = max(knees.whole.cases.numbers - int(free.sum()), 1)
    for trail in trails:
        trail.flat = False

    def watch(rows: np.ndarray, found: Slopes, objective: np.ndarray, taken: np.ndarray):
        """Note each step; end where steps gain less than the noise: a valley that is flat to the
        data."""
        for k, row in enumerate(rows):
            trail, problem, own = trails[row], knees.members[row].fitted, found.take([k])
            _count(problem, trail, own, name)
            if taken[k]:
                trail.move(problem, own, float(objective[k]), name)
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
    return jax.tree.map(lambda *each: np.concatenate(each), *(trail.known for trail in trails))


def _stage_by_lbfgsb(knees: SeveralKnees, trails: Sequence[Trail], free, name: str) -> None:
    """A stage of one knee."""
    (one,), (trail,) = knees.members, trails
    problem, origin = one.fitted, trail.x

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
            trail.move(problem, found, value, name)
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


_MAX_STEPS = 500
#: Bound of the projected gradient, in units of the scale and of the value at the start.
_TOLERANCE = 1e-8
_LEAST_CACHED = "jax_persistent_cache_min_compile_time_secs"


class Minimum(NamedTuple):
    """Where a minimisation ended: the point `(p,)`, the value there, whether the projected gradient
    is below the tolerance, and why it is not; that is empty if it is."""

    x: np.ndarray
    value: float
    converged: bool
    reason: str


def minimise_bounded(
    value_and_gradient: Callable, start: np.ndarray, lower: np.ndarray, upper: np.ndarray,
    scale: np.ndarray | None = None, max_steps: int | None = None,
) -> Minimum:  # fmt: skip
    """Minimise a function `(p,) -> value, gradient` of numbers within bounds by L-BFGS-B of jaxopt;
    steps are cut back where it is not finite. `scale` is the change of each unknown that matters as
    much as one of any other, the width of the bounds by default."""
    jaxopt = imported("jaxopt", "jaxopt", "lbfgsb")
    scale = np.where(upper > lower, upper - lower, 1.0) if scale is None else scale
    first = float(value_and_gradient(np.asarray(start))[0])
    if not np.isfinite(first):
        reason = "L-BFGS-B could not begin: the function is not finite at the start"
        return Minimum(np.asarray(start), first, False, reason)
    unit = max(abs(first), 1e-12)

    def scaled(z):
        with jax.disable_jit(False):  # jaxopt calls this without compilation, which it needs
            value, gradient = value_and_gradient(np.clip(np.asarray(z) * scale, lower, upper))
            if not np.isfinite(value):
                return jnp.asarray(jnp.inf), jnp.zeros(len(z))
            return jnp.asarray(value / unit), jnp.asarray(gradient * scale / unit)

    solver = jaxopt.LBFGSB(
        scaled, value_and_grad=True, tol=_TOLERANCE, maxiter=max_steps or _MAX_STEPS,
        stop_if_linesearch_fails=True, implicit_diff=False, jit=False,
    )  # fmt: skip
    bounds, least = (jnp.asarray(lower / scale), jnp.asarray(upper / scale)), _LEAST_CACHED
    usual = getattr(jax.config, least)
    jax.config.update(least, 0.0)  # its loops are 200 small programs, slower to compile than to run
    try:
        with jax.disable_jit():  # which close over arrays: compiled again in every iteration
            answer, state = solver.run(jnp.asarray(start / scale), bounds=bounds)
    finally:
        jax.config.update(least, usual)
    error, failed, reason = float(state.error), bool(state.failed_linesearch), ""
    if not error <= _TOLERANCE:
        ended = "its line search found no lower point" if failed else "the limit of iterations"
        reason = (
            f"L-BFGS-B ended after {int(state.iter_num)} iterations ({ended}): projected gradient "
            f"{error:.1e}, expected at most {_TOLERANCE:.0e}"
        )
    x = np.clip(np.asarray(answer) * scale, lower, upper)
    return Minimum(x, float(state.value) * unit, not reason, reason)
