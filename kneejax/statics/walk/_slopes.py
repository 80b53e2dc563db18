"""Balances with their exact derivatives by what varies, for many variants at many stations."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from kneejax.mechanics import Knee
from kneejax.numerics import compiled, on_all_cores
from kneejax.statics._newton import EnergyNewton, Guess
from kneejax.statics._settle import Settled, differentiable, settle
from kneejax.statics._status import converged
from kneejax.statics.walk._balances import Balances
from kneejax.statics.walk._batch import balance_many, own_motion
from kneejax.statics.walk._stations import Stations
from kneejax.statics.walk._variants import Variants, Vary, in_lanes, with_numbers

#: Searches begin from a linear prediction; what is farther off is searched by `balance_many`.
_SEARCH = EnergyNewton(atol=1e-8, most_steps=32)
#: Lanes of a call; each takes Python half as long as the compiled program (benchmarks/profiles.py:
#: eight profiles in 0.22 s, with 64 lanes in 0.55 s).
_LANES = 128


@dataclasses.dataclass(frozen=True)
class Slopes:
    """Balanced poses and their derivatives; arrays begin with variant and station.

    Attributes:
        values: what varies, `(variants, p)`.
        q: free coordinates `(variants, stations, free)`, rad and mm; NaN where there is no balance.
        jacobian: of them by the values, `(variants, stations, free, p)`.
        meeting: parameters of the meeting points, `(variants, stations, n, 2)`.
        meeting_jacobian: likewise, `(variants, stations, n, 2, p)`.
        tangent: stiffness, `(variants, stations, free, free)`.
        status: `Status` values, `(variants, stations)`.
    """

    values: np.ndarray
    q: np.ndarray
    jacobian: np.ndarray
    meeting: np.ndarray
    meeting_jacobian: np.ndarray
    tangent: np.ndarray
    status: np.ndarray

    @property
    def converged(self) -> np.ndarray:
        """Where forces balance, `(variants, stations)`."""
        return converged(self.status)

    def take(self, rows) -> Slopes:
        """Some of the variants, in the order of `rows`."""
        return Slopes(*(getattr(self, f.name)[rows] for f in dataclasses.fields(self)))

    def put(self, rows, others: Slopes) -> None:
        """Replace some of the variants in place."""
        for field in dataclasses.fields(self):
            getattr(self, field.name)[rows] = getattr(others, field.name)


@compiled(static_argnums=(4,))
def _found(
    knee: Knee, numbers: dict[int, Any], stations: Stations, guess: Guess, search: EnergyNewton
) -> Settled:
    """One node in each lane: the same program whatever varies."""
    lanes = stations.load(with_numbers(knee, numbers))
    return settle(lanes, stations.prescribed, guess, search)


@compiled(static_argnums=(0,))
def _slopes(vary: Vary, knee: Knee, values, stations: Stations, settled: Settled):
    """Derivatives of coordinates and meeting points by each lane's values, lanes first."""

    def poses(x):
        lanes = stations.load(in_lanes(knee, vary, x))
        found = differentiable(lanes, stations.prescribed, settled)
        return found.q, found.meeting

    _, push = jax.linearize(poses, values)
    # Lanes do not touch each other: one direction moves the same number of all of them.
    units = jnp.broadcast_to(jnp.eye(values.shape[1])[:, None], (values.shape[1], *values.shape))
    q, meeting = jax.vmap(push, out_axes=-1)(units)
    return jnp.moveaxis(q, 1, 0), jnp.moveaxis(meeting, 2, 0)


def balance_with_slopes(
    knee: Knee,
    vary: Vary,
    values: np.ndarray,
    stations: Stations,
    near: Slopes | None = None,
    *,
    lanes: int = _LANES,
    search: EnergyNewton = _SEARCH,
) -> Slopes:
    """Balance variants of a knee at stations, with exact derivatives by their values.

    Args:
        knee: gives all numbers that do not vary.
        vary: see `balance_many`; its value is a vector here.
        values: `(variants, p)`.
        stations: as in `balance_many`.
        near: of near values, one variant each, to predict from; by default each variant is
            searched from the motion of the first one.
        lanes: of a call; few where a motion is balanced by itself.
        search: how to find each balance from its guess.

    Returns:
        The `Slopes`; a node without a balance is NaN by itself.
    """
    values = np.asarray(values, float)
    if near is None and len(values) == 1:
        found = own_motion(knee, vary, values[0], stations)
    elif near is None:
        found = balance_many(knee, vary, values[0], values, stations)
    if near is None:
        guess = found.q, found.meeting, np.zeros((*found.status.shape, *(len(stations.free),) * 2))
    else:
        step = values - near.values
        q = near.q + np.einsum("vscp,vp->vsc", near.jacobian, step)
        meeting = near.meeting + np.einsum("vsncp,vp->vsnc", near.meeting_jacobian, step)
        guess = q, meeting, near.tangent
    answer = _in_chunks(knee, vary, values, stations, guess, lanes, search)
    return answer if near is not None else _as_walked(answer, found)


def _as_walked(found: Slopes, walked: Balances) -> Slopes:
    """With nothing known where walks found nothing: from there a search may end anywhere."""
    lost = ~walked.converged
    for name in ("q", "jacobian", "meeting", "meeting_jacobian"):
        getattr(found, name)[lost] = np.nan
    found.status[lost] = walked.status[lost]
    return found


def _in_chunks(knee, vary, values, stations: Stations, guess, lanes, search) -> Slopes:
    """Nodes dealt to lanes, chunks of lanes to threads."""
    count, size = len(values), len(stations)
    q, meeting, tangent = (x.reshape(count * size, *x.shape[2:]) for x in guess)
    marks = jax.tree.map(np.asarray, stations.plain())
    variants = Variants.of(knee, vary, values)

    def chunk(first: int):
        rows = np.minimum(np.arange(first, first + lanes), count * size - 1)
        here = Guess(*(np.moveaxis(x[rows], 0, -1) for x in (q, meeting, tangent)))
        variant, at = rows // size, jax.tree.map(lambda x: x[rows % size], marks)
        numbers = {leaf: x[variant] for leaf, x in variants.numbers.items()}
        found = _found(knee, numbers, at, here, search)
        slopes = _slopes(vary, knee, values[variant], at, found)
        of_nodes = (found.q, found.meeting, found.tangent)
        q_, met, stiffness = (np.moveaxis(np.asarray(x), -1, 0) for x in of_nodes)
        slope, met_slope = map(np.asarray, slopes)
        return q_, slope, met, met_slope, stiffness, np.asarray(found.status)

    parts = on_all_cores(chunk, range(0, count * size, lanes))
    whole = (np.concatenate(x)[: count * size] for x in zip(*parts, strict=True))
    return Slopes(values, *(x.reshape(count, size, *x.shape[1:]) for x in whole))
