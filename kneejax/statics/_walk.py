"""Paths of nodes that predict each other, walked side by side at their own pace.

A node is a variant of a knee at a station. One call of the compiled program takes as many paths as
it has lanes a stretch further. The longest paths go first, so that lanes stay full to the end.
"""

from __future__ import annotations

import dataclasses
import functools
import threading
from collections.abc import Callable

import jax
import numpy as np

from kneejax.statics._paths import Found, Paths
from kneejax.statics._settle import longest_stride_mm
from kneejax.statics._stations import Stations
from kneejax.statics._status import converged
from kneejax.statics._stretch import Memory, Nodes, Reached, first_meeting, walk_stretch
from kneejax.statics._variants import Variants

#: Lanes of a call. Few lanes are soon filled, many share what an operation costs by itself (before
#: lanes went at their own pace a map of 101 x 101 points took 2.2, 1.4, 1.4 and 1.5 s with 32, 64,
#: 96 and 128 lanes, the motion of a single knee 22, 31, 43 and 65 ms).
LANES = 64
#: Nodes of a call in each lane, and lanes that must be busy where others wait.
_STRETCH, _FULL = 32, 32
#: Flexion between stations beyond which distances from the own motion are not extrapolated, rad.
_FAR = np.deg2rad(12.0)


class Walker:
    """Walks paths over variants of one knee.

    Attributes:
        found: what has been found so far.
    """

    def __init__(
        self,
        variants: Variants,
        stations: Stations,
        found: Found,
        report: Callable[[int], None],
    ):
        """Prepare.

        Args:
            variants: of one knee.
            stations: where variants are balanced.
            found: to be filled.
            report: called with the number of nodes that are done.
        """
        self.variants = variants
        self.stations = jax.tree.map(np.asarray, stations)
        self.found, self.report = found, report
        self._count = threading.Lock()
        numbers = [np.reshape(x, (len(stations), -1)) for x in jax.tree.leaves(self.stations)]
        self._marks = np.hstack(numbers)

    def walk(self, paths: Paths, give_up: int, led_to: bool = True) -> None:
        """Walk paths to their ends; the same paths give the same numbers, bit by bit.

        Args:
            paths: any number.
            give_up: lost nodes in a row after which the rest of a path is left alone.
            led_to: whether paths begin near a balance. Otherwise nodes are passed over until a
                short search balances one: a long search from afar, where the knee may have no
                balance at all, ends on another branch, and the rest of the path would follow.
        """
        place, left = np.zeros(len(paths), int), paths.length.copy()
        memory = _nothing_behind(self._met(paths), led_to)
        while left.any():
            rows = np.argsort(-left, kind="stable")[: min(LANES, np.count_nonzero(left))]
            # Where others wait, lanes that are through make room for them.
            fewest = _FULL if np.count_nonzero(left) > len(rows) else 0
            reached = self._stretch(paths, rows, place[rows], memory, give_up, fewest)
            ended = self._note(paths, rows, place[rows], reached)
            place[rows] += ended
            left = np.where(memory.lost < give_up, paths.length - place, 0)
            with self._count:
                self.report(int(ended.sum()))

    def _stretch(self, paths: Paths, rows, place, memory: Memory, give_up, fewest) -> Reached:
        """Walk some paths for a stretch; keeps their memory."""
        # Lanes beyond the rows have nothing ahead of them.
        lane = np.minimum(np.arange(LANES), len(rows) - 1)
        row, at = rows[lane], place[lane]
        ahead = np.minimum(paths.length[row] - at, _STRETCH)
        along = at + np.minimum(np.arange(_STRETCH)[:, None], ahead - 1)
        variant, station = paths.variant[row, along], paths.station[row, along]
        even, reach = self._strides(paths, row, along)
        nodes = Nodes(
            numbers={leaf: x[variant] for leaf, x in self.variants.numbers.items()},
            stations=jax.tree.map(lambda x: x[station], self.stations),
            q=self.found.own[0][station],
            meeting=self.found.own[1][station],
            even=even,
            reach=reach,
            length=np.where(np.arange(LANES) < len(rows), ahead, 0),
        )
        behind = jax.tree.map(lambda x: x[..., row], memory)
        reached, behind = walk_stretch(self.variants.knee, nodes, behind, give_up, fewest)
        for old, new in zip(jax.tree.leaves(memory), jax.tree.leaves(behind), strict=True):
            old[..., rows] = np.asarray(new)[..., : len(rows)]
        return jax.tree.map(lambda x: np.asarray(x)[..., : len(rows)], reached)

    def _met(self, paths: Paths) -> Paths:
        """With meeting points of all first nodes."""
        meeting = paths.meeting.copy()
        unknown = np.flatnonzero(np.isnan(meeting).any(axis=(1, 2)))
        for first in range(0, len(unknown), LANES):
            some = unknown[first : first + LANES]
            rows = some[np.minimum(np.arange(LANES), len(some) - 1)]
            variant, station = paths.variant[rows, 0], paths.station[rows, 0]
            found = first_meeting(
                self.variants.knee,
                {leaf: x[variant] for leaf, x in self.variants.numbers.items()},
                jax.tree.map(lambda x, station=station: x[station], self.stations),
                self.found.own[0][station] + paths.q[rows],
            )
            found = np.moveaxis(np.asarray(found), -1, 0) - self.found.own[1][station]
            meeting[some] = found[: len(some)]
        return dataclasses.replace(paths, meeting=meeting)

    def _note(self, paths: Paths, rows, place, reached: Reached) -> np.ndarray:
        """Write down what was reached; how many nodes of each row ended."""
        ended, known = reached.place >= 0, converged(reached.status)
        for which in (ended & known, ended):
            when, lane = np.nonzero(which)
            along = place[lane] + reached.place[when, lane]
            node = paths.variant[rows[lane], along], paths.station[rows[lane], along]
            if which is not ended:
                self.found.q[node] = reached.q[when, :, lane]
                self.found.meeting[node] = reached.meeting[when, :, :, lane]
        self.found.status[node] = reached.status[when, lane]
        self.found.steps[node] += reached.steps[when, lane]
        return ended.sum(axis=0)

    def reach(self, here: np.ndarray, there: np.ndarray) -> np.ndarray:
        """How far the distance from the own motion may change between stations, mm.
        Where they are far apart or loaded differently nothing is known."""
        stride = self._marks[here] - self._marks[there]
        size = np.abs(stride[..., 0])
        alike = np.abs(stride[..., 1:]).max(axis=-1) <= 1e-6 * size
        near = (size <= _FAR) & (size > 0) & alike
        return np.where(near, longest_stride_mm(np.rad2deg(size)), np.inf)

    @functools.cached_property
    def segments(self) -> list[np.ndarray]:
        """Stations that follow each other in short strides under the same loads."""
        count = len(self._marks)
        far = np.isinf(self.reach(np.arange(1, count), np.arange(count - 1)))
        return np.split(np.arange(count), np.flatnonzero(far) + 1)

    def _strides(self, paths: Paths, row: np.ndarray, place: np.ndarray):
        """Whether a path's last two strides and the next one are alike and short, and how far from
        the own motion the next one may lead."""
        here, last, before = (
            np.where(place < k, paths.origin[row], paths.station[row, np.maximum(place - k, 0)])
            for k in (0, 1, 2)
        )
        stride = self._marks[here] - self._marks[last]
        former = self._marks[last] - self._marks[before]
        size = np.abs(stride).max(axis=-1)
        alike = np.abs(stride - former).max(axis=-1) <= 1e-6 * size
        short = np.abs(stride[..., 0]) <= _FAR
        return (alike | (place < 2)) & short, self.reach(here, last)


def _nothing_behind(paths: Paths, led_to: bool) -> Memory:
    """Of paths at their beginning."""
    count = len(paths)
    q, meeting = np.moveaxis(paths.q, 0, -1), np.moveaxis(paths.meeting, 0, -1)
    return Memory(
        away_q=np.repeat(q[None], 3, axis=0),
        away_meeting=np.repeat(meeting[None], 3, axis=0),
        known=np.zeros(count, int),
        lost=np.zeros(count, int),
        led=np.full(count, led_to),
        # Paths that do not begin at their own first station begin at a balance beside it.
        begun=paths.origin != paths.station[:, :1].reshape(-1),
        wary=np.zeros(count, bool),
        tangent=np.zeros((5, 5, count)),
        steps=np.zeros(count, int),
    )
