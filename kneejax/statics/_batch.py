"""Many balances: any variants of a knee at any load cases, each reached as a test is made.

A knee is bent from its reference pose without the loads, which then grow (`_flexion_paths.py`). So
what is found depends neither on which other load cases or knees were asked for, nor on their order.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np

from kneejax.mechanics import Knee
from kneejax.statics._chunks import Paths, follow_in_chunks, freed
from kneejax.statics._continuation import Behind
from kneejax.statics._equilibria import Equilibria
from kneejax.statics._equilibrium import needs_float64
from kneejax.statics._flexion_paths import Chain, Routes
from kneejax.statics._load_cases import Case, LoadCases, Variants, Vary, in_rows
from kneejax.statics._status import Status, gives_way

#: Called with how many balances are done, and of how many.
Progress = Callable[[int, int], None]

#: Load cases without an equilibrium in a row after which a path ends. While a knee bends the next
#: ones may well balance (a knee too tight in extension); beyond the end of a branch nothing does.
_WHILE_BENT, _WHILE_CHANGED = 5, 2
#: Flexions from the reference pose by way of which a knee is followed that does not balance there,
#: rad.
_LEADS = tuple(np.deg2rad([45.0, 20.0, 70.0]))
#: Stiffness, as a part of the unloaded knee's, below which a branch that ends has turned: along a
#: load it falls like the root of the distance to a limit point, and 1/16384 is tried.
_SOFT = 0.1


def balance_many(
    knee: Knee,
    vary: Vary,
    values: Any,
    load_cases: LoadCases,
    *,
    holding: bool = False,
    progress: Progress | None = None,
) -> Equilibria:
    """Balance variants of a knee at load cases.

    Args:
        knee: gives all numbers that do not vary.
        vary: makes a variant: `(knee, value) -> knee` of the same structure, hashable, e.g. the
            bound method `selection.apply`.
        values: with a leading axis `(variants, ...)`.
        load_cases: in any order.
        holding: whether to tell what holds the balances, see `Equilibria`.
        progress: called now and then with balances done and asked for.

    Returns:
        The balances, in order.

    Raises:
        RuntimeError: float64 is switched off.
    """
    needs_float64()
    load_cases = load_cases.of(knee)
    variants = Variants.of(knee, vary, values)
    total = len(variants) * len(load_cases)
    if not load_cases.by_flexion:
        before = _bent(variants, load_cases.loaded(), False, _counter(progress, total))
        return freed(variants, load_cases, before)
    return _bent(variants, load_cases, holding, _counter(progress, total))


def balance_one(knee: Knee, load_cases: LoadCases) -> Equilibria:
    """Balance a knee itself at load cases, with what holds it.

    A lax knee may have several balances; this is the one that a test finds.

    Args:
        knee: without a lane axis.
        load_cases: in any order.

    Returns:
        The balances of one variant.

    Raises:
        RuntimeError: float64 is switched off.
    """
    return balance_many(knee, itself, np.zeros((1, 0)), load_cases, holding=True)


def itself(knee: Knee, _) -> Knee:
    """A variant that is the knee itself.

    Example:
        >>> from kneejax.files import load_knee
        >>> knee = load_knee("four_ligament")
        >>> itself(knee, None) is knee
        True
    """
    return knee


def balance_lines(
    knee: Knee,
    vary: Vary,
    values: Any,
    load_cases: LoadCases,
    begin: np.ndarray,
    *,
    near: Equilibria | None = None,
    progress: Progress | None = None,
) -> Equilibria:
    """Balance variants that stand in lines, each near its neighbours.

    At each load case a line is followed from one of its points in both directions.

    Args:
        knee: as in `balance_many`; likewise `vary`, `load_cases`, `progress`.
        values: with leading axes `(lines, points, ...)`.
        begin: the point of each line where it begins, `(lines,)`.
        near: balances near those points, `(lines, load_cases)`; by default each is reached by
            itself.

    Returns:
        The balances, in order, with leading axes `(lines, points)`.

    Raises:
        RuntimeError: float64 is switched off.
    """
    needs_float64()
    lines, points = np.shape(jax.tree.leaves(values)[0])[:2]
    flat = jax.tree.map(lambda x: np.reshape(x, (lines * points, *np.shape(x)[2:])), values)
    load_cases = load_cases.of(knee)
    batch = _Batch(Variants.of(knee, vary, flat), load_cases.plain(), False)
    report, size = _counter(progress, lines * points * len(load_cases)), len(load_cases)
    middle = np.arange(lines) * points + np.asarray(begin, int)
    if near is None:
        firsts = jax.tree.map(lambda x: x[middle], flat)
        near = balance_many(knee, vary, firsts, load_cases)
    every, load_case = np.repeat(middle, size), np.tile(np.arange(size), lines)
    batch.seek(every, load_case, near.q.reshape(lines * size, -1), near.contact_points.reshape(
        lines * size, -1, 2), report)  # fmt: skip
    # A line of a single point has arms of no length, on one node that is never followed.
    steps = np.arange(1, max(points, 2))
    place = np.tile(every % points, 2)
    way = np.repeat([1, -1], len(every))
    length = np.where(way > 0, points - 1 - place, place)
    walked = np.minimum(steps, np.maximum(length, 0)[:, None])
    variant = np.tile(every, 2)[:, None] + way[:, None] * walked
    along = np.broadcast_to(np.tile(load_case, 2)[:, None], variant.shape)
    origin = np.tile(every, 2), np.tile(load_case, 2)
    batch.follow(variant, along, length, origin, _WHILE_CHANGED, report)
    return batch.answer((lines, points))


def balance_near(
    knee: Knee, vary: Vary, values: Any, load_cases: LoadCases, q, contact_points,
    progress: Progress | None = None,
) -> Equilibria:  # fmt: skip
    """Balance variants at load cases, each by itself near where it is expected: no path leads
    there.

    A search that begins near a balance may end at another one: compare what is found with what was
    expected.

    Args:
        knee: as in `balance_many`; likewise `vary`, `values`.
        load_cases: any choice of prescribed coordinates.
        q: free coordinates to begin with, `(variants, load_cases, free)`, rad and mm; the reference
            pose where they are NaN.
        contact_points: parameters of the contact points, `(variants, load_cases, n, 2)`.
        progress: as in `balance_many`.

    Returns:
        The balances, with what holds them.

    Raises:
        RuntimeError: float64 is switched off.
    """
    needs_float64()
    variants, load_cases = Variants.of(knee, vary, values), load_cases.of(knee).plain()
    batch, size = _Batch(variants, load_cases, True), len(load_cases)
    count = len(variants) * size
    variant, load_case = np.arange(count) // max(size, 1), np.arange(count) % max(size, 1)
    q, contact_points = (np.reshape(x, (count, *np.shape(x)[2:])) for x in (q, contact_points))
    batch.seek(variant, load_case, q, contact_points, _counter(progress, count))
    return batch.answer((len(variants),))


class _Batch:
    """Variants at load cases, and what is found of them."""

    def __init__(self, variants: Variants, load_cases: LoadCases, holding: bool):
        knee, load_cases = variants.knee, jax.tree.map(np.asarray, load_cases)
        self.variants, self.load_cases = variants, load_cases
        shape = len(variants), len(load_cases)
        self.found = Equilibria.nothing(shape, load_cases, knee.patch_count, holding)
        whole = {leaf: variants.numbers[leaf] for leaf in sorted(variants.numbers)}
        none = np.zeros((len(variants), 0))
        self._numbers = in_rows(whole, 1) if whole else none
        self._marks = in_rows(load_cases, 1)
        first = jax.tree.map(lambda x: np.zeros(x.shape[1:]), (whole, load_cases))
        self._like = Case(*first)

    def follow(
        self, variant, load_case, length, origin: tuple, give_up: int, report, anew: bool = True
    ) -> None:
        """Follow paths of nodes from balances.

        Args:
            variant: of each node, `(paths, nodes)`; likewise `load_case`.
            length: nodes of each path that count, `(paths,)`.
            origin: variant and load case of the balance where each begins; without it none does.
            give_up: see `follow_in_chunks`.
            report: called with how many nodes are done.
            anew: whether paths are followed whose first node is known.
        """
        known = self.found.converged
        length = np.where(known[origin], length, 0)
        if not anew:
            length = np.where(known[variant[:, 0], load_case[:, 0]], 0, length)
        q, contact_points = self.found.q[origin], self.found.contact_points[origin]
        begun = known[origin]
        behind = self._behind(origin[0], origin[1], q, contact_points, begun.astype(int))
        self._run(variant, load_case, length, behind, give_up, report)

    def seek(self, variant, load_case, q, contact_points, report) -> None:
        """Search nodes, each near a guess; arrays begin with the node."""
        one, unknown = np.ones(len(variant), int), np.isnan(q).any(axis=-1)
        q, contact_points = np.array(q), np.array(contact_points)
        q[unknown] = self._reference()
        contact_points[unknown] = np.nan
        behind = self._behind(variant, load_case, q, contact_points, 0 * one)
        self._run(variant[:, None], load_case[:, None], one, behind, _WHILE_CHANGED, report)

    def begin(self, variant, load_case, length, give_up: int, report) -> None:
        """Follow paths of nodes from the reference pose; as in `follow`."""
        nothing = np.zeros(len(length), int)
        q = np.tile(self._reference(), (len(length), 1))
        contact_points = np.full((len(length), self.variants.knee.patch_count, 2), np.nan)
        behind = self._behind(variant[:, 0], load_case[:, 0], q, contact_points, nothing)
        self._run(variant, load_case, length, behind, give_up, report)

    def _reference(self) -> np.ndarray:
        """Free coordinates at the reference pose."""
        return np.asarray(self.variants.knee.at_reference.at(self.load_cases.free))

    def answer(self, shape: tuple[int, ...]) -> Equilibria:
        """What was found, with other leading axes of the variants."""
        self.found.reached[:] = np.where(self.found.converged, 1.0, 0.0)
        return self.found.shaped(shape)

    def _rows(self, variant, load_case) -> np.ndarray:
        return np.concatenate([self._numbers[variant], self._marks[load_case]], axis=-1)

    def _behind(self, variant, load_case, q, contact_points, known) -> Behind:
        """What lies behind paths that begin at nodes; q and meeting begin with the path."""
        q, contact_points = np.moveaxis(q, 0, -1), np.moveaxis(contact_points, 0, -1)
        return Behind.at(self._rows(variant, load_case).T, q, contact_points, known)

    def _run(self, variant, load_case, length, behind: Behind, give_up: int, report) -> None:
        def cases(path: np.ndarray, place: np.ndarray) -> np.ndarray:
            return self._rows(variant[path, place], load_case[path, place])

        def note(path: np.ndarray, place: np.ndarray, record: dict[str, Any]) -> None:
            self.found.note((variant[path, place], load_case[path, place]), record)
            report(len(path))

        if length.any():
            paths = Paths(self._like, cases, length, variant.shape[1], behind)
            follow_in_chunks(self.variants.knee, paths, give_up, note)

    def follow_chains(self, chains: Sequence[Chain], variants, give_up, report, anew=True) -> None:
        """Some variants along chains of load cases, each from its origin."""
        chains = [chain for chain in chains if chain.nodes]
        if chains and len(variants):
            load_cases, length = _even([chain.nodes for chain in chains])
            rows, variant = np.divmod(np.arange(len(chains) * len(variants)), len(variants))
            origin = np.array([chain.origin for chain in chains])[rows]
            variant = np.asarray(variants)[variant]
            nodes = np.broadcast_to(variant[:, None], (len(variant), load_cases.shape[1]))
            begins = variant, origin
            self.follow(nodes, load_cases[rows], length[rows], begins, give_up, report, anew)


def _bent(variants: Variants, load_cases: LoadCases, holding: bool, report) -> Equilibria:
    """Variants at load cases where flexion alone is prescribed."""
    reference = float(variants.knee.reference_pose.flexion)
    answer, at_home = _along(Routes.to(load_cases, reference), variants, holding, report)
    if not at_home.all():
        # Where the way begins must not depend on how far it was to lead.
        leads = tuple(reference + lead for lead in _LEADS)
        lost = np.flatnonzero(~at_home)
        some = variants.take(lost)
        again, _ = _along(Routes.to(load_cases, reference, leads), some, holding, lambda _: None)
        answer.put(lost, again)
    return answer


def _along(routes: Routes, variants: Variants, holding: bool, report):
    """Variants along all routes: balances at what was asked for, and which ones balance at the
    reference pose."""
    batch, every = _Batch(variants, routes.nodes, holding), np.arange(len(variants))
    found, home = batch.found, routes.home
    # Both ways from the reference pose; who is lost there, back from where it was found first.
    arms = [(home, *routes.bent(home, way).nodes) for way in (1, -1)]
    load_cases, length = _even(arms)
    variant = np.broadcast_to(np.tile(every, 2)[:, None], (2 * len(every), load_cases.shape[1]))
    load_cases, length = (np.repeat(x, len(every), axis=0) for x in (load_cases, length))
    batch.begin(variant, load_cases, length, _WHILE_BENT, report)
    at_home = found.converged[:, home].copy()
    lost = np.flatnonzero(~at_home)
    for way, arm in zip((1, -1), arms, strict=True):
        known = found.converged[lost[:, None], arm]
        begin, row = np.argmax(known, axis=1), np.arange(len(lost))
        # From two strides farther on, if may be: three equilibria tell where the branch leads.
        for _ in range(2):
            ahead = np.minimum(begin + 1, len(arm) - 1)
            begin = np.where(known[row, ahead], ahead, begin)
        begin = np.where(known.any(axis=1), begin, -1)
        before = found.at(lost[:, None], np.array(arm))
        for place in np.unique(begin[begin >= 0]):
            back = routes.bent(arm[place], -way)
            batch.follow_chains([back], lost[begin == place], _WHILE_BENT, report)
        again, there = np.nonzero(known & ~found.converged[lost[:, None], arm])
        found.put((lost[again], np.array(arm)[there]), before.at(again, there))
        # Who is found has one branch: that of another arm would be laid over it.
        lost = lost[begin < 0]
    # Flexions between, from either side; then the loads, one after the other.
    batch.follow_chains(routes.hops, every, 1, report)
    batch.follow_chains(routes.back, every, 1, report, anew=False)
    share = np.where(found.converged, 1.0, 0.0)
    for chains in routes.loading:
        batch.follow_chains(chains, every, 1, report)
        for chain in chains:
            _say_how_far(found, share, chain)
    found.reached[:] = share
    return found.at(slice(None), routes.asked), at_home


def _say_how_far(found: Equilibria, share: np.ndarray, chain: Chain) -> None:
    """Write down how much of its load each variant held along a chain, and whether it gave way."""
    nodes, sizes, row = np.array(chain.nodes), np.array(chain.sizes), np.arange(len(share))
    known = found.converged[:, nodes]
    lost = np.where(known.all(axis=1), len(nodes) - 1, np.argmin(known, axis=1))
    begin, end = np.r_[0.0, sizes][lost], sizes[lost]
    held = begin + found.reached[row, nodes[lost]] * (end - begin)
    held = np.where(found.converged[:, chain.origin], held, 0.0)[:, None]
    soft = found.softness[row, nodes[lost]] < _SOFT * found.softness[:, chain.origin]
    fault = found.fault[row, nodes[lost]]
    blocked = gives_way(~known, held, soft[:, None], fault[:, None])
    found.fault[:, nodes] = np.where(known, found.fault[:, nodes], fault[:, None])
    share[:, nodes] = np.where(known, 1.0, np.minimum(held / sizes, 1.0))
    found.status[:, nodes] = np.where(blocked, Status.GIVES_WAY, found.status[:, nodes])


def _even(rows: Sequence[Sequence[int]]) -> tuple[np.ndarray, np.ndarray]:
    """Rows of one length, filled up, and how many of each count."""
    longest = max(map(len, rows))
    return np.array([np.resize(row, longest) for row in rows]), np.array([len(x) for x in rows])


def _counter(progress: Progress | None, total: int) -> Callable[[int], None]:
    done = 0

    def report(count: int) -> None:
        nonlocal done
        # Nodes on the way count as well, and what is followed twice.
        done = min(done + count, total)
        if progress is not None:
            progress(done, total)

    return report
