"""How a fibre passes its obstacle over given poses, and where it changes sides."""

from __future__ import annotations

import enum

import numpy as np

from kneejax.experiments._evaluate import Mechanics

# Two ways around whose lengths differ by less compete, mm.
_CLOSE_MM = 0.5


class Way(enum.IntEnum):
    """How a fibre runs at a pose.

    Attributes:
        word: for tables.
        sentence: what it means and what to do; empty where nothing is wrong.
    """

    STRAIGHT = 0, ""
    FREE = 1, ""
    WRAPPED = 2, ""
    NEAR_FLIP = (
        3,
        "the ways around both sides of the obstacle are nearly as long: a small motion may flip "
        "the fibre; move the obstacle or an attachment",
    )
    FLIPPED = (
        4,
        "the fibre passes its obstacle on the other side than at the pose before: length and force "
        "jump; take smaller steps, or move the obstacle or an attachment",
    )
    BEYOND_ENDS = (
        5,
        "the fibre touches its cylinder beyond the cylinder's length: make it longer, or "
        "check its place",
    )
    INSIDE = (
        6,
        "an end of the fibre lies inside its obstacle: its length means nothing; make the "
        "obstacle smaller or move the attachment",
    )

    sentence: str

    def __new__(cls, value: int, sentence: str) -> Way:
        member = int.__new__(cls, value)
        member._value_ = value
        member.sentence = sentence
        return member

    @property
    def word(self) -> str:
        """Name for tables."""
        return self.name.lower()

    @property
    def doubtful(self) -> bool:
        """Whether lengths and forces are not to be trusted as they stand."""
        return self in (Way.FLIPPED, Way.BEYOND_ENDS, Way.INSIDE)


def ways_of(found: Mechanics) -> np.ndarray:
    """How each fibre runs at each pose.

    Args:
        found: of poses that follow each other; a fibre is compared with the pose before.

    Returns:
        `Way` values, `(poses, ligaments)`.
    """
    angle, side = np.asarray(found.wrap_angle), np.asarray(found.wrap_side)
    other, wrapped = np.asarray(found.other_side), angle > 0
    ways = np.where(wrapped, Way.WRAPPED, Way.FREE)
    ways = np.where(wrapped & (other < _CLOSE_MM), Way.NEAR_FLIP, ways)
    turned = np.zeros_like(wrapped)
    # Only a fibre that lies on its obstacle at both poses can change sides by a jump.
    turned[1:] = wrapped[1:] & wrapped[:-1] & ((side[1:] * side[:-1]).sum(axis=-1) < 0.0)
    ways = np.where(turned, Way.FLIPPED, ways)
    ways = np.where(np.asarray(found.wrap_beyond), Way.BEYOND_ENDS, ways)
    ways = np.where((side == 0.0).all(axis=-1), Way.STRAIGHT, ways)
    return np.where(np.asarray(found.wrap_inside), Way.INSIDE, ways)
