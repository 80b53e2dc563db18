"""Many balances: any parameters, any stations, on all cores, in order, in bounded memory.

Nodes (a variant at a station) are laid out in paths along which one pose predicts the next, and the
paths are dealt to threads in lots of a fixed size: answers depend neither on the number of cores
nor on who was first.
"""

from __future__ import annotations

import concurrent.futures
import dataclasses
import os
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from kneejax.mechanics import Knee, Load
from kneejax.statics._stations import Stations
from kneejax.statics._status import Status
from kneejax.statics._walk import LANES, Found, Paths, Vary, Walker

#: Called with how many balances are done, and of how many.
Progress = Callable[[int, int], None]

#: Paths of a lot, at least and at most.
_LOT = (2 * LANES, 8 * LANES)
#: Lost nodes in a row after which a path is given up. Along stations the next ones may well
#: balance (a knee too tight in extension); beyond the end of a branch nothing does.
_ALONG_STATIONS, _ALONG_VALUES = 5, 2
#: Flexion between two nodes on the way from the reference pose, rad, and steps of a load.
_STRIDE, _LOAD_STEPS = np.deg2rad(5.0), 4


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
        return self.status < Status.TOO_DEEP


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

    Each variant walks along the stations, predicted from its distance to the motion of the knee
    itself.

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
    walker = _walker(knee, vary, base, values, stations, own, progress)
    _walk_all(walker, _along_stations(walker), _ALONG_STATIONS)
    # What was not reached on the way up may be reached from above.
    _walk_all(walker, _gaps(walker, -1), _ALONG_STATIONS)
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
    walker = _walker(knee, vary, base, flat, stations, own, progress)
    middle = np.arange(lines) * points + np.asarray(begin, int)
    _walk_all(walker, _single_nodes(walker, middle, near), _ALONG_VALUES)
    up, down = (_arms(walker, middle, points, way) for way in (1, -1))
    _walk_all(walker, _joined(up, down), _ALONG_VALUES)
    for way in (1, -1):
        _walk_all(walker, _gaps(walker, way), _ALONG_VALUES)
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
    """
    stations = stations.plain()
    size, start = len(stations), float(knee.reference_pose.flexion)
    flexion, loads = np.asarray(stations.flexion), jax.tree.map(np.asarray, stations.loads)
    bends = max(int(np.ceil(np.max(np.abs(flexion - start), initial=0.0) / _STRIDE)), 1)
    grows = _LOAD_STEPS * any(x.any() for load in loads for x in (load.force, load.moment))
    steps = bends + grows
    bent = np.tile(np.minimum(np.arange(steps + 1) / bends, 1.0), size)
    loaded = np.tile(np.maximum(np.arange(steps + 1) - bends, 0) / max(grows, 1), size)
    last = jax.tree.map(lambda x: np.repeat(x, steps + 1, axis=0), (flexion, loads))
    way = Stations(start + bent * (last[0] - start), tuple(_part(x, loaded) for x in last[1]))
    found = Found.nothing(knee, 1, len(way))
    reference = np.array([float(x) for x in knee.reference_pose.state])
    rest = (np.broadcast_to(reference, (len(way), 5)), np.zeros(found.meeting.shape[1:]))
    one = jax.tree.map(lambda x: np.asarray(x)[None], base)
    walker = Walker(knee, vary, one, way, rest, found, lambda _: None)
    station = np.arange(len(way)).reshape(size, steps + 1)
    paths = _paths(walker, np.zeros_like(station), station, np.full(size, steps + 1))
    _walk_all(walker, paths, _ALONG_STATIONS)
    ends = station[:, -1]
    return Balances(*(x[:, ends] for x in (found.q, found.meeting, found.status, found.steps)))


def _part(load: Load, part: np.ndarray) -> Load:
    return dataclasses.replace(
        load, force=part[:, None] * load.force, moment=part[:, None] * load.moment
    )


def _walker(knee, vary, base, values, stations, own: Balances | None, progress) -> Walker:
    variants, size = len(jax.tree.leaves(values)[0]), len(stations)
    start = _filled(own or own_motion(knee, vary, base, stations), knee)
    found = Found.nothing(knee, variants, size)
    report = _counter(progress, variants * size)
    return Walker(knee, vary, values, stations.plain(), start, found, report)


def _filled(own: Balances, knee: Knee) -> tuple[np.ndarray, np.ndarray]:
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


def _walk_all(walker: Walker, paths: Paths, give_up: int) -> None:
    """Deal the paths to threads."""
    count = len(paths)
    size = int(np.clip(-(-count // 4), *_LOT))
    lots = [paths.take(slice(i, i + size)) for i in range(0, count, size)]
    if len(lots) < 2:
        for lot in lots:
            walker.walk(lot, give_up)
        return
    # One thread more than cores: while one prepares its call in Python another computes (a map of
    # 101 x 101 points on two cores: 3.4 instead of 3.9 s).
    with concurrent.futures.ThreadPoolExecutor((os.cpu_count() or 1) + 1) as pool:
        # Ctrl-C or an error in one lot must not wait for all the others.
        futures = [pool.submit(walker.walk, lot, give_up) for lot in lots]
        try:
            for future in futures:
                future.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _paths(walker: Walker, variant, station, length, q=0.0, meeting=np.nan) -> Paths:
    """Paths whose first node is expected so far from the own motion."""
    count, patches = len(length), walker.found.meeting.shape[2]
    return Paths(
        variant,
        station,
        length,
        np.broadcast_to(q, (count, 5)),
        np.broadcast_to(meeting, (count, patches, 2)),
    )


def _along_stations(walker: Walker) -> Paths:
    """Each variant along all stations, from the own motion."""
    count, size = walker.found.status.shape
    variant = np.broadcast_to(np.arange(count)[:, None], (count, size))
    station = np.broadcast_to(np.arange(size), (count, size))
    return _paths(walker, variant, station, np.full(count, size), meeting=0.0)


def _single_nodes(walker: Walker, variants: np.ndarray, near: Balances | None) -> Paths:
    """Some variants at all stations, each a path of one node."""
    size = walker.found.status.shape[1]
    variant, station = (
        x.reshape(-1, 1) for x in np.meshgrid(variants, np.arange(size), indexing="ij")
    )
    one = np.ones(len(variant), int)
    if near is None:
        return _paths(walker, variant, station, one, meeting=0.0)
    return _paths(walker, variant, station, one, *_away(walker, near.q, near.meeting))


def _arms(walker: Walker, middle: np.ndarray, points: int, way: int) -> Paths:
    """From the middle of each line to one of its ends, at each station."""
    size = walker.found.status.shape[1]
    place = middle % points
    length = points - 1 - place if way > 0 else place
    walked = np.minimum(np.arange(1, points), length[:, None])
    variant = np.repeat(middle[:, None] + way * walked, size, axis=0)
    station = np.broadcast_to(np.tile(np.arange(size), len(middle))[:, None], variant.shape)
    away = _away(walker, walker.found.q[middle], walker.found.meeting[middle])
    return _paths(walker, variant, station, np.repeat(length, size), *away)


def _away(walker: Walker, q: np.ndarray, meeting: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far poses `(rows, stations, ...)` are from the own motion; none where they are lost."""
    lost = np.asarray(np.isnan(q).any(axis=-1)).reshape(-1)
    away_q = (q - walker.own[0]).reshape(-1, 5)
    away_meeting = (meeting - walker.own[1]).reshape(-1, *meeting.shape[2:])
    return (
        np.where(lost[:, None], 0.0, away_q),
        np.where(lost[:, None, None], np.nan, away_meeting),
    )


def _gaps(walker: Walker, way: int) -> Paths:
    """Rows of stations that are not balanced, beginning beside one that is."""
    known = walker.found.known[:, ::way]
    variants, size = known.shape
    length = np.zeros((variants, size + 1), int)
    for s in range(size - 1, -1, -1):
        length[:, s] = np.where(known[:, s], 0, 1 + length[:, s + 1])
    row, before = np.nonzero(known[:, :-1] & ~known[:, 1:])
    length = length[row, before + 1]
    along = before[:, None] + 1 + np.arange(max(length, default=1))
    station = np.minimum(along, size - 1)
    if way < 0:
        station, before = size - 1 - station, size - 1 - before
    variant = np.broadcast_to(row[:, None], station.shape)
    q, meeting = (
        here[row, before] - own[before]
        for here, own in zip((walker.found.q, walker.found.meeting), walker.own, strict=True)
    )
    return _paths(walker, variant, station, length, q, meeting)


def _joined(*parts: Paths) -> Paths:
    fields = [f.name for f in dataclasses.fields(Paths)]
    return Paths(*(np.concatenate([getattr(part, name) for part in parts]) for name in fields))
