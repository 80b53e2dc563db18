"""Many instants of one movement: some are walked to, the others found between them.

An instant lies near its neighbours in time, so only every so many are walked to from the reference
pose, each on its own route. The others are sought where their neighbours in time say, half-way
first; what is not found there is walked to.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from scipy.interpolate import PchipInterpolator

from kneejax.experiments._motion import Motion, again, itself
from kneejax.geometry import COORDINATES, FREE_COORDINATES, free_of, scales, table_units
from kneejax.mechanics import Knee
from kneejax.statics import Balances, Stations, converged, own_motion, own_motion_near, settled_of

#: Instants that are walked to, at least: those of a cycle of gait, 4 % apart.
_ANCHORS = 25
#: A balance farther from where its neighbours say is walked to, mm (rotations at 30 mm).
_MISSED_MM = 2.0
#: Muscles are lines towards a tibia that moves a little under them: balances are found anew until
#: what acts changes by less, N (moments at 30 mm), or so often.
SAME_N, _MOST_ROUNDS = 0.5, 10
#: What a wrench is counted by: moments at 30 mm.
_PER_N = np.repeat([1.0, 30.0], 3)
#: Fields of a balance from which a search begins.
_GUESSED = "q", "meeting", "tangent"
#: Degrees and mm of the tibia's free coordinates that count 1 mm.
_PER_MM = np.array(scales(FREE_COORDINATES)) * table_units(FREE_COORDINATES)
#: Part of a change that a step takes.
_SHARES = 0.1, 2.0
#: What is left of a step that led nowhere.
_SHORTER = 0.3

#: What acts on the tibia at some instants, where it is given (degrees and mm): `(rows, 6)` both.
Acting = Callable[[np.ndarray, np.ndarray], np.ndarray]
#: Stations of some instants under what acts there.
At = Callable[[np.ndarray, np.ndarray], Stations]


@dataclasses.dataclass
class Instants:
    """Balances of instants, as far as they are known.

    Attributes:
        knee: that balances.
        flexion: prescribed, `(n,)`, degrees.
        acting: see `Acting`.
        at: see `At`.
        total: what acts, `(n, 6)`.
        moved: by how much it changed when it was last asked for, `(n,)`, N (moments at 30 mm).
        nodes: fields of the balances, arrays begin with the instant.
        reached: as in `Motion`.
        rounds: how often what acts was asked for at the balances themselves.
    """

    knee: Knee
    flexion: np.ndarray
    acting: Acting
    at: At
    total: np.ndarray
    moved: np.ndarray
    nodes: dict[str, np.ndarray]
    reached: np.ndarray
    rounds: int = 0

    @classmethod
    def of(cls, knee: Knee, flexion: np.ndarray, acting: Acting, at: At, guess: np.ndarray):
        """Find them all.

        Args:
            knee: without a lane axis, its numbers known.
            flexion: as in the attributes; likewise `acting` and `at`.
            guess: where the tibia roughly is, `(n, 6)`, degrees and mm, for the lines of muscles.
        """
        count = len(flexion)
        every = np.arange(count)
        total = acting(every, guess)
        moved = np.full(count, np.inf)
        found = cls(knee, flexion, acting, at, total, moved, {}, np.full(count, np.nan))
        anchors = np.unique(np.linspace(0, count - 1, min(count, _ANCHORS)).round().astype(int))
        found._walk(anchors)
        found._repeat(anchors)
        found._between(anchors)
        found._repeat(every)
        found._in_time(1)
        found._in_time(-1)
        lost = every[~found._known(every)]
        if len(lost):
            found._walk(lost)
            found._repeat(lost)
        return found

    @property
    def poses(self) -> np.ndarray:
        """Of the tibia, `(n, 6)`, degrees and mm; NaN where there is no balance."""
        return self.poses_of(np.arange(len(self.flexion)))

    def poses_of(self, rows: np.ndarray) -> np.ndarray:
        """Of the tibia at some instants, likewise."""
        return self.tibia(rows, self.nodes["q"][rows])

    def motion(self, knee: Knee) -> Motion:
        """All of them as one motion of a knee of equal numbers, of which derivatives are asked."""
        stations = self.at(np.arange(len(self.flexion)), self.total).of(knee)
        nodes = {name: np.moveaxis(x, 0, -1) for name, x in self.nodes.items()}
        settled = settled_of(stations, nodes)
        return again(knee, stations, settled, jnp.asarray(self.reached))

    def tibia(self, rows: np.ndarray, q: np.ndarray) -> np.ndarray:
        """Where the tibia is at some instants with given free coordinates, `(rows, free)`."""
        free = free_of(["flexion"], self.knee.bodies)
        places = [free.index(name) for name in COORDINATES if name != "flexion"]
        own = q * table_units(free)
        return np.concatenate([self.flexion[rows, None], own[:, places]], axis=1)

    def _known(self, rows: np.ndarray) -> np.ndarray:
        return converged(self.nodes["status"][rows])

    def _walk(self, rows: np.ndarray) -> None:
        """Walk to some instants, each on its own route."""
        stations = self.at(rows, self.total[rows])
        self._take(rows, own_motion(self.knee, itself, np.zeros(()), stations))

    def _near(self, rows: np.ndarray, begin: list[np.ndarray]) -> np.ndarray:
        """Find some near where they are expected; how far from there they lie, mm."""
        stations = self.at(rows, self.total[rows]).of(self.knee)
        found = own_motion_near(self.knee, itself, np.zeros(()), stations, *begin)
        self._take(rows, found)
        return self._away(found, begin[0], stations)

    def _away(self, found: Balances, q: np.ndarray, stations: Stations) -> np.ndarray:
        """How far balances lie from where they were expected, mm; infinite where there is none."""
        away = (np.abs(found.q[0] - q) / np.array(scales(stations.free))).max(axis=1)
        return np.where(found.converged[0] & np.isfinite(away), away, np.inf)

    def _take(self, rows: np.ndarray, found: Balances) -> None:
        """Write down what was found."""
        every = found.in_nodes()
        for name, values in every.items():
            if name not in self.nodes:
                shape = len(self.flexion), *values.shape[1:]
                dtype = values.dtype
                self.nodes[name] = np.full(shape, 0 if dtype.kind in "biu" else np.nan, dtype)
            self.nodes[name][rows] = values
        self.reached[rows] = found.reached[0]

    def _repeat(self, rows: np.ndarray) -> None:
        """Ask what acts at the balances themselves, until it no longer changes.

        Each step is as long as the last two say (Aitken's relaxation of a fixed point).
        """
        rows = rows[self._known(rows)]
        share, last = np.ones(len(self.flexion)), np.full(self.total.shape, np.nan)
        for _ in range(_MOST_ROUNDS):
            if not len(rows):
                return
            asked = self.acting(rows, self.tibia(rows, self.nodes["q"][rows]))
            change = (asked - self.total[rows]) / _PER_N
            self.moved[rows] = np.abs(change).max(axis=1)
            going = self.moved[rows] > SAME_N
            rows, change = rows[going], change[going]
            if not len(rows):
                return
            share[rows] = _relaxed(share[rows], change, last[rows])
            last[rows] = change
            before = self._kept(rows)
            self.total[rows] += share[rows, None] * change * _PER_N
            self.rounds += 1
            self._near(rows, [self.nodes[x][rows] for x in _GUESSED])
            lost = ~self._known(rows)
            if lost.any():  # Too long a step: from where it began, a shorter one.
                self._put_back(rows[lost], before, lost)
                share[rows[lost]] *= _SHORTER
                last[rows[lost]] = np.nan

    def _between(self, known: np.ndarray) -> None:
        """Find what lies between instants that are known, half-way first."""
        while len(known) < len(self.flexion):
            first, last = known[:-1], known[1:]
            apart = last - first > 1
            rows = (first[apart] + last[apart]) // 2
            begin = [self._expected(rows, known, x) for x in _GUESSED]
            lost = np.isnan(begin[0]).any(axis=1)
            if lost.any():
                self._walk(rows)
            else:
                self.total[rows] = self.acting(rows, self.tibia(rows, begin[0]))
                self._near(rows, begin)
            known = np.sort(np.r_[known, rows])

    def _expected(self, rows: np.ndarray, known: np.ndarray, name: str) -> np.ndarray:
        """A field at some instants, as the nearest known ones on both sides tell."""
        good = known[self._known(known)]
        if not len(good):
            return np.full((len(rows), *self.nodes[name].shape[1:]), np.nan)
        if len(good) == 1:
            return np.repeat(self.nodes[name][good], len(rows), axis=0)
        return PchipInterpolator(good, self.nodes[name][good], axis=0)(rows)

    def _in_time(self, way: int) -> None:
        """Where an instant lies far from the one before, or has no balance: begin at that one.

        A knee that may be in balance in two ways stays on the one that it is on.

        Args:
            way: 1 from the first on; -1 from the last backwards, where there is no balance only.
        """
        poses = self.poses / np.r_[1.0, _PER_MM]
        for row in range(len(self.flexion))[::way][1:]:
            here, last = np.array([row]), np.array([row - way])
            known = not np.isnan(poses[row, 1])
            near = np.abs(poses[row, 1:] - poses[row - way, 1:]).max() <= _MISSED_MM
            if near or np.isnan(poses[row - way, 1]) or (way < 0 and known):
                continue
            before = self._kept(here)
            begin = [self.nodes[x][last] for x in _GUESSED]
            self.total[row] = self.acting(here, self.tibia(here, begin[0]))
            if self._near(here, begin)[0] <= _MISSED_MM:
                self._repeat(here)
            found = self.poses_of(here)[0] / np.r_[1.0, _PER_MM]
            if np.abs(found[1:] - poses[row - way, 1:]).max() <= _MISSED_MM:
                poses[row] = found
            else:
                self._put_back(here, before, np.array([True]))

    def _kept(self, rows: np.ndarray) -> list[np.ndarray]:
        """All that is known of some instants."""
        return [x[rows].copy() for x in self._every()]

    def _put_back(self, rows: np.ndarray, kept: list[np.ndarray], some: np.ndarray) -> None:
        for values, old in zip(self._every(), kept, strict=True):
            values[rows] = old[some]

    def _every(self) -> list[np.ndarray]:
        return [*self.nodes.values(), self.total, self.moved, self.reached]


def _relaxed(share: np.ndarray, change: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Part of a change to take, from the one before and what came of it, `(rows,)`."""
    turn = change - last
    size = np.sum(turn**2, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        found = -share * np.sum(last * turn, axis=1) / size
    return np.where(size > 0, np.clip(found, *_SHARES), share)
