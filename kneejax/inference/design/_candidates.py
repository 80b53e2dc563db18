"""Tests that could be made, and what each would tell."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from kneejax.geometry import FREE_COORDINATES
from kneejax.inference.fit import table_of
from kneejax.mechanics import NAMED_LOADS, RANGES, Knee, load_of, load_words
from kneejax.parameters import Selection, UnsuitableData
from kneejax.statics import LoadCases, Slopes, balance_with_slopes


@dataclasses.dataclass(frozen=True)
class LoadCaseDerivatives:
    """Poses at load cases, and how parameters move them; rows that failed are NaN.

    Attributes:
        slopes: the balances in full, one variant.
    """

    slopes: Slopes

    @property
    def table(self) -> np.ndarray:
        """Free coordinates, degrees and mm, `(load_cases, 5)`."""
        return table_of(self.slopes)[0][0]

    @property
    def jacobian(self) -> np.ndarray:
        """Derivative of the table with respect to the parameters, `(load_cases, 5, p)`."""
        return table_of(self.slopes)[1][0]

    @property
    def status(self) -> np.ndarray:
        """`Status` values, `(load_cases,)`."""
        return self.slopes.status[0]

    def take(self, rows: Sequence[int]) -> LoadCaseDerivatives:
        """Some of the load cases, in the order of `rows`."""
        return LoadCaseDerivatives(self.slopes.at(list(rows)))


def load_case_derivatives(
    selection: Selection,
    knee: Knee,
    values: np.ndarray,
    load_cases: LoadCases,
    near: LoadCaseDerivatives | None = None,
) -> LoadCaseDerivatives:
    """Balance a knee at flexions with loads, and differentiate each pose by the parameters.

    Every load case is reached as a test is made: the knee is bent without load, then loaded.

    Args:
        selection: the parameters.
        knee: gives everything else.
        values: of the parameters, `(p,)`.
        load_cases: the load cases, in any order; none depends on another.
        near: balanced poses at these load cases, of parameters close by, to predict from instead.

    Returns:
        Poses, exact derivatives (the implicit function theorem) and outcomes.
    """
    known = None if near is None else near.slopes
    one = np.asarray(values, float)[None]
    return LoadCaseDerivatives(balance_with_slopes(knee, selection.apply, one, load_cases, known))


def departures(
    selection: Selection, knee: Knee, values: np.ndarray, covariance: np.ndarray, noise: np.ndarray,
    candidates: Sequence[Candidate], chosen: Sequence[int], foreseen: LoadCaseDerivatives,
) -> np.ndarray:  # fmt: skip
    """How wrong first derivatives are over the width that matters, for each chosen test,
    `(chosen,)`.

    Parameters, of `covariance` `(p, p)` before the tests, move by one standard deviation along what
    the test tells most about, both ways: the change of the pose that the derivative leaves out, as
    a part of the one it gives. Infinite where the moved knee has no balance.
    """
    parts: dict[int, float] = {}
    for row in set(chosen):
        jacobian = foreseen.jacobian[row] / noise[:, None]
        sizes, directions = np.linalg.eigh(jacobian @ covariance @ jacobian.T)
        step = covariance @ jacobian.T @ directions[:, -1] / np.sqrt(sizes[-1])
        # As many load cases as there were candidates: one shape, one compilation.
        copies = [row] * len(candidates)
        alike, near = load_cases_of([candidates[i] for i in copies]), foreseen.take(copies)
        for side in (step, -step):
            moved = load_case_derivatives(selection, knee, values + side, alike, near).table[0]
            change, straight = (moved - foreseen.table[row]) / noise, jacobian @ side
            part = np.linalg.norm(change - straight) / np.linalg.norm(straight)
            parts[row] = max(parts.get(row, 0.0), float(np.nan_to_num(part, nan=np.inf)))
    return np.array([parts[row] for row in chosen])


#: Loads of the usual tests, of the size that laxity tests use: name of a load -> its size.
USUAL_LOADS: tuple[dict[str, float], ...] = (
    {}, {"anterior_N": 100.0}, {"anterior_N": -100.0}, {"internal_Nm": 3.0}, {"internal_Nm": -3.0},
    {"varus_Nm": 10.0}, {"varus_Nm": -10.0}, {"compression_N": 200.0},
)  # fmt: skip
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


def usual_candidates(flexion_deg: Sequence[float] = USUAL_FLEXION_DEG) -> tuple[Candidate, ...]:
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
    """The load cases at which a knee must be balanced to predict each candidate.

    Example:
        >>> from kneejax.inference import Candidate
        >>> load_cases_of([Candidate("drawer", 30.0, anterior_N=100.0)]).flexion.shape
        (1,)
    """
    sizes = {name: np.array([test.loads[name] for test in candidates]) for name in NAMED_LOADS}
    return LoadCases.at([test.flexion_deg for test in candidates], [load_of(**sizes, name="test")])
