"""The times at which a motion is computed."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

#: Parts of the first step: it begins with order one, and the errors of that shrink with its square.
_FIRST = (1, 1, 2, 4, 8)


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
    def of(cls, time_s: ArrayLike, within: int = 1) -> Grid:
        """Equal steps between the times asked for.

        Args:
            time_s: rising, from the start on, `(times,)`; two at least.
            within: steps between two of them.

        Raises:
            ValueError: times that do not rise, or fewer than one step.

        Example:
            >>> Grid.of([0.0, 0.1, 0.2]).time_s[[0, 4, 5]].tolist()
            [0.00625, 0.1, 0.2]
        """
        times = np.asarray(time_s, float)
        if times.ndim != 1 or len(times) < 2 or not np.isfinite(times).all():
            raise ValueError("Grid needs two finite times at least")
        back = np.flatnonzero(np.diff(times) <= 0.0)
        if len(back):
            at = back[0]
            raise ValueError(
                f"time {times[at + 1]:g} s follows {times[at]:g} s; expected times that rise"
            )
        if within < 1:
            raise ValueError(f"{within} steps between two times; expected one at least")
        parts = np.arange(1, within + 1) / within
        ends = times[:-1, None] + np.diff(times)[:, None] * parts
        first = np.cumsum(_FIRST[:-1]) / sum(_FIRST) * (ends[0, 0] - times[0])
        every = np.concatenate([times[0] + first, ends.ravel()])
        asked = len(first) + within * np.arange(1, len(times)) - 1
        return cls(every - times[0], asked)

    @property
    def length_s(self) -> NDArray[np.float64]:
        """Of each step."""
        return np.diff(self.time_s, prepend=0.0)

    @property
    def ratio(self) -> NDArray[np.float64]:
        """Of each step to the one before; 0 of the first."""
        length = self.length_s
        return np.concatenate([[0.0], length[1:] / length[:-1]])
