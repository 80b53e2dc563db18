"""Many bounded least squares at once: one motion each, some parameters held.

Each fit is a Levenberg-Marquardt search of its own, with its own bounds, damping and end; the
balances of all fits that still search are one batch. Constant offsets between frames enter
linearly, so the best ones are taken out of every residual in closed form.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from kneejax.geometry import FREE_COORDINATES
from kneejax.inference.fit._bounded import BoundedLevenbergMarquardt
from kneejax.inference.fit._problem import TABLE_UNITS
from kneejax.mechanics import Knee
from kneejax.parameters import Selection
from kneejax.statics import Slopes, Stations, balance_with_slopes

#: Evaluations of a fit that is to reach the end of a long flat valley.
PATIENT = 200
#: Relative decrease of an objective, and relative step, that end a fit.
_RTOL, _ATOL = 1e-9, 1e-8
#: Balances at values `(fits, p)`, reached from near ones, with their derivatives by the values.
Balance = Callable[[np.ndarray, Slopes], Slopes]


@dataclasses.dataclass(frozen=True)
class MotionData:
    """A measured motion and how well it is known.

    Attributes:
        stations: where it was measured.
        target: free coordinates, degrees and mm, `(stations, 5)`, or one set a fit
            `(fits, stations, 5)`.
        noise: standard deviation of each coordinate, degrees and mm, `(5,)`, or one set a fit
            `(fits, 5)`; infinite for a coordinate that does not count.
        offsets: free coordinates whose constant difference to the measurement is free.
        used: poses that count, `(stations,)`.
    """

    stations: Stations
    target: np.ndarray
    noise: np.ndarray
    offsets: tuple[str, ...] = ()
    used: np.ndarray | None = None

    @property
    def counted(self) -> np.ndarray:
        """Poses that count, `(stations,)`."""
        return np.ones(len(self.stations), bool) if self.used is None else self.used

    @property
    def count(self) -> int:
        """Rows of the residual."""
        return 5 * int(self.counted.sum())

    def take(self, rows) -> MotionData:
        """The data of some of the fits."""
        target = self.target if self.target.ndim == 2 else self.target[rows]
        noise = self.noise if self.noise.ndim == 1 else self.noise[rows]
        return dataclasses.replace(self, target=target, noise=noise)

    def residual(self, found: Slopes) -> tuple[np.ndarray, np.ndarray]:
        """Errors over their standard deviations `(fits, r)`, and by the parameters."""
        units = TABLE_UNITS[:, None]
        error = found.q * TABLE_UNITS - self.target
        slope = found.jacobian * units
        error, slope = error[:, self.counted], slope[:, self.counted]
        for name in self.offsets:
            column = FREE_COORDINATES.index(name)
            error[..., column] -= error[..., column].mean(axis=1, keepdims=True)
            slope[..., column, :] -= slope[..., column, :].mean(axis=1, keepdims=True)
        noise = self.noise[..., None, :]
        error, slope = error / noise, slope / noise[..., None]
        return error.reshape(len(error), -1), slope.reshape(len(slope), -1, slope.shape[-1])


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


def fit_many(
    knee: Knee,
    selection: Selection,
    data: MotionData,
    begin: Slopes,
    starts: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    *,
    most: int = 60,
    far: bool = False,
) -> ManyFits:
    """Fit parameters to motion, many times at once.

    Args:
        knee: gives everything else.
        selection: the parameters.
        data: measured motion, one for all or one a fit.
        begin: known balances, one variant a fit, from which the starts are predicted.
        starts: `(fits, p)`.
        lower: bounds, `(fits, p)`; equal to `upper` holds a parameter.
        upper: bounds.
        most: evaluations of a fit before it is given up.
        far: whether the answers may be far from the starts; first steps are short then.

    Returns:
        The `ManyFits`. A fit whose start has no balance at some pose that counts ends at once,
        with an infinite `chi2`.
    """
    balance = balances_of(knee, selection, data.stations)
    return fit_lanes(balance, data, begin, starts, lower, upper, most=most, far=far)


def balances_of(knee: Knee, selection: Selection, stations: Stations) -> Balance:
    """Balances of a knee's variants, many at a time."""
    return lambda values, near: balance_with_slopes(knee, selection.apply, values, stations, near)


