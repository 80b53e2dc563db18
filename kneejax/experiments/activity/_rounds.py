"""A knee's secondary motion given back to the whole body, until both say the same."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

#: How much of the first change goes back, and between which limits that stays.
_FIRST = 0.5
_WITHIN = 0.1, 1.0


@dataclasses.dataclass(frozen=True)
class Round:
    """What a whole body moved with, and what the knee made of its forces.

    Attributes:
        number: 0 for the model as it was.
        flexion_deg: at which both motions are compared, `(k,)`.
        before: secondary motion that the whole body's knee had, degrees and mm, `(k, 5)`, in the
            order of `kneejax.geometry.FREE_COORDINATES`.
        after: that of the knee in balance with the whole body's forces, likewise.
        left: what splines of flexion leave of the balanced poses, rms, `(5,)`.
        holds: at how many of the instants there is a balance, and how many there are.
        moment_Nm: that holds flexion, rms.
        reaction_N: by how much the knee's reaction as the whole-body program states it differs from
            what was read of its forces, rms; NaN where it cannot be compared.
    """

    number: int
    flexion_deg: np.ndarray
    before: np.ndarray
    after: np.ndarray
    left: np.ndarray
    holds: tuple[int, int]
    moment_Nm: float
    reaction_N: float

    @property
    def residual(self) -> np.ndarray:
        """Of the fixed point: by how much the motion changed, rms and largest, `(2, 5)`."""
        change = self.change
        return np.stack([np.sqrt(np.mean(change**2, axis=0)), np.abs(change).max(axis=0)])

    @property
    def change(self) -> np.ndarray:
        """From one motion to the other, `(k, 5)`."""
        return self.after - self.before


def weights(rounds: Sequence[Round]) -> list[float]:
    """How much of each round's change goes back into the model, by Aitken's rule.

    The whole change would be put back where the forces did not answer to the motion. They do: with
    two rounds a secant tells how much, and the next change is shortened or lengthened by that.

    Args:
        rounds: in their order.

    Returns:
        One number a round, from 0.1 to 1; the first is one half.

    Source: Irons and Tuck, Int J Numer Methods Eng 1 (1969).

    Example:
        >>> def made(number, before):
        ...     at = np.full((1, 5), before)
        ...     return Round(number, np.zeros(1), at, -at, np.zeros(5), (1, 1), 0.0, 0.0)
        >>> weights([made(0, 1.0), made(1, 0.0)])
        [0.5, 0.5]
    """
    found = [_FIRST]
    for last, this in zip(rounds, rounds[1:], strict=False):
        turn = this.change - last.change
        size = float(np.sum(turn * turn))
        secant = -found[-1] * float(np.sum(last.change * turn)) / size if size else found[-1]
        found.append(float(np.clip(secant, *_WITHIN)))
    return found[: len(rounds)]
