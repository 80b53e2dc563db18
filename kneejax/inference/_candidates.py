"""Tests that could be made next: a flexion, a load on the tibia, and what is measured."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from kneejax.geometry import FREE_COORDINATES
from kneejax.inference._parameters import UnsuitableData
from kneejax.mechanics import Load
from kneejax.statics import Stations

#: Loads of the usual tests: name, force on the tibia in N (anterior, superior, lateral) and moment
#: in N mm (adduction, internal rotation), of the size that laxity tests use.
USUAL_LOADS = (
    ("no load", (0.0, 0.0, 0.0), (0.0, 0.0)),
    ("anterior force 100 N", (100.0, 0.0, 0.0), (0.0, 0.0)),
    ("posterior force 100 N", (-100.0, 0.0, 0.0), (0.0, 0.0)),
    ("internal torque 3 N m", (0.0, 0.0, 0.0), (0.0, 3000.0)),
    ("external torque 3 N m", (0.0, 0.0, 0.0), (0.0, -3000.0)),
    ("varus moment 10 N m", (0.0, 0.0, 0.0), (10_000.0, 0.0)),
    ("valgus moment 10 N m", (0.0, 0.0, 0.0), (-10_000.0, 0.0)),
    ("compression 200 N", (0.0, 200.0, 0.0), (0.0, 0.0)),
)
#: Flexions of the usual tests, degrees.
USUAL_FLEXION_DEG = tuple(range(0, 121, 15))
_FORCES = (("anterior", "posterior"), ("compressive", "distractive"), ("lateral", "medial"))
_MOMENTS = (("varus moment", "valgus moment"), ("internal torque", "external torque"))


@dataclasses.dataclass(frozen=True)
class Candidate:
    """One pose that could be measured: the knee held at a flexion, under a load on the tibia.

    Forces act at the tibia's origin and keep, like moments, to the tibia's axes: an anterior force
    is a drawer at every flexion, a superior one compresses the joint. They act besides the loads
    of the knee.

    Attributes:
        name: of the load; candidates that share it are one row of a table or figure.
        flexion_deg: prescribed flexion.
        force_N: anterior, superior, lateral.
        moment_Nmm: adduction (varus), internal rotation.
        measured: which free coordinates are measured.

    Example:
        >>> print(Candidate("drawer", 90.0, force_N=(-100.0, 0.0, 0.0)))
        drawer at 90 degrees
    """

    name: str
    flexion_deg: float
    force_N: tuple[float, float, float] = (0.0, 0.0, 0.0)
    moment_Nmm: tuple[float, float] = (0.0, 0.0)
    measured: tuple[str, ...] = FREE_COORDINATES

    def __post_init__(self) -> None:
        unknown = [name for name in self.measured if name not in FREE_COORDINATES]
        if unknown or not self.measured:
            what = f"unknown coordinate {unknown[0]!r}" if unknown else "nothing is measured"
            raise UnsuitableData(f"{self}: {what}; expected any of {', '.join(FREE_COORDINATES)}")
        if not np.isfinite([self.flexion_deg, *self.force_N, *self.moment_Nmm]).all():
            raise UnsuitableData(f"{self}: flexion, force and moment must be finite numbers")

    def __str__(self) -> str:
        return f"{self.name} at {self.flexion_deg:g} degrees"


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
        Candidate(name, float(angle), force, moment)
        for name, force, moment in USUAL_LOADS
        for angle in flexion_deg
    )


def load_words(force_N: Sequence[float], moment_Nmm: Sequence[float]) -> str:
    """A name for a load, in clinical words.

    Args:
        force_N: anterior, superior, lateral.
        moment_Nmm: adduction, internal rotation.

    Returns:
        What acts, or `no load`.

    Example:
        >>> load_words((-134.0, 0.0, 0.0), (0.0, 1500.0))
        'posterior force 134 N, internal torque 1.5 N m'
    """
    words = [
        f"{more if size > 0 else less} force {abs(size):g} N"
        for (more, less), size in zip(_FORCES, force_N, strict=True)
        if size
    ]
    words += [
        f"{more if size > 0 else less} {abs(size) / 1000:g} N m"
        for (more, less), size in zip(_MOMENTS, moment_Nmm, strict=True)
        if size
    ]
    return ", ".join(words) or "no load"


def stations_of(candidates: Sequence[Candidate]) -> Stations:
    """Where a knee must be balanced to foresee the outcome of each candidate."""
    load = Load(
        np.array([test.force_N for test in candidates], float),
        np.array([(*test.moment_Nmm, 0.0) for test in candidates], float),
        axes="tibia",
        name="test",
    )
    return Stations.at([test.flexion_deg for test in candidates], [load])
