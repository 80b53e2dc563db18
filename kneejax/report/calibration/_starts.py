"""Where several starts of a calibration ended, in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kneejax.report.look import number

if TYPE_CHECKING:
    from kneejax.inference import Fit


def rivals_words(fit: Fit) -> str:
    """Ends that the data do not tell from the answer, though a parameter is outside its limits."""
    starts = fit.starts
    assert starts is not None
    estimates = (*fit.estimates, *fit.offsets)
    ends = starts.values[starts.rivals]
    names = [
        f"{e.name} {number(min(e.value, *column))} to {number(max(e.value, *column))}"
        for e, column in zip(estimates, ends.T, strict=True)
        if (column < np.nan_to_num(e.low, nan=e.lower)).any()
        or (column > np.nan_to_num(e.high, nan=e.upper)).any()
    ]
    count = int(starts.rivals.sum())
    return (
        f"{count} of {len(starts.objectives)} starts ended apart from the answer and fit as well: "
        f"{', '.join(names)}."
    )


def starts_words(fit: Fit) -> str:
    """Where several starts ended; empty if there was one."""
    starts = fit.starts
    if starts is None:
        return ""
    count, objectives = len(starts.objectives), np.array(starts.objectives)
    lost = int(np.isinf(objectives).sum())
    apart = starts.elsewhere & ~np.isinf(objectives)
    words = [f"{count - int((starts.elsewhere | starts.rivals).sum())} of {count} at the answer"]
    if starts.rivals.any():
        words.append(f"{int(starts.rivals.sum())} apart from it with as good a fit")
    if apart.any():
        low, high = number(objectives[apart].min()), number(objectives[apart].max())
        among = low if low == high else f"{low} to {high}"
        words.append(
            f"{int(apart.sum())} at worse fits (objective {among}, the answer's is "
            f"{number(fit.objective)})"
        )
    if lost:
        words.append(f"{lost} found no balance")
    return f"Several starts ended: {'; '.join(words)}."
