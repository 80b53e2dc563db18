"""The searches that move parameters: stages, procedures I to III, several starts."""

from __future__ import annotations

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from kneejax.inference._bounded import BoundedLevenbergMarquardt
from kneejax.inference._problem import Problem
from kneejax.inference._result import Iteration

#: The stages of a procedure of paper 1: which quantities are free in turn. Frame offsets are
#: free in every stage.
PROCEDURES = {
    "I": (("stiffness",), ("reference_strain", "slack_length")),
    "II": (("reference_strain", "slack_length"), ("stiffness",)),
    "III": (None,),
}
_MAX_EVALUATIONS = 200
_MAX_CYCLES = 200
# A search ends when this many accepted steps lower chi squared by less than this altogether.
_WINDOW, _INSIGNIFICANT = 6, 0.5


@dataclasses.dataclass
class Trail:
    """What a search has done so far.

    Attributes:
        x: best parameters (and offsets).
        objective: there.
        history: accepted steps.
        counts: evaluations by stage.
        converged: whether the last stage ended by itself.
        flat: whether it ended because further steps gained less than the noise.
    """

    x: np.ndarray
    objective: float
    history: list[Iteration]
    counts: dict[str, int]
    converged: bool = True
    flat: bool = False

    @property
    def evaluations(self) -> int:
        """Evaluations of all poses and their Jacobian."""
        return sum(self.counts.values())


def run_procedure(
    problem: Problem,
    procedure: str,
    start: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    cycles: int = _MAX_CYCLES,
    tolerance: float = 1e-6,
) -> Trail:
    """Search by one of paper 1's procedures.

    Args:
        problem: what is fitted.
        procedure: `I` (stiffnesses, then slack lengths), `II` (the reverse) or `III` (all).
        start: parameters and offsets, `(p,)`.
        lower: bounds.
        upper: bounds.
        cycles: how often I and II may be gone through; paper 1 did it once.
        tolerance: relative decrease of the objective in a cycle that ends the search.

    Returns:
        The trail.
    """
    trail = Trail(np.array(start, float), np.inf, [], {})
    stages = PROCEDURES[procedure]
    before, after = [], []
    for cycle in range(cycles if len(stages) > 1 else 1):
        reached, here = trail.objective, trail.x
        for number, quantities in enumerate(stages, 1):
            free = _free(problem, quantities)
            if free.any():
                name = f"{procedure}.{number}" if len(stages) > 1 else procedure
                _stage(problem, trail, free, lower, upper, name)
        if len(stages) == 1 or cycles == 1:
            return trail
        if trail.objective < 1e-16 * problem.target.size:
            return trail
        if cycle and reached - trail.objective <= tolerance * reached:
            return trail
        before.append(here)
        after.append(trail.x)
        _extrapolate(problem, trail, before[-6:], after[-6:], lower, upper)
    trail.converged = False
    return trail


def _extrapolate(problem, trail: Trail, before, after, lower, upper) -> None:
    """Anderson's acceleration of the cycles; kept only where it lowers the objective.

    Alternating between two coupled blocks converges linearly, here by 2 to 10 per cent a cycle.
    """
    if len(before) < 3:
        return
    width = upper - lower
    moved = (np.array(after) - np.array(before)) / width
    differences = (moved[1:] - moved[:-1]).T
    mix, *_ = np.linalg.lstsq(differences, moved[-1], rcond=1e-12)
    images = (np.array(after)[1:] - np.array(after)[:-1]).T
    trial = np.clip(after[-1] - images @ mix, lower, upper)
    found = problem.poses(trial)
    residual, _ = problem.residual(trial, found)
    trail.counts["acceleration"] = trail.counts.get("acceleration", 0) + 1
    objective = float((residual**2).sum())
    if objective < trail.objective:
        problem.keep(trial, found)
        trail.x, trail.objective = trial, objective
        trail.history.append(Iteration("acceleration", trail.evaluations, objective))


