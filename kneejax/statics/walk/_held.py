"""From flexion prescribed to any other choice: coordinates moved by a machine, or let go.

A displacement is tested like a load: the knee is bent and loaded first, then the machine takes hold
of a coordinate where it is and moves it to where it is wanted, along a straight line. A flexion
that is to be free is supported where the knee was loaded, and the support is taken away. Either way
is divided where the knee does not follow at once, as loads are.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.geometry import Prescribed, State, scales
from kneejax.mechanics import Knee, Support
from kneejax.numerics import compiled, identity, on_all_cores
from kneejax.statics._balance import balance
from kneejax.statics._settle import shapes_of_holding
from kneejax.statics._status import Status, converged, gives_way
from kneejax.statics._stiffness import softness_of
from kneejax.statics.walk._balances import Balances
from kneejax.statics.walk._places import (
    Memory,
    Nodes,
    Place,
    Reached,
    in_rows,
    packed,
    unpacked,
)
from kneejax.statics.walk._stations import Stations
from kneejax.statics.walk._stretch import walk_stretch
from kneejax.statics.walk._variants import Variants, with_numbers

#: Nodes of a call.
_LANES = 64
#: Stiffness, as a part of that at the beginning, below which a knee that cannot follow gives way.
_SOFT = 0.1


def held(variants: Variants, stations: Stations, before: Balances) -> Balances:
    """Move balances under flexion alone to another choice of prescribed coordinates.

    Args:
        variants: of one knee.
        stations: what is wanted.
        before: balances of the same variants at `stations.loaded()`.

    Returns:
        The balances; where `before` has none, there is none. `reached` is the part of the way that
        the knee followed.
    """
    found = _not_begun(stations, before)
    variant, station = np.nonzero(before.converged)
    wanted = jax.tree.map(np.asarray, stations.plain())

    def some(first: int) -> None:
        # Lanes that are filled up do the last node again.
        rows = np.minimum(np.arange(first, first + _LANES), len(variant) - 1)
        node = variant[rows], station[rows]
        there = jax.tree.map(lambda x: x[node[1]], wanted)
        tangent = before.holding["tangent"][node] if before.holding else None
        begin = before.q[node], before.meeting[node], tangent
        moved = _moved(variants, there, node[0], *begin)
        for name, numbers in moved.items():
            (found.holding if name in found.holding else vars(found))[name][node] = numbers

    on_all_cores(some, range(0, len(variant), _LANES))
    return found


def _not_begun(stations: Stations, before: Balances) -> Balances:
    """As lost as the knee is with flexion alone prescribed."""
    shape, free = before.status.shape, stations.free
    size, patches = len(free), before.meeting.shape[2]
    status = np.where(before.converged, int(Status.NOT_CONVERGED), before.status)
    holding = shapes_of_holding(size, patches)
    return Balances(
        np.full((*shape, size), np.nan),
        np.full(before.meeting.shape, np.nan),
        status.astype(before.status.dtype),
        before.steps.copy(),
        np.where(before.converged, 1.0, before.reached),
        before.fault.copy(),
        {name: np.full((*shape, *tail), np.nan) for name, tail in holding.items()},
        free,
    )


def _moved(
    variants: Variants, wanted: Stations, variant, q, meeting, tangent
) -> dict[str, np.ndarray]:
    """Some nodes, each from a balance under flexion alone; arrays begin with the node."""
    lanes, free = len(variant), wanted.free
    knee, numbers = variants.knee, variants.at(variant)
    begin = _beginning(knee, numbers, wanted, q, meeting, None if _released(wanted) else tangent)
    start, support, tangent, softness = jax.tree.map(np.asarray, begin)
    every, released = _coordinates(wanted), _released(wanted)
    supports = tuple(Support(support[:, k], name) for k, name in enumerate(released))
    none = tuple(Support(np.zeros(lanes), name) for name in released)
    ends = dataclasses.replace(wanted, supports=none)
    own = {name: start[:, row] for row, name in enumerate(every)}
    here = dataclasses.replace(
        ends,
        prescribed={name: own[name] for name in wanted.prescribed},
        supports=supports,
        loads=wanted.loaded().loads,
    )
    at_rest = np.stack([own[name] for name in free], axis=1)
    there, last = (
        jax.tree.map(np.asarray, Place(numbers, place, at_rest, meeting)) for place in (ends, here)
    )
    yes, no = np.ones(lanes, bool), np.zeros(lanes, bool)
    nodes = Nodes(
        like=jax.tree.map(lambda x: x[0], there),
        places=in_rows(there, 1)[None],
        even=no[None],
        reach=np.full((1, lanes), np.inf),
        loading=yes[None],
        first=np.zeros(lanes),
        length=np.ones(lanes, int),
    )
    memory = Memory(
        lost=np.zeros(lanes, int),
        away_q=np.zeros((3, len(free), lanes)),
        away_meeting=np.zeros((3, *meeting.shape[1:], lanes)),
        when=np.zeros((3, lanes)),
        last=in_rows(last, 1).T,
        known=np.ones(lanes, int),
        begun=yes, based=yes, wary=no,
        aim=np.ones(lanes),
        softness=softness,
        steps=np.zeros(lanes, int),
    )  # fmt: skip
    like = Reached.like(len(free), meeting.shape[1])
    return _what_became(_walked(knee, nodes, packed(memory), like), softness)


def _walked(knee: Knee, nodes: Nodes, memory: np.ndarray, like: Reached) -> Reached:
    """What became of one node in each lane; a call leaves lanes behind that take long."""
    lanes, ended = len(nodes.first), []
    left = np.ones(lanes, bool)
    while left.any():
        ahead = dataclasses.replace(nodes, length=left.astype(int))
        log, memory = walk_stretch(knee, ahead, memory, 1, 0)
        ended.append(np.asarray(log))
        left &= ~(ended[-1][:, 0] >= 0).any(axis=0)
    every = np.concatenate(ended)
    when, lane = np.argmax(every[:, 0] >= 0, axis=0), np.arange(lanes)
    reached = unpacked(every[when, :, lane].T, like)
    return jax.tree.map(lambda x: np.moveaxis(x, -1, 0), reached)


def _what_became(reached: Reached, softness_before: np.ndarray) -> dict[str, np.ndarray]:
    """The fields of `Balances`, and of its `holding`; arrays begin with the node."""
    status, fault = reached.status, reached.fault
    good = converged(status)
    soft = reached.softness < _SOFT * softness_before
    way = np.where(good, 1.0, reached.way)
    blocked = gives_way(~good, way, soft, fault)
    return {
        "q": np.where(good[:, None], reached.q, np.nan),
        "meeting": np.where(good[:, None, None], reached.meeting, np.nan),
        "status": np.where(blocked, int(Status.GIVES_WAY), status),
        "steps": reached.steps,
        "reached": way,
        "fault": fault,
    } | reached.holding


@compiled()
def _beginning(knee: Knee, numbers: dict[int, Any], wanted: Stations, q, meeting, tangent):
    """All coordinates where nodes begin, what supports those that will be free, the stiffness of
    the free ones, and how little force moves them; arrays begin with the node. The stiffness under
    flexion alone, where it is known, gives that of fewer coordinates: without it the knee is
    compiled once more, which takes 20 s of a detailed one."""
    in_lanes = {leaf: jnp.moveaxis(x, 0, -1) for leaf, x in numbers.items()}
    before = wanted.loaded()
    knees = before.load(with_numbers(knee, in_lanes))
    state = State.of(before.prescribed, q.T, wanted.bodies)
    met = jnp.moveaxis(meeting, 0, -1)
    held = {name: state.at([name])[0] for name in wanted.prescribed}
    free = state.at(wanted.free)
    if tangent is None:
        holds = balance(knees, held, free, (met[:, 0], met[:, 1]))
        stiffness, residual = holds.tangent, holds.residual
    else:
        own = jnp.moveaxis(tangent, 0, -1)
        stiffness, residual = _of_fewer(own, held, free, before, wanted), jnp.zeros_like(free)
    softness, _ = softness_of(stiffness, scales(wanted.free))
    released = [wanted.free.index(name) for name in _released(wanted)]
    support = residual[jnp.array(released, int)]
    every = state.at(_coordinates(wanted))
    return every.T, support.T, jnp.moveaxis(stiffness, -1, 0), softness


def _of_fewer(tangent, held: Prescribed, free: Array, before: Stations, wanted: Stations) -> Array:
    """The stiffness along coordinates that depend linearly on those of before, in balance."""

    def at(q: Array) -> Array:
        return State.of(held, q, wanted.bodies).at(before.free)

    units = identity(len(free), 1) + jnp.zeros_like(free)
    along = jnp.stack([jax.jvp(at, (free,), (unit,))[1] for unit in units], axis=1)
    return jnp.einsum("ai...,ab...,bj...->ij...", along, tangent, along)


def _coordinates(wanted: Stations) -> tuple[str, ...]:
    """Of all bodies, as stations name them."""
    return (*wanted.prescribed, *wanted.free)


def _released(wanted: Stations) -> tuple[str, ...]:
    """Coordinates that were prescribed while the knee was loaded and are to be free."""
    return tuple(name for name in wanted.free if name in wanted.loaded().prescribed)
