"""Motion made by a knee with known parameters, for twin experiments."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kneejax.mechanics import Knee, Load
from kneejax.parameters import UnsuitableData
from kneejax.statics import LoadCases, balance_one


def synthetic_motion(
    knee: Knee,
    truth: dict[str, float],
    flexion_deg: np.ndarray,
    *,
    noise_mm: float = 0.0,
    noise_deg: float = 0.0,
    seed: int = 0,
    loads: Sequence[Load] = (),
) -> np.ndarray:
    """Balanced poses of a knee with known parameters, plus normal noise.

    Args:
        knee: any knee.
        truth: parameter -> value.
        flexion_deg: prescribed angles, `(n,)`.
        noise_mm: standard deviation of the noise on displacements.
        noise_deg: standard deviation of the noise on rotations.
        seed: of the noise.
        loads: on the tibia, each one for all poses or one per pose.

    Returns:
        `(n, 6)` in the order of `kneejax.geometry.COLUMNS`.

    Raises:
        UnsuitableData: where the knee with these parameters has no balance.
        Implausible: no knee has these parameters.
    """
    true_knee = knee.replace(truth)
    table = np.zeros((len(flexion_deg), 6))
    table[:, 0] = flexion_deg
    motion = balance_one(true_knee, LoadCases.at(flexion_deg, tuple(loads)))
    poses, balanced = motion.table[0], motion.converged[0]
    if not balanced.all():
        angles = ", ".join(f"{f:g}" for f in np.asarray(flexion_deg)[~balanced])
        raise UnsuitableData(f"the knee that makes the data has no balance at {angles} degrees")
    scatter = np.array([noise_deg, noise_deg, noise_mm, noise_mm, noise_mm])
    noise = np.random.default_rng(seed).standard_normal((len(flexion_deg), 5))
    table[:, 1:] = poses + scatter * noise
    return table
