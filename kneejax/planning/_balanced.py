"""Balances of many operated knees, each walked to by itself or from its neighbours on a grid."""

from __future__ import annotations

import numpy as np

from kneejax.planning._reconstruction import Reconstruction
from kneejax.statics import Balances, Progress, Stations, balance_lines, balance_many


def balanced(
    plan: Reconstruction,
    values: np.ndarray,
    stations: Stations,
    grid: tuple[int, int] | None = None,
    progress: Progress | None = None,
) -> Balances:
    """Balance variants at stations.

    Args:
        plan: the knee and its grafts.
        values: numbers of the variants, `(v, numbers)`.
        stations: flexions and loads.
        grid: rows and columns in which the variants stand, if they are near each other: each is
            then predicted from its neighbour, which takes two fifths of the time.
        progress: called now and then with balances done and asked for.

    Returns:
        Arrays begin with variant and station.
    """
    if grid is None:
        return balance_many(plan.knee, plan.vary, values[0], values, stations, progress=progress)
    rows, columns = grid
    lines, row, column = values.reshape(rows, columns, -1), rows // 2, columns // 2
    base = lines[row, column]

    def along(lines: np.ndarray, begin: np.ndarray, near: Balances | None, report) -> Balances:
        return balance_lines(
            plan.knee, plan.vary, base, lines, stations, begin, near=near, progress=report
        )

    spine = along(lines[None, :, column], np.array([row]), None, None)
    found = along(lines, np.full(rows, column), spine.at(0), progress)
    size = len(stations)
    return Balances(
        *(x.reshape(rows * columns, size, *x.shape[3:]) for x in (
            found.q, found.meeting, found.status, found.steps, found.reached, found.fault)),
        free=found.free,
    )  # fmt: skip
