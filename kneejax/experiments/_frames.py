"""Frames of a knee that moves: when each was taken, and what moved with the knee."""

__all__ = ["Frames"]

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from kneejax.dynamics import MovingKnee, rising
from kneejax.mechanics import Knee, Mass
from kneejax.numerics import WrongValue

#: s; for a rate by differences.
_SHORT_S = 1e-6
#: At a period of flexion, for its largest.
_LOOKS = 400


@dataclasses.dataclass(frozen=True, eq=False)
class Frames:
    """When the rows of a measured test were seen, of a knee whose flexion somebody led.

    Attributes:
        time_s: of each row, rising, `(n,)`.
        flexion_deg: that was measured, `(n,)`.
        leg: shank and foot.
        gravity_m_s2: along the femur's axes, `(3,)`; zeros without.
        critical: damping of each fibre as part of `sqrt(4 k m)`.
        damping_N_s_per_mm: of every coordinate, rotations at 30 mm: without it a bone whose fibres
            are slack swings on for seconds.
        period_s: of a motion that repeats itself; None for one that begins in the first row, in
            balance but for its flexion, which is led from there on.
        harmonics: of a motion that repeats itself, those with which flexion is led: noise in it
            would shake the leg. One that does not is led through every row.
        cycles_before: how often at least it had gone through its period before the first row; it
            begins at rest where it is bent most.
        most_mm: that the steps may leave of the error of any pose (rotations at 30 mm).

    Raises:
        ValueError: times that do not rise or outlast the period, or fewer rows than harmonics need.

    Example:
        >>> from kneejax.experiments import leg_of_person
        >>> times = np.linspace(0.0, 1.9, 20)
        >>> bent = 30.0 - 20.0 * np.cos(np.pi * times)
        >>> frames = Frames(times, bent, leg_of_person(75.0, 1.75), period_s=2.0)
        >>> frames.led_deg[[0, 10]].round(6).tolist(), frames.since_start_s[-20].round(6).item()
        ([10.0, 50.0], 3.0)
    """

    time_s: np.ndarray
    flexion_deg: np.ndarray
    leg: Mass
    gravity_m_s2: tuple[float, float, float] = (0.0, 0.0, 0.0)
    critical: float = 1.0
    damping_N_s_per_mm: float = 1.0
    period_s: float | None = None
    harmonics: int = 3
    cycles_before: int = 1
    most_mm: float = 0.01

    def __post_init__(self) -> None:
        times, flexion = rising(self.time_s), np.asarray(self.flexion_deg, float)
        self.__dict__.update(time_s=times, flexion_deg=flexion)
        if times.shape != flexion.shape or len(times) < 2:
            raise WrongValue("time_s", f"{len(times)} rows", str(max(len(flexion), 2)))
        if self.period_s is None:
            return
        if times[-1] - times[0] >= self.period_s:
            found = f"{self.period_s:g} s of rows over {times[-1] - times[0]:g} s"
            raise WrongValue("period_s", found, "a longer one, or the rows of one period")
        if len(times) <= 2 * self.harmonics:
            expected = f"at most {(len(times) - 1) // 2} from {len(times)} rows"
            raise WrongValue("harmonics", str(self.harmonics), expected)

    @property
    def led_deg(self) -> np.ndarray:
        """Flexion that is led, at the rows, `(n,)`."""
        return np.rad2deg(self._way(self.time_s))

    @functools.cached_property
    def _times_s(self) -> np.ndarray:
        """At which the motion is computed, the rows last."""
        if self.period_s is None:
            return self.time_s
        first = self._turns_before(self.period_s) - self.cycles_before * self.period_s
        cycles = np.arange(-self.cycles_before - 1, 1)[:, None] * self.period_s
        times = (cycles + self.time_s).ravel()
        return np.r_[first, times[times > first + _SHORT_S]]

    def _turns_before(self, period_s: float) -> float:
        """The last time before the rows at which a motion that repeats itself is bent most: there a
        knee may begin at rest without a shock."""
        from scipy.optimize import minimize_scalar

        times = self.time_s[0] - np.linspace(1.0, 0.0, _LOOKS) * period_s
        middle, near = times[np.argmax(self._way(times))], period_s / _LOOKS
        found: Any = minimize_scalar(
            lambda t: -float(self._way(np.array([t]))[0]), method="bounded",
            bounds=(middle - near, middle + near), options={"xatol": _SHORT_S},
        )  # fmt: skip
        return float(found.x) - period_s * (found.x > self.time_s[0])

    @property
    def since_start_s(self) -> np.ndarray:
        """Times at which the motion is computed, from its start on, the rows last."""
        return self._times_s - self._times_s[0]

    def led(self, since_start_s: np.ndarray) -> np.ndarray:
        """Flexion, rad, at times from the start of the motion on."""
        return self._way(np.asarray(since_start_s, float) + self._times_s[0])

    @property
    def starts_with_rad_s(self) -> float:
        """Rate of flexion at the start."""
        after, before = self.led(np.array([_SHORT_S, -_SHORT_S]))
        return float(after - before) / (2.0 * _SHORT_S)

    @functools.cached_property
    def _way(self) -> Callable[[np.ndarray], np.ndarray]:
        """Flexion over time, rad."""
        through = np.deg2rad(self.flexion_deg)
        if self.period_s is None:
            from scipy.interpolate import PchipInterpolator

            return PchipInterpolator(self.time_s, through)

        per_s = 2.0 * np.pi / self.period_s * np.arange(1, self.harmonics + 1)

        def waves(time_s: np.ndarray) -> np.ndarray:
            turn = np.multiply.outer(np.asarray(time_s, float), per_s)
            still = np.ones((*turn.shape[:-1], 1))
            return np.concatenate([still, np.cos(turn), np.sin(turn)], axis=-1)

        size, *_ = np.linalg.lstsq(waves(self.time_s), through, rcond=None)
        return lambda time_s: waves(time_s) @ size

    def over_time(self, rows: np.ndarray) -> np.ndarray:
        """What was told for each row, `(n, k)`, at `since_start_s`: alike in each cycle."""
        times, known = self._times_s, self.time_s
        return np.stack([np.interp(times, known, x, period=self.period_s) for x in rows.T], axis=1)

    def moving(self, knee: Knee) -> MovingKnee:
        """The knee with the mass of the leg, under gravity, without dampers."""
        return MovingKnee.of(knee, self.leg, gravity_m_s2=self.gravity_m_s2)
