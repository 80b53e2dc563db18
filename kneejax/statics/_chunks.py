"""Many paths in chunks of one width, on all cores, in bounded memory.

So fits, maps and cohorts of any size share one compiled program. Answers depend neither on the
number of cores nor on who was first.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np

from kneejax.mechanics import Knee
from kneejax.numerics import on_all_cores
from kneejax.statics._continuation import Behind, follow
from kneejax.statics._equilibria import of_record, shapes_of_record
from kneejax.statics._variants import Case

#: Paths side by side. Few are soon filled, many share what an operation costs by itself
#: (docs/performance.md). Over points one path by itself fills the processor.
LANES, LANES_OVER_POINTS = 64, 8
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
    lanes = LANES_OVER_POINTS if knee.patch_count < len(knee.contacts) else LANES
    size = np.clip(-(-count // 2), _LOT[0] * lanes, _LOT[1] * lanes)
    # Neighbours are alike, and the hard ones would all be in the last lot.
    lots = -(-count // size)
    every = [np.arange(first, count, lots) for first in range(lots)]
    on_all_cores(lambda lot: _follow_lot(knee, paths, lot, lanes, give_up, note), every)


def _follow_lot(
    knee: Knee, paths: Paths, lot: np.ndarray, lanes: int, give_up: int, note: Note
) -> None:
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
        log, after = follow(knee, paths.like, cases, length, here, give_up, fewest)
        log = np.asarray(log)
        when, by = np.nonzero(log[:, 0, : len(rows)] >= 0)
        record = of_record(log[when, :, by].T, shapes)
        note(lot[rows[by]], place[rows[by]] + record["place"].astype(int), record)
        place[rows] += np.bincount(by, minlength=len(rows))
        for old, new in zip(jax.tree.leaves(behind), jax.tree.leaves(after), strict=True):
            old[..., rows] = np.asarray(new)[..., : len(rows)]
        left = np.where(behind.failed < give_up, paths.length[lot] - place, 0)
