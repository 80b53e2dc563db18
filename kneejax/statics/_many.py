"""Many balances: any variants of a knee at any load cases, each reached as a test is made.

A knee is bent from its reference pose without the loads, which then grow (`_flexion_paths.py`). So
what is found depends neither on which other load cases or knees were asked for, nor on their order.
"""

__all__ = ["Progress", "balance_lines", "balance_many", "balance_near", "balance_one", "itself"]

from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from kneejax.mechanics import Knee
from kneejax.statics._batch import Batch
from kneejax.statics._equilibria import Equilibria
from kneejax.statics._equilibrium import needs_float64
from kneejax.statics._flexion_paths import Chain, Routes
from kneejax.statics._freed import freed
from kneejax.statics._load_cases import LoadCases, Variants, Vary
from kneejax.statics._status import SOFT, Status, gives_way

#: Called with how many balances are done, and of how many.
Progress = Callable[[int, int], None]

#: Load cases without an equilibrium in a row after which a path ends. While a knee bends the next
#: ones may well balance (a knee too tight in extension); beyond the end of a branch nothing does.
_WHILE_BENT, _WHILE_CHANGED = 5, 2
#: Flexions from the reference pose by way of which a knee is followed that does not balance there,
#: rad.
_LEADS = tuple(np.deg2rad([45.0, 20.0, 70.0]))


def balance_many(
    knee: Knee,
    vary: Vary,
    values: Any,
    load_cases: LoadCases,
    *,
    forces: bool = False,
    progress: Progress | None = None,
) -> Equilibria:
    """Balance variants of a knee at load cases.

    Args:
        knee: gives all numbers that do not vary.
        vary: makes a variant: `(knee, value) -> knee` of the same structure, hashable, e.g. the
            bound method `selection.apply`.
        values: with a leading axis `(variants, ...)`.
        load_cases: in any order.
        forces: whether forces and stiffness are asked for, see `Equilibria`.
        progress: called now and then with balances done and asked for.

    Returns:
        The balances, in order.

    Raises:
        RuntimeError: float64 is switched off.
    """
    needs_float64()
    load_cases = load_cases.of(knee)
    variants = Variants.of(knee, vary, values)
    report = _counter(progress, len(variants) * len(load_cases))
    if load_cases.by_flexion:
        return _bent(variants, load_cases, forces, report)
    return freed(variants, load_cases, _bent(variants, load_cases.loaded(), False, report))


