"""How far one value can go while a misfit stays within a limit: one step of an arm.

The limit of a profile is the farthest value of a parameter at which the others can still keep chi
squared low enough. That is asked here of the linear model at a point, in closed form; at the next
point the model is a better one (D. J. Venzon and S. H. Moolgavkar, Appl. Statist. 37, 87, 1988).

Where a valley of the misfit bends, the others cannot make up for a step as the derivatives at one
point say, and an arm that believes them crawls. What it saw of the derivatives elsewhere is kept as
a second-order part of the sum of squares, as NL2SOL does (J. E. Dennis, D. M. Gay and R. E. Welsch,
ACM Trans. Math. Softw. 7, 348, 1981). It costs no evaluation. Of kinks, where a fibre goes slack
or a contact begins, nothing is learned: believed, they end arms early.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Farthest(NamedTuple):
    """What a linear model says."""

    step: np.ndarray  # of all values, to where the one is farthest, `(p,)`
    # By how much the sum of squares grows there with the value, however well the others make up for
    # it; zero where the sum is too large everywhere.
    price: float
    refit: np.ndarray  # of the others where the one stays, `(p,)`
    spare: float  # by how much that lowers the sum of squares


def products(residual: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """All that a linear model of residuals `(points, r)` with slopes `(points, r, p)` says of sums
    of squares: products of columns, the residuals' last, `(points, p + 1, p + 1)`."""
    columns = np.concatenate([slope, residual[..., None]], axis=-1)
    return np.swapaxes(columns, 1, 2) @ columns


def squares(model: np.ndarray, step: np.ndarray) -> float:
    """Sum of squares that a model promises after a step `(p,)`."""
    ahead = np.append(step, 1.0)
    return float(ahead @ model @ ahead)


def farthest(
    model: np.ndarray, i: int, way: float, most: float, low: np.ndarray, high: np.ndarray,
    damping: float,
) -> Farthest:  # fmt: skip
    """Lead one value `i` as far up or down (`way` is 1 or -1) as the sum of squares allows, the
    others making up for it.

    Where the model, one of `products`, stays above `most`, the sum is made as small as can be.
    Steps of each value lie between `low` and `high`, `(p,)`; `damping` counts for the square of a
    step of one: values that change nothing stay where they are.
    """
    damped = model.copy()
    damped[np.diag_indices(len(low))] += damping
    here = np.arange(len(low)) == i
    step, price = _led(damped, i, way, most, low, high)
    stays = np.where(here, 0.0, low), np.where(here, 0.0, high)
    refit, _ = _led(damped, i, way, most, *stays)
    return Farthest(step, price, refit, float(model[-1, -1] - squares(model, refit)))


def _led(
    model: np.ndarray, i: int, way: float, most: float, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, float]:
    """The step, and the price. Values that would leave the box are stopped one by one."""
    size = len(low)
    step, held, freed, price = np.zeros(size), low >= high, np.zeros(size, bool), 0.0
    held[i] = False
    for _ in range(3 * size):
        others = ~held
        others[i] = False
        moved = np.append(np.where(held, step, 0.0), 1.0)
        # What is held is part of the residual.
        left = model[:size] @ moved
        made_up = np.linalg.solve(
            model[np.ix_(others, others)], np.stack([model[:size][others, i], left[others]], 1)
        )
        steep, half = np.array([model[i, i], left[i]]) - model[i, :size][others] @ made_up
        rest = moved @ model @ moved - left[others] @ made_up[:, 1]
        root = np.sqrt(max(half**2 - steep * (rest - most), 0.0))
        price = 2.0 * root
        step[i] = np.clip((way * root - half) / steep, low[i], high[i])
        step[others] = -made_up @ np.array([step[i], 1.0])
        beyond = np.maximum(low - step, step - high) / np.maximum(high - low, 1e-300)
        beyond[held], beyond[i] = 0.0, 0.0
        worst = int(np.argmax(beyond))
        if beyond[worst] > 0.0:
            step[worst] = np.clip(step[worst], low[worst], high[worst])
            held[worst] = True
            continue
        # What was stopped and would lower the sum on its way back is let go, once.
        uphill = model[:size] @ np.append(step, 1.0)
        wrong = held & ~freed & (low < high) & np.where(step >= high, uphill > 0, uphill < 0)
        if not wrong.any():
            break
        held, freed = held & ~wrong, freed | wrong
    return np.clip(step, low, high), price


#: A change of the gradient along a step below this says nothing of curvature.
_SILENT = 1e-12
#: A sum of squares that is flatter than this part of the linear model's has no farthest point.
_FLAT = 1e-9
#: More curvature than so many times the linear model's is no curvature but a kink that was passed.
_KINK = 3.0


def learned(
    curvature: np.ndarray, linear: np.ndarray, step: np.ndarray, change: np.ndarray
) -> np.ndarray:
    """Second-order part of half a sum of squares' Hessian, `(p, p)`, after one more step has been
    seen.

    The least change of `curvature`, in the metric of what was seen, with which the Hessian explains
    how half the gradient changed along the step, `(p,)`; unchanged where it falls along the step,
    and where a kink was passed. `linear` are products of derivatives there.

    Example:
        >>> curvature = learned(np.zeros((1, 1)), np.eye(1), np.array([2.0]), np.array([5.0]))
        >>> float((1.0 + curvature.item()) * 2.0)
        5.0
    """
    along = float(step @ change)
    if along <= _SILENT:
        return curvature
    wanted = change - linear @ step
    if abs(step @ wanted) > _KINK * float(step @ linear @ step):
        return curvature
    had = step @ curvature @ step
    # An old part that is too large for what is seen now would outlive it.
    kept = curvature * (min(1.0, abs(step @ wanted) / abs(had)) if had else 1.0)
    missing = wanted - kept @ step
    outer = np.outer(missing, change) / along
    return kept + outer + outer.T - (missing @ step) * np.outer(change, change) / along**2


def is_convex(hessian: np.ndarray, linear: np.ndarray) -> bool:
    """Whether a Hessian is positive, in the scale of the linear model's, both `(p, p)`."""
    scale = np.sqrt(np.diag(linear))
    return bool(np.linalg.eigvalsh(hessian / np.outer(scale, scale))[0] > _FLAT)
