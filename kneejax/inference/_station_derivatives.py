"""Balanced poses of a knee at any flexions and loads, with their exact Jacobian."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.inference._parameters import Selection
from kneejax.inference._problem import TABLE_UNITS, Evaluation
from kneejax.mechanics import Knee, Load, add_lane_axis
from kneejax.statics import Guess, Stations, Status, compiled, first_guess, poses_on_the_way, settle

#: Steps in which a load grows.
_LOAD_STEPS = 4


@dataclasses.dataclass(frozen=True)
class StationDerivatives:
    """Poses at stations, and how parameters move them; rows that failed are NaN.

    Attributes:
        table: free coordinates, degrees and mm, `(stations, 5)`.
        jacobian: by the parameters, `(stations, 5, p)`.
        status: `Status` values, `(stations,)`.
        meeting: parameters of the meeting points, `(stations, n, 2)`.
    """

    table: np.ndarray
    jacobian: np.ndarray
    status: np.ndarray
    meeting: np.ndarray

    def take(self, rows: Sequence[int]) -> StationDerivatives:
        """Some of the stations, in the order of `rows`."""
        place = list(rows)
        return StationDerivatives(
            self.table[place], self.jacobian[place], self.status[place], self.meeting[place]
        )


def station_derivatives(
    selection: Selection,
    knee: Knee,
    values: np.ndarray,
    stations: Stations,
    near: StationDerivatives | None = None,
) -> StationDerivatives:
    """Balance a knee at flexions with loads, and differentiate each pose by the parameters.

    Every station is reached as a test is made: the knee is bent without the load, which then grows
    in four steps. A lax knee may have several balanced poses; this is the one that a test finds.
    Where it fails, the knee is bent under the whole load.

    Args:
        selection: the parameters.
        knee: gives everything else.
        values: of the parameters, `(p,)`.
        stations: in any order; none depends on another.
        near: balanced poses at these stations, of parameters close by, to begin at instead.

    Returns:
        Poses, exact derivatives (the implicit function theorem) and outcomes.
    """
    x, flexion = jnp.asarray(values, float), stations.flexion
    if near is not None:
        q, meeting = near.table.T / TABLE_UNITS[:, None], np.moveaxis(near.meeting, 0, -1)
        beside = Guess(jnp.asarray(q), jnp.asarray(meeting))
        once = jnp.asarray(1)
        return _by_station(_evaluate(selection, knee, x, stations, beside, flexion, once))
    begin = jnp.broadcast_to(knee.reference_pose.flexion, flexion.shape)
    count = poses_on_the_way(knee.reference_pose.flexion, flexion)
    guess = first_guess(add_lane_axis(selection.apply(knee, x)), begin)
    grown = _by_station(_under_growing_load(selection, knee, x, stations, guess, begin, count))
    failed = grown.status >= Status.TOO_DEEP
    if not failed.any():
        return grown
    direct = _by_station(_evaluate(selection, knee, x, stations, guess, begin, jnp.asarray(count)))

    def better(by_load: np.ndarray, at_once: np.ndarray) -> np.ndarray:
        return np.where(failed.reshape(-1, *(1,) * (by_load.ndim - 1)), at_once, by_load)

    return StationDerivatives(
        better(grown.table, direct.table),
        better(grown.jacobian, direct.jacobian),
        better(grown.status, direct.status),
        better(grown.meeting, direct.meeting),
    )


def _by_station(found: Evaluation) -> StationDerivatives:
    return StationDerivatives(
        np.asarray(found.table).T,
        np.moveaxis(np.asarray(found.jacobian), 1, 0),
        np.asarray(found.settled.status),
        np.moveaxis(np.asarray(found.settled.meeting), -1, 0),
    )


def _under_growing_load(selection, knee, x, stations, guess, begin, count) -> Evaluation:
    """Balances reached without the load first; each step of it starts from the last."""
    free, once = _loaded_in_part(stations, 0.0), jnp.asarray(1)
    found = _evaluate(selection, knee, x, free, guess, begin, jnp.asarray(count))
    for step in range(1, _LOAD_STEPS + 1):
        part = _loaded_in_part(stations, step / _LOAD_STEPS)
        near = Guess(found.settled.q, found.settled.meeting, found.settled.tangent)
        found = _evaluate(selection, knee, x, part, near, stations.flexion, once)
    return found


def _loaded_in_part(stations: Stations, part: float) -> Stations:
    def scaled(load: Load) -> Load:
        return dataclasses.replace(load, force=part * load.force, moment=part * load.moment)

    return dataclasses.replace(stations, loads=tuple(scaled(load) for load in stations.loads))


@compiled(static_argnums=(0,))
def _evaluate(
    selection: Selection,
    knee: Knee,
    values: Array,
    stations: Stations,
    guess: Guess,
    start: Array,
    count: Array,
) -> Evaluation:
    def table(x: Array):
        loaded = stations.load(add_lane_axis(selection.apply(knee, x)))
        settled = settle(loaded, stations.flexion, guess, start, count)
        return settled.q * jnp.asarray(TABLE_UNITS)[:, None], settled

    value, push, settled = jax.linearize(table, values, has_aux=True)
    return Evaluation(value, jax.vmap(push, out_axes=-1)(jnp.eye(values.shape[0])), settled)
