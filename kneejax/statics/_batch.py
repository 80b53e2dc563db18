"""Many balances: any parameters, any stations, on all cores, in order, in bounded memory.

Nodes (a variant at a station) are laid out in paths along which one pose predicts the next, and the
paths are dealt to threads in lots of a fixed size: answers depend neither on the number of cores
nor on who was first.
"""

from __future__ import annotations

import concurrent.futures
import copy
import dataclasses
import os
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from kneejax.mechanics import Knee, Load
from kneejax.statics._newton import UNITS
from kneejax.statics._paths import (
    Found,
    Own,
    Paths,
    along,
    arms,
    gaps,
    joined,
    nodes_at,
    paths,
    single_nodes,
)
from kneejax.statics._settle import needs_float64
from kneejax.statics._stations import Stations
from kneejax.statics._status import converged
from kneejax.statics._variants import Variants, Vary
from kneejax.statics._walk import LANES, Walker

#: Called with how many balances are done, and of how many.
Progress = Callable[[int, int], None]

#: Paths of a lot, at least and at most.
_LOT = (2 * LANES, 8 * LANES)
#: Lost nodes in a row after which a path is given up. Along stations the next ones may well
#: balance (a knee too tight in extension); beyond the end of a branch nothing does.
_ALONG_STATIONS, _ALONG_VALUES, _ALONG_THE_STEM = 5, 2, 6
#: Flexion between two nodes on the way from the reference pose, rad; where that leads nowhere; and
#: steps of a load.
_STRIDE, _SHORT_STRIDE, _LOAD_STEPS = np.deg2rad(5.0), np.deg2rad(1.0), 4
#: Steps in which the knee itself is changed into a variant that is far from it.
_CHANGES = 8
#: So many at a time, to bound memory.
_LINES = 1024


@dataclasses.dataclass(frozen=True)
class Balances:
    """Balanced poses of variants at stations; arrays begin with the axes of the values.

    Attributes:
        q: free coordinates `(variants, stations, 5)`, rad and mm; NaN where there is no balance.
        meeting: parameters of the meeting points, `(variants, stations, n, 2)`.
        status: `Status` values, `(variants, stations)`.
        steps: Newton steps taken, `(variants, stations)`.
    """

    q: np.ndarray
    meeting: np.ndarray
    status: np.ndarray
    steps: np.ndarray

    @property
    def table(self) -> np.ndarray:
        """Free coordinates in degrees and mm, `(variants, stations, 5)`."""
        return self.q * np.r_[np.rad2deg([1.0, 1.0]), 1.0, 1.0, 1.0]

    @property
    def converged(self) -> np.ndarray:
        """Where forces balance, `(variants, stations)`."""
        return converged(self.status)


def balance_many(
    knee: Knee,
    vary: Vary,
    base: Any,
    values: Any,
    stations: Stations,
    *,
    own: Balances | None = None,
    progress: Progress | None = None,
) -> Balances:
    """Balance variants of a knee at stations.

    Each variant is led onto the knee's own branch at one station and walks from there along the
    others, predicted from its distance to the motion of the knee itself.

    Args:
        knee: gives all numbers that do not vary.
        vary: makes a variant: `(knee, value) -> knee` of the same structure, hashable, e.g. the
            bound method `selection.apply`.
        base: the value of the knee itself.
        values: like `base`, with a leading axis `(variants, ...)`.
        stations: in an order in which neighbours are near each other.
        own: the knee's own motion (`own_motion`) if it is known; computed by default.
        progress: called now and then with balances done and asked for.

    Returns:
        The balances, in order.

    Raises:
        RuntimeError: float64 is switched off.
    """
    own = own or own_motion(knee, vary, base, stations)
    walker = _walker(knee, vary, values, stations, own, progress)
    _lead(walker, base, own.converged[0])
    for inner in (False, True):
        _walk_all(walker, gaps(walker.found, walker.segments, inner=inner), _ALONG_STATIONS)
    _fill_by_changing(walker, base)
    return _balances(walker, walker.found.status.shape[:1])


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
    own = own or own_motion(knee, vary, base, stations)
    walker = _walker(knee, vary, flat, stations, own, progress)
    middle = np.arange(lines) * points + np.asarray(begin, int)
    poses = None if near is None else (near.q, near.meeting)
    _walk_all(walker, single_nodes(walker.found, middle, poses), _ALONG_VALUES)
    up, down = (arms(walker.found, middle, points, way) for way in (1, -1))
    _walk_all(walker, joined(up, down), _ALONG_VALUES)
    for way in (1, -1):
        _walk_all(walker, gaps(walker.found, walker.segments, (way,)), _ALONG_VALUES)
    return _balances(walker, (lines, points))


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
    stations = stations.plain()
    found = _from_reference(knee, vary, base, stations, _STRIDE)
    lost = np.flatnonzero(~found.converged[0])
    if len(lost):
        finely = _from_reference(knee, vary, base, stations.take(lost), _SHORT_STRIDE)
        for name in ("q", "meeting", "status"):
            getattr(found, name)[:, lost] = getattr(finely, name)
        found.steps[:, lost] += finely.steps
    return found


