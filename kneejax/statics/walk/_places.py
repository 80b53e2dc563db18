"""What a stretch of a walk is asked, what its lanes remember, and what became of its nodes.

Between calls all of it is a few arrays, in which the numbers of a lane stand below each other: a
hundred calls a second would else spend more on handing over forty small arrays than on the walk.
"""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.mechanics import Knee
from kneejax.statics._settle import shapes_of_holding
from kneejax.statics.walk._stations import Stations
from kneejax.statics.walk._variants import with_numbers

_Tree = TypeVar("_Tree")


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Place:
    """Where lanes stand between their nodes; arrays end in lanes.

    Attributes:
        numbers: leaves of the knee that vary, by their places in it.
        stations: what is prescribed, and the loads.
        q: coordinates from which distances are predicted, `(free, lanes)`.
        meeting: likewise, `(n, 2, lanes)`.
    """

    numbers: dict[int, Any]
    stations: Stations
    q: Any
    meeting: Any

    def loaded(self, knee: Knee) -> Knee:
        """A knee in each lane, with its loads."""
        return self.stations.added_to(with_numbers(knee, self.numbers)).for_many_poses()

    def rows_of_points(self) -> np.ndarray:
        """Which of its numbers say where a load acts."""

        def points(place: Place) -> list[Any]:
            return [x for load in place.stations.loads for x in load.places]

        nowhere = jax.tree.map(lambda x: np.zeros(np.shape(x), bool), self)
        return in_rows(eqx.tree_at(points, nowhere, [np.ones_like(x) for x in points(nowhere)]), 0)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Nodes:
    """What lies ahead of each lane; arrays begin with place and lane.

    Attributes:
        like: any place, without lanes: so the next numbers are read.
        places: in rows, `(places, lanes, numbers)`.
        even: whether the last two strides and this one are alike, `(places, lanes)`.
        reach: mm (rotations at 30 mm) that the distance from the motion may change by on the way
            to a node, `(places, lanes)`; what lies farther is another branch.
        loading: whether loads change on the way to a node, `(places, lanes)`.
        first: how many nodes of its path a lane has behind it, `(lanes,)`.
        length: places of each lane, `(lanes,)`; none where a lane is not needed.
    """

    like: Place
    places: Any
    even: Any
    reach: Any
    loading: Any
    first: Any
    length: Any

    def at(self, place: Array) -> tuple[Array, Array]:
        """Where the numbers of a place stand, in each lane."""
        places, lanes = self.even.shape
        return jnp.minimum(place, places - 1), jnp.arange(lanes)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Memory:
    """What a lane knows of its way so far; arrays end in lanes.

    Attributes:
        lost: nodes lost in a row; packed, the first row.
        away_q: distances `(3, free, lanes)` at the last three balances, the latest first.
        away_meeting: likewise, `(3, n, 2, lanes)`.
        when: how far along the path they were, in nodes, `(3, lanes)`.
        last: the place of the latest, packed.
        known: balances in a row, of nodes or on the way to them.
        begun: whether a balance lies behind; from elsewhere any way is long.
        based: whether `last` is where the path comes from, so that the way can be divided.
        wary: whether the next search is not to be predicted, since one was lost.
        aim: part of the way from `last` to the next node that is tried.
        softness: see `softness_of`, at the latest balance.
        steps: looks spent so far on a node that is not finished.
    """

    lost: Any
    away_q: Any
    away_meeting: Any
    when: Any
    last: Any
    known: Any
    begun: Any
    based: Any
    wary: Any
    aim: Any
    softness: Any
    steps: Any

    @classmethod
    def like(cls, place: Place) -> Memory:
        """The memory of one lane: so a packed one is read."""
        free, patches, yes = len(place.q), len(place.meeting), np.zeros((), bool)
        number, count = np.zeros(()), np.zeros((), int)
        return cls(
            lost=count,
            away_q=np.zeros((3, free)),
            away_meeting=np.zeros((3, patches, 2)),
            when=np.zeros(3),
            last=np.zeros(len(place.rows_of_points())),
            known=count,
            begun=yes,
            based=yes,
            wary=yes,
            aim=number,
            softness=number,
            steps=count,
        )


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Reached:
    """What became of the nodes; arrays begin with the turn and end in lanes.

    Attributes:
        place: of the node that ended in this turn; -1 where none did; packed, the first row.
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

    place: Any
    q: Any
    meeting: Any
    status: Any
    fault: Any
    steps: Any
    way: Any
    softness: Any
    holding: dict[str, Any]

    @classmethod
    def like(cls, free: int, patches: int) -> Reached:
        """What became of one lane in one turn: so a packed log is read."""
        number, count = np.zeros(()), np.zeros((), int)
        return cls(
            place=count,
            q=np.zeros(free),
            meeting=np.zeros((patches, 2)),
            status=count,
            fault=count,
            steps=count,
            way=number,
            softness=number,
            holding={k: np.zeros(shape) for k, shape in shapes_of_holding(free, patches).items()},
        )


def packed(tree: Any) -> Any:
    """All numbers of arrays that end in lanes, below each other, `(numbers, lanes)`."""
    leaves = jax.tree.leaves(tree)
    numpy = np if all(isinstance(x, np.ndarray) for x in leaves) else jnp
    return numpy.concatenate([x.reshape(-1, x.shape[-1]).astype(float) for x in leaves])


def in_rows(tree: Any, axes: int) -> Any:
    """All numbers of arrays that begin with the same axes, beside each other: `(..., numbers)`."""
    leaves = jax.tree.leaves(tree)
    numpy = np if all(isinstance(x, np.ndarray) for x in leaves) else jnp
    return numpy.concatenate([x.reshape(*x.shape[:axes], -1) for x in leaves], axis=-1)


def unpacked(numbers: Any, like: _Tree) -> _Tree:
    """What was packed.

    Args:
        numbers: `(..., numbers, lanes)`.
        like: of one lane; gives shapes and kinds.

    Returns:
        The same, arrays with further axes in front and lanes at the end.
    """
    leaves, kinds = jax.tree.flatten(like)
    *front, _, lanes = numbers.shape
    ends = np.cumsum([x.size for x in leaves])
    shaped = [
        numbers[..., end - x.size : end, :].reshape(*front, *x.shape, lanes).astype(x.dtype)
        for x, end in zip(leaves, ends, strict=True)
    ]
    return jax.tree.unflatten(kinds, shaped)
