"""Chunks of one width, and coordinates that are prescribed or freed in them.

So fits, maps and cohorts of any size share one compiled program. Answers depend neither on the
number of cores nor on who was first.

A displacement is tested like a load: the knee is bent and loaded first, then the machine takes hold
of a coordinate where it is and moves it to where it is wanted, along a straight line. A flexion
that is to be free is supported where the knee was loaded, and the support is taken away.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.geometry import State
from kneejax.mechanics import Knee, Support
from kneejax.numerics import compiled, on_all_cores
from kneejax.statics._balance import force_along
from kneejax.statics._continuation import Behind, follow
from kneejax.statics._equilibria import Equilibria, of_record, shapes_of_record
from kneejax.statics._load_cases import Case, LoadCases, Variants, in_rows
from kneejax.statics._status import Status, gives_way

#: Paths side by side. Few are soon filled, many share what an operation costs by itself
#: (docs/performance.md). Over points one path by itself fills the processor.
LANES, LANES_OVER_POINTS = 64, 8
#: Load cases of all paths from which on a program pays that runs a quarter faster and takes twice
#: the seconds to compile (docs/performance.md).
_MANY, _MANY_OVER_POINTS = 500_000, 10_000
_follow, _follow_many = compiled()(follow), compiled(effort="most")(follow)
#: Load cases ahead of each path in one call.
_AHEAD = 32
#: Paths for each one that a call leaves on its way, where others wait; likewise of one load case.
_ROOM, _ROOM_OF_ONE = 2, 8
#: Paths of a thread's lot, at least and at most, for each lane.
_LOT = (2, 8)


class Paths(NamedTuple):
    """Paths of load cases.

    Attributes:
        like: any case, without lanes.
        cases: rows of some paths at some of their places, both index arrays of one shape.
        length: load cases of each path, `(paths,)`.
        longest: that any path may have.
        behind: what lies behind each; arrays of NumPy.
    """

    like: Case
    cases: Callable[[np.ndarray, np.ndarray], np.ndarray]
    length: np.ndarray
    longest: int
    behind: Behind


#: Called with paths, places on them, and their records by name, arrays that end in records.
Note = Callable[[np.ndarray, np.ndarray, dict[str, Any]], None]


def follow_in_chunks(knee: Knee, paths: Paths, give_up: int, note: Note) -> None:
    """Follow paths to their ends.

    Args:
        knee: gives all numbers that do not vary.
        paths: any number.
        give_up: load cases without an equilibrium in a row after which a path ends.
        note: called, by several threads, with what became of some load cases.
    """
    count = len(paths.length)
    over_points = knee.patch_count < len(knee.contacts)
    lanes = LANES_OVER_POINTS if over_points else LANES
    many = paths.length.sum() >= (_MANY_OVER_POINTS if over_points else _MANY)
    program = _follow_many if many else _follow
    size = np.clip(-(-count // 2), _LOT[0] * lanes, _LOT[1] * lanes)
    # Neighbours are alike, and the hard ones would all be in the last lot.
    lots = -(-count // size)
    every = [np.arange(first, count, lots) for first in range(lots)]
    on_all_cores(lambda lot: _follow_lot(program, knee, paths, lot, lanes, give_up, note), every)


def _follow_lot(
    program: Callable[..., tuple[Array, Behind]], knee: Knee, paths: Paths, lot: np.ndarray,
    lanes: int, give_up: int, note: Note,
) -> None:  # fmt: skip
    """Chunk after chunk of some paths, the longest first, so that lanes stay full to the end."""
    place, left = np.zeros(len(lot), int), paths.length[lot]
    behind: Behind = jax.tree.map(lambda x: x[..., lot], paths.behind)
    shapes = shapes_of_record(paths.like.load_cases, knee.patch_count)
    ahead = np.arange(_AHEAD)[:, None] if paths.longest > 1 else np.zeros((1, 1), int)
    room = lanes // (_ROOM if paths.longest > 1 else _ROOM_OF_ONE)
    while left.any():
        waiting = np.count_nonzero(left)
        rows = np.argsort(-left, kind="stable")[: min(lanes, waiting)]
        # Lanes beyond the rows have nothing ahead of them.
        lane = rows[np.minimum(np.arange(lanes), len(rows) - 1)]
        length = np.where(np.arange(lanes) < len(rows), np.minimum(left[lane], _AHEAD), 0)
        at = place[lane] + np.minimum(ahead, np.maximum(length - 1, 0))
        cases = paths.cases(np.broadcast_to(lot[lane], at.shape), at)
        # What is the same everywhere is looked up once.
        cases = np.broadcast_to(cases, (_AHEAD, *cases.shape[1:]))
        # Where others wait, lanes that are through make room for them.
        fewest = room if waiting > len(rows) else 0
        here = jax.tree.map(lambda x, lane=lane: x[..., lane], behind)
        log, after = program(knee, paths.like, cases, length, here, give_up, fewest)
        log = np.asarray(log)
        when, by = np.nonzero(log[:, 0, : len(rows)] >= 0)
        record = of_record(log[when, :, by].T, shapes)
        note(lot[rows[by]], place[rows[by]] + record["place"].astype(int), record)
        place[rows] += np.bincount(by, minlength=len(rows))
        for old, new in zip(jax.tree.leaves(behind), jax.tree.leaves(after), strict=True):
            old[..., rows] = np.asarray(new)[..., : len(rows)]
        left = np.where(behind.failed < give_up, paths.length[lot] - place, 0)


#: Stiffness, as a part of that at the beginning, below which a knee that cannot follow gives way.
_SOFT = 0.1


def freed(variants: Variants, load_cases: LoadCases, before: Equilibria) -> Equilibria:
    """Move balances under flexion alone to another choice of prescribed coordinates.

    Args:
        variants: of one knee.
        load_cases: what is wanted.
        before: balances of the same variants at `load_cases.loaded()`.

    Returns:
        The balances, with what holds them; where `before` has none, there is none. `reached` is the
        part of the way that the knee followed.
    """
    free, knee = load_cases.free, variants.knee
    found = Equilibria.nothing(before.status.shape, load_cases, knee.patch_count, True)
    found.status[:], found.fault[:] = before.status, before.fault
    found.steps[:], found.reached[:] = before.steps, before.reached
    node = np.nonzero(before.converged)
    count = len(node[0])
    if not count:
        return found
    wanted = jax.tree.map(lambda x: np.asarray(x)[node[1]], load_cases.plain())
    numbers = {leaf: x[node[0]] for leaf, x in variants.numbers.items()}
    q, contact_points = (np.moveaxis(x[node], 0, -1) for x in (before.q, before.contact_points))
    names = *wanted.prescribed, *wanted.free
    released = tuple(name for name in wanted.free if name in wanted.loaded().prescribed)
    own, force = _at_rest(knee, numbers, wanted, q, contact_points, released)
    at = dict(zip(names, own, strict=True))
    ends, begins = (
        dataclasses.replace(wanted, supports=tuple(map(Support, forces, released)))
        for forces in (np.zeros_like(force), force)
    )
    begins = dataclasses.replace(
        begins,
        prescribed={name: at[name] for name in wanted.prescribed},
        loads=jax.tree.map(np.asarray, wanted.loaded().loads),
    )
    rows = np.stack([in_rows((numbers, place), 1) for place in (begins, ends)])
    like = Case(*jax.tree.map(lambda x: np.zeros(x.shape[1:]), (numbers, begins)))
    begin = np.stack([at[name] for name in free]), contact_points, np.ones(count, int)
    softness = np.full(count, np.nan)

    def note(path: np.ndarray, place: np.ndarray, record: dict) -> None:
        # The balance that is known is found once more in its new coordinates: how stiff they are.
        at_rest = place == 0
        softness[path[at_rest]] = record["softness"][at_rest]
        over = ~at_rest | (record["status"] >= Status.TOO_DEEP)
        record = {name: x[..., over] for name, x in record.items()}
        record["way"] = np.where(at_rest[over], 0.0, record["way"])
        found.note(tuple(x[path[over]] for x in node), record)

    paths = Paths(like, lambda path, place: rows[place, path], np.full(count, 2), 2,
                  Behind.at(rows[0].T, *begin))  # fmt: skip
    follow_in_chunks(knee, paths, 1, note)
    lost = ~found.converged[node]
    soft = found.softness[node] < _SOFT * softness
    blocked = gives_way(lost, found.reached[node], soft, found.fault[node])
    found.status[node] = np.where(blocked, int(Status.GIVES_WAY), found.status[node])
    return found


def _at_rest(
    knee: Knee, numbers, wanted: LoadCases, q, contact_points, released: tuple[str, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """All coordinates where nodes begin, in the order of prescribed and free ones, and the forces
    that support those to be freed; as many nodes a call as there are lanes."""
    parts, count = [], q.shape[-1]
    for first in range(0, count, LANES):
        rows = np.minimum(np.arange(first, first + LANES), count - 1)
        case = jax.tree.map(lambda x, rows=rows: np.moveaxis(x[rows], 0, -1), (numbers, wanted))
        parts.append(
            _beginning(knee, Case(*case), q[..., rows], contact_points[..., rows], released)
        )
    own, force = (np.concatenate(x, axis=-1)[:, :count] for x in zip(*parts, strict=True))
    return own, force


@compiled(static_argnums=(4,))
def _beginning(knee: Knee, case: Case, q, contact_points, released) -> tuple[Array, Array]:
    before = case.load_cases.loaded()
    state = State.of(before.prescribed, q, case.load_cases.bodies)
    own = state.at((*case.load_cases.prescribed, *case.load_cases.free))
    if not released:
        return own, jnp.zeros((0, q.shape[-1]))
    knees = Case(case.numbers, before).knees(knee)
    return own, force_along(knees, state, contact_points, released)
