"""Paths of nodes that predict each other, walked side by side at their own pace.

A node is a variant of a knee at a station. One call of the compiled program takes as many paths as
it has lanes a stretch further. The longest paths go first, so that lanes stay full to the end.
"""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Callable

import jax
import numpy as np

from kneejax.statics._status import converged
from kneejax.statics.walk._paths import Found, Paths
from kneejax.statics.walk._places import (
    Memory,
    Nodes,
    Place,
    Reached,
    in_rows,
    packed,
    unpacked,
)
from kneejax.statics.walk._routes import longest_stride_mm
from kneejax.statics.walk._stations import Stations
from kneejax.statics.walk._stretch import first_meeting, walk_stretch
from kneejax.statics.walk._variants import Variants

#: Lanes of a call. Few lanes are soon filled, many share what an operation costs by itself
#: (docs/performance.md). Over points a lane by itself fills the processor.
LANES, LANES_OVER_POINTS = 64, 8
#: Nodes of a call in each lane.
_STRETCH = 32
#: Lanes for each one that a call leaves on its way, where others wait; of paths of one node.
_ROOM, _ROOM_OF_ONE = 2, 8
#: Flexion between stations beyond which distances from the own motion are not extrapolated, rad.
_FAR = np.deg2rad(12.0)


class Walker:
    """Walks paths over variants of one knee.

    Attributes:
        found: what has been found so far.
        lanes: of a call of the compiled program.
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
        self.found, self.report = found, report
        over_points = variants.knee.patch_count < len(variants.knee.contacts)
        self.lanes = LANES_OVER_POINTS if over_points else LANES
        self._count = threading.Lock()
        stations = jax.tree.map(np.asarray, stations)
        self._marks = in_rows(stations, 1)
        self._rows = variants.in_rows(), in_rows((stations, *found.own), 1)
        some = variants.at(0), *jax.tree.map(lambda x: x[0], (stations, *found.own))
        self._like = Place(*some)
        turn = Reached.like(found.q.shape[2], found.meeting.shape[2])
        # What holds balances stands at the end, and most never ask for it.
        self._turn = turn if found.holding is not None else dataclasses.replace(turn, holding={})
        self._logged = len(in_rows(self._turn, 0))

    def walk(self, paths: Paths, give_up: int) -> None:
        """Walk paths to their ends; the same paths give the same numbers, bit by bit.

        Args:
            paths: any number.
            give_up: lost nodes in a row after which the rest of a path is left alone.
        """
        place, left = np.zeros(len(paths), int), paths.length.copy()
        memory = self._nothing_behind(self._met(paths))
        # What has no end of its path in sight begins its node anew; a path of one node all of it.
        share = _ROOM if paths.station.shape[1] > 1 else _ROOM_OF_ONE
        while left.any():
            rows = np.argsort(-left, kind="stable")[: min(self.lanes, np.count_nonzero(left))]
            # Where others wait, lanes that are through make room for them.
            fewest = self.lanes // share if np.count_nonzero(left) > len(rows) else 0
            log, behind = self._stretch(paths, rows, place[rows], memory, give_up, fewest)
            ended = self._note(paths, rows, place[rows], np.asarray(log)[..., : len(rows)])
            place[rows] += ended
            left = paths.length - place
            if left.any():
                memory[:, rows] = np.asarray(behind)[:, : len(rows)]
                lost = memory[0]
                left = np.where(lost < give_up, left, 0)
            with self._count:
                self.report(int(ended.sum()))

    def _stretch(self, paths: Paths, rows, place, memory: np.ndarray, give_up, fewest):
        """Walk some paths for a stretch: what became of its nodes, and what is remembered, both
        packed."""
        # Lanes beyond the rows have nothing ahead of them.
        lane = np.minimum(np.arange(self.lanes), len(rows) - 1)
        row, at = rows[lane], place[lane]
        ahead = np.minimum(paths.length[row] - at, _STRETCH)
        along = at + np.minimum(np.arange(_STRETCH)[:, None], ahead - 1)
        if paths.station.shape[1] == 1:
            # All places are the same, and are looked up once.
            along = along[:1]
        variant, station = paths.variant[row, along], paths.station[row, along]
        every = self._places(variant, station), *self._strides(paths, row, along)
        places, even, reach, loading = (
            np.broadcast_to(x, (_STRETCH, *x.shape[1:])) if len(x) == 1 else x for x in every
        )
        nodes = Nodes(
            self._like,
            places,
            even,
            reach,
            loading,
            first=at.astype(float),
            length=np.where(np.arange(self.lanes) < len(rows), ahead, 0),
        )
        return walk_stretch(self.variants.knee, nodes, memory[:, row], give_up, fewest)

    def _places(self, variant: np.ndarray, station: np.ndarray) -> np.ndarray:
        """Numbers of variants, of the knee itself where they are negative, of stations and of the
        own motion there, in rows."""
        numbers, stations = self._rows
        return np.concatenate([numbers[variant], stations[station]], axis=-1)

    def _met(self, paths: Paths) -> Paths:
        """With meeting points of all first nodes."""
        meeting = paths.meeting.copy()
        unknown = np.flatnonzero(np.isnan(meeting).any(axis=(1, 2)))
        for first in range(0, len(unknown), self.lanes):
            some = unknown[first : first + self.lanes]
            rows = some[np.minimum(np.arange(self.lanes), len(some) - 1)]
            variant, station = paths.variant[rows, 0], paths.station[rows, 0]
            here = self._places(variant, station).T
            found = first_meeting(self.variants.knee, self._like, here, paths.q[rows].T)
            meeting[some] = np.moveaxis(np.asarray(found), -1, 0)[: len(some)]
        return dataclasses.replace(paths, meeting=meeting)

    def _note(self, paths: Paths, rows, place, log: np.ndarray) -> np.ndarray:
        """Write down what was reached; how many nodes of each row ended."""
        ended = log[:, 0] >= 0
        when, lane = np.nonzero(ended)
        reached = unpacked(log[when, : self._logged, lane].T, self._turn)
        along = place[lane] + reached.place
        node = paths.variant[rows[lane], along], paths.station[rows[lane], along]
        known = converged(reached.status)
        good = node[0][known], node[1][known]
        self.found.q[good] = np.moveaxis(reached.q, -1, 0)[known]
        self.found.meeting[good] = np.moveaxis(reached.meeting, -1, 0)[known]
        self.found.status[node] = reached.status
        self.found.steps[node] += reached.steps
        self.found.fault[node] = reached.fault
        self.found.softness[node] = reached.softness
        if self.found.holding is not None:
            for name, values in reached.holding.items():
                there = np.moveaxis(values, -1, 0)
                if name not in self.found.holding:
                    every = np.full((*self.found.status.shape, *there.shape[1:]), np.nan)
                    self.found.holding.setdefault(name, every)
                self.found.holding[name][node] = there
        # How far along the stride to a node the last balance was.
        self.found.share[node] = np.clip(reached.way - along, 0.0, 1.0)
        return ended.sum(axis=0)

    def _strides(self, paths: Paths, row: np.ndarray, place: np.ndarray):
        """Whether a path's last two strides and the next one are alike and short; how far from the
        own motion the next one may lead, mm; and whether loads change on the way."""
        here, last, before = (
            np.where(place < k, paths.origin[row], paths.station[row, np.maximum(place - k, 0)])
            for k in (0, 1, 2)
        )
        if np.array_equal(here, last) and np.array_equal(last, before):
            # Along values, at one station, nothing is known.
            still = np.zeros(place.shape, bool)
            return ~still, np.full(place.shape, np.inf), still
        stride = self._marks[here] - self._marks[last]
        former = self._marks[last] - self._marks[before]
        size = np.abs(stride).max(axis=-1)
        alike = np.abs(stride - former).max(axis=-1) <= 1e-6 * size
        bend, loads = np.abs(stride[..., 0]), np.abs(stride[..., 1:]).max(axis=-1)
        reach = np.where(bend > 0, longest_stride_mm(np.rad2deg(bend)), np.inf)
        return (alike | (place < 2)) & (bend <= _FAR), reach, loads > 0

    def _nothing_behind(self, paths: Paths) -> np.ndarray:
        """The memory of paths at their beginning, packed."""
        count, first = len(paths), paths.station[:, :1].reshape(-1)
        q, meeting = np.moveaxis(paths.q, 0, -1), np.moveaxis(paths.meeting, 0, -1)
        source = paths.variant[:, :1].reshape(-1)
        behind = Memory(
            lost=np.zeros(count, int),
            away_q=np.repeat(q[None], 3, axis=0),
            away_meeting=np.repeat(meeting[None], 3, axis=0),
            when=np.zeros((3, count)),
            last=self._places(paths.source, paths.origin).T,
            known=np.zeros(count, int),
            # Paths that do not begin at their own first station begin at a balance beside it.
            begun=paths.origin != first,
            based=(paths.origin != first) | (paths.source != source),
            wary=np.zeros(count, bool),
            aim=np.ones(count),
            softness=np.full(count, np.inf),
            steps=np.zeros(count, int),
        )
        return packed(behind)