def _from_reference(knee, vary, base, stations: Stations, stride: float) -> Balances:
    """The knee, bent and extended in strides that do not depend on the stations, and from there to
    each of them, first without its load."""
    start, flexion = float(knee.reference_pose.flexion), np.asarray(stations.flexion)
    strides = np.trunc((flexion - start) / stride).astype(int)
    arms = [way * np.arange(1 + np.max(way * strides, initial=0)) for way in (1, -1)]
    loaded = any(np.any(load.force) or np.any(load.moment) for load in stations.loads)
    grown = np.linspace(0.0, 1.0, _LOAD_STEPS + 1) if loaded else np.zeros(1)
    way = _way(start + stride * np.concatenate(arms), stations, grown)
    reference = np.array([float(x) for x in knee.reference_pose.state])
    still = np.tile(reference, (len(way), 1)), np.zeros((len(way), knee.patch_count, 2))
    found = Found.nothing(1, still)
    one = jax.tree.map(lambda x: np.asarray(x)[None], base)
    walker = Walker(Variants.of(knee, vary, one), way, found, lambda _: None)
    bent, extended, ends = np.split(np.arange(len(way)), np.cumsum([len(arm) for arm in arms]))
    stem = joined(along(found, bent[None]), along(found, extended[None]))
    _walk_all(walker, stem, _ALONG_THE_STEM)
    ends = ends.reshape(len(stations), len(grown))
    beside = np.where(strides < 0, extended[0], bent[0]) + np.abs(strides)
    _walk_all(walker, along(found, ends, beside), len(grown))
    last = ends[:, -1]
    return Balances(*(x[:, last] for x in (found.q, found.meeting, found.status, found.steps)))


def _way(stem: np.ndarray, stations: Stations, grown: np.ndarray) -> Stations:
    """Flexions of the stem without loads, then each station with growing parts of its loads."""
    every = np.repeat(np.arange(len(stations)), len(grown))
    part = np.r_[np.zeros(len(stem)), np.tile(grown, len(stations))][:, None]

    def growing(load: Load) -> Load:
        force, moment, point = (
            np.vstack([np.zeros((len(stem), 3)), np.asarray(x)[every]])
            for x in (load.force, load.moment, load.point)
        )
        return dataclasses.replace(
            load, force=part * force, moment=part * moment, point=(part > 0) * point
        )

    flexion = np.r_[stem, np.asarray(stations.flexion)[every]]
    return Stations(flexion, tuple(growing(load) for load in stations.loads))


def _walker(knee, vary, values, stations, own: Balances, progress) -> Walker:
    needs_float64()
    variants = Variants.of(knee, vary, values)
    found = Found.nothing(len(variants), _filled(own, knee))
    report = _counter(progress, len(variants) * len(stations))
    return Walker(variants, stations.plain(), found, report)


def _filled(own: Balances, knee: Knee) -> Own:
    """Where searches begin; where the knee itself has no balance, at that of a near station."""
    size = own.q.shape[1]
    known = np.flatnonzero(own.converged[0])
    if not len(known):
        reference = np.array([float(x) for x in knee.reference_pose.state])
        return np.broadcast_to(reference, (size, 5)), own.meeting[0]
    nearest = known[np.abs(np.arange(size)[:, None] - known).argmin(axis=1)]
    return own.q[0, nearest], own.meeting[0, nearest]


def _balances(walker: Walker, shape: tuple[int, ...]) -> Balances:
    found = walker.found
    arrays = (found.q, found.meeting, found.status, found.steps)
    return Balances(*(np.reshape(x, (*shape, *x.shape[1:])) for x in arrays))


def _counter(progress: Progress | None, total: int) -> Callable[[int], None]:
    done = 0

    def report(count: int) -> None:
        nonlocal done
        # Lost nodes are walked again.
        done = min(done + count, total)
        if progress is not None:
            progress(done, total)

    return report


