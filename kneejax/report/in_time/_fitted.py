"""What a recorded motion told of dampers, in lines."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from kneejax.geometry import coordinate
from kneejax.inference.transients import FittedTransient

#: Correlation from which two dampers are said to stand for each other.
_ALIKE = 0.95


def fitted_lines(found: FittedTransient) -> Iterator[str]:
    """Dampers with their intervals, what the record leaves open, and what is left of it.

    Args:
        found: the fit.
    """
    for name, value, lower, upper in zip(
        found.names, found.values, found.lower, found.upper, strict=True
    ):
        sides = f"95 % {lower:.4g} to {upper:.4g}" if np.isfinite(lower) else "at its bound"
        if lower < 0.0:
            sides += "; the record cannot tell it from none"
        yield f"found: {name} {value:.4g} ({sides})"
    together = np.nan_to_num(found.uncertainty.correlation)
    for i, first in enumerate(found.names):
        for j in range(i):
            if abs(together[i, j]) > _ALIKE:
                yield (
                    f"{found.names[j]} and {first} stand for each other (correlation "
                    f"{together[i, j]:.2f}): this record does not part them"
                )
    left = (f"{coordinate(k).axis_label} {x:.2g}" for k, x in found.rms.items())
    yield f"left of the record, root of the mean square: {'; '.join(left)}"
    if not found.converged:
        yield f"the search was given up after {found.evaluations} evaluations"
