"""What belongs to the tables of a comparison of joints, and what is missing in them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from kneejax.joints import FEWEST_SUBJECTS

if TYPE_CHECKING:
    from kneejax.joints import Comparison

_MOST_LISTED = 6


def comparison_notes(found: Comparison) -> Iterator[str]:
    """Sentences on which poses the numbers are of, and what they mean."""
    subjects = len(found.measured)
    if not found.compared.all():
        yield (
            f"Models were calibrated at {_left_out(found.flexion_deg, found.compared)} degrees: "
            "these are in the summaries, but not in differences, R2, RMSE and tests."
        )
    yield (
        "R2 is that of the straight line from modelled to measured values, subjects and compared "
        "flexions together; adjusted for one predictor. RMSE is of the values as they are."
    )
    if found.tests:
        yield (
            "Tests: one-way repeated-measures analyses of variance, a measure and flexion each, "
            "Greenhouse-Geisser corrected; pairs Bonferroni-adjusted, significant (*) up to "
            f"p = {found.alpha:g}, intervals of {100.0 * (1.0 - found.alpha):g}%."
        )
    elif subjects < FEWEST_SUBJECTS:
        one = "One subject" if subjects == 1 else f"{subjects} subjects"
        yield (
            f"{one}: numbers describe, and nothing is tested; an analysis of variance needs "
            f"{FEWEST_SUBJECTS} subjects or more."
        )


def comparison_doubts(found: Comparison) -> Iterator[str]:
    """Sentences on what is missing in the tables."""
    for name, gaps in found.missing.items():
        yield (
            f"{name} has no pose for {gaps} of {found.models[name][..., 0].size} values: they are "
            "left out of its numbers, and its flexions out of the tests."
        )
    if found.undefined:
        yield (
            f"{found.undefined} of {len(found.tests)} analyses of variance are undefined: motions "
            "are the same distance apart in all subjects. Are these different persons?"
        )


def _left_out(flexion: np.ndarray, compared: np.ndarray) -> str:
    """Flexions that are not compared; of many, neighbours as a range."""
    order = np.argsort(flexion, kind="stable")
    rows = np.flatnonzero(~compared[order])
    if len(rows) <= _MOST_LISTED:
        return ", ".join(f"{x:g}" for x in flexion[order][rows])
    runs = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    ends = [flexion[order][[run[0], run[-1]]] for run in runs]
    return ", ".join(f"{a:g}" if a == b else f"{a:.1f} to {b:.1f}" for a, b in ends)
