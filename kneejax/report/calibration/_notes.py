"""What limits a fit, in sentences."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kneejax.geometry import COORDINATES, FREE_COORDINATES
from kneejax.inference import IntervalKind
from kneejax.parameters import sums_in_words
from kneejax.statics import Status

if TYPE_CHECKING:
    from kneejax.inference import Calibration


def calibration_notes(calibration: Calibration) -> list[str]:
    """Sentences on what limits a fit: data, bounds, and where the misfit is."""
    fit, notes = calibration.fit, []
    everything = (*fit.estimates, *fit.offsets)
    unsure = [e.name for e in everything if e.interval is IntervalKind.NOT_DETERMINED]
    if unsure:
        notes.append(
            "These data do not determine " + ", ".join(unsure) + ": other parameters make up for "
            "nearly all that their bounds allow. Fix them, or measure where those ligaments are "
            "tight."
        )
    alone = [e.name for e in everything if e.interval is IntervalKind.PRIOR]
    if alone:
        notes.append(
            "Known from the prior alone: " + ", ".join(alone) + ". Their standard deviation is "
            "more than 0.9 of the prior's: the data do not narrow them."
        )
    bound = [e.name for e in everything if e.at_bound]
    if bound:
        notes.append(
            "On a bound: " + ", ".join(bound) + ". The model lacks something that these try to "
            "make up for, or the bounds are too narrow."
        )
    if sums := sums_in_words(fit.motion.knee, [e.name for e in fit.estimates]):
        notes.append(sums)
    if fit.objective > 0:
        notes.append(_worst(calibration))
    if calibration.left_out:
        poses = "1 pose was" if calibration.left_out == 1 else f"{calibration.left_out} poses were"
        notes.append(
            f"{poses} left out: the start's parameters find no balance there "
            f"({Status.NOT_CONVERGED.sentence})."
        )
    return notes


def _worst(calibration: Calibration) -> str:
    """In which coordinate most of what is left of the misfit is."""
    fit = calibration.fit
    share = dict(zip(FREE_COORDINATES, calibration.weights, strict=True))
    share = {name: weight * fit.partial_objectives[name] for name, weight in share.items()}
    worst = max(share, key=share.__getitem__)
    unit = "degrees" if COORDINATES[worst].unit == "deg" else "mm"
    error = f" (RMSE {fit.rmse[worst]:.3g} {unit})" if np.isfinite(fit.rmse[worst]) else ""
    return (
        f"{100 * share[worst] / fit.objective:.0f} % of the remaining misfit is in "
        f"{worst.replace('_', ' ')}{error}."
    )
