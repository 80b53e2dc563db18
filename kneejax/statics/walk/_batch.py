"""Many balances: any parameters, any stations, on all cores, in order, in bounded memory.

Nodes (a variant at a station) are laid out in paths along which one pose predicts the next, and the
paths are dealt to threads in lots of a fixed size: answers depend neither on the number of cores
nor on who was first.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np

from kneejax.geometry import free_of
from kneejax.mechanics import Knee
from kneejax.numerics import on_all_cores
from kneejax.statics._settle import needs_float64
from kneejax.statics._status import Status, converged, gives_way
from kneejax.statics.walk._balances import Balances
from kneejax.statics.walk._held import held
from kneejax.statics.walk._paths import (
    Found,
    Own,
    Paths,
    along_chains,
    arms,
    joined,
    paths,
    single_nodes,
)
from kneejax.statics.walk._routes import Chain, Routes
from kneejax.statics.walk._stations import Stations
from kneejax.statics.walk._variants import Variants, Vary
from kneejax.statics.walk._walk import Walker

#: Called with how many balances are done, and of how many.
Progress = Callable[[int, int], None]

#: Paths of a lot, at least and at most, for each lane of a call.
_LOT = (2, 8)
#: Lost nodes in a row after which a path is given up. Along stations the next ones may well
#: balance (a knee too tight in extension); beyond the end of a branch nothing does.
_ALONG_STATIONS, _ALONG_VALUES, _ALONG_LOADS = 5, 2, 1
#: Flexions from the reference pose by way of which a knee is followed that does not balance there,
#: rad.
_LEADS = tuple(np.deg2rad([45.0, 20.0, 70.0]))
#: Stiffness, as a part of the unloaded knee's, below which a branch that ends has turned: along a
#: load it falls like the root of the distance to a turning point, and 1/16384 is tried.
_SOFT = 0.1


def _asked(found: Found, routes: Routes) -> Balances:
    """What was found at the stations that were asked for; how far the others got."""
    every = Balances.of(found, (len(found.status),), routes.nodes.free)
    for chain in itertools.chain.from_iterable(routes.loading):
        _say_how_far(every, found, chain)
    return every.at(slice(None), routes.asked)


def _say_how_far(every: Balances, found: Found, chain: Chain) -> None:
    """Write down how much of its load each variant held along a chain, and whether it gave way."""
    nodes, sizes = np.array(chain.nodes), np.array(chain.sizes)
    known, row = found.known[:, nodes], np.arange(len(found.status))
    lost = np.where(known.all(axis=1), len(nodes) - 1, np.argmin(known, axis=1))
    begin, end = np.r_[0.0, sizes][lost], sizes[lost]
    held = begin + found.share[row, nodes[lost]] * (end - begin)
    held = np.where(found.known[:, chain.origin], held, 0.0)[:, None]
    soft = found.softness[row, nodes[lost]] < _SOFT * found.softness[:, chain.origin]
    fault = found.fault[row, nodes[lost]]
    blocked = gives_way(~known, held, soft[:, None], fault[:, None])
    every.fault[:, nodes] = np.where(known, every.fault[:, nodes], fault[:, None])
    every.reached[:, nodes] = np.where(known, 1.0, np.minimum(held / sizes, 1.0))
    every.status[:, nodes] = np.where(blocked, Status.GIVES_WAY, found.status[:, nodes])


def balance_many(
    knee: Knee,
    vary: Vary,
    base: Any,
    values: Any,
    stations: Stations,
    *,
    progress: Progress | None = None,
) -> Balances:
    """Balance variants of a knee at stations.

    Each variant is bent from the knee's reference pose, and then its loads grow (see `Routes`):
    what is found at a station depends on no other station, nor on their order.

    Args:
        knee: gives all numbers that do not vary.
        vary: makes a variant: `(knee, value) -> knee` of the same structure, hashable, e.g. the
            bound method `selection.apply`.
        base: the value of the knee itself.
        values: like `base`, with a leading axis `(variants, ...)`.
        stations: in any order.
        progress: called now and then with balances done and asked for.

    Returns:
        The balances, in order.

    Raises:
        RuntimeError: float64 is switched off.
    """
    needs_float64()
    stations = stations.of(knee)
    if not stations.by_flexion:
        before = balance_many(knee, vary, base, values, stations.loaded(), progress=progress)
        return held(Variants.of(knee, vary, values), stations, before)
    reference = float(knee.reference_pose.flexion)
    routes = Routes.to(stations, reference)
    one = jax.tree.map(lambda x: np.asarray(x)[None], base)
    baseline = _walked(knee, vary, one, routes, None)
    variants = Variants.of(knee, vary, values)
    found = Found.nothing(len(variants), _filled(baseline, knee))
    report = _counter(progress, len(variants) * len(stations))
    walker = Walker(variants, routes.nodes, found, report)
    _walk_all_routes(walker, routes)
    answer, lost = _asked(found, routes), ~found.known[:, routes.needed].all(axis=1)
    if lost.any():
        # What the baseline motion does not lead to may be found without it.
        some = jax.tree.map(lambda x: np.asarray(x)[lost], values)
        alone = _by_themselves(knee, vary, some, stations)
        for name in ("q", "meeting", "status", "steps", "reached", "fault"):
            getattr(answer, name)[lost] = getattr(alone, name)
    return answer


def balance_lines(
    knee: Knee,
    vary: Vary,
    base: Any,
    values: Any,
    stations: Stations,
    begin: np.ndarray,
    *,
    near: Balances | None = None,
    own: Balances | None = None,
    progress: Progress | None = None,
) -> Balances:
    """Balance variants that stand in lines, each near its neighbours.

    At each station a line is walked from one of its points in both directions.

    Args:
        knee: as in `balance_many`; likewise `vary`, `base`, `stations`, `own`, `progress`.
        values: like `base`, with leading axes `(lines, points, ...)`.
        begin: the point of each line where the walk begins, `(lines,)`.
        near: balances near those points, `(lines, stations)`; the knee's own motion by default.

    Returns:
        The balances, in order, with leading axes `(lines, points)`.

    Raises:
        RuntimeError: float64 is switched off.
    """
    lines, points = np.shape(jax.tree.leaves(values)[0])[:2]
    flat = jax.tree.map(lambda x: np.reshape(x, (lines * points, *np.shape(x)[2:])), values)
    needs_float64()
    stations = stations.of(knee)
    own = own or own_motion(knee, vary, base, stations)
    variants = Variants.of(knee, vary, flat)
    found = Found.nothing(len(variants), _filled(own, knee))
    report = _counter(progress, lines * points * len(stations))
    walker = Walker(variants, stations.plain(), found, report)
    middle = np.arange(lines) * points + np.asarray(begin, int)
    poses = None if near is None else (near.q, near.meeting)
    _walk_all(walker, single_nodes(walker.found, middle, poses), _ALONG_VALUES)
    up, down = (arms(walker.found, middle, points, way) for way in (1, -1))
    _walk_all(walker, joined(up, down), _ALONG_VALUES)
    return Balances.of(found, (lines, points), stations.free)


def own_motion(knee: Knee, vary: Vary, base: Any, stations: Stations) -> Balances:
    """Balance the knee itself at stations.

    Each station is reached as a test is made: the knee is bent from the reference pose without the
    load, which then grows. A lax knee may have several balances; this is the one that a test finds,
    and it does not depend on which other stations were asked for.

    Args:
        knee: as in `balance_many`; likewise `vary`, `base`.
        stations: in any order.

    Returns:
        The balances of one variant.

    Raises:
        RuntimeError: float64 is switched off.
    """
    needs_float64()
    stations = stations.of(knee)
    one = jax.tree.map(lambda x: np.asarray(x)[None], base)
    if not stations.by_flexion:
        before = own_motion(knee, vary, base, stations.loaded())
        return held(Variants.of(knee, vary, one), stations, before)
    return _by_themselves(knee, vary, one, stations, {})


def own_motion_near(
    knee: Knee, vary: Vary, base: Any, stations: Stations, q, meeting
) -> Balances:
    """Balance the knee itself at stations, each by itself near where it is expected: no walk.

    A search that begins near a balance may end at another one: compare what is found with what was
    expected.

    Args:
        knee: as in `own_motion`; likewise `vary`, `base`, `stations`.
        q: free coordinates to begin with, `(stations, free)`, rad and mm.
        meeting: parameters of the meeting points, `(stations, n, 2)`.

    Returns:
        The balances of one variant, by the program that walks to them.

    Raises:
        RuntimeError: float64 is switched off.
    """
    needs_float64()
    one = jax.tree.map(lambda x: np.asarray(x)[None], base)
    plain = stations.of(knee).plain()
    begin = (np.asarray(x)[None] for x in (q, meeting))
    return balance_near(Variants.of(knee, vary, one), plain, *begin)


def balance_near(variants: Variants, stations: Stations, q, meeting) -> Balances:
    """Balance variants at stations, each node by itself near where it is expected.

    Args:
        variants: of one knee.
        stations: any choice of prescribed coordinates, `plain`.
        q: free coordinates to begin with, `(variants, stations, free)`; NaN where nothing is known,
            and so is the next.
        meeting: parameters of the meeting points, `(variants, stations, n, 2)`.

    Returns:
        The balances, with what holds them.
    """
    size, knee = len(stations), variants.knee
    reference = np.asarray(knee.at_reference.at(stations.free))
    own = np.tile(reference, (size, 1)), np.zeros((size, knee.patch_count, 2))
    found = Found.nothing(len(variants), own, {})
    walker = Walker(variants, stations, found, lambda _: None)
    every = np.arange(len(variants))
    nodes = single_nodes(found, every, (q, meeting))
    _walk_all(walker, nodes, _ALONG_VALUES)
    return Balances.of(found, (len(variants),), stations.free)


def _by_themselves(
    knee: Knee, vary: Vary, values: Any, stations: Stations, holding: dict | None = None
) -> Balances:
    """Variants that nothing leads but their own last poses; each as if it were the only one."""
    reference = float(knee.reference_pose.flexion)
    routes = Routes.to(stations, reference)
    found = _walked(knee, vary, values, routes, holding)
    answer, astray = _asked(found, routes), ~found.known[:, routes.home]
    if not astray.any():
        return answer
    # Where the way begins must not depend on how far it was to lead.
    routes = Routes.to(stations, reference, tuple(reference + lead for lead in _LEADS))
    some = jax.tree.map(lambda x: np.asarray(x)[astray], values)
    again = _asked(_walked(knee, vary, some, routes, None if holding is None else {}), routes)
    for field in dataclasses.fields(Balances):
        numbers = getattr(again, field.name)
        if field.name == "holding":
            for name, x in numbers.items():
                answer.holding[name][astray] = x
        elif field.name != "free":
            getattr(answer, field.name)[astray] = numbers
    return answer


def _walked(knee: Knee, vary: Vary, values: Any, routes: Routes, holding: dict | None) -> Found:
    """Variants along all routes, predicted from poses alone."""
    reference = _at_reference(knee)
    size, variants = len(routes.nodes), Variants.of(knee, vary, values)
    nothing = np.tile(reference, (size, 1)), np.zeros((size, knee.patch_count, 2))
    found = Found.nothing(len(variants), nothing, holding)
    _walk_all_routes(Walker(variants, routes.nodes, found, lambda _: None), routes)
    return found


def _walk_all_routes(walker: Walker, routes: Routes) -> None:
    """Every variant along all routes, from the knee's reference pose."""
    _bend_from_reference(walker, routes)
    _walk_off_the_stem(walker, routes)


