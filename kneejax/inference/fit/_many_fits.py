"""The one fit: bounded least squares in lanes, each with load cases of its own, some values held.

Each fit is a Levenberg-Marquardt search of its own, with its own bounds, damping and end; the
balances of all fits that still search are one batch. Constant offsets between frames enter
linearly, so the best ones are taken out of every residual in closed form.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from kneejax.inference.fit._bounded import BoundedLevenbergMarquardt
from kneejax.inference.fit._load_cases import Balance, LoadCases
from kneejax.statics import Slopes

#: Evaluations of a fit that is to reach the end of a long flat valley.
PATIENT = 200
#: Relative decrease of an objective, and relative step, that end a fit.
_RTOL, _ATOL = 1e-9, 1e-8
#: Called with fits, what a trial of each gave, its best sum of squares so far, and whether the
#: trial was taken; says which of them end.
Watch = Callable[[np.ndarray, Slopes, np.ndarray, np.ndarray], np.ndarray]


@dataclasses.dataclass(frozen=True)
class ManyFits:
    """Where fits ended.

    Attributes:
        slopes: balances and derivatives there; `slopes.values` are the parameters, `(fits, p)`.
        chi2: sum of squared errors over their variances, `(fits,)`.
        converged: whether a fit ended by itself, `(fits,)`.
        evaluations: of all poses of one fit, summed over fits.
    """

    slopes: Slopes
    chi2: np.ndarray
    converged: np.ndarray
    evaluations: int

    @property
    def values(self) -> np.ndarray:
        """Parameters, `(fits, p)`."""
        return self.slopes.values


def fit_lanes(
    balance: Balance,
    data: LoadCases,
    begin: Slopes,
    starts: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    *,
    asked: np.ndarray | None = None,
    most: int = 60,
    far: bool = False,
    rtol: float = _RTOL,
    atol: float = _ATOL,
    watch: Watch | None = None,
) -> ManyFits:
    """Fit whatever can be balanced to motion, many times at once.

    Args:
        balance: of the values that are fitted; see `balances_of`.
        data: measured motion, one for all or one per fit.
        begin: known balances, one variant per fit, from which the starts are predicted.
        starts: `(fits, p)`.
        lower: bounds, `(fits, p)`; equal to `upper` holds a parameter.
        upper: bounds.
        asked: fits to be made, `(fits,)`; the others cost nothing and mean nothing.
        most: evaluations of a fit before it is given up.
        far: whether the answers may be far from the starts; first steps are short then.
        rtol: relative decrease of the sum of squares that ends a fit.
        atol: relative step, of the width of the bounds, that ends a fit.
        watch: called after every evaluation; may end fits, which does not count as an end by
            itself.

    Returns:
        The `ManyFits`. A fit whose start has no balance at some pose that counts ends at once,
        with an infinite `chi2`.
    """
    count = len(starts)
    trial, known = np.array(starts, float), begin.take(np.arange(count))
    bounds = np.asarray(lower, float), np.asarray(upper, float)
    state = _begin(trial.copy(), data.count, 1.0 if far else 1e-3)
    ended, evaluations = np.zeros(count, bool), 0
    here = np.arange(count) if asked is None else np.flatnonzero(asked)
    for _ in range(most):
        if not len(here):
            break
        found = balance(trial[here], known.take(here))
        evaluations += len(here)
        residual, slope = data.take(here).residual(found)
        # A step into the void is refused for its infinite squares; no NaN may spread from there.
        residual[~(np.isfinite(residual) & np.isfinite(slope).all(axis=2))] = np.inf
        slope[np.isinf(residual).any(axis=1)] = 0.0
        # Only fits that still search, filled up with the last one: a profile ends with few of them.
        own = np.minimum(np.arange(_lanes(len(here))), len(here) - 1)
        box, before, there = _taken((bounds, state, trial), here[own])
        new = _advance(np.array([rtol, atol]), box, before, there, residual[own], slope[own])
        following, after, stop, searching = _taken(new, slice(len(here)))
        for every, some in zip(*map(jax.tree.leaves, (state, after)), strict=True):
            every[here] = some
        better = after.accepted
        known.put(here[better], found.take(better))
        trial[here], ended[here] = following, stop
        through = stop | ~searching
        if watch is not None:
            through |= watch(here, found, np.sum(after.residual**2, axis=1), better)
        here = here[~through]
    chi2 = np.sum(state.residual**2, axis=1)
    return ManyFits(known, np.where(np.isfinite(chi2), chi2, np.inf), ended, evaluations)


def _taken(arrays, rows):
    return jax.tree.map(lambda x: np.asarray(x)[rows], arrays)


def _lanes(fits: int) -> int:
    """Lanes of a compiled step that does for so many fits: 64, 256, 1024, ..."""
    return 64 * 4 ** max(0, math.ceil(math.log(fits / 64, 4)))


def _solver(lower, upper, ends=(_RTOL, _ATOL)) -> BoundedLevenbergMarquardt:
    tolerances = {"rtol": ends[0], "atol": ends[1]}
    return BoundedLevenbergMarquardt(lower, upper, **tolerances)  # pyright: ignore


def _begin(starts: np.ndarray, rows: int, damping: float):
    """One state per fit."""
    x, struct = np.zeros(starts.shape[1]), jax.ShapeDtypeStruct((rows,), float)
    one = _solver(x, x).init(None, x, None, {}, struct, None, frozenset())
    # NumPy compiles nothing; JAX would, for every leaf and number of fits.
    state = jax.tree.map(lambda x: np.repeat(np.asarray(x)[None], len(starts), axis=0), one)
    begin = starts, np.full(len(starts), damping)
    return eqx.tree_at(lambda s: (s.x, s.damping), state, begin)


@eqx.filter_jit
def _advance(ends, bounds, state, trial, residual, slope):
    """Judge trial points and propose the next ones.

    Returns:
        Next points, states, which fits are done, and which have any balance to go on from.
    """

    def one(bounds, state, trial, residual, slope):
        solver = _solver(bounds[0], bounds[1], ends)
        following, new = solver.following(solver.judged(trial, residual, slope, state))
        stop, _ = solver.terminate(None, following, None, {}, new, frozenset())
        return following, new, stop, jnp.isfinite(jnp.sum(new.residual**2))

    return jax.vmap(one)(bounds, state, trial, residual, slope)


def compile_step(unknowns: int, residuals: int) -> None:
    """Compile a step of the fit, for instance while something else is computed.

    Args:
        unknowns: number of values.
        residuals: number of residuals.
    """
    lanes = _lanes(1)
    x, y = np.zeros((lanes, unknowns)), np.zeros((lanes, residuals))
    state = _begin(x, residuals, 1.0)
    _advance(np.array([_RTOL, _ATOL]), (x, x + 1.0), state, x, y, np.zeros((*y.shape, unknowns)))
