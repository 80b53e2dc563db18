"""Levenberg-Marquardt with bounds in the original variables, many fits side by side.

Variables that sit on a bound and are pushed outwards are held; a step that would leave the box
stops the variables that leave it on their bound and is solved again for the others. A sigmoid
that maps the box to a line needs hundreds of steps when a bound is active; this needs none more.

The damping of a variable goes by the steepest slope that any look has shown (by that of the steps
taken in J. J. More, Lect. Notes Math. 630, 105, 1978). A fibre that is slack has next to no slope:
by that alone it would be sent as far as it can go, to where it tears or nothing balances, and each
step of the others would be refused until its own had become short.

At a limit point a pose loses its balance: one reading refuses every step alone, since its pose
jumps or is lost, while all others would take it. Its slope grows without bound there, and each step
along the limit leaves what is balanced. That reading is first led inwards, away from the limit, by
as far as the limit is, and where this promises too little a quarter of the refused way; all others
go as far as they want. Its slope on the way does not count for the damping: it would stop them too.

All of it is NumPy: by JAX a step compiles for every number of values and readings.
"""

__all__ = ["PATIENT", "BoundedLevenbergMarquardt", "ManyFits", "fit_lanes"]

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from kneejax.inference.fit._observed import Balance, Observations
from kneejax.statics import Slopes

#: A reading jumps if it changes by more than so many times what its slope at either end explains.
_JUMP = 2.0
#: Part of a refused move that a reading is led which alone refused a step.
_LED = 0.25
#: How firmly: its weight, in parts of that of all readings together.
_FIRMLY = 100.0
#: Part of what that promises that a step away from the limit must promise.
_INWARDS = 0.1
#: Factor on the damping after a refused step, and divisor after one that kept half its promise.
_RAISE, _LOWER = 4.0, 10.0
#: Steps refused in a row after which rounding is all that is left.
_STUCK = 12


class _Point(NamedTuple):
    """Of some fits; the first axis counts them. See `BoundedLevenbergMarquardt`."""

    x: np.ndarray
    residual: np.ndarray
    jacobian: np.ndarray
    damping: np.ndarray
    steepest: np.ndarray
    led: np.ndarray
    inwards: np.ndarray
    jumps: np.ndarray
    earlier: np.ndarray
    reduction: np.ndarray
    seen: np.ndarray
    accepted: np.ndarray
    refused: np.ndarray


