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

__all__ = ["continued_in_trace"]

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from kneejax.mechanics import Knee
from kneejax.statics._continuation import Behind, Continuation
from kneejax.statics._equilibria import equilibrium_of, of_record, shapes_of_record
from kneejax.statics._equilibrium import Equilibrium
from kneejax.statics._load_cases import Case, LoadCases, in_rows
from kneejax.statics._status import Status, converged

#: Flexion between two nodes of the stem, rad.
STRIDE = np.deg2rad(5.0)
#: Flexions closer than this are the same, rad.
_SAME = 1e-9


class Chain(NamedTuple):
    """Nodes that are followed one after the other."""

    origin: int  # the node beside which the chain begins
    nodes: tuple[int, ...]
    sizes: tuple[float, ...] = ()  # of the load that grows along the chain, N (moments at 30 mm)


class Routes:
    """All nodes on the way to some load cases, numbered as they are met.

    Attributes:
        asked: the node of each load case that was asked for, `(load_cases,)`.
        stem: unloaded nodes in strides from the reference, in order of flexion.
        home: the node at the reference flexion.
        hops: chains that leave the stem for flexions between its nodes, from the side of the
            reference; `back` are the same from the other side.
        loading: for the first load, the second, ...: chains along which it grows.
    """

    def __init__(self, load_cases: LoadCases, reference: float, also: tuple[float, ...] = ()):
        """Lay the routes.

        Args:
            load_cases: wanted, in any order.
            reference: flexion of the reference pose, rad.
            also: flexions (rad) to which the stem reaches in any case.
        """
        load_cases = jax.tree.map(np.asarray, load_cases.plain())
        self._wanted, self._reference, loads = load_cases, reference, load_cases.loads
        # One row a load case, of each load: all its numbers, how much acts, and where.
        self._rows = [in_rows(load, 1) for load in loads]
        self._sizes = [in_rows(np.asarray(load.sizes), 1) for load in loads]
        self._places = [in_rows((np.empty((len(load_cases), 0)), *x.places), 1) for x in loads]
        self._flexion: list[float] = []
        # The load case whose first loads act at a node, and how many do.
        self._acting: list[tuple[int, int]] = []
        self._numbers: dict[tuple[int, bytes], int] = {}
        strides = [
            way(self._along(flexion)) for flexion in (*load_cases.flexion, *also, reference)
            for way in (np.floor, np.ceil)
        ]  # fmt: skip
        self._first = int(min(strides))
        every = range(self._first, int(max(strides)) + 1)
        self.stem = np.array([self._node(reference + STRIDE * k) for k in every])
        self.home = int(self.stem[-self._first])
        self._beside: dict[int, tuple[Chain, Chain]] = {}
        self._lines: list[dict[tuple, set[tuple[float, int]]]] = [{} for _ in loads]
        wanted = enumerate(load_cases.flexion)
        self.asked = np.array([self._reached(f, row, len(loads)) for row, f in wanted], int)
        self.hops, self.back = ([pair[k] for pair in self._beside.values()] for k in (0, 1))
        self.loading = [
            [_grown(origin, members) for (origin, _), members in lines.items()]
            for lines in self._lines
        ]

    @property
    def nodes(self) -> LoadCases:
        """Flexion and loads of every node."""
        rows, stages = np.array(self._acting).T

        def acting(x: np.ndarray, stage: int) -> np.ndarray:
            acts = (stages > stage).reshape(-1, *(1,) * (x.ndim - 1))
            return np.where(acts, x[rows], 0.0)

        loads = tuple(
            jax.tree.map(lambda x, stage=stage: acting(x, stage), load)
            for stage, load in enumerate(self._wanted.loads)
        )
        return LoadCases({"flexion": np.array(self._flexion)}, loads, bodies=self._wanted.bodies)

    def bent(self, begin: int, way: int) -> Chain:
        """The stem from one of its nodes towards more (1) or less flexion (-1)."""
        place = int(np.flatnonzero(self.stem == begin)[0])
        ahead = self.stem[place + 1 :] if way > 0 else self.stem[:place][::-1]
        return Chain(begin, tuple(ahead.tolist()))

    def _along(self, flexion: float) -> float:
        """Strides from the reference; whole ones are whole."""
        along = (flexion - self._reference) / STRIDE
        return round(along) if abs(along - round(along)) < _SAME / STRIDE else along

    def _node(self, flexion: float, row: int = 0, stages: int = 0) -> int:
        """The node of a flexion under the first loads of a load case; by default, under none."""
        acting = b"".join(rows[row].tobytes() for rows in self._rows[:stages])
        key = round(float(flexion) / _SAME), acting
        if key not in self._numbers:
            self._numbers[key] = len(self._flexion)
            self._flexion.append(float(flexion))
            self._acting.append((row, stages))
        return self._numbers[key]

    def _reached(self, flexion: float, row: int, stages: int) -> int:
        """As `_node`, after those on the way, which join the lines of their load."""
        sizes = [of_load[row] for of_load in self._sizes[:stages]]
        stage = max((k for k, size in enumerate(sizes) if size.any()), default=None)
        if stage is None:
            return self._unloaded(flexion)
        origin, node = self._reached(flexion, row, stage), self._node(flexion, row, stage + 1)
        size = float(np.linalg.norm(sizes[stage]))
        line = np.round(np.r_[sizes[stage] / size, self._places[stage][row]], 9) + 0.0
        self._lines[stage].setdefault((origin, tuple(line)), set()).add((size, node))
        return node

    def _unloaded(self, flexion: float) -> int:
        place = int(np.trunc(self._along(flexion))) - self._first
        near = int(self.stem[place])
        if abs(flexion - self._flexion[near]) < _SAME:
            return near
        node = self._node(flexion)
        beyond = int(self.stem[place + (1 if flexion > self._reference else -1)])
        self._beside[node] = Chain(near, (node,)), Chain(beyond, (node,))
        return node


def _grown(origin: int, members: set[tuple[float, int]]) -> Chain:
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