def _free(problem: Problem, quantities) -> np.ndarray:
    selection = problem.selection
    chosen = [
        quantities is None or selection.quantity(i) in quantities for i in range(len(selection))
    ]
    if quantities is not None and not any(chosen):
        return np.zeros(len(chosen) + len(problem.offsets), bool)
    return np.array(chosen + [True] * len(problem.offsets))


def _stage(problem: Problem, trail: Trail, free, lower, upper, name: str) -> None:
    fixed = jnp.asarray(trail.x)
    solver = BoundedLevenbergMarquardt(  # pyright: ignore[reportCallIssue]
        jnp.where(free, lower, fixed), jnp.where(free, upper, fixed), jacobian_from_aux=True
    )
    found = None

    def look(y, _):
        nonlocal found
        found = problem.poses(np.asarray(y))
        residual, jacobian = problem.residual(np.asarray(y), found)
        return residual, (jacobian,)

    y, tags = fixed, frozenset()
    struct = jax.ShapeDtypeStruct((problem.target.size,), float)
    state = solver.init(look, y, None, {}, struct, None, tags)
    ended, reached = False, []
    spare = max(problem.target.size - int(free.sum()), 1)
    for _ in range(_MAX_EVALUATIONS):
        trial = np.asarray(y)
        y, state, _ = solver.step(look, y, None, {}, state, tags)
        trail.counts[name] = trail.counts.get(name, 0) + 1
        if bool(state.accepted):
            problem.keep(trial, found)
            trail.x = trial
            trail.objective = float(jnp.sum(state.residual**2))
            trail.history.append(Iteration(name, trail.evaluations, trail.objective))
            reached.append(trail.objective)
            # In units of the noise (chi squared): a valley that the data cannot tell from flat.
            gain = reached[-_WINDOW] - reached[-1] if len(reached) >= _WINDOW else np.inf
            trail.flat = gain < _INSIGNIFICANT * reached[-1] / spare
        ended = trail.flat or bool(solver.terminate(look, y, None, {}, state, tags)[0])
        if ended:
            break
    trail.converged = ended


def several_starts(
    problem: Problem,
    starts: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    steps: int = 40,
) -> tuple[np.ndarray, np.ndarray]:
    """Run procedure III from several starts at once, under vmap.

    Args:
        problem: what is fitted; its poses at the first start must be known (`keep`).
        starts: `(s, p)`.
        lower: bounds.
        upper: bounds.
        steps: evaluations of each start.

    Returns:
        End points `(s, p)` and their objectives `(s,)`, infinite where a start found no balance.
    """
    solver = BoundedLevenbergMarquardt(  # pyright: ignore[reportCallIssue]
        jnp.asarray(lower), jnp.asarray(upper), jacobian_from_aux=True
    )
    count, size = len(starts), problem.target.size
    struct = jax.ShapeDtypeStruct((size,), float)
    first = solver.init(None, jnp.asarray(starts[0]), None, {}, struct, None, frozenset())
    state = jax.tree.map(lambda x: jnp.broadcast_to(x, (count, *x.shape)), first)
    y = jnp.asarray(starts)
    state = eqx.tree_at(lambda s: s.x, state, y)
    known = None
    for _ in range(steps):
        found = problem.many_poses(np.asarray(y), known)
        pairs = [
            problem.residual(np.asarray(y[k]), jax.tree.map(lambda x, k=k: x[k], found))
            for k in range(count)
        ]
        residual, jacobian = (jnp.stack([jnp.asarray(pair[i]) for pair in pairs]) for i in (0, 1))
        trial = y
        y, state = _update_many(solver, y, residual, jacobian, state)
        known = problem.nearest_many(np.asarray(trial), found, np.asarray(state.accepted), known)
    objective = np.asarray(jnp.sum(state.residual**2, axis=1))
    return np.asarray(state.x), np.where(np.isfinite(objective), objective, np.inf)


@eqx.filter_jit
def _update_many(solver, y, residual, jacobian, state):
    def one(y, residual, jacobian, state):
        return solver.following(solver.judged(y, residual, jacobian, state))

    return jax.vmap(one)(y, residual, jacobian, state)
