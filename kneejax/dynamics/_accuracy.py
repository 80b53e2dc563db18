"""Motions as exact as they are wanted: steps are halved, and shortened where that tells."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kneejax.dynamics._account import CLOSES_WITHIN
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

    A motion is compared with the one before it, whose steps were twice as long at least
    (`_error_of`). Where its error is too large all steps are halved, and become shorter still where
    they surprised most, and where one could not be taken, and so where the account of energy does
    not close; no more than 256 are made between two times.

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

    def moved(within: NDArray[np.int64]) -> Trajectory:
        return move(moving, start, time_s, **options, within=within)

    wanted = np.ones(len(np.asarray(time_s)) - 1, int)
    # Steps that cannot be taken become as short as they may.
    while True:
        coarse = moved(wanted)
        wanted = _shorter(coarse, float("inf"))
        if np.array_equal(wanted, coarse.grid.within()):
            break
    while True:
        fine = moved(np.maximum(2 * coarse.grid.within(), wanted))
        error = _error_of(coarse, fine)
        fine = dataclasses.replace(fine, error_mm=error)
        going_on = bool(converged(np.asarray(fine.status)).all())
        # Energy that steps lose tells of what is over before the next time that was asked for.
        missing = float(fine.account().part_missing) if going_on else 0.0
        factor = max(error / most_mm, missing / CLOSES_WITHIN)
        wanted = _shorter(fine, factor)
        if (factor <= 1.0 and going_on) or np.array_equal(wanted, fine.grid.within()):
            return fine
        coarse = fine


def _error_of(coarse: Trajectory, fine: Trajectory) -> float:
    """Largest error of a motion, `coarse`, by another with shorter steps, mm (rotations at 30 mm),
    over the times that both reach; infinite where none is.

    Errors fall with the square of the steps, so that steps half as long leave a third of the
    difference. Where some became shorter than others, the error is taken to stem from where the
    longer steps surprised.
    """
    off = (np.asarray(fine.q) - np.asarray(coarse.q)) / np.array(scales(fine.names))
    known = np.asarray(np.isfinite(off).all(axis=1))
    if not known[1:].any():
        return float("inf")
    shorter = fine.grid.within() / coarse.grid.within()
    surprise = _surprises(coarse, np.add) + np.finfo(float).tiny
    left = float(np.sum(surprise / shorter**2) / np.sum(surprise))
    return float(np.abs(off[known]).max()) * left / (1.0 - left)


def _surprises(motion: Trajectory, how: np.ufunc) -> NDArray[np.float64]:
    """How far its steps ended from where they were expected, for each two of the times, mm."""
    each = np.nan_to_num(np.asarray(motion.moments.surprise)[1:, 0])
    begin = np.concatenate([[0], motion.grid.asked[:-1] + 1])
    return how.reduceat(each, begin)


def _shorter(fine: Trajectory, factor: float) -> NDArray[np.int64]:
    """Steps between two times that promise an error so much less: each should surprise alike.

    With an error that is not known, infinite, only steps that could not be taken become shorter.
    """
    within, each = fine.grid.within(), _surprises(fine, np.maximum)
    # What is left of an error falls with the square of the steps, a surprise with the cube.
    less = max(1.2 * factor, 1.0) if np.isfinite(factor) else 1.0
    allowed = max(each.max(), 1e-12) / less**1.5
    times = np.ceil(np.cbrt(np.maximum(each / allowed, 1.0)) - 1e-9).astype(int)
    lost = ~np.asarray(converged(np.asarray(fine.status)))
    if lost.any():
        first = int(np.flatnonzero(lost)[0]) - 1
        times[max(first - 1, 0) : first + 1] *= 4
    return np.maximum(within, np.minimum(within * times, MOST_WITHIN))
