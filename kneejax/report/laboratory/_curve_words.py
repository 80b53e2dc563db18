"""What is wrong with the poses of a test under load."""

from __future__ import annotations

import jax
import numpy as np

from kneejax.experiments import Curves, Mechanics
from kneejax.report.motion import pose_words, search_words, second_balance


def curve_words(
    curves: Curves, mechanics: Mechanics, second: np.ndarray | None = None
) -> list[tuple[str, ...]]:
    """Say what is wrong at every load of each flexion of a test.

    Args:
        curves: of the test.
        mechanics: of their motion (`kneejax.experiments.mechanics_of`).
        second: poses of a second stable balance, NaN where there is none, `(flexions, loads, 6)`.

    Returns:
        For each flexion a text per different load, in order of its size; as `pose_words`.
    """
    test, motion = curves.test, curves.motion
    full = test.full or {test.observed: test.size}
    sizes = {name: np.zeros(len(motion.status)) for name in full}
    for name, size in full.items():
        sizes[name][curves.nodes] = size * curves.part
    found = search_words(motion, sizes)
    own = [
        pose_words(motion.knee, _at(mechanics, rows), [found[row] for row in rows])
        for rows in curves.nodes
    ]
    if second is None:
        return own
    here = femoral_poses(curves)
    return [
        tuple(
            "; ".join(filter(None, (text, _second(*pair))))
            for text, *pair in zip(row, second[i], here[i], strict=True)
        )
        for i, row in enumerate(own)
    ]


def _second(other: np.ndarray, here: np.ndarray) -> str:
    return second_balance(other, here) if np.isfinite(other).all() else ""


def femoral_poses(one: Curves) -> np.ndarray:
    """Poses by flexion and load, `(flexions, loads, 6)`, degrees and mm.

    Args:
        one: curves of a test; flexion is as it was asked for, not through radians.
    """
    table = np.asarray(one.motion.to_table())[one.nodes]
    table[..., 0] = np.array(one.test.flexion_deg)[:, None]
    return table


def _at(mechanics: Mechanics, rows: np.ndarray) -> Mechanics:
    return jax.tree.map(lambda x: x[rows], mechanics)
