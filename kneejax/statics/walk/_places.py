"""What a stretch of a walk is asked, what its lanes remember, and what became of its nodes.

They are made and taken apart a hundred times a second: plain dataclasses, since each equinox module
costs a tenth of a millisecond more.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.statics.walk._stations import Stations


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Nodes:
    """What lies ahead of each lane; arrays begin with place and lane.

    Attributes:
        numbers: leaves of the knee that vary, by their places in it, `(places, lanes, ...)`.
        stations: likewise.
        q: coordinates from which distances are predicted, `(places, lanes, free)`.
        meeting: likewise, `(places, lanes, n, 2)`.
        even: whether the last two strides and this one are alike, `(places, lanes)`.
        reach: mm (rotations at 30 mm) that the distance from the motion may change by on the way
            to a node, `(places, lanes)`; what lies farther is another branch.
        loading: whether loads change on the way to a node, `(places, lanes)`.
        first: how many nodes of its path a lane has behind it, `(lanes,)`.
        length: places of each lane, `(lanes,)`; none where a lane is not needed.
    """

    numbers: dict[int, Any]
    stations: Stations
    q: Any
    meeting: Any
    even: Any
    reach: Any
    loading: Any
    first: Any
    length: Any


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Place:
    """Where lanes stand between their nodes; arrays begin with the lane.

    Attributes:
        numbers: as in `Nodes`, `(lanes, ...)`.
        stations: likewise.
        q: likewise, `(lanes, free)`.
        meeting: likewise, `(lanes, n, 2)`.
    """

    numbers: dict[int, Any]
    stations: Stations
    q: Any
    meeting: Any

    def towards(self, there: Place, part: Array) -> Place:
        """A part of the straight way to another place."""

        def between(here: Array, end: Array) -> Array:
            share = in_front(part, end)
            return jnp.where(share >= 1.0, end, here + share * (end - here))

        way = jax.tree.map(between, self, there)
        # A force that grows acts where it will act.

        def points(place: Place) -> list[Array]:
            return [load.point for load in place.stations.loads]

        return eqx.tree_at(points, way, points(there))


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Memory:
    """What a lane knows of its way so far; arrays end in lanes, those of `last` begin with them.

    Attributes:
        away_q: distances `(3, free, lanes)` at the last three balances, the latest first.
        away_meeting: likewise, `(3, n, 2, lanes)`.
        when: how far along the path they were, in nodes, `(3, lanes)`.
        last: the place of the latest.
        known: balances in a row, of nodes or on the way to them.
        lost: nodes lost in a row.
        begun: whether a balance lies behind; from elsewhere any way is long.
        based: whether `last` is where the path comes from, so that the way can be divided.
        wary: whether the next search is not to be predicted, since one was lost.
        aim: part of the way from `last` to the next node that is tried.
        tangent: stiffness at the latest balance, `(free, free, lanes)`; zero where it is not known.
        softness: see `softness_of`, at the latest balance.
        steps: looks spent so far on a node that is not finished.
    """

    away_q: Any
    away_meeting: Any
    when: Any
    last: Place
    known: Any
    lost: Any
    begun: Any
    based: Any
    wary: Any
    aim: Any
    tangent: Any
    softness: Any
    steps: Any


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Reached:
    """What became of the nodes; arrays begin with the turn and end in lanes.

    Attributes:
        place: of the node that ended in this turn; -1 where none did.
        q: `(turns, free, lanes)`.
        meeting: `(turns, n, 2, lanes)`.
        status: `(turns, lanes)`.
        fault: see `Settled`, of the last search.
        steps: looks of all searches for the node.
        way: how far along the path the last balance was, in nodes, `(turns, lanes)`.
        softness: see `softness_of`; there, or where the search ended if that is less and not far;
            at the node if it is balanced.
        holding: fields of `Settled` by name, of the last search: those that a look computes.
    """

    place: Array
    q: Array
    meeting: Array
    status: Array
    fault: Array
    steps: Array
    way: Array
    softness: Array
    holding: dict[str, Array]

    def packed(self) -> Array:
        """All numbers of one turn, `(numbers, lanes)`: one by one their writing took 2 % of it."""
        leaves = jax.tree.leaves(self)
        return jnp.concatenate([x.reshape(-1, x.shape[-1]).astype(float) for x in leaves])

    def unpacked(self, log: np.ndarray | Array) -> Reached:
        """All turns of a log, whose turns are like this one."""
        leaves, kinds = jax.tree.flatten(self)
        ends = np.cumsum([x.size // x.shape[-1] for x in leaves])
        shaped = [
            log[:, end - x.size // x.shape[-1] : end].reshape(len(log), *x.shape).astype(x.dtype)
            for x, end in zip(leaves, ends, strict=True)
        ]
        return jax.tree.unflatten(kinds, shaped)


def in_front(lanes: Array, like: Array) -> Array:
    """Lanes as the first axis of an array."""
    return lanes.reshape(-1, *(1,) * (like.ndim - 1))
