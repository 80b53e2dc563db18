"""How a fibre passes its obstacle over given poses, and where it changes sides."""

from __future__ import annotations

import enum

import numpy as np
from numpy.typing import ArrayLike

from kneejax.experiments._evaluate import Mechanics
from kneejax.statics import Status

# Two ways around whose lengths differ by less compete, mm.
_CLOSE_MM = 0.5


class Way(enum.IntEnum):
    """How a fibre runs at a pose; what that makes of the pose, its `Status` says.

    A small motion may flip a fibre that is `NEAR_FLIP`: its ways around both sides of the obstacle
    are nearly as long.
    """

    STRAIGHT = 0
    FREE = 1
    WRAPPED = 2
    NEAR_FLIP = 3
    FLIPPED = 4
    BEYOND_ENDS = 5
    INSIDE = 6

    @property
    def word(self) -> str:
        """Name for tables."""
        return self.name.lower()


def ways_of(found: Mechanics) -> np.ndarray:
    """How each fibre runs at each pose.

    Args:
        found: of poses that follow each other; a fibre is compared with the pose before.

    Returns:
        `Way` values, `(poses, ligaments)`.
    """
    wrapped, side = np.asarray(found.wrap_angle) > 0, np.asarray(found.wrap_side)
    ways = np.where(wrapped, Way.WRAPPED, Way.FREE)
    ways = np.where(near_flip(found), Way.NEAR_FLIP, ways)
    ways = np.where(flipped(found), Way.FLIPPED, ways)
    ways = np.where(np.asarray(found.wrap_beyond), Way.BEYOND_ENDS, ways)
    ways = np.where((side == 0.0).all(axis=-1), Way.STRAIGHT, ways)
    return np.where(np.asarray(found.wrap_inside), Way.INSIDE, ways)


def near_flip(found: Mechanics) -> np.ndarray:
    """Whose ways around both sides are nearly as long, `(poses, ligaments)`."""
    return (np.asarray(found.wrap_angle) > 0) & (np.asarray(found.other_side) < _CLOSE_MM)


def flipped(found: Mechanics) -> np.ndarray:
    """Which fibres pass their obstacle on the other side than at the pose before.

    Args:
        found: of poses that follow each other.

    Returns:
        Truth values, `(poses, ligaments)`.
    """
    wrapped, side = np.asarray(found.wrap_angle) > 0, np.asarray(found.wrap_side)
    turned = np.zeros_like(wrapped)
    # Only a fibre that lies on its obstacle at both poses can change sides by a jump.
    turned[1:] = wrapped[1:] & wrapped[:-1] & ((side[1:] * side[:-1]).sum(axis=-1) < 0.0)
    return turned


def with_flips(status: ArrayLike, found: Mechanics) -> np.ndarray:
    """Status of poses that follow each other: a fibre is compared with the pose before.

    Args:
        status: of each pose by itself, `(poses,)`.
        found: their mechanics.

    Returns:
        `Status` values, `way_flipped` where that is the worst.
    """
    status = np.asarray(status)
    jumps = flipped(found).any(axis=1) & (status < Status.WAY_FLIPPED)
    return np.where(jumps, int(Status.WAY_FLIPPED), status)
