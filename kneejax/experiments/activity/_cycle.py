"""When in a cycle of gait an instant is: from heel strike to heel strike."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kneejax.mechanics import LegRecord

#: Upward force of the ground from which a foot stands on it, N, if no other component is larger.
STANDS_N = 20.0
#: No foot that stands is off the ground for less, s.
_SHORTEST_S = 0.05


class Cycle(NamedTuple):
    """Instants as parts of a cycle.

    Attributes:
        percent: `(n,)`; negative before the first heel strike.
        toe_off: percent at which the foot leaves the ground; NaN where it is not recorded.
        words: what 0 and 100 are.
        is_gait: whether that is a cycle of gait, from one heel strike to the next.
    """

    percent: np.ndarray
    toe_off: float
    words: str
    is_gait: bool = False

    @property
    def axis_label(self) -> str:
        """What an axis of `percent` is called."""
        return "Gait cycle, %" if self.is_gait else "Record, %"


def cycle_of(record: LegRecord) -> Cycle:
    """Count a record from heel strike to heel strike, as the force of the ground tells.

    Args:
        record: of a gait, or of something else: without a foot that comes down and bears weight,
            as in a squat or a drawer, 0 and 100 are the ends of the record.

    Example:
        >>> import types
        >>> ground = np.array([0, 0, 300, 300, 300, 0, 0, 0, 300.0])[:, None] * [0, 1, 0]
        >>> record = types.SimpleNamespace(time_s=np.arange(9) / 10, ground_N=ground)
        >>> cycle = cycle_of(record)
        >>> cycle.words, *(round(float(x), 6) for x in (*cycle.percent[[2, 8]], cycle.toe_off))
        ('from heel strike to heel strike', 0.0, 100.0, 50.0)
    """
    time = np.asarray(record.time_s, float)
    # A device that draws the tibia forwards is no ground: that presses upwards, along Y.
    upwards = np.asarray(record.ground_N)[:, 1]
    stands = (upwards > STANDS_N) & (upwards >= np.abs(record.ground_N).max(axis=1))
    change = np.diff(stands.astype(int))
    strikes, lifts = time[1:][change > 0], time[1:][change < 0]
    strikes = strikes[np.diff(strikes, prepend=-np.inf) > _SHORTEST_S]
    if not len(strikes):
        begin, end, words = time[0], time[-1], "the whole record"
    elif len(strikes) == 1:
        begin, end, words = strikes[0], time[-1], "from heel strike to the end of the record"
    else:
        begin, end, words = strikes[0], strikes[1], "from heel strike to heel strike"
    percent = 100.0 * (time - begin) / (end - begin)
    after = lifts[(lifts > begin) & (lifts < end)]
    toe_off = 100.0 * (after[-1] - begin) / (end - begin) if len(after) else np.nan
    return Cycle(percent, float(toe_off), words, len(strikes) > 1)
