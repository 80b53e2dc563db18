"""Tests that could be made next: a flexion, a load on the tibia, and what is measured."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from kneejax.geometry import FREE_COORDINATES
from kneejax.mechanics import NAMED_LOADS, RANGES, load_of, load_words
from kneejax.parameters import UnsuitableData
from kneejax.statics import LoadCases

#: Loads of the usual tests, of the size that laxity tests use: name of a load -> its size.
USUAL_LOADS: tuple[dict[str, float], ...] = (
    {},
    {"anterior_N": 100.0},
    {"anterior_N": -100.0},
    {"internal_Nm": 3.0},
    {"internal_Nm": -3.0},
    {"varus_Nm": 10.0},
    {"varus_Nm": -10.0},
    {"compression_N": 200.0},
)
#: Flexions of the usual tests, degrees.
USUAL_FLEXION_DEG = tuple(range(0, 121, 15))


@dataclasses.dataclass(frozen=True)
class Candidate:
    """One pose that could be measured: the knee held at a flexion, under a load on the tibia.

    Loads are those of `kneejax.mechanics.load_of`: along the axes of Grood and Suntay, at the
    tibia's origin, besides the loads of the knee.

    Attributes:
        name: of the load; candidates that share it are one row of a table or figure.
        flexion_deg: prescribed flexion.
        lateral_N: along the femur's transverse axis.
        anterior_N: along the floating axis.
        compression_N: along the tibia's long axis, towards the femur.
        varus_Nm: about the floating axis.
        internal_Nm: about the tibia's long axis.
        measured: which free coordinates are measured.

    Example:
        >>> print(Candidate("drawer", 90.0, anterior_N=-100.0))
        drawer at 90 degrees
    """

    name: str
    flexion_deg: float
    _: dataclasses.KW_ONLY
    lateral_N: float = 0.0
    anterior_N: float = 0.0
    compression_N: float = 0.0
    varus_Nm: float = 0.0
    internal_Nm: float = 0.0
    measured: tuple[str, ...] = FREE_COORDINATES

    def __post_init__(self) -> None:
        unknown = [name for name in self.measured if name not in FREE_COORDINATES]
        if unknown or not self.measured:
            what = f"unknown coordinate {unknown[0]!r}" if unknown else "nothing is measured"
            raise UnsuitableData(f"{self}: {what}; expected any of {', '.join(FREE_COORDINATES)}")
        for name, value in {"flexion_deg": self.flexion_deg, **self.loads}.items():
            if not RANGES[name].holds(value):
                expected = RANGES[name].expected(value)
                raise UnsuitableData(f"{self}: {name}: {value:g}: expected {expected}")

    def __str__(self) -> str:
        return f"{self.name} at {self.flexion_deg:g} degrees"

    @property
    def loads(self) -> dict[str, float]:
        """Name of a load -> its size."""
        return {name: getattr(self, name) for name in NAMED_LOADS}


def usual_candidates(
    flexion_deg: Sequence[float] = USUAL_FLEXION_DEG,
) -> tuple[Candidate, ...]:
    """The tests of a laxity rig: no load, drawers, torques, varus, valgus and compression.

    Args:
        flexion_deg: every load is tried at each.

    Returns:
        Every load of `USUAL_LOADS` at every flexion: 100 N anterior and posterior, 3 N m internal
        and external, 10 N m varus and valgus, 200 N of compression, or nothing.

    Example:
        >>> tests = usual_candidates()
        >>> len(tests), str(tests[27 + 2])
        (72, 'internal torque 3 N m at 30 degrees')
    """
    return tuple(
        Candidate(load_words(loads), float(angle), **loads)
        for loads in USUAL_LOADS
        for angle in flexion_deg
    )


def load_cases_of(candidates: Sequence[Candidate]) -> LoadCases:
    """The load cases at which a knee must be balanced to predict each candidate."""
    sizes = {name: np.array([test.loads[name] for test in candidates]) for name in NAMED_LOADS}
    return LoadCases.at([test.flexion_deg for test in candidates], [load_of(**sizes, name="test")])
