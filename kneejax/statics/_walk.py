"""Paths of nodes that predict each other, walked side by side at their own pace.

A node is a variant of a knee at a station. One call of the compiled step takes a node of as many
paths as it has lanes. A path that has balanced queues for its next node, so none waits for the
slowest; a node that a few steps do not balance is set aside and searched again, with patience, when
nothing else is left.
"""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from kneejax.mechanics import Knee
from kneejax.statics._compiled import compiled
from kneejax.statics._newton import EnergyNewton, Guess
from kneejax.statics._settle import search_one
from kneejax.statics._stations import Stations
from kneejax.statics._status import Status

#: A function `(knee, value) -> knee` of the same structure; hashable, since it steers compiling.
Vary = Callable[[Knee, Any], Knee]

#: Lanes of a call: what a step needs stays in the processor's cache (benchmarks/batch.py).
LANES = 128
#: Of a node that is predicted, and of one that was lost: Newton steps, and the part of all lanes
#: that must ask before tangents are computed anew.
_QUICK, _PATIENT = (5, 0.1), (40, 0.0)
#: Quick calls in which a node may go on from where the last one left it.
_GOES_ON = 2
#: Flexion between stations beyond which distances from the own motion are not extrapolated, rad.
_FAR = np.deg2rad(12.0)
_ACCURACY_MM = 1e-7


def in_lanes(knee: Knee, vary: Vary, values: Any) -> Knee:
    """The knee with a lane for each value; numbers that do not vary have one lane for all.

    Args:
        knee: without a lane axis.
        vary: see `Vary`.
        values: leaves begin with the lane.

    Returns:
        A knee whose leaves end in lanes.
    """
    knee = jax.tree.map(jnp.asarray, knee)
    one = vary(knee, jax.tree.map(lambda x: x[0], values))
    # A number that `vary` leaves alone is handed through as the very same array.
    still = jax.tree.map(lambda old, new: old is new, knee, one)
    axes = jax.tree.map(lambda same: None if same else -1, still)
    lanes = jax.vmap(vary, in_axes=(None, 0), out_axes=axes)(knee, values)
    return jax.tree.map(lambda x, same: x[..., None] if same else x, lanes, still)


@compiled(static_argnums=(0,))
def _step(vary: Vary, knee: Knee, values, stations: Stations, guess: Guess, patience):
    """One node in each lane."""
    lanes = stations.load(in_lanes(knee, vary, values))
    most_steps, least_share = patience
    search = EnergyNewton(atol=_ACCURACY_MM, most_steps=most_steps, least_share=least_share)
    reached, rest = search_one(lanes, stations.flexion, guess, search)
    return reached.q, reached.meeting, rest["tangent"], rest["status"], rest["steps"]


@dataclasses.dataclass(frozen=True)
class Found:
    """What is known of every variant at every station, filled in place; arrays begin with both."""

    q: np.ndarray
    meeting: np.ndarray
    status: np.ndarray
    steps: np.ndarray

    @classmethod
    def nothing(cls, knee: Knee, variants: int, stations: int) -> Found:
        """Nothing known yet: every node counts as not balanced."""
        size = (variants, stations)
        return cls(
            np.full((*size, 5), np.nan),
            np.full((*size, knee.patch_count, 2), np.nan),
            np.full(size, int(Status.NOT_CONVERGED), np.int8),
            np.zeros(size, np.int32),
        )

    @property
    def known(self) -> np.ndarray:
        """Where forces balance, `(variants, stations)`."""
        return self.status < Status.TOO_DEEP


@dataclasses.dataclass(frozen=True)
class Paths:
    """Rows of nodes; all arrays begin with the path.

    Attributes:
        variant: of each node, `(paths, nodes)`.
        station: of each node, `(paths, nodes)`.
        length: nodes of each path, the others are not walked, `(paths,)`.
        q: how far the first node is expected from the own motion, `(paths, 5)`.
        meeting: likewise, `(paths, n, 2)`; NaN where it is not known.
    """

    variant: np.ndarray
    station: np.ndarray
    length: np.ndarray
    q: np.ndarray
    meeting: np.ndarray

    def __len__(self) -> int:
        return len(self.length)

    def take(self, rows) -> Paths:
        """Some of the paths."""
        return Paths(*(getattr(self, f.name)[rows] for f in dataclasses.fields(self)))


