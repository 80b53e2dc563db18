"""Measured curves of tests under load, as load cases of a fit."""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from kneejax.experiments import LabTest
from kneejax.geometry import FREE_COORDINATES
from kneejax.inference.fit._load_cases import LoadCases
from kneejax.statics import Stations

#: The convention along whose translations loads act and laxity is read.
CLINICAL = "grood-suntay"


def cases_of_tests(
    tests: Sequence[LabTest],
    measured: Sequence[np.ndarray],
    noise: np.ndarray,
    passive: np.ndarray | None = None,
) -> LoadCases:
    """What tests under load observed, and a passive motion beside them.

    Each step of a test counts by how far it is from the unloaded pose of the same flexion, which is
    a load case without an observation of its own: where the zero of a robot lies need not be known.

    Args:
        tests: that were made.
        measured: of each, change of its coordinate from the neutral pose at every step,
            `(flexions, steps)`, mm or degrees; NaN where a step was not measured.
        noise: standard deviations of the free coordinates, `(5,)`, degrees and mm.
        passive: poses without a load that count as they are, `(n, 6)`, degrees and mm, with
            translations of Grood and Suntay; NaN where a coordinate was not measured.

    Returns:
        The load cases.

    Raises:
        ValueError: a table has another shape than its test.

    Example:
        >>> import kneejax as kj
        >>> (test,) = kj.lab_tests("drawer", [0.0, 30.0], steps=2)
        >>> cases = cases_of_tests([test], [np.zeros((2, 5))], np.full(5, 0.1))
        >>> len(cases.stations), cases.neutral.tolist()
        (12, [0, 0, 0, 0, 0, 0, 6, 6, 6, 6, 6, 6])
    """
    rows = np.zeros((0, 6)) if passive is None else np.asarray(passive, float)
    flexion, target = [rows[:, 0]], [rows[:, 1:]]
    neutral, loads, count = [np.full(len(rows), -1)], [], len(rows)
    for test, table in zip(tests, measured, strict=True):
        shape = len(test.flexion_deg), len(test.path)
        if np.shape(table) != shape:
            raise ValueError(f"{test.name}: measured is {np.shape(table)}; expected {shape}")
        part = np.tile(np.r_[0.0, test.path], shape[0])
        seen = np.full((shape[0], 1 + shape[1], 5), np.nan)
        seen[:, 1:, FREE_COORDINATES.index(test.observed)] = table
        flexion.append(np.repeat(test.flexion_deg, 1 + shape[1]))
        target.append(seen.reshape(-1, 5))
        neutral.append(np.repeat(count + np.arange(shape[0]) * (1 + shape[1]), 1 + shape[1]))
        loads.append(test.loads(part))
        count += len(part)
    nothing = [jax.tree.map(lambda x: jnp.zeros((len(rows), 3)), load) for load in loads[0]]
    acting = [
        jax.tree.map(lambda *x: jnp.concatenate(x), *kind)
        for kind in zip(nothing, *loads, strict=True)
    ]
    stations = Stations.at(np.concatenate(flexion), acting)
    at = np.concatenate(neutral)
    return LoadCases(stations, np.vstack(target), noise, read_as=CLINICAL, neutral=at)
