"""Varus and valgus moments on a knee under axial load: the simulation of paper 4."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import numpy as np

from kneejax.mechanics import Knee, load_of
from kneejax.statics import Equilibria, LoadCases, Status, balance_many, itself

#: N; of the mean mass, 66.2 kg, of paper 4's four subjects (its Table 1).
BODY_WEIGHT_N = 649.2
VARUS, VALGUS = "varus", "valgus"
#: Directions of the moment, and its sign about the floating axis.
DIRECTIONS = {VARUS: 1.0, VALGUS: -1.0}
#: Degrees or mm between neighbouring steps that no knee follows.
_JUMP = 10.0


@dataclasses.dataclass(frozen=True)
class VarusValgusRamp:
    """Axial load in steps, then a moment in steps while that load stays.

    The axial load is half a body weight, `compression_N` of `kneejax.mechanics.load_of`; the moment
    is its `varus_Nm`. Both act besides the loads and lines of the knee.

    Attributes:
        flexion_deg: prescribed.
        axial_N: `(steps,)`.
        moment_Nm: `(steps,)`, positive in varus.
        full_Nm: the moment that is aimed at, positive.
    """

    flexion_deg: float
    axial_N: np.ndarray
    moment_Nm: np.ndarray
    full_Nm: float

    @classmethod
    def towards(
        cls,
        direction: str,
        full_Nm: float = 40.0,
        body_weight_N: float = BODY_WEIGHT_N,
        axial_steps: int = 4,
        moment_steps: int = 80,
        flexion_deg: float = 0.0,
    ) -> VarusValgusRamp:
        """A ramp in equal steps.

        Args:
            direction: `varus` or `valgus`.
            full_Nm: moment at its end.
            body_weight_N: the axial load is half of it.
            axial_steps: to reach the axial load; the last has no moment yet.
            moment_steps: to reach the moment.
            flexion_deg: prescribed.

        Example:
            >>> ramp = VarusValgusRamp.towards("valgus", 40.0, 600.0, 1, 2)
            >>> ramp.moment_Nm.tolist(), ramp.axial_N.tolist()
            ([0.0, -20.0, -40.0], [300.0, 300.0, 300.0])
        """
        rise = np.arange(1, axial_steps + 1) / axial_steps
        turn = DIRECTIONS[direction] * full_Nm * np.arange(1, moment_steps + 1) / moment_steps
        axial = 0.5 * body_weight_N * np.r_[rise, np.ones(moment_steps)]
        return cls(flexion_deg, axial, np.r_[np.zeros(axial_steps), turn], full_Nm)

    def __len__(self) -> int:
        return len(self.moment_Nm)

    @property
    def loaded(self) -> np.ndarray:
        """Whether the axial load is complete, `(steps,)`."""
        return self.axial_N >= self.axial_N[-1]

    @property
    def time(self) -> np.ndarray:
        """Time in paper 4's Table 2, `(steps,)`: axial load from 1.5 to 2, moment from 2 to 3."""
        return 1.5 + 0.5 * self.axial_N / self.axial_N[-1] + np.abs(self.moment_Nm) / self.full_Nm

    @property
    def load_cases(self) -> LoadCases:
        """Flexion and loads for statics."""
        load = load_of(compression_N=self.axial_N, varus_Nm=self.moment_Nm, name="varus_valgus")
        return LoadCases.at(np.full(len(self), self.flexion_deg), [load])


@dataclasses.dataclass(frozen=True)
class VarusValgus:
    """A knee, or variants of it, on such a ramp.

    A load that only grows ends where the knee cannot follow: at the first step without a balance,
    with an unstable one, with one where surfaces meet outside their fitted regions (what lies
    there is not known), or with one so far from the step before (10 degrees or mm) that the knee
    must have jumped.

    Attributes:
        ramp: the loads.
        balances: of the variants at the steps of the ramp, also beyond such an end.
    """

    ramp: VarusValgusRamp
    balances: Equilibria

    @functools.cached_property
    def reached(self) -> np.ndarray:
        """Number of steps that each variant holds before its end, `(variants,)`."""
        fine = (self.balances.status == Status.BALANCED) & ~self._jumps
        return np.where(fine.all(axis=1), len(self.ramp), np.argmin(fine, axis=1))

    @property
    def held(self) -> np.ndarray:
        """Whether a variant got to a step, `(variants, steps)`."""
        return np.arange(len(self.ramp)) < self.reached[:, None]

    @property
    def ending(self) -> tuple[str, ...]:
        """What ends the ramp of each variant: a word of `Status`, `jump`, or empty at its top."""
        words = []
        for row, step in enumerate(self.reached):
            if step == len(self.ramp):
                words.append("")
            else:
                status = Status(int(self.balances.status[row, step]))
                words.append("jump" if status is Status.BALANCED else status.word)
        return tuple(words)

    @property
    def adduction_deg(self) -> np.ndarray:
        """Varus rotation, `(variants, steps)`; NaN beyond what was reached."""
        return np.where(self.held, self.balances.table[..., 0], np.nan)

    @property
    def time_reached(self) -> np.ndarray:
        """Last time held, as paper 4 counts it (`VarusValgusRamp.time`), `(variants,)`."""
        return np.r_[1.5, self.ramp.time][self.reached]

    @property
    def moment_reached_Nm(self) -> np.ndarray:
        """Last moment held, positive in varus, `(variants,)`."""
        return np.r_[0.0, self.ramp.moment_Nm][self.reached]

    @property
    def _jumps(self) -> np.ndarray:
        apart = np.abs(np.diff(self.balances.table, axis=1)).max(axis=-1, initial=0.0)
        return np.pad(apart > _JUMP, ((0, 0), (1, 0)))


def varus_valgus(
    knee: Knee,
    ramp: VarusValgusRamp,
    vary=None,
    values: Any = None,
    progress=None,
) -> VarusValgus:
    """Load a knee, or variants of it, in varus or valgus.

    Args:
        knee: any knee.
        ramp: the loads.
        vary: makes a variant, as in `kneejax.statics.balance_many`; likewise `values` and
            `progress`. Without it the knee itself is loaded: one variant.

    Returns:
        Rotation, and how much of the load each variant holds.

    Source: paper 4, section 2.2 and Table 2.
    """
    if vary is None:
        vary, values = itself, np.zeros(1)
    found = balance_many(knee, vary, values, ramp.load_cases, progress=progress)
    return VarusValgus(ramp, found)