class Walker:
    """Walks paths over variants of one knee.

    Attributes:
        found: what has been found so far.
    """

    def __init__(
        self,
        knee: Knee,
        vary: Vary,
        values: Any,
        stations: Stations,
        own: tuple[np.ndarray, np.ndarray],
        found: Found,
        report: Callable[[int], None],
    ):
        """Prepare.

        Args:
            knee: gives all numbers that do not vary.
            vary: see `Vary`.
            values: leaves begin with the variant.
            stations: where variants are balanced.
            own: coordinates `(stations, 5)` and meeting points `(stations, n, 2)` of the motion
                from which distances are predicted.
            found: to be filled.
            report: called with the number of nodes that are done.
        """
        self.knee, self.vary, self.own = knee, vary, own
        self.values = jax.tree.map(np.asarray, values)
        self.stations = jax.tree.map(np.asarray, stations)
        self.found, self.report = found, report
        self._count = threading.Lock()
        numbers = [np.reshape(x, (len(stations), -1)) for x in jax.tree.leaves(self.stations)]
        self._marks = np.hstack(numbers)

    def walk(self, paths: Paths, give_up: int) -> None:
        """Walk paths to their ends; the same paths give the same numbers, bit by bit.

        Args:
            paths: any number.
            give_up: lost nodes in a row after which the rest of a path is left alone.
        """
        count = len(paths)
        place, lost = np.zeros(count, int), np.zeros(count, int)
        patient, known = np.zeros(count, bool), np.zeros(count, int)
        # Distances from the own motion at the last three nodes, the latest first.
        away_q = np.repeat(paths.q[None], 3, axis=0)
        away_meeting = np.repeat(paths.meeting[None], 3, axis=0)
        tangent = np.zeros((count, 5, 5))
        # What a call left unfinished: how often, and where.
        begun, left_q, left_meeting = np.zeros(count, int), paths.q.copy(), paths.meeting.copy()
        while True:
            waiting = np.flatnonzero(place < paths.length)
            if not len(waiting):
                return
            quick, aside = waiting[~patient[waiting]], waiting[patient[waiting]]
            # Patience first where a call would not be full: who is found walks on with the others.
            patiently = len(quick) < LANES and len(aside) > 0
            rows = aside if patiently else quick[np.argsort(place[quick], kind="stable")]
            rows = rows[:LANES]
            here = paths.variant[rows, place[rows]], paths.station[rows, place[rows]]
            # What was lost may have been led astray by its prediction.
            ahead = self._even(paths, rows, place[rows]) & ~patient[rows]
            trusted = np.where(ahead, known[rows], 0)
            guess = [
                np.where(
                    (begun[rows] > 0).reshape(-1, *(1,) * (own.ndim - 1)),
                    left[rows],
                    own[here[1]] + _extrapolated(away[:, rows], trusted),
                )
                for left, own, away in zip(
                    (left_q, left_meeting), self.own, (away_q, away_meeting), strict=True
                )
            ]
            q, meeting, stiffness, status, steps = self._call(
                *here, (*guess, tangent[rows]), patiently
            )
            good = status < Status.TOO_DEEP
            self.found.steps[here] += steps
            won, nodes = rows[good], (here[0][good], here[1][good])
            self.found.q[nodes], self.found.meeting[nodes] = q[good], meeting[good]
            away_q[:, won] = np.stack([q[good] - self.own[0][nodes[1]], *away_q[:2, won]])
            away_meeting[:, won] = np.stack(
                [meeting[good] - self.own[1][nodes[1]], *away_meeting[:2, won]]
            )
            tangent[won] = stiffness[good]
            known[won], lost[won], patient[won], begun[won] = known[won] + 1, 0, False, 0
            gone = ~good & patient[rows]
            more = ~good & ~gone & (begun[rows] < _GOES_ON) & np.isfinite(q).all(axis=1)
            left_q[rows[more]], left_meeting[rows[more]] = q[more], meeting[more]
            tangent[rows[more]] = stiffness[more]
            begun[rows[more]] += 1
            set_aside = ~good & ~gone & ~more
            begun[rows[set_aside]], tangent[rows[set_aside]] = 0, 0.0
            patient[rows[set_aside]], patient[rows[gone]] = True, False
            known[rows[gone]] = 0
            lost[rows[gone]] += 1
            ended = good | gone
            self.found.status[here[0][ended], here[1][ended]] = status[ended]
            place[rows[ended]] += 1
            place[lost >= give_up] = paths.length[lost >= give_up]
            with self._count:
                self.report(int(ended.sum()))

    def _even(self, paths: Paths, rows: np.ndarray, place: np.ndarray) -> np.ndarray:
        """Whether a path's last two strides and the next one are alike, and short."""
        last, before = (paths.station[rows, np.maximum(place - k, 0)] for k in (1, 2))
        here = self._marks[paths.station[rows, place]]
        stride, former = here - self._marks[last], self._marks[last] - self._marks[before]
        size = np.abs(stride).max(axis=1)
        alike = np.abs(stride - former).max(axis=1) <= 1e-6 * size
        return (alike | (place < 2)) & (np.abs(stride[:, 0]) <= _FAR)

    def _call(self, variant, station, guess, patiently: bool):
        """One node in each lane; a short row is filled up with its own nodes."""
        size = len(variant)
        full = np.resize(np.arange(size), LANES)
        q, meeting, tangent = (np.moveaxis(x[full], 0, -1) for x in guess)
        found = _step(
            self.vary,
            self.knee,
            jax.tree.map(lambda x: x[variant[full]], self.values),
            jax.tree.map(lambda x: x[station[full]], self.stations),
            Guess(q, meeting, tangent),
            _PATIENT if patiently else _QUICK,
        )
        return (np.moveaxis(np.asarray(x), -1, 0)[:size] for x in found)


def _extrapolated(away: np.ndarray, known: np.ndarray) -> np.ndarray:
    """The next distance: a parabola through three nodes, a line through two, or the last."""
    last, before, first = away
    known = known.reshape(-1, *(1,) * (last.ndim - 1))
    ahead = np.where(known > 2, 2 * last - 3 * before + first, last - before)
    return last + np.where(known > 1, ahead, 0.0)
