"""How far a foreseen pose follows a straight line where parameters are still uncertain."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kneejax.inference.design._candidates import Candidate, load_cases_of
from kneejax.inference.design._load_case_derivatives import (
    LoadCaseDerivatives,
    load_case_derivatives,
)
from kneejax.mechanics import Knee
from kneejax.parameters import Selection


def departures(
    selection: Selection,
    knee: Knee,
    values: np.ndarray,
    covariance: np.ndarray,
    noise: np.ndarray,
    candidates: Sequence[Candidate],
    chosen: Sequence[int],
    foreseen: LoadCaseDerivatives,
) -> np.ndarray:
    """Move parameters by one standard deviation along what a test tells most about, both ways.

    What a design promises rests on first derivatives. This is their error over the width that
    matters: the change of the pose that the derivative leaves out, as a part of the one it gives.

    Args:
        selection: the parameters.
        knee: gives everything else.
        values: of the parameters, `(p,)`.
        covariance: of the parameters before the tests, `(p, p)`.
        noise: standard deviations, `(5,)`.
        candidates: all tests.
        chosen: rows of those to check.
        foreseen: poses and derivatives of all tests.

    Returns:
        One part a chosen test; infinite where the moved knee has no balance.
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
