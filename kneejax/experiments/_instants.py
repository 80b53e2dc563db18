"""Many instants of one movement: a path of its own leads to some, the others lie between them.

An instant lies near its neighbours in time, so only a few are followed from the reference pose,
each by itself. The others are sought where their neighbours in time say, half-way first; what is
not found there gets a path of its own. It bends the knee without the movement's loads first. A
loose knee can be lost there, or come to a balance far from the intact knee's though one is near it:
a knee that was cut is sought also where the intact one balances, cut while the loads act.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable

import jax
import jax.numpy as jnp
import numpy as np

from kneejax.experiments._branches import (
    APART_MM,
    GUESSED,
    SecondBalances,
    changed_in_steps,
    guesses,
    in_rows,
)
from kneejax.experiments._motion import Motion, again, balanced_near
from kneejax.geometry import scales
from kneejax.mechanics import Knee
from kneejax.statics import (
    Equilibrium,
    LoadCases,
    Status,
    balance_one,
    converged,
    equilibrium_of,
    sound,
)

#: Instants with a path of their own. That costs as much as eighty instants that are found between
#: others; of a recorded step 25, 9, 5 and 3 led to the same balances.
_ANCHORS = 5
#: A balance farther from the one before is sought from there, mm (rotations at 30 mm).
_MISSED_MM = 2.0


@dataclasses.dataclass
class Instants:
    """Balances of instants, as far as they are known."""

    knee: Knee  # that balances
    load_cases: LoadCases  # the instants, in order of time
    # Balances of a like knee at the same instants, see `activity`; or none.
    near: Equilibrium | None = None
    # Fields of the balances, and `reached` as in `Motion`; arrays begin with the instant.
    nodes: dict[str, np.ndarray] = dataclasses.field(default_factory=dict)

    @classmethod
    def of(cls, knee: Knee, load_cases: LoadCases, near: Equilibrium | None = None,
           before: Knee | None = None) -> tuple[Instants, SecondBalances]:  # fmt: skip
        """Find them all, and second ones: of a knee without a lane axis, its numbers known;
        `before` is the knee that balances at `near`."""
        count = len(load_cases)
        found = cls(knee, jax.tree.map(np.asarray, load_cases.of(knee)), near)
        anchors = np.unique(np.linspace(0, count - 1, min(count, _ANCHORS)).round().astype(int))
        found._by_own_path(anchors)
        found._between(anchors)
        found._in_time(1)
        found._in_time(-1)
        lost = np.flatnonzero(~found._known(np.arange(count)))
        if len(lost):
            found._by_own_path(lost)
        second = SecondBalances(knee, found.load_cases, found.nodes)
        if near is not None and before is not None:
            found._from_before(before, second)
        elif near is None:
            found._from_unloaded(anchors, second)
        return found, second

    def motion(self, knee: Knee, load_cases: LoadCases) -> Motion:
        """All of them as one motion of a knee and load cases of equal numbers, of which derivatives
        are asked."""
        nodes = {x: np.moveaxis(y, 0, -1) for x, y in self.nodes.items() if x != "reached"}
        reached = jnp.asarray(self.nodes["reached"])
        return again(knee, load_cases, equilibrium_of(self.load_cases, nodes), reached)

    def _known(self, rows: np.ndarray) -> np.ndarray:
        return converged(self.nodes["status"][rows])

    def _path(self, rows: np.ndarray) -> dict[str, np.ndarray]:
        """Balances of some instants, to each of which a path of its own leads."""
        return in_rows(balance_one(self.knee, self.load_cases.take(rows)))

    def _take(self, rows: np.ndarray, found: dict[str, np.ndarray]) -> None:
        """Write down what was found."""
        for name, values in found.items():
            if name not in self.nodes:
                shape, dtype = (len(self.load_cases), *values.shape[1:]), values.dtype
                self.nodes[name] = np.full(shape, 0 if dtype.kind in "biu" else np.nan, dtype)
            self.nodes[name][rows] = values

    def _near(self, rows: np.ndarray, begin: Iterable[np.ndarray]) -> None:
        """Find some near where they are expected."""
        at = self.load_cases.take(rows)
        self._take(rows, in_rows(balanced_near(self.knee, at, begin)))

    def _by_own_path(self, rows: np.ndarray) -> None:
        """Some instants, each by a path of its own; what was not found at all is sought where the
        other knee balances. Where the knee was found to give way, it does."""
        self._take(rows, self._path(rows))
        if self.near is None:
            return
        lost = self.nodes["status"][rows] == Status.NOT_CONVERGED
        rows = rows[lost & np.asarray(converged(self.near.status))[rows]]
        if len(rows):
            self._near(rows, [values[rows] for values in guesses(self.near).values()])

    def _from_before(self, before: Knee, second: SecondBalances) -> None:
        """Take the balances that the knee before has when it is changed in steps, where they are
        stable; what was found on the other way is a second one where it is another.

        A knee that was found to give way under its load stays lost, with the balance as second.
        """
        assert self.near is not None
        rows = np.flatnonzero(np.asarray(converged(self.near.status)))
        begin = [values[rows] for values in guesses(self.near).values()]
        at = self.load_cases.take(rows)
        found = changed_in_steps(before, self.knee, at, begin) if len(rows) else None
        if found is None:
            return
        taken = second.add(rows, found) & self._known(rows)
        self._exchange(rows[taken], {x: values[taken] for x, values in found.items()}, second)
        second.follow(np.arange(len(self.load_cases))[None])

    def _from_unloaded(self, anchors: np.ndarray, second: SecondBalances) -> None:
        """Report the balances to which the path from the unloaded knee leads where two are known.

        A second one is looked for where that path leads elsewhere than the neighbours in time,
        half-way between anchors, and on both sides of each jump in time.
        """
        own = np.setdiff1d((anchors[:-1] + anchors[1:]) // 2, anchors)
        if len(own):
            second.add(own, self._path(own))
        second.follow(np.arange(len(self.load_cases))[None])
        rows = np.flatnonzero(second.known)
        if not len(rows):
            return
        path, units = self._path(rows), np.array(scales(self.load_cases.free))
        to_main, to_second = (
            np.abs((path["q"] - x["q"][rows]) / units).max(axis=1)
            for x in (self.nodes, second.found)
        )
        ends = converged(path["status"]) & (to_second < np.minimum(to_main, APART_MM))
        self._exchange(rows[ends], {x: values[ends] for x, values in path.items()}, second)

    def _exchange(
        self, rows: np.ndarray, found: dict[str, np.ndarray], second: SecondBalances
    ) -> None:
        """Report what was found at some instants; what was reported there is second if stable."""
        stable = np.asarray(sound(self.nodes["status"][rows]))
        for name, values in second.found.items():
            values[rows] = np.nan
            values[rows[stable]] = self.nodes[name][rows[stable]]
        self._take(rows, found)

    def _between(self, known: np.ndarray) -> None:
        """Find what lies between instants that are known, half-way first."""
        from scipy.interpolate import PchipInterpolator  # 0.2 s that no other command waits for

        while len(known) < len(self.load_cases):
            first, last = known[:-1], known[1:]
            apart = last - first > 1
            rows = (first[apart] + last[apart]) // 2
            good = known[self._known(known)]
            if len(good) > 1:
                along = (PchipInterpolator(good, self.nodes[x][good], axis=0) for x in GUESSED)
                self._near(rows, [at(rows) for at in along])
            else:
                self._by_own_path(rows)
            known = np.sort(np.r_[known, rows])

    def _in_time(self, way: int) -> None:
        """Where an instant lies far from the one before, or has no balance: begin at that one.

        A knee that may be in balance in two ways stays on the one that it is on. The way is 1 from
        the first on, or -1 from the last backwards, where there is no balance only.
        """
        q, units = self.nodes["q"], np.array(scales(self.load_cases.free))

        def is_near(row: int) -> bool:
            return np.abs((q[row] - q[row - way]) / units).max() <= _MISSED_MM

        for row in range(len(q))[::way][1:]:
            known, before = self._known(np.array([row, row - way]))
            if not before or is_near(row) or (way < 0 and known):
                continue
            kept = [x[row].copy() for x in self.nodes.values()]
            self._near(np.array([row]), [self.nodes[x][[row - way]] for x in GUESSED])
            if not is_near(row):
                for values, old in zip(self.nodes.values(), kept, strict=True):
                    values[row] = old
