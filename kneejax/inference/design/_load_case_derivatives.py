"""Balanced poses of a knee at any flexions and loads, with their exact Jacobian."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from kneejax.inference.fit import table_of
from kneejax.mechanics import Knee
from kneejax.parameters import Selection
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