def _walk_all(walker: Walker, rows: Paths, give_up: int, led_to: bool = True) -> None:
    """Deal the paths to threads."""
    count = len(rows)
    most = int(np.clip(-(-count // 2), *_LOT))
    # Neighbours are alike, and the hard ones would all be in the last lot.
    lots = max(-(-count // most), 1)
    lots = [rows.take(slice(i, None, lots)) for i in range(lots)]
    if len(lots) < 2:
        for lot in lots:
            walker.walk(lot, give_up, led_to)
        return
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        # Ctrl-C or an error in one lot must not wait for all the others.
        futures = [pool.submit(walker.walk, lot, give_up, led_to) for lot in lots]
        try:
            for future in futures:
                future.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _lead(walker: Walker, base: Any, balanced: np.ndarray) -> None:
    """Balance each variant at one station of each segment, on the branch of the knee itself.

    Where a short search from the own motion does not do, at any of three stations, the knee itself
    is changed into the variant step by step. A long search from afar may end on another branch,
    and all of the variant's motion with it; it is all that is left where the knee itself balances
    nowhere.
    """
    if not balanced.any():
        everyone = np.arange(len(walker.found.status))
        _walk_all(walker, single_nodes(walker.found, everyone, None), _ALONG_STATIONS)
        return
    choices = [
        dict.fromkeys(stations[int(part * len(stations))] for part in (0.5, 0.25, 0.75))
        for segment in walker.segments
        if len(stations := segment[balanced[segment]])
    ]
    ranks = [np.array(x) for x in zip(*(_padded(list(c)) for c in choices), strict=True)]
    for stations in ranks:
        nodes = _without_lead(walker, stations[stations >= 0])
        _walk_all(walker, nodes_at(walker.found, *nodes), _ALONG_VALUES, led_to=False)
    for stations in ranks:
        _change_into(walker, base, *_without_lead(walker, stations[stations >= 0]))


def _padded(stations: list[int]) -> list[int]:
    return stations + [-1] * (3 - len(stations))


def _without_lead(walker: Walker, stations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Variants at these stations that have no balance in all the segment yet."""
    row, place = np.nonzero(~_led(walker)[:, stations])
    return row, stations[place]


def _led(walker: Walker) -> np.ndarray:
    """Whether a variant has a balance in the segment of a station, `(variants, stations)`."""
    starts = [segment[0] for segment in walker.segments]
    led = np.logical_or.reduceat(walker.found.known, starts, axis=1)
    return np.repeat(led, [len(segment) for segment in walker.segments], axis=1)


def _fill_by_changing(walker: Walker, base: Any) -> None:
    """What walks have lost, from the knee itself; alone in its segment a node was led there."""
    alone = np.concatenate([np.full(len(s), len(s) == 1) for s in walker.segments])
    _change_into(walker, base, *np.nonzero(~walker.found.known & _led(walker) & ~alone))


def _change_into(walker: Walker, base: Any, variants: np.ndarray, stations: np.ndarray) -> None:
    """The knee itself, changed step by step into variants, each at a station."""
    for first in range(0, len(variants), _LINES):
        some = slice(first, first + _LINES)
        _change_some(walker, base, variants[some], stations[some])


def _change_some(walker: Walker, base: Any, variants: np.ndarray, stations: np.ndarray) -> None:
    part = np.arange(1, _CHANGES + 1) / _CHANGES

    way, found = copy.copy(walker), walker.found
    way.variants = walker.variants.between(base, variants, part)
    way.found = Found.nothing(len(variants) * _CHANGES, found.own)
    way.report = lambda _: None
    points = np.arange(len(variants) * _CHANGES).reshape(-1, _CHANGES)
    station = np.repeat(stations[:, None], _CHANGES, axis=1)
    lines = paths(way.found, points, station, np.full(len(points), _CHANGES), meeting=0.0)
    _walk_all(way, lines, _ALONG_VALUES)
    node, last = (variants, stations), (points[:, -1], stations)
    found.steps[node] += way.found.steps[last]
    reached = np.flatnonzero(way.found.known[last])
    while len(reached):
        here = variants[reached], stations[reached]
        joins = _joins(walker, here, way.found.q[last][reached])
        if not joins.any():
            return
        taken, here = reached[joins], (here[0][joins], here[1][joins])
        for name in ("q", "meeting", "status"):
            getattr(found, name)[here] = getattr(way.found, name)[last][taken]
        reached = reached[~joins]


def _joins(walker: Walker, node: tuple[np.ndarray, np.ndarray], q: np.ndarray) -> np.ndarray:
    """Whether poses carry on the motion of their variant: those known at the next stations of the
    segment are near, and there is one, or nothing in the segment is known."""
    (variant, station), found = node, walker.found
    beside_known, contradicted = np.zeros((2, len(variant)), bool)
    for way in (1, -1):
        beside = np.clip(station + way, 0, found.status.shape[1] - 1)
        reach = walker.reach(station, beside)
        change = (q - found.own[0][station]) - (found.q[variant, beside] - found.own[0][beside])
        known = found.known[variant, beside] & np.isfinite(reach)
        beside_known |= known
        contradicted |= known & (np.abs(change / UNITS).max(axis=1) > reach)
    return (beside_known | ~_led(walker)[node]) & ~contradicted
