"""Optimal design: which of several measurements leave the least uncertainty, D or A."""

from __future__ import annotations

import numpy as np

#: What a choice of tests makes small: D the volume of the joint confidence region, A the mean
#: squared standard error in units of the parameters' scales.
CRITERIA = ("D", "A")
# Exchanges that gain less are rounding.
_GAIN = 1e-10


def choose(
    base: np.ndarray, told: np.ndarray, count: int, criterion: str = "D", *,
    usable: np.ndarray | None = None, repeat: bool = False,
) -> tuple[int, ...]:  # fmt: skip
    """Choose candidates: one after the other, then exchanging while that gains.

    The best next one is added until there are enough (greedy). Then each is exchanged for any other
    candidate while the criterion falls (Fedorov), and the final choice is put in the order in
    which each next one tells most.

    Args:
        base: information that exists, regular, `(p, p)`.
        told: information of each candidate, `(candidates, p, p)`.
        count: how many to choose.
        criterion: `D` or `A`.
        usable: candidates to choose from, `(candidates,)`; all by default.
        repeat: whether one may be chosen several times.

    Returns:
        Rows of `told`.

    Example:
        >>> base, told = np.eye(2), np.array([np.diag([9.0, 0.0]), np.diag([1.0, 1.0])])
        >>> choose(base, told, 1)
        (0,)
    """
    usable = np.ones(len(told), bool) if usable is None else np.asarray(usable, bool)
    rows: list[int] = _greedy(base, told, count, criterion, usable, repeat)
    total = base + told[rows].sum(axis=0)
    best = float(criterion_of(total, criterion))
    improved = True
    while improved:
        improved = False
        for place in range(count):
            others = total - told[rows[place]]
            values = criterion_of(others + told, criterion)
            values[~usable] = np.inf
            if not repeat:
                values[rows] = np.inf
            candidate = int(np.argmin(values))
            if values[candidate] < best - _GAIN * max(1.0, abs(best)):
                rows[place], best = candidate, float(values[candidate])
                total, improved = others + told[candidate], True
    own, order = told[rows], np.ones(count, bool)
    return tuple(rows[i] for i in _greedy(base, own, count, criterion, order, False))


def criterion_of(information: np.ndarray, criterion: str) -> np.ndarray:
    """What is made small: minus the log determinant (D) or the trace of the inverse (A).

    Args:
        information: `(..., p, p)`, regular.
        criterion: `D` or `A`.

    Example:
        >>> criterion_of(np.diag([4.0, 4.0]), "A").tolist()
        0.5
    """
    if criterion == "D":
        return -np.linalg.slogdet(information)[1]
    return np.trace(np.linalg.inv(information), axis1=-2, axis2=-1)


def standard_errors(information: np.ndarray) -> np.ndarray:
    """Standard errors that regular information promises, `(..., p)`.

    Example:
        >>> standard_errors(np.diag([4.0, 100.0])).tolist()
        [0.5, 0.1]
    """
    return np.sqrt(np.diagonal(np.linalg.inv(information), axis1=-2, axis2=-1))


def _greedy(base, told, count, criterion, usable, repeat) -> list[int]:
    rows, total, free = [], base, usable.copy()
    for _ in range(count):
        values = np.where(free, criterion_of(total + told, criterion), np.inf)
        rows.append(int(np.argmin(values)))
        total = total + told[rows[-1]]
        free[rows[-1]] = repeat
    return rows