def _bend_from_reference(walker: Walker, routes: Routes) -> None:
    """The stem both ways from the reference pose; where that finds nothing at first, back from
    where it did."""
    found, home = walker.found, routes.home
    arms = [np.array([home, *routes.bent(home, way).nodes]) for way in (1, -1)]
    count, longest = len(found.status), max(map(len, arms))
    variant = np.broadcast_to(np.tile(np.arange(count), 2)[:, None], (2 * count, longest))
    station = np.repeat([np.resize(arm, longest) for arm in arms], count, axis=0)
    length = np.repeat([len(arm) for arm in arms], count)
    knee = walker.variants.knee
    reference = _at_reference(knee)
    begin = paths(found, variant, station, length, reference - found.own[0][home])
    _walk_all(walker, begin, _ALONG_STATIONS)
    lost = np.flatnonzero(~found.known[:, home])
    for way, arm in zip((1, -1), arms, strict=True):
        known = found.known[np.ix_(lost, arm)]
        first = np.where(known.any(axis=1), np.argmax(known, axis=1), -1)
        for place in np.unique(first[first >= 0]):
            back = Chain(int(arm[place]), routes.bent(int(arm[place]), -way).nodes)
            if back.nodes:
                rows = lost[first == place]
                _walk_all(walker, along_chains(found, [back], rows), _ALONG_STATIONS)