class BoundedLevenbergMarquardt:
    """Nonlinear least squares within bounds, for many fits that are asked and told.

    Attributes:
        trial: where each fit wants its residuals, `(fits, p)`.
        x: its best point so far, `(fits, p)`.
        chi2: sum of squares there, `(fits,)`; infinite where nothing is known.
        accepted: whether the last trial is the best point, `(fits,)`.
        ended: whether a fit has ended by itself, `(fits,)`.

    Example:
        >>> import numpy as np
        >>> fit = BoundedLevenbergMarquardt(np.ones((1, 2)), np.zeros(2), np.array([1.0, 5.0]))
        >>> while not fit.ended.all():
        ...     fit.tell(np.arange(1), fit.trial - np.array([2.0, 3.0]), np.eye(2)[None])
        >>> fit.x.round(4).tolist()
        [[1.0, 3.0]]
    """

    def __init__(
        self,
        starts: ArrayLike,
        lower: ArrayLike,
        upper: ArrayLike,
        *,
        rtol: float = 1e-10,
        atol: float = 1e-9,
        first_damping: float = 1.0,
    ):
        """Begin.

        Args:
            starts: `(fits, p)`.
            lower: bounds, `(p,)` or `(fits, p)`; equal to `upper` holds a variable.
            upper: bounds.
            rtol: relative decrease of a sum of squares below which its fit ends.
            atol: step relative to the width of the bounds below which a fit ends.
            first_damping: added to the normal matrix, relative to its diagonal.
        """
        self.trial = np.array(starts, float)
        self.lower, self.upper = (
            np.broadcast_to(np.asarray(x, float), self.trial.shape) for x in (lower, upper)
        )
        self.rtol, self.atol, self._first_damping = rtol, atol, first_damping
        self.x, self.chi2 = self.trial.copy(), np.full(len(self.trial), np.inf)
        self.accepted, self.ended = np.zeros((2, len(self.trial)), bool)
        self._best: _Point | None = None

    def tell(self, rows: np.ndarray, residual: np.ndarray, jacobian: np.ndarray) -> None:
        """Take or refuse trials, and propose the next ones.

        Args:
            rows: fits that are told.
            residual: at their trials, `(rows, readings)`; infinite where a reading is lost.
            jacobian: there, `(rows, readings, p)`.
        """
        if self._best is None:
            count, size = self.trial.shape
            each = count, residual.shape[1]
            self._best = _Point(
                x=self.x, residual=np.full(each, np.inf), jacobian=np.zeros((*each, size)),
                damping=np.full(count, self._first_damping), steepest=np.zeros((count, size)),
                led=np.full(each, np.nan), inwards=np.zeros(each), jumps=np.zeros(each, bool),
                earlier=np.zeros((count, 2, each[1])), reduction=np.full(count, np.inf),
                seen=np.zeros(count, bool), accepted=self.accepted, refused=np.zeros(count, int),
            )  # fmt: skip
        width = np.where(self.upper > self.lower, self.upper - self.lower, 1.0)[rows]
        with np.errstate(all="ignore"):
            before = _Point(*(x[rows] for x in self._best))
            point = _judged(before, self.trial[rows], residual, jacobian, width)
            bounds = self.lower[rows], self.upper[rows]
            trial, promise = _following(point, bounds, width, self.rtol)
            upcoming = np.max(np.abs(trial - point.x) / width, axis=1, initial=0.0)
            flat = point.accepted & (point.reduction < self.rtol)
            chi2 = np.sum(point.residual**2, axis=1)
            negligible = promise <= self.rtol * chi2
        for old, new in zip(self._best, point, strict=True):
            old[rows] = new
        self.trial[rows], self.chi2[rows] = trial, chi2
        ends = flat | negligible | (upcoming < self.atol) | (point.refused > _STUCK)
        self.ended[rows] = ends & np.isfinite(point.residual).all(axis=1)


def _judged(
    best: _Point, y: np.ndarray, residual: np.ndarray, jacobian: np.ndarray, width: np.ndarray
) -> _Point:
    """Accept or refuse trial points and set the damping."""
    before, after = np.sum(best.residual**2, axis=1), np.sum(residual**2, axis=1)
    accept = np.isfinite(after) & ((after <= before) | ~best.seen)
    good = accept & (before - after > 0.5 * _predicted(best, y))
    alone, move = _refuses_alone(best, y, residual, jacobian)
    alone &= (~accept & best.seen)[:, None]
    steepness = np.linalg.norm(best.jacobian * width[:, None], axis=2)
    led, inwards = _led(best, alone, move, steepness)
    # What refuses alone for the first time is led, and the others go as far as before.
    firstly = np.isnan(best.led).all(axis=1) & alone.any(axis=1)
    change = np.where(accept, 1.0, np.where(firstly, 1.0, _RAISE))
    change = np.where(good, 1.0 / _LOWER, change)
    jumps = best.jumps | alone
    slopes = np.where((jumps & accept[:, None])[..., None], 0.0, jacobian * width[:, None])
    steep = np.sum(slopes**2, axis=1)

    def taken(new: np.ndarray, old: np.ndarray) -> np.ndarray:
        return np.where(accept.reshape(-1, *(1,) * (new.ndim - 1)), new, old)

    return _Point(
        x=taken(y, best.x),
        residual=taken(residual, best.residual),
        jacobian=taken(jacobian, best.jacobian),
        damping=np.maximum(best.damping * np.where(best.seen, change, 1.0), 1e-15),
        steepest=np.maximum(best.steepest, np.where(np.isfinite(steep), steep, 0.0)),
        led=taken(np.full_like(led, np.nan), led),
        inwards=inwards,
        jumps=jumps,
        earlier=taken(np.stack([best.residual, steepness], axis=1), best.earlier),
        reduction=np.where(
            best.seen & accept, (before - after) / (before + 1e-300), best.reduction
        ),
        seen=np.ones_like(best.seen),
        accepted=accept,
        refused=np.where(accept, 0, best.refused + 1),
    )


