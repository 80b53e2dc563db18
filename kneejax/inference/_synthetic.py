"""Motion made by a knee with known parameters, for twin experiments."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from kneejax.inference._parameters import UnsuitableData, select, with_values
from kneejax.inference._problem import DEFAULT_WEIGHTS, Problem
from kneejax.mechanics import Knee


def synthetic_motion(
    knee: Knee,
    truth: dict[str, float],
    flexion_deg: np.ndarray,
    parameters: tuple[str, ...] = ("*.stiffness", "*.reference_strain"),
    *,
    noise_mm: float = 0.0,
    noise_deg: float = 0.0,
    seed: int = 0,
) -> np.ndarray:
    """Balanced poses of a knee with known parameters, plus normal noise.

    Args:
        knee: any knee.
        truth: parameter -> value.
        flexion_deg: prescribed angles, `(n,)`.
        parameters: names that a calibration will free. They change no number here; with the same
            ones as the calibration, its compiled function serves for both.
        noise_mm: standard deviation of the noise on displacements.
        noise_deg: standard deviation of the noise on rotations.
        seed: of the noise.

    Returns:
        `(n, 6)` in the order of `kneejax.geometry.COLUMNS`.

    Raises:
        UnsuitableData: where the knee with these parameters has no balance.
    """
    true_knee = with_values(knee, truth)
    table = np.zeros((len(flexion_deg), 6))
    table[:, 0] = flexion_deg
    selection = select(knee, parameters)
    problem = Problem(true_knee, selection, table, DEFAULT_WEIGHTS)
    found = problem.poses(np.asarray(selection.read(true_knee)))
    failed = ~np.asarray(found.settled.converged)
    if failed.any():
        angles = ", ".join(f"{f:g}" for f in np.asarray(flexion_deg)[failed])
        raise UnsuitableData(f"the knee that makes the data has no balance at {angles} degrees")
    scatter = np.array([noise_deg, noise_deg, noise_mm, noise_mm, noise_mm])
    noise = np.random.default_rng(seed).standard_normal((len(flexion_deg), 5))
    table[:, 1:] = np.asarray(jnp.asarray(found.table)).T + scatter * noise
    return table
