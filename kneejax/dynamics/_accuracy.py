"""Motions as exact as they are wanted: every step is halved, and shortened where that tells."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kneejax.dynamics._account import CLOSES_WITHIN
from kneejax.dynamics._grid import Grid
from kneejax.dynamics._moving import MovingKnee
from kneejax.dynamics._trajectory import Trajectory, move
from kneejax.geometry import scales
from kneejax.statics import converged

#: Steps between two times at most: what still cannot be taken then ends the motion.
MOST_WITHIN = 256


def move_within(
    most_mm: float, moving: MovingKnee, start: ArrayLike, time_s: ArrayLike, **options
) -> Trajectory:
    """Let a knee move, with steps so short that its poses are right within an error.

    The motion is computed twice, with every step halved the second time. A formula of second order
    leaves a third of the difference as the error of the second. Where that is too large, steps
    become shorter where they surprised most, and where one could not be taken, and so where the
    account of energy does not close; no more than 256 are made between two times.

    Args:
        most_mm: that is left of the error at any of the times, mm (rotations at 30 mm).
        moving: as `move`; likewise the others.
        start: likewise.
        time_s: likewise.
        options: likewise.

    Returns:
        The motion; `error_mm` says what its error is, which exceeds `most_mm` where not even the
        shortest steps were enough.
    """
    within = np.ones(len(np.asarray(time_s)) - 1, int)
    while True:
        coarse = move(moving, start, time_s, **options, within=within)
        grid = Grid.of(time_s, 2 * coarse.grid.within())
        fine = move(moving, start, time_s, **options, within=grid.within())
        error = error_of(coarse, fine)
        fine = dataclasses.replace(fine, error_mm=error)
        going_on = bool(converged(np.asarray(fine.status)).all())
        # Energy that steps lose tells of what is over before the next time that was asked for.
        missing = float(fine.account().part_missing) if going_on else 0.0
        factor = max(error / most_mm, missing / CLOSES_WITHIN)
        good = factor <= 1.0 and going_on
        made = grid.within()
        wanted = np.maximum(made, np.minimum(_shorter(fine, factor), MOST_WITHIN))
        if good or np.array_equal(wanted, made):
            return fine
        within = -(-wanted // 2)


def error_of(coarse: Trajectory, fine: Trajectory) -> float:
    """Largest error of a motion whose steps are half as long as those of another, mm.

    Over the times that both reach; infinite where none is.
    """
    off = (np.asarray(fine.q) - np.asarray(coarse.q)) / np.array(scales(fine.names))
    known = np.asarray(np.isfinite(off).all(axis=1))
    return float(np.abs(off[known]).max() / 3.0) if known[1:].any() else float("inf")


def _shorter(fine: Trajectory, factor: float) -> NDArray[np.int64]:
    """Steps between two times that promise an error so much less: each should surprise alike."""
    within = fine.grid.within()
    ends = np.concatenate([[0], fine.grid.asked + 1])
    surprise = np.nan_to_num(np.asarray(fine.moments.surprise)[1:, 0])
    each = np.array([surprise[a:b].max() for a, b in zip(ends[:-1], ends[1:], strict=True)])
    # What is left of an error falls with the square of the steps, a surprise with the cube.
    less = max(1.2 * factor, 1.0) if np.isfinite(factor) else 1.0
    allowed = max(each.max(), 1e-12) / less**1.5
    times = np.ceil(np.cbrt(np.maximum(each / allowed, 1.0)) - 1e-9).astype(int)
    lost = ~np.asarray(converged(np.asarray(fine.status)))
    if lost.any():
        first = int(np.flatnonzero(lost)[0]) - 1
        times[max(first - 1, 0) : first + 1] *= 4
    return np.asarray(within * times)