def fit_lanes(
    balance: Balance,
    data: MotionData,
    begin: Slopes,
    starts: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    *,
    asked: np.ndarray | None = None,
    most: int = 60,
    far: bool = False,
    rtol: float = _RTOL,
) -> ManyFits:
    """Fit whatever can be balanced to motion, many times at once.

    Args:
        balance: of the values that are fitted.
        data: as in `fit_many`, and so are the next six.
        begin: known balances.
        starts: `(fits, p)`.
        lower: bounds, `(fits, p)`.
        upper: bounds.
        asked: fits to be made, `(fits,)`; the others cost nothing and mean nothing.
        most: evaluations of a fit.
        far: whether first steps are short.
        rtol: relative decrease of the sum of squares that ends a fit.

    Returns:
        The `ManyFits`.
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
        lost = ~(np.isfinite(residual).all(axis=1) & np.isfinite(slope).all(axis=(1, 2)))
        # A step into the void is refused for its infinite squares; no NaN may spread from there.
        residual[lost], slope[lost] = np.inf, 0.0
        # Only fits that still search, filled up with the last one: a profile ends with few of them.
        own = np.minimum(np.arange(_lanes(len(here))), len(here) - 1)
        box, before, there = _taken((bounds, state, trial), here[own])
        new = _advance(rtol, box, before, there, residual[own], slope[own])
        following, after, stop, searching = _taken(new, slice(len(here)))
        for every, some in zip(*map(jax.tree.leaves, (state, after)), strict=True):
            every[here] = some
        better = after.accepted
        known.put(here[better], found.take(better))
        trial[here], ended[here] = following, stop
        here = here[~stop & searching]
    chi2 = np.sum(state.residual**2, axis=1)
    return ManyFits(known, np.where(np.isfinite(chi2), chi2, np.inf), ended, evaluations)


def _taken(arrays, rows):
    return jax.tree.map(lambda x: np.asarray(x)[rows], arrays)


def _lanes(fits: int) -> int:
    """Lanes of a compiled step that does for so many fits: 64, 256, 1024, ..."""
    return 64 * 4 ** max(0, math.ceil(math.log(fits / 64, 4)))


def with_offsets(balance: Balance, offsets: Sequence[str]) -> Balance:
    """A balance whose last values are constants added to some coordinates.

    `MotionData.offsets` takes the best constants out of every residual; this makes them values
    like any other, which have bounds and can be held.

    Args:
        balance: of the other values.
        offsets: free coordinates; their constants are in degrees and mm.

    Returns:
        The balance.
    """

    def shifted(values: np.ndarray, near: Slopes) -> Slopes:
        size = values.shape[1] - len(offsets)
        found = balance(values[:, :size], without_offsets(near, offsets))
        return add_offsets(found, values[:, size:], offsets)

    return shifted if offsets else balance


def add_offsets(found: Slopes, shifts: np.ndarray, offsets: Sequence[str]) -> Slopes:
    """Balances with constants `(fits, offsets)` added, degrees and mm, as their last values."""
    q, more = np.array(found.q), np.zeros((*found.q.shape, len(offsets)))
    for k, name in enumerate(offsets):
        row = FREE_COORDINATES.index(name)
        q[..., row] += shifts[:, [k]] / TABLE_UNITS[row]
        more[..., row, k] = 1.0 / TABLE_UNITS[row]
    still = np.zeros((*found.meeting.shape, len(offsets)))
    return dataclasses.replace(
        found,
        values=np.hstack([found.values, shifts]),
        q=q,
        jacobian=np.concatenate([found.jacobian, more], axis=-1),
        meeting_jacobian=np.concatenate([found.meeting_jacobian, still], axis=-1),
    )


def without_offsets(found: Slopes, offsets: Sequence[str]) -> Slopes:
    """The reverse of `add_offsets`."""
    q, size = np.array(found.q), found.values.shape[1] - len(offsets)
    for k, name in enumerate(offsets):
        row = FREE_COORDINATES.index(name)
        q[..., row] -= found.values[:, [size + k]] / TABLE_UNITS[row]
    return dataclasses.replace(
        found,
        values=found.values[:, :size],
        q=q,
        jacobian=found.jacobian[..., :size],
        meeting_jacobian=found.meeting_jacobian[..., :size],
    )


def best_offsets(data: MotionData, fit: Slopes) -> list[float]:
    """The best constant of each coordinate whose frames may differ, to be added to the model's.

    Args:
        data: measured motion of one fit.
        fit: balances of one variant.

    Returns:
        Degrees or mm, in the order of `data.offsets`.
    """
    target = data.target.reshape(len(data.stations), 5)
    error = (fit.q[0] * TABLE_UNITS - target)[data.counted]
    return [-float(error[:, FREE_COORDINATES.index(name)].mean()) for name in data.offsets]


def _solver(lower, upper, rtol=_RTOL) -> BoundedLevenbergMarquardt:
    tolerances = {"rtol": rtol, "atol": _ATOL}
    return BoundedLevenbergMarquardt(lower, upper, **tolerances)  # pyright: ignore


def _begin(starts: np.ndarray, rows: int, damping: float):
    """One state a fit."""
    x, struct = np.zeros(starts.shape[1]), jax.ShapeDtypeStruct((rows,), float)
    one = _solver(x, x).init(None, x, None, {}, struct, None, frozenset())
    # NumPy compiles nothing; JAX would, for every leaf and number of fits.
    state = jax.tree.map(lambda x: np.repeat(np.asarray(x)[None], len(starts), axis=0), one)
    begin = starts, np.full(len(starts), damping)
    return eqx.tree_at(lambda s: (s.x, s.damping), state, begin)


@eqx.filter_jit
def _advance(rtol, bounds, state, trial, residual, slope):
    """Judge trial points and propose the next ones.

    Returns:
        Next points, states, which fits are done, and which have any balance to go on from.
    """

    def one(bounds, state, trial, residual, slope):
        solver = _solver(bounds[0], bounds[1], rtol)
        following, new = solver.following(solver.judged(trial, residual, slope, state))
        stop, _ = solver.terminate(None, following, None, {}, new, frozenset())
        return following, new, stop, jnp.isfinite(jnp.sum(new.residual**2))

    return jax.vmap(one)(bounds, state, trial, residual, slope)
