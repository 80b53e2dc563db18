"""What is wrong with the poses of a test under load."""

from __future__ import annotations

import jax
import numpy as np

from kneejax.experiments import Curves, Mechanics
from kneejax.report.motion import pose_words, search_words


def curve_words(curves: Curves, mechanics: Mechanics) -> list[tuple[str, ...]]:
    """Say what is wrong at every load of each flexion of a test.

    Args:
        curves: of the test.
        mechanics: of their motion (`kneejax.experiments.mechanics_of`).

    Returns:
        For each flexion a text per different load, in order of its size; as `pose_words`.
    """
    test, motion = curves.test, curves.motion
    full = test.full or {test.observed: test.size}
    sizes = {name: np.zeros(len(motion.status)) for name in full}
    for name, size in full.items():
        sizes[name][curves.nodes] = size * curves.part
    found = search_words(motion, sizes)
    return [
        pose_words(motion.knee, _at(mechanics, rows), [found[row] for row in rows])
        for rows in curves.nodes
    ]


def _at(mechanics: Mechanics, rows: np.ndarray) -> Mechanics:
    return jax.tree.map(lambda x: x[rows], mechanics)
