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
#: Newton steps of a node that is predicted, and of one that was lost.
_QUICK, _PATIENT = 8, 40
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
    search = EnergyNewton(atol=_ACCURACY_MM, most_steps=patience, least_share=0.1)
    q, meeting, rest = search_one(lanes, stations.flexion, guess, search)
    return q, meeting, rest["tangent"], rest["status"], rest["steps"]


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
        while True:
            waiting = np.flatnonzero(place < paths.length)
            if not len(waiting):
                return
            lost_ones = patient[waiting]
            quick = waiting[~lost_ones]
            # Patience first where a call would not be full: who is found walks on with the others.
            patiently = len(quick) < LANES and bool(lost_ones.any())
            rows = waiting[lost_ones] if patiently else quick
            rows = rows[np.argsort(place[rows], kind="stable")[:LANES]]
            here = paths.variant[rows, place[rows]], paths.station[rows, place[rows]]
            guess = (
                self.own[0][here[1]] + _extrapolated(away_q[:, rows], known[rows]),
                self.own[1][here[1]] + _extrapolated(away_meeting[:, rows], known[rows]),
                tangent[rows],
            )
            q, meeting, stiffness, status, steps = self._call(*here, guess, patiently)
            good = status < Status.TOO_DEEP
            self.found.steps[here] += steps
            won, nodes = rows[good], (here[0][good], here[1][good])
            self.found.q[nodes], self.found.meeting[nodes] = q[good], meeting[good]
            away_q[:, won] = np.stack([q[good] - self.own[0][nodes[1]], *away_q[:2, won]])
            away_meeting[:, won] = np.stack(
                [meeting[good] - self.own[1][nodes[1]], *away_meeting[:2, won]]
            )
            tangent[won] = stiffness[good]
            known[won], lost[won], patient[won] = known[won] + 1, 0, False
            patient[rows[~good]] = not patiently
            if patiently:
                known[rows[~good]] = 0
                lost[rows[~good]] += 1
            ended = good | patiently
            self.found.status[here[0][ended], here[1][ended]] = status[ended]
            place[rows[ended]] += 1
            place[lost >= give_up] = paths.length[lost >= give_up]
            with self._count:
                self.report(int(ended.sum()))

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
            np.asarray(_PATIENT if patiently else _QUICK),
        )
        return (np.moveaxis(np.asarray(x), -1, 0)[:size] for x in found)


def _extrapolated(away: np.ndarray, known: np.ndarray) -> np.ndarray:
    """The next distance: a parabola through three nodes, a line through two, or the last."""
    last, before, first = away
    known = known.reshape(-1, *(1,) * (last.ndim - 1))
    ahead = np.where(known > 2, 2 * last - 3 * before + first, last - before)
    return last + np.where(known > 1, ahead, 0.0)
