"""Balances of many operated knees, each followed by itself or from its neighbours on a grid."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kneejax.planning._reconstruction import Reconstruction
from kneejax.statics import (
    Equilibria,
    LoadCases,
    Progress,
    Slopes,
    balance_lines,
    balance_many,
    balance_with_slopes,
    converged,
)


class Poses(NamedTuple):
    """Balanced poses of variants at load cases.

    Attributes:
        q: free coordinates, `(v, s, free)`; NaN where forces do not balance.
        status: `Status` values, `(v, s)`.
        near: with derivatives, to predict others from; None where none were asked for.
    """

    q: np.ndarray
    status: np.ndarray
    near: Slopes | None


def balanced(
    plan: Reconstruction,
    values: np.ndarray,
    load_cases: LoadCases,
    *,
    slopes: bool = False,
    near: Slopes | None = None,
    grid: tuple[int, int] | None = None,
    progress: Progress | None = None,
) -> Poses:
    """Balance variants at load cases.

    Args:
        plan: the knee and its grafts.
        values: numbers of the variants, `(v, numbers)`.
        load_cases: flexions and loads.
        slopes: whether derivatives are wanted.
        near: of near variants, to begin from, with derivatives.
        grid: rows and columns in which the variants stand, if they are near each other: each is
            then predicted from its neighbour, which takes two fifths of the time.
        progress: called now and then with balances done and asked for.

    Returns:
        The poses that were found.
    """
    if slopes:
        found = near = balance_with_slopes(plan.knee, plan.vary, values, load_cases, near)
    elif grid is None:
        near = None
        found = balance_many(plan.knee, plan.vary, values, load_cases, progress=progress)
    else:
        found, near = _on_grid(plan, values, load_cases, grid, progress), None
    known = converged(found.status)[..., None]
    return Poses(np.where(known, found.q, np.nan), found.status, near)


def _on_grid(
    plan: Reconstruction,
    values: np.ndarray,
    load_cases: LoadCases,
    grid: tuple[int, int],
    progress: Progress | None,
) -> Equilibria:
    rows, columns = grid
    lines, row, column = values.reshape(rows, columns, -1), rows // 2, columns // 2

    def along(lines: np.ndarray, begin: np.ndarray, near: Equilibria | None, report) -> Equilibria:
        return balance_lines(
            plan.knee, plan.vary, lines, load_cases, begin, near=near, progress=report
        )

    spine = along(lines[None, :, column], np.array([row]), None, None)
    found = along(lines, np.full(rows, column), spine.at(0), progress)
    size = len(load_cases)
    return Equilibria(
        *(x.reshape(rows * columns, size, *x.shape[3:]) for x in (
            found.q, found.contact_points, found.status, found.steps, found.reached, found.fault,
            found.softness)),
        free=found.free,
    )  # fmt: skip
