"""The times at which a motion is computed."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kneejax.numerics import WrongValue

#: Parts of the first step: it begins with order one, and the errors of that shrink with its square.
_FIRST = (1, 1, 2, 4, 8)
#: Growth of a step against the one before; the formula is stable up to 2.4.
_LONGER = 2.0


@dataclasses.dataclass(frozen=True)
class Grid:
    """Steps through time.

    Attributes:
        time_s: at the end of each step, `(steps,)`, from 0.
        asked: rows of the steps that end at times that were asked for; the start is none of them.
    """

    time_s: NDArray[np.float64]
    asked: NDArray[np.int64]

    @classmethod
    def of(cls, time_s: ArrayLike, within: ArrayLike = 1) -> Grid:
        """Equal steps between two of the times asked for.

        Args:
            time_s: rising, from the start on, `(times,)`; two at least.
            within: steps between two of them, one number or one for each pair. No step is made
                more than about twice as long as the one before it.

        Raises:
            ValueError: times that do not rise, or fewer than one step.

        Example:
            >>> Grid.of([0.0, 0.1, 0.2]).time_s[[0, 4, 5]].tolist()
            [0.00625, 0.1, 0.2]
        """
        times = np.asarray(time_s, float)
        if times.ndim != 1 or len(times) < 2 or not np.isfinite(times).all():
            raise WrongValue("time_s", str(times), "two finite times at least")
        back = np.flatnonzero(np.diff(times) <= 0.0)
        if len(back):
            at = back[0]
            found = f"{times[at + 1]:g} s after {times[at]:g} s"
            raise WrongValue("time_s", found, "times that rise")
        count = len(times) - 1
        parts = np.broadcast_to(np.asarray(within, int), (count,)).copy()
        if parts.min() < 1:
            raise WrongValue("within", str(parts.min()), "one step at least between two times")
        span = np.diff(times)
        for k in range(1, count):
            longest = _LONGER * span[k - 1] / parts[k - 1]
            parts[k] = max(parts[k], int(np.ceil(span[k] / longest - 1e-9)))
        first = np.cumsum(_FIRST[:-1]) / sum(_FIRST) * span[0] / parts[0]
        ends = [
            t + length * np.arange(1, n + 1) / n
            for t, length, n in zip(times[:-1], span, parts, strict=True)
        ]
        every = np.concatenate([times[0] + first, *ends])
        return cls(every - times[0], len(first) + np.cumsum(parts) - 1)

    def within(self) -> NDArray[np.int64]:
        """Steps between two of the times asked for."""
        found = np.diff(self.asked, prepend=-1)
        found[0] -= len(_FIRST) - 1
        return found

    @property
    def length_s(self) -> NDArray[np.float64]:
        """Of each step."""
        return np.diff(self.time_s, prepend=0.0)

    @property
    def ratio(self) -> NDArray[np.float64]:
        """Of each step to the one before; 0 of the first."""
        length = self.length_s
        return np.concatenate([[0.0], length[1:] / length[:-1]])
