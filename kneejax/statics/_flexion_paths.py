"""Paths over flexion, in batches and within a trace.

A knee is bent from its reference pose in strides of 5 degrees, the stem; a load case between two of
them hangs off the nearer one towards the reference. There its loads grow, one after the other in
their order, each along a straight line; load cases whose loads lie on the same line are passed on
the way to the largest. So a load case's route is its own, and a load is reached through lighter
ones.

Paths cannot be shared where numbers are not known yet. So each goes all the way to its own load
case: from the reference pose in strides of 5 degrees, and then under its loads, one after the
other. Where the knee does not balance at its reference pose, a path that found nothing goes once
more by way of 45 degrees, from where the knee may be followed back.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from numpy.typing import ArrayLike

from kneejax.mechanics import Knee, Load, Pull
from kneejax.statics._continuation import Behind, Continuation
from kneejax.statics._equilibria import equilibrium_of, of_record, shapes_of_record
from kneejax.statics._equilibrium import Equilibrium
from kneejax.statics._load_cases import Case, LoadCases, in_rows
from kneejax.statics._status import Status, converged

#: Flexion between two nodes of the stem, rad.
STRIDE = np.deg2rad(5.0)
#: Flexions closer than this are the same, rad.
_SAME = 1e-9


@dataclasses.dataclass(frozen=True)
class Chain:
    """Nodes that are followed one after the other, beginning beside a node that is known.

    Attributes:
        origin: the node beside which the chain begins.
        nodes: in order.
        sizes: of the load that grows along the chain, N (moments at 30 mm); empty without one.
    """

    origin: int
    nodes: tuple[int, ...]
    sizes: tuple[float, ...] = ()


@dataclasses.dataclass(frozen=True)
class Routes:
    """All nodes on the way to some load cases.

    Attributes:
        nodes: flexion and loads of every node.
        asked: the node of each load case that was asked for, `(load_cases,)`.
        stem: unloaded nodes in strides from the reference, in order of flexion.
        home: the node at the reference flexion.
        hops: chains that leave the stem for flexions between its nodes, from the side of the
            reference; `back` are the same from the other side.
        loading: for the first load, the second, ...: chains along which it grows.
    """

    nodes: LoadCases
    asked: np.ndarray
    stem: np.ndarray
    home: int
    hops: tuple[Chain, ...]
    back: tuple[Chain, ...]
    loading: tuple[tuple[Chain, ...], ...]

    @classmethod
    def to(cls, load_cases: LoadCases, reference: float, also: tuple[float, ...] = ()) -> Routes:
        """Lay the routes.

        Args:
            load_cases: wanted, in any order.
            reference: flexion of the reference pose, rad.
            also: flexions (rad) to which the stem reaches in any case.
        """
        return _Layout(load_cases.plain(), reference, also).routes()

    def at(self, flexion: float) -> int:
        """The node of the stem nearest to a flexion, rad."""
        away = np.abs(np.asarray(self.nodes.flexion)[self.stem] - flexion)
        return int(self.stem[np.argmin(away)])

    def bent(self, begin: int, way: int) -> Chain:
        """The stem from one of its nodes towards more (1) or less flexion (-1).

        Args:
            begin: a node of the stem.
            way: 1 or -1.
        """
        place = int(np.flatnonzero(self.stem == begin)[0])
        ahead = self.stem[place + 1 :] if way > 0 else self.stem[:place][::-1]
        return Chain(begin, tuple(int(node) for node in ahead))


class _Layout:
    """Nodes, numbered as they are met."""

    def __init__(self, load_cases: LoadCases, reference: float, also: tuple[float, ...]):
        self.reference, self.wanted = reference, np.asarray(load_cases.flexion)
        self.kinds, self.bodies = load_cases.loads, load_cases.bodies
        # One row a load: all its numbers, how much acts, and where.
        self.loads = _beside([in_rows(load, 1) for load in self.kinds])
        self.sizes = _beside([load.sizes for load in self.kinds])
        self.places = _beside([_places_of(load) for load in self.kinds])
        self.flexion: list[float] = []
        self.acting: list[np.ndarray] = []
        self.numbers: dict[tuple[int, bytes], int] = {}
        strides = [
            way(self._along(flexion)) for flexion in (*self.wanted, *also, reference)
            for way in (np.floor, np.ceil)
        ]  # fmt: skip
        self.nothing = np.zeros(self.loads.shape[1:])
        self.first = int(min(strides))
        self.stem = np.array(
            [self._node(reference + STRIDE * k, self.nothing)
             for k in range(self.first, int(max(strides)) + 1)]
        )  # fmt: skip
        self.home = int(self.stem[-self.first])
        self.hops: dict[int, Chain] = {}
        self.back: dict[int, Chain] = {}
        self.groups: list[dict[tuple, set[tuple[float, int]]]] = [{} for _ in self.kinds]

    def routes(self) -> Routes:
        asked = np.array(
            [self._reached(f, row, len(self.kinds)) for row, f in enumerate(self.wanted)], int
        )
        loading = tuple(
            tuple(_loading(origin, members) for (origin, _), members in groups.items())
            for groups in self.groups
        )
        loads = tuple(map(_of_rows, np.moveaxis(np.array(self.acting), 1, 0), self.kinds))
        nodes = LoadCases({"flexion": np.array(self.flexion)}, loads, bodies=self.bodies)
        hops, back = (tuple(chains.values()) for chains in (self.hops, self.back))
        return Routes(nodes, asked, self.stem, self.home, hops, back, loading)

    def _stride(self, flexion: float) -> int:
        """Whole strides from the reference, towards it."""
        return int(np.trunc(self._along(flexion)))

    def _along(self, flexion: float) -> float:
        """Strides from the reference; whole ones are whole."""
        along = (flexion - self.reference) / STRIDE
        return round(along) if abs(along - round(along)) < _SAME / STRIDE else along

    def _node(self, flexion: float, acting: np.ndarray) -> int:
        key = (round(float(flexion) / _SAME), acting.tobytes())
        if key not in self.numbers:
            self.numbers[key] = len(self.flexion)
            self.flexion.append(float(flexion))
            self.acting.append(acting)
        return self.numbers[key]

    def _reached(self, flexion: float, row: int, stages: int) -> int:
        """The node of a flexion under the first loads of a load case, after those on the way."""
        grown = np.flatnonzero(np.abs(self.sizes[row, :stages]).max(axis=1) > 0)
        if not len(grown):
            return self._unloaded(flexion)
        stage = int(grown[-1])
        acting = self.loads[row].copy()
        acting[stage + 1 :] = 0.0
        origin, node = self._reached(flexion, row, stage), self._node(flexion, acting)
        pull = self.sizes[row, stage]
        size = float(np.linalg.norm(pull))
        line = tuple(np.round(np.r_[pull / size, self.places[row, stage]], 9) + 0.0)
        self.groups[stage].setdefault((origin, line), set()).add((size, node))
        return node

    def _unloaded(self, flexion: float) -> int:
        place = self._stride(flexion) - self.first
        beside = int(self.stem[place])
        if abs(flexion - self.flexion[beside]) < _SAME:
            return beside
        node = self._node(flexion, self.nothing)
        self.hops[node] = Chain(beside, (node,))
        beyond = int(self.stem[place + (1 if flexion > self.reference else -1)])
        self.back[node] = Chain(beyond, (node,))
        return node


def _beside(rows: Sequence[ArrayLike]) -> np.ndarray:
    """Rows of several loads, `(load_cases, loads, numbers)`: shorter ones end in zeros."""
    longest = max(np.shape(row)[1] for row in rows)
    even = [np.pad(row, ((0, 0), (0, longest - np.shape(row)[1]))) for row in rows]
    return np.stack(even, axis=1)


def _places_of(load: Load | Pull) -> np.ndarray:
    """Where a load acts, `(load_cases, numbers)`, of any number of numbers."""
    count = len(load.sizes)
    rows = (np.reshape(x, (count, -1)) for x in load.places)
    return np.hstack([np.empty((count, 0)), *rows])


def _of_rows(rows: np.ndarray, kind: Load | Pull) -> Load | Pull:
    """Loads of one kind from rows of all their numbers, `(nodes, numbers)`."""
    leaves, structure = jax.tree.flatten(kind)
    ends = np.cumsum([np.size(x[0]) for x in leaves])
    parts = zip(leaves, np.r_[0, ends[:-1]], ends, strict=True)
    shaped = [rows[:, a:b].reshape(-1, *np.shape(x)[1:]) for x, a, b in parts]
    return jax.tree.unflatten(structure, shaped)


def _loading(origin: int, members: set[tuple[float, int]]) -> Chain:
    sizes, nodes = zip(*sorted(members), strict=True)
    return Chain(origin, nodes, sizes)


#: Load cases without an equilibrium in a row after which a path ends.
_GIVE_UP = 5
#: Strides of the way around, and of all ways at most: half a turn of the knee.
_AROUND, _MOST = 9, 36


def continued_in_trace(knee: Knee, load_cases: LoadCases) -> Equilibrium:
    """Balance a knee at load cases where flexion alone is prescribed.

    Args:
        knee: without a lane axis; nothing is differentiated through the search.
        load_cases: in any order, within half a turn of the reference pose.

    Returns:
        The balances, a lane each; NaN where there is none.
    """
    knee = knee.for_many_poses()
    stages, load_cases = len(load_cases.loads), load_cases.of(knee).plain()
    lanes, free = len(load_cases), load_cases.free
    q = jnp.broadcast_to(knee.at_reference.at(free)[:, None], (len(free), lanes))
    contact_points = jnp.full((knee.patch_count, 2, lanes), jnp.nan)
    like = Case({}, jax.tree.map(lambda x: x[0], load_cases))
    shapes = shapes_of_record(load_cases, knee.patch_count)

    def a_trip(trip: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        again, goes, found = trip
        cases, length = _cases(knee, load_cases, stages, again * _AROUND)
        length = jnp.where(goes, length, 0)
        behind = Behind.at(cases[0].T, q, contact_points, jnp.zeros(lanes, int))
        end = Continuation(knee, like, cases, length, jnp.asarray(_GIVE_UP)).run(behind, None)
        # What ended before its load case says nothing of it, nor where the ways end before it.
        record = of_record(end.record, shapes)
        here = (record["place"] == length - 1) & (length <= len(cases))
        record["status"] = jnp.where(here, record["status"], float(Status.NOT_CONVERGED))
        there = jnp.concatenate([x.reshape(-1, lanes) for x in record.values()])
        found = jnp.where(goes, there, found)
        return again + 1, goes & ~converged(record["status"]) & ~end.at_first, found

    size = sum(len(jnp.zeros(shape).reshape(-1)) for shape in shapes.values())
    trip = jnp.asarray(0), jnp.ones(lanes, bool), jnp.zeros((size, lanes))
    _, _, found = lax.while_loop(lambda x: (x[0] < 2) & jnp.any(x[1]), a_trip, trip)
    record = of_record(found, shapes)
    good = converged(record["status"])
    nodes = {name: record[name] for name in record if name not in ("place", "way", "softness")}
    for name in ("status", "fault", "steps"):
        nodes[name] = nodes[name].astype(int)
    return equilibrium_of(load_cases, nodes | {"q": jnp.where(good, record["q"], jnp.nan)})


def _cases(knee: Knee, load_cases: LoadCases, stages: int, around: Array) -> tuple[Array, Array]:
    """Load cases of each path in rows, `(places, lanes, numbers)`, by way of so many strides
    around; and how many there are."""
    begin, goal = knee.reference_pose.flexion, load_cases.flexion
    turn, place = begin + around * STRIDE, jnp.arange(2 * _AROUND + _MOST + stages)[:, None]
    strides = jnp.ceil(jnp.abs(goal - turn) / STRIDE - 1e-9).astype(int)
    back = jnp.maximum(place - around, 0) * STRIDE
    bent = jnp.where(
        place <= around, begin + place * STRIDE, turn + jnp.clip(goal - turn, -back, back)
    )
    stage = place - around - strides
    grown = tuple(
        load.times(jnp.where(stage > k, 1.0, 0.0)).at_each(stage.shape)
        for k, load in enumerate(load_cases.loads)
    )
    cases = dataclasses.replace(load_cases, prescribed={"flexion": bent}, loads=grown)
    return in_rows(({}, cases), 2), around + strides + 1 + stages