def _refuses_alone(
    best: _Point, y: np.ndarray, residual: np.ndarray, jacobian: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Which reading jumps and refuses a trial that the others would take, and how far each was led.
    A fibre that becomes taut refuses too, but its slope there tells of it."""
    move, back = (_along(slope, y - best.x) for slope in (best.jacobian, jacobian))
    lost = np.asarray(~np.isfinite(residual))
    worse = np.where(lost, 0.0, residual**2 - best.residual**2)
    size = np.where(lost.any(axis=1, keepdims=True), np.where(lost, np.abs(move), -1.0), worse)
    worst = np.arange(size.shape[1]) == np.argmax(size, axis=1)[:, None]
    others = np.sum(np.where(worst, 0.0, worse), axis=1, keepdims=True)
    explained = _JUMP * np.maximum(np.abs(move), np.abs(back))
    jumps = np.abs(residual - best.residual) > explained
    return worst & jumps & (others <= 0.0) & (move != 0.0), move


def _led(
    best: _Point, alone: np.ndarray, move: np.ndarray, steepness: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """How far readings that refused alone are led next, and how far away from their limits."""
    residual, slope = best.earlier[:, 0], best.earlier[:, 1]
    # A slope grows by one over the distance from the limit: two points tell how far that is.
    limit = np.abs((best.residual - residual) / (steepness / slope - 1.0))
    away = np.minimum(np.where(np.isfinite(limit), limit, 0.0), np.abs(best.residual))
    led = _LED * np.where(alone, move, best.led)
    return led, np.where(alone, -np.sign(move) * away, best.inwards)


def _following(
    best: _Point, bounds: tuple[np.ndarray, np.ndarray], width: np.ndarray, rtol: float
) -> tuple[np.ndarray, np.ndarray]:
    """The next trial points, and by how much the sums of squares are promised to fall."""
    gone = np.isnan(best.led)
    away = _trial(best, np.where(gone, np.nan, best.inwards), bounds, width)
    along = away if gone.all() else _trial(best, best.led, bounds, width)
    promised = _predicted(best, away), _predicted(best, along)
    least = rtol * np.sum(best.residual**2, axis=1)
    inwards = promised[0] > _INWARDS * np.maximum(promised[1], least)
    return np.where(inwards[:, None], away, along), np.where(inwards, *promised)


def _trial(
    best: _Point, led: np.ndarray, bounds: tuple[np.ndarray, np.ndarray], width: np.ndarray
) -> np.ndarray:
    """The damped step from the accepted point, stopped at the bounds it meets."""
    size, jacobian = best.x.shape[1], best.jacobian * width[:, None]
    across = np.swapaxes(jacobian, 1, 2)
    normal = across @ jacobian
    known = np.asarray(~np.isnan(led))
    squares = np.trace(normal, axis1=1, axis2=2)[:, None] / np.sum(jacobian**2, axis=2)
    firm = np.where(known, _FIRMLY**2 * squares, 0.0)
    pulled = np.where(known, -firm * np.where(known, led, 0.0), best.residual)
    gradient = _along(across, pulled)
    damped = normal + (across * firm[:, None]) @ jacobian
    most = np.max(best.steepest, axis=1, keepdims=True, initial=0.0)
    diagonal = np.maximum(best.steepest, 1e-12 * most + 1e-300)
    damped = damped + (best.damping[:, None] * diagonal)[:, None] * np.eye(size)
    low, high = ((bound - best.x) / width for bound in bounds)
    held = ((low >= 0) & (gradient > 0)) | ((high <= 0) & (gradient < 0)) | (low >= high)
    step = np.zeros_like(best.x)
    # Where nothing balances there is nothing to solve.
    sure = np.isfinite(damped).all(axis=(1, 2)) & np.isfinite(gradient).all(axis=1)
    sure = np.asarray(sure)[:, None]
    held, damped = held | ~sure, np.where(sure[..., None], damped, np.eye(size))
    gradient = np.where(sure, gradient, 0.0)
    for _ in range(size + 1):
        free = ~held
        right = -(gradient + _along(damped, np.where(held, step, 0.0)))
        matrix = np.where(free[:, :, None] & free[:, None], damped, np.eye(size))
        solved = _solved(matrix, np.where(free, right, 0.0))
        solved = np.where(free, solved, step)
        step = np.clip(solved, low, high)
        stopped = held | (step != solved)
        if (stopped == held).all():
            break
        held = stopped
    return np.clip(best.x + step * width, *bounds)


def _solved(matrices: np.ndarray, rights: np.ndarray) -> np.ndarray:
    """Solutions, NaN where there is none."""
    try:
        return np.linalg.solve(matrices, rights[..., None])[..., 0]
    except np.linalg.LinAlgError:
        ranks = np.asarray(np.linalg.matrix_rank(matrices) == matrices.shape[-1])
        usable = np.where(ranks[:, None, None], matrices, np.eye(matrices.shape[-1]))
        solved = np.linalg.solve(usable, rights[..., None])[..., 0]
        return np.where(ranks[:, None], solved, np.nan)


def _predicted(best: _Point, y: np.ndarray) -> np.ndarray:
    """By how much a linear model lets the sums of squares fall."""
    model = best.residual + _along(best.jacobian, y - best.x)
    return np.sum(best.residual**2, axis=1) - np.sum(model**2, axis=1)


def _along(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Products of matrices and vectors, one for each fit."""
    return np.einsum("fij,fj->fi", matrices, vectors)


#: Evaluations of a fit that is to reach the end of a long flat valley.
PATIENT = 200
#: Relative decrease of an objective, and relative step, that end a fit.
_RTOL, _ATOL = 1e-9, 1e-8
#: Called with fits, what a trial of each gave, its best sum of squares so far, and whether the
#: trial was taken; says which of them end.
Watch = Callable[[np.ndarray, Slopes, np.ndarray, np.ndarray], np.ndarray]


@dataclasses.dataclass(frozen=True)
class ManyFits:
    """Where fits ended."""

    slopes: Slopes  # balances and derivatives there
    chi2: np.ndarray  # sum of squared errors over their variances, `(fits,)`
    converged: np.ndarray  # whether a fit ended by itself, `(fits,)`
    evaluations: int  # of all poses of one fit, summed over fits

    @property
    def values(self) -> np.ndarray:
        """Parameters, `(fits, p)`."""
        return self.slopes.values


def fit_lanes(
    balance: Balance,
    data: Observations,
    begin: Slopes,
    starts: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    *,
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
        lower: bounds, `(p,)` or `(fits, p)`; equal to `upper` holds a parameter.
        upper: bounds.
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
    here, evaluations = np.arange(len(starts)), 0
    known = begin.take(here)
    fit = BoundedLevenbergMarquardt(
        starts, lower, upper, rtol=rtol, atol=atol, first_damping=1.0 if far else 1e-3
    )
    for _ in range(most):
        if not len(here):
            break
        found = balance(fit.trial[here], known.take(here))
        evaluations += len(here)
        residual, slope = data.take(here).residual(found)
        # A step into the void is refused for its infinite squares; no NaN may spread from there.
        residual[~(np.isfinite(residual) & np.isfinite(slope).all(axis=2))] = np.inf
        slope[np.isinf(residual).any(axis=1)] = 0.0
        fit.tell(here, residual, slope)
        better, chi2 = fit.accepted[here], fit.chi2[here]
        known.put(here[better], found.take(better))
        through = fit.ended[here] | ~np.isfinite(chi2)
        if watch is not None:
            through |= watch(here, found, chi2, better)
        here = here[~through]
    return ManyFits(known, fit.chi2, fit.ended, evaluations)
