"""Scores from 0 to 3 for the influence of a parameter: Table 5 of paper 4."""

from __future__ import annotations

import math

#: Outcomes, and the upper limits of the scores 0.5, 1, 1.5, 2 and 2.5 in the outcome's unit.
LIMITS = {
    "convergence_percent": (1.0, 5.0, 10.0, 20.0, 40.0),
    "rmse_deg": (0.2, 0.5, 0.9, 1.4, 2.0),
    "pressure_percent": (1.0, 5.0, 10.0, 20.0, 40.0),
    "displacement_mm": (0.2, 0.5, 1.25, 2.5, 4.0),
}
#: What a balance leaves open counts as no difference.
NOUGHT = 1e-6


def score(outcome: str, difference: float) -> float:
    """Score of an average difference to the unchanged knee.

    Args:
        outcome: a key of `LIMITS`.
        difference: not negative; below `NOUGHT` it counts as none.

    Returns:
        0 to 3 in halves; NaN for NaN.

    Source: paper 4, Table 5.

    Example:
        >>> [score("rmse_deg", x) for x in (0.0, 0.2, 0.21, 2.0, 2.01)]
        [0.0, 0.5, 1.0, 2.5, 3.0]
    """
    if math.isnan(difference):
        return math.nan
    if difference < NOUGHT:
        return 0.0
    return 0.5 + 0.5 * sum(difference > limit for limit in LIMITS[outcome])
