"""The instants of one movement, each followed from the one before it in time.

One instant is reached by a path of its own, from the reference pose; from there the knee is
followed through the movement, forwards and backwards, so that a knee which may be in balance in two
ways stays on the one that it is on. An instant that is lost on the way gets a path of its own. Such
a path bends the knee without the movement's loads first. A loose knee can be lost there, or come to
a balance far from the intact knee's though one is near it: a knee that was cut is sought also where
the intact one balances, cut while the loads act.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np

from kneejax.experiments._motion import Motion, again
from kneejax.experiments._second_balances import (
    GUESSED,
    changed_in_steps,
    follow_second,
    second_of,
)
from kneejax.mechanics import Knee
from kneejax.statics import (
    Equilibria,
    Equilibrium,
    LoadCases,
    Status,
    balance_in_order,
    balance_near,
    balance_one,
    converged,
    equilibrium_of,
    itself,
    sound,
)

#: Instants from one of which the movement is followed: the first of them that balances.
_FIRST = 5


@dataclasses.dataclass
class Instants:
    """Balances of instants, as far as they are known.

    Attributes:
        knee: that balances.
        load_cases: the instants, in order of time.
        nodes: fields of the balances, arrays begin with the instant.
        reached: as in `Motion`.
        near: balances of a like knee at the same instants, see `activity`; or none.
        other: coordinates of a second stable balance, `(n, free)`; NaN where none is known.
    """

    knee: Knee
    load_cases: LoadCases
    nodes: dict[str, np.ndarray]
    reached: np.ndarray
    near: Equilibrium | None = None
    other: np.ndarray = dataclasses.field(default_factory=lambda: np.empty((0, 0)))

    @classmethod
    def of(
        cls,
        knee: Knee,
        load_cases: LoadCases,
        near: Equilibrium | None = None,
        before: Knee | None = None,
    ) -> Instants:
        """Find them all.

        Args:
            knee: without a lane axis, its numbers known.
            load_cases: as in the attributes.
            near: likewise.
            before: the knee that balances there.
        """
        count = len(load_cases)
        load_cases = jax.tree.map(np.asarray, load_cases.of(knee))
        found = cls(knee, load_cases, {}, np.full(count, np.nan), near)
        firsts = np.unique(np.linspace(0, count - 1, min(count, _FIRST)).round().astype(int))
        found._by_own_path(firsts)
        good = firsts[found._known(firsts)]
        if len(good):
            begin = (found.nodes[name][good[0]] for name in GUESSED)
            in_order = balance_in_order(knee, load_cases, int(good[0]), *begin)
            found._take(np.arange(count), in_order)
        lost = np.flatnonzero(~found._known(np.arange(count)))
        if len(lost):
            found._by_own_path(lost)
        found.other = np.full_like(found.nodes["q"], np.nan)
        if near is not None and before is not None:
            found._from_before(before)
        return found

    def motion(self, knee: Knee, load_cases: LoadCases) -> Motion:
        """All of them as one motion of a knee and load cases of equal numbers, of which derivatives
        are asked."""
        nodes = {name: np.moveaxis(x, 0, -1) for name, x in self.nodes.items()}
        return again(
            knee, load_cases, equilibrium_of(self.load_cases, nodes), jnp.asarray(self.reached)
        )

    def _known(self, rows: np.ndarray) -> np.ndarray:
        return converged(self.nodes["status"][rows])

    def _at(self, rows: np.ndarray) -> LoadCases:
        return jax.tree.map(lambda x: x[rows], self.load_cases)

    def _by_own_path(self, rows: np.ndarray) -> None:
        """Some instants, each by a path of its own; what was not found at all is sought where the
        other knee balances. Where the knee was found to give way, it does."""
        self._take(rows, balance_one(self.knee, self._at(rows)))
        if self.near is None:
            return
        lost = self.nodes["status"][rows] == Status.NOT_CONVERGED
        rows = rows[lost & np.asarray(converged(self.near.status))[rows]]
        if len(rows):
            begin = (np.moveaxis(np.asarray(getattr(self.near, x)), -1, 0) for x in GUESSED)
            self._near(rows, [values[rows] for values in begin])

    def _from_before(self, before: Knee) -> None:
        """Take the balances that the knee before has when it is changed in steps, where they are
        stable; what was found on the other way is a second one where it is another.

        A knee that was found to give way under its load stays lost, with the balance as second.
        """
        assert self.near is not None
        rows = np.flatnonzero(np.asarray(converged(self.near.status)))
        begin = [np.moveaxis(np.asarray(getattr(self.near, x)), -1, 0)[rows] for x in GUESSED]
        at = self._at(rows)
        found = changed_in_steps(before, self.knee, at, begin) if len(rows) else None
        if found is None:
            return
        own = {name: values[rows] for name, values in self.nodes.items()}
        apart = second_of(at, own, found)
        taken = apart & self._known(rows)
        second = {x: np.full_like(self.nodes[x], np.nan) for x in GUESSED}
        for name, values in second.items():
            values[rows[apart]] = found[name][apart]
            values[rows[taken]] = own[name][taken]
        for name, values in self.nodes.items():
            values[rows[taken]] = found[name][taken]
        self.reached[rows[taken]] = found["reached"][taken]
        unsound = taken & ~np.asarray(sound(own["status"]))
        second["q"][rows[unsound]] = np.nan
        in_time = np.arange(len(self.reached))[None]
        follow_second(self.knee, self.load_cases, self.nodes, second, in_time)
        self.other = second["q"]

    def _near(self, rows: np.ndarray, begin: list[np.ndarray]) -> None:
        """Find some near where they are expected."""
        q, contact_points = (np.asarray(x)[None] for x in begin)
        found = balance_near(self.knee, itself, np.zeros(1), self._at(rows), q, contact_points)
        self._take(rows, found)

    def _take(self, rows: np.ndarray, found: Equilibria) -> None:
        """Write down what was found."""
        for name, values in found.in_nodes().items():
            if name not in self.nodes:
                shape, dtype = (len(self.reached), *values.shape[1:]), values.dtype
                nothing = int(Status.NOT_CONVERGED) if dtype.kind in "biu" else np.nan
                self.nodes[name] = np.full(shape, nothing, dtype)
            self.nodes[name][rows] = values
        self.reached[rows] = found.reached[0]
