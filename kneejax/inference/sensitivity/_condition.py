"""What became of a motion: the worst over its poses."""

from __future__ import annotations

import enum
from collections.abc import Collection

import numpy as np

from kneejax.statics import FAILURES, Status, converged, fails


class Condition(enum.IntEnum):
    """Outcome of the motion at a grid point: the worst over its poses.

    Attributes:
        sentence: what that means.
    """

    SOUND = 0, "balanced, stable and physiological at every pose"
    OUTSIDE_REGION = 1, "equilibrium found, but contact lies off the fitted cartilage at some pose"
    UNPHYSIOLOGICAL = (
        2,
        "equilibrium found, but unphysiological: farther from the baseline motion than knees move, "
        "dislocated, or at a fault that the study counts as a failure",
    )
    UNSTABLE = 3, "forces balance, but a small push would move the knee away at some pose"
    NO_BALANCE = 4, "no balance at some pose"

    sentence: str

    def __new__(cls, value: int, sentence: str) -> Condition:
        member = int.__new__(cls, value)
        member._value_ = value
        member.sentence = sentence
        return member

    @property
    def word(self) -> str:
        """Name for tables."""
        return self.name.lower()


def worst_condition(
    status: np.ndarray, unphysiological: np.ndarray, failures: Collection[Status] = FAILURES
) -> np.ndarray:
    """What became of motions: the worst `Condition` over the poses, the last axis of both.

    Args:
        status: `Status` values, `(..., poses)`.
        unphysiological: truth values, `(..., poses)`.
        failures: statuses of balances that count for nothing.

    Returns:
        `Condition` values, `(...)`.
    """
    failed = fails(status, failures) | (status == Status.DISLOCATED)
    condition = np.zeros(np.shape(status)[:-1], np.int8)
    worst = [
        (status == Status.OUTSIDE_REGION, Condition.OUTSIDE_REGION),
        (unphysiological | failed, Condition.UNPHYSIOLOGICAL),
        (status == Status.UNSTABLE, Condition.UNSTABLE),
        (~converged(status), Condition.NO_BALANCE),
    ]
    for where, what in worst:
        condition[where.any(axis=-1)] = what
    return condition
