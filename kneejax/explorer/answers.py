"""What a setting gives: a pose, and curves over flexion."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import cached_property

import numpy as np

from kneejax.explorer.setting import Setting
from kneejax.geometry import State
from kneejax.mechanics import Knee
from kneejax.statics import Equilibrium, Status

#: Flexions of the curves, degrees.
FLEXIONS = np.linspace(0.0, 120.0, 25)
#: Tests of laxity: load -> its size, both ways.
TESTS = {"anterior_N": 100.0, "varus_Nm": 10.0, "internal_Nm": 5.0}
#: The coordinate that each moves most.
MOVED = {"anterior_N": "anterior", "varus_Nm": "adduction", "internal_Nm": "internal_rotation"}


@dataclasses.dataclass(frozen=True)
class Answer:
    """A pose at a setting.

    Attributes:
        setting: that was asked for.
        knee: with its parameters.
        status: of the pose; None until the first is known.
        coordinates: free coordinate -> degrees or mm; NaN where nothing balances.
        state: where the bones are, of shape `(1,)`; of the last pose that balanced where this one
            does not, as are the numbers below.
        found: the balance; None where there is none.
        force_N: ligament -> force.
        strain: ligament -> largest strain of its fibres.
        peak_MPa: compartment -> largest pressure.
        derive: computes `slopes`.
    """

    setting: Setting
    knee: Knee
    status: Status | None
    coordinates: dict[str, float]
    state: State
    found: Equilibrium | None
    force_N: dict[str, float]
    strain: dict[str, float]
    peak_MPa: dict[str, float]
    derive: Callable[[], dict[str, np.ndarray]]

    @cached_property
    def slopes(self) -> dict[str, np.ndarray]:
        """Coordinate or ligament -> exact derivative of its degrees, mm or N by the parameters,
        `(p,)`; nothing where nothing balances."""
        return self.derive()

    @property
    def sentence(self) -> str:
        """What is wrong with the pose and what to try; empty where nothing is."""
        if self.status is None:
            return "Compiling: some minutes the first time that a knee is opened, seconds later."
        if self.status == Status.BALANCED:
            return ""
        last = "" if self.status.converged else " The last pose that balanced is shown, grey."
        return f"{self.status.fault.capitalize()}: {self.status.advice}.{last}"


@dataclasses.dataclass(frozen=True)
class Curves:
    """What a setting does over flexion.

    Attributes:
        setting: that was asked for.
        flexion_deg: of the poses, `(n,)`.
        status: `Status` values, `(n,)`.
        coordinates: free coordinate -> degrees or mm, `(n,)`; NaN where nothing balances.
        force_N: ligament -> force, `(n,)`.
        laxity: test -> degrees or mm between its two loads, `(n,)`, where one was asked for.
        own: free coordinates as they are solved, `(n, free)`; of a test those under both loads
            follow, `(3 n, free)`.
        contact_points: likewise, `(n, points, 2)`.
        derive: computes `slopes`.
    """

    setting: Setting
    flexion_deg: np.ndarray
    status: np.ndarray
    coordinates: dict[str, np.ndarray]
    force_N: dict[str, np.ndarray]
    laxity: dict[str, np.ndarray]
    own: np.ndarray
    contact_points: np.ndarray
    derive: Callable[[], dict[str, np.ndarray]]

    @cached_property
    def slopes(self) -> dict[str, np.ndarray]:
        """Coordinate or ligament -> exact derivative of its degrees, mm or N by the parameters,
        `(n, p)`; NaN where nothing balances."""
        return self.derive()

    @property
    def table(self) -> np.ndarray:
        """Poses in the order of `kneejax.geometry.COLUMNS`, `(n, 6)`, degrees and mm."""
        return np.column_stack([self.flexion_deg, *self.coordinates.values()])

    def at(self, flexion_deg: float) -> tuple[np.ndarray, np.ndarray]:
        """Free coordinates, `(free,)`, and contact points near a flexion."""
        flexion = self.flexion_deg
        q = np.array([np.interp(flexion_deg, flexion, x) for x in self.own[: len(flexion)].T])
        return q, self.contact_points[int(np.argmin(np.abs(flexion - flexion_deg)))]