def balance_one(knee: Knee, load_cases: LoadCases) -> Equilibria:
    """Balance a knee itself at load cases, with forces and stiffness.

    A lax knee may have several balances; this is the one that a test finds.

    Args:
        knee: without a lane axis.
        load_cases: in any order.

    Returns:
        The balances of one variant.

    Raises:
        RuntimeError: float64 is switched off.
    """
    return balance_many(knee, itself, np.zeros((1, 0)), load_cases, forces=True)


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
    load_cases, size = load_cases.of(knee), len(load_cases)
    report = _counter(progress, lines * points * size)
    batch = Batch(Variants.of(knee, vary, flat), load_cases.plain(), False, report)
    middle = np.arange(lines) * points + np.asarray(begin, int)
    if near is None:
        near = balance_many(knee, vary, jax.tree.map(lambda x: x[middle], flat), load_cases)
    variant, load_case = np.repeat(middle, size), np.tile(np.arange(size), lines)
    guess = (x.reshape(lines * size, *x.shape[2:]) for x in (near.q, near.contact_points))
    _seek(batch, variant, load_case, *guess)
    # Both ways from there; a line of a single point has arms of no length.
    way = np.repeat([1, -1], len(variant))
    variant, load_case = np.tile(variant, 2), np.tile(load_case, 2)
    length = np.where(way > 0, points - 1 - variant % points, variant % points)
    steps = np.minimum(np.arange(1, max(points, 2)), length[:, None])
    nodes = variant[:, None] + way[:, None] * steps
    along = np.broadcast_to(load_case[:, None], nodes.shape)
    batch.follow(nodes, along, length, _WHILE_CHANGED, origin=(variant, load_case))
    return _answer(batch, (lines, points))


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
        The balances, with forces and stiffness.

    Raises:
        RuntimeError: float64 is switched off.
    """
    needs_float64()
    variants, load_cases = Variants.of(knee, vary, values), load_cases.of(knee).plain()
    size, count = len(load_cases), len(variants) * len(load_cases)
    batch = Batch(variants, load_cases, True, _counter(progress, count))
    guess = (np.reshape(x, (count, *np.shape(x)[2:])) for x in (q, contact_points))
    _seek(batch, *np.divmod(np.arange(count), max(size, 1)), *guess)
    return _answer(batch, (len(variants),))


def _seek(batch: Batch, variant, load_case, q, contact_points) -> None:
    """Search nodes, each near a guess; arrays begin with the node."""
    near, one = (np.asarray(q), np.asarray(contact_points)), np.ones(len(variant), int)
    batch.follow(variant[:, None], load_case[:, None], one, _WHILE_CHANGED, near=near)


def _answer(batch: Batch, shape: tuple[int, ...]) -> Equilibria:
    """What was found, with other leading axes of the variants."""
    batch.found.reached[:] = np.where(batch.found.converged, 1.0, 0.0)
    return jax.tree.map(lambda x: x.reshape(*shape, *x.shape[1:]), batch.found)


def _bent(variants: Variants, load_cases: LoadCases, forces: bool, report) -> Equilibria:
    """Variants at load cases where flexion alone is prescribed."""
    reference = float(variants.knee.reference_pose.flexion)
    answer, at_home = _along(Routes(load_cases, reference), variants, forces, report)
    if not at_home.all():
        # Where the way begins must not depend on how far it was to lead.
        leads = tuple(reference + lead for lead in _LEADS)
        lost = np.flatnonzero(~at_home)
        routes = Routes(load_cases, reference, leads)
        answer.put(lost, _along(routes, variants.take(lost), forces, lambda _: None)[0])
    return answer


def _along(
    routes: Routes, variants: Variants, forces: bool, report
) -> tuple[Equilibria, np.ndarray]:
    """Variants along all routes: balances at what was asked for, and which ones balance at the
    reference pose."""
    batch, every = Batch(variants, routes.nodes, forces, report), np.arange(len(variants))
    found, home = batch.found, routes.home
    # Both ways from the reference pose; who is lost there, back from where it was found first.
    arms = [Chain(home, (home, *routes.bent(home, way).nodes)) for way in (1, -1)]
    batch.follow_chains(arms, every, _WHILE_BENT, from_reference=True)
    at_home = found.converged[:, home].copy()
    lost = np.flatnonzero(~at_home)
    for way, arm in zip((1, -1), [np.array(arm.nodes) for arm in arms], strict=True):
        known = found.converged[lost[:, None], arm]
        begin, row = np.argmax(known, axis=1), np.arange(len(lost))
        # From two strides farther on, if may be: three equilibria tell where the branch leads.
        for _ in range(2):
            ahead = np.minimum(begin + 1, len(arm) - 1)
            begin = np.where(known[row, ahead], ahead, begin)
        begin = np.where(known.any(axis=1), begin, -1)
        before = found.at(lost[:, None], arm)
        for place in np.unique(begin[begin >= 0]):
            back = routes.bent(arm[place], -way)
            batch.follow_chains([back], lost[begin == place], _WHILE_BENT)
        again, there = np.nonzero(known & ~found.converged[lost[:, None], arm])
        found.put((lost[again], arm[there]), before.at(again, there))
        # Who is found has one branch: that of another arm would be laid over it.
        lost = lost[begin < 0]
    # Flexions between, from either side; then the loads, one after the other.
    batch.follow_chains(routes.hops, every, 1)
    batch.follow_chains(routes.back, every, 1, anew=False)
    share = np.where(found.converged, 1.0, 0.0)
    for chains in routes.loading:
        batch.follow_chains(chains, every, 1)
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
    soft = found.softness[row, nodes[lost]] < SOFT * found.softness[:, chain.origin]
    fault = found.fault[row, nodes[lost]]
    blocked = gives_way(~known, held, soft[:, None], fault[:, None])
    found.fault[:, nodes] = np.where(known, found.fault[:, nodes], fault[:, None])
    share[:, nodes] = np.where(known, 1.0, np.minimum(held / sizes, 1.0))
    found.status[:, nodes] = np.where(blocked, Status.GIVES_WAY, found.status[:, nodes])


def _counter(progress: Progress | None, total: int) -> Callable[[int], None]:
    done = 0

    def report(count: int) -> None:
        nonlocal done
        # Nodes on the way count as well, and what is followed twice.
        done = min(done + count, total)
        if progress is not None:
            progress(done, total)

    return report
