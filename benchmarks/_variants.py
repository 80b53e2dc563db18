"""Knees that differ in stiffness and slack length, for the batch engine."""

from __future__ import annotations

import time

import equinox as eqx
import numpy as np

from kneejax.mechanics import Knee, ligament_law
from kneejax.statics import Equilibria, LoadCases, balance_many, balance_one


def with_ligaments(knee: Knee, value) -> Knee:
    """The knee with other stiffnesses and slack lengths, `(ligaments,)` each."""
    return eqx.tree_at(lambda k: (k.ligaments.stiffness, k.ligaments.slack_length), knee, value)


def random_knees(knee: Knee, count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness from 300 to 9300 N and slack lengths for +-0.03 around the knee's reference
    strains, both `(count, ligaments)`."""
    draw = np.random.default_rng(seed)
    size = (count, len(knee.ligaments.names))
    stiffness = draw.uniform(300.0, 9300.0, size)
    strain = np.asarray(knee.reference_strain()) + draw.uniform(-0.03, 0.03, size)
    length = np.asarray(knee.reference_length())
    return stiffness, np.asarray(ligament_law.slack_length_from_strain(length, strain))


def own_values(knee: Knee) -> tuple[np.ndarray, np.ndarray]:
    """The knee's own stiffnesses and slack lengths."""
    return np.asarray(knee.ligaments.stiffness), np.asarray(knee.ligaments.slack_length)


def timed_batch(knee: Knee, values, angles: np.ndarray) -> tuple[float, Equilibria]:
    """Seconds of all passes over all knees, the knee's own motion included, and the balances."""
    begun = time.perf_counter()
    found = balance_many(knee, with_ligaments, values, LoadCases.at(angles))
    return time.perf_counter() - begun, found


def motion_of(knee: Knee, angles: np.ndarray) -> Equilibria:
    """The knee's own motion."""
    return balance_one(knee, LoadCases.at(angles))
