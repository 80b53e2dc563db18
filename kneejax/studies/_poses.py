"""The poses of a study: as they were measured, or made by its knee."""

from __future__ import annotations

import numpy as np

from kneejax.inference import synthetic_motion
from kneejax.studies._study import Study


def measured_poses(study: Study) -> np.ndarray:
    """The poses that a study compares its knee with; synthetic ones take a motion of the knee.

    Args:
        study: any.

    Returns:
        Shape `(n, 6)` in the order of `kneejax.geometry.COLUMNS`, degrees and mm; no row where a
        study has only tests.

    Raises:
        UnsuitableData: the knee that should make the data does not balance.
    """
    made = study.synthetic
    if made is None:
        return np.empty((0, 6)) if study.measured is None else study.measured
    return synthetic_motion(
        study.knee,
        study.truth,
        made.flexion_deg,
        noise_mm=made.noise_mm,
        noise_deg=made.noise_deg,
        loads=study.acting,
        seed=made.seed,
    )