def _walk_off_the_stem(walker: Walker, routes: Routes) -> None:
    """To flexions between its nodes, from either side, and under loads."""
    _walk_chains(walker, routes.hops, _ALONG_LOADS)
    _walk_chains(walker, routes.back, _ALONG_LOADS, again=False)
    for chains in routes.loading:
        _walk_chains(walker, chains, _ALONG_LOADS)


def _walk_chains(walker: Walker, chains: Sequence[Chain], give_up: int, again: bool = True) -> None:
    """All variants along chains."""
    chains = [chain for chain in chains if chain.nodes]
    if chains:
        everyone = np.arange(len(walker.found.status))
        _walk_all(walker, along_chains(walker.found, chains, everyone, again), give_up)


def _at_reference(knee: Knee) -> np.ndarray:
    """What is free when a knee is bent, at its reference pose."""
    return np.asarray(knee.at_reference.at(free_of(["flexion"], knee.bodies)))


def _filled(own: Found | Balances, knee: Knee) -> Own:
    """Where searches begin; where the knee itself has no balance, at that of a near station."""
    q, meeting = own.q[0], own.meeting[0]
    known = np.flatnonzero(converged(own.status[0]))
    if not len(known):
        reference = _at_reference(knee)
        return np.broadcast_to(reference, q.shape), np.nan_to_num(meeting)
    nearest = known[np.abs(np.arange(len(q))[:, None] - known).argmin(axis=1)]
    return q[nearest], meeting[nearest]


def _counter(progress: Progress | None, total: int) -> Callable[[int], None]:
    done = 0

    def report(count: int) -> None:
        nonlocal done
        # Lost nodes are walked again.
        done = min(done + count, total)
        if progress is not None:
            progress(done, total)

    return report


def _walk_all(walker: Walker, rows: Paths, give_up: int) -> None:
    """Deal the paths to threads; arguments as in `Walker.walk`."""
    count = len(rows)
    if not count:
        return
    least, longest = (walker.lanes * size for size in _LOT)
    most = min(max(-(-count // 2), least), longest)
    # Neighbours are alike, and the hard ones would all be in the last lot.
    lots = -(-count // most)
    lots = [rows.take(slice(i, None, lots)) for i in range(lots)]
    on_all_cores(lambda lot: walker.walk(lot, give_up), lots)
