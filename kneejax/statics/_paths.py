"""Which nodes predict each other: rows of variants at stations, and what is found at them.

Distances are from the motion of the knee itself, the own motion.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from kneejax.statics._status import Status, converged

#: Coordinates `(stations, 5)` and meeting points `(stations, n, 2)` of the own motion.
Own = tuple[np.ndarray, np.ndarray]


@dataclasses.dataclass(frozen=True)
class Found:
    """What is known of every variant at every station, filled in place; arrays begin with both.

    Attributes:
        own: motion from which distances are predicted.
        q: `(variants, stations, 5)`, NaN where there is no balance.
        meeting: `(variants, stations, n, 2)`, likewise.
        status: `Status` values.
        steps: Newton steps taken, of all searches.
    """

    own: Own
    q: np.ndarray
    meeting: np.ndarray
    status: np.ndarray
    steps: np.ndarray

    @classmethod
    def nothing(cls, variants: int, own: Own) -> Found:
        """Nothing known yet: every node counts as not balanced."""
        size = variants, len(own[0])
        return cls(
            own,
            np.full((*size, 5), np.nan),
            np.full((*size, *own[1].shape[1:]), np.nan),
            np.full(size, int(Status.NOT_CONVERGED), np.int8),
            np.zeros(size, np.int32),
        )

    @property
    def known(self) -> np.ndarray:
        """Where forces balance, `(variants, stations)`."""
        return converged(self.status)


@dataclasses.dataclass(frozen=True)
class Paths:
    """Rows of nodes; all arrays begin with the path.

    Attributes:
        variant: of each node, `(paths, nodes)`.
        station: of each node, `(paths, nodes)`.
        length: nodes of each path, the others are not walked, `(paths,)`.
        origin: station from which the first node is predicted, `(paths,)`.
        q: how far the first node is expected from the own motion, `(paths, 5)`.
        meeting: likewise, `(paths, n, 2)`; NaN where it is not known.
    """

    variant: np.ndarray
    station: np.ndarray
    length: np.ndarray
    origin: np.ndarray
    q: np.ndarray
    meeting: np.ndarray

    def __len__(self) -> int:
        return len(self.length)

    def take(self, rows) -> Paths:
        """Some of the paths."""
        return Paths(*(getattr(self, f.name)[rows] for f in dataclasses.fields(self)))


def paths(found: Found, variant, station, length, q=0.0, meeting=np.nan, origin=None) -> Paths:
    """Paths whose first node is expected so far from the own motion, as at the origin."""
    count, patches = len(length), found.meeting.shape[2]
    return Paths(
        variant,
        station,
        length,
        station[:, :1].reshape(-1) if origin is None else origin,
        np.broadcast_to(q, (count, 5)),
        np.broadcast_to(meeting, (count, patches, 2)),
    )


def nodes_at(found: Found, variants: np.ndarray, stations: np.ndarray) -> Paths:
    """Single nodes, each a path."""
    one = np.ones(len(variants), int)
    return paths(found, variants[:, None], stations[:, None], one, meeting=0.0)


def single_nodes(found: Found, variants: np.ndarray, near: Own | None) -> Paths:
    """Some variants at all stations, each a path of one node."""
    size = found.status.shape[1]
    variant, station = (
        x.reshape(-1, 1) for x in np.meshgrid(variants, np.arange(size), indexing="ij")
    )
    one = np.ones(len(variant), int)
    if near is None:
        return paths(found, variant, station, one, meeting=0.0)
    return paths(found, variant, station, one, *_away(found, *near))


def along(found: Found, station: np.ndarray, origin: np.ndarray | None = None) -> Paths:
    """Rows of stations of the first variant.

    Args:
        found: so far.
        station: of each node, `(paths, nodes)`.
        origin: station beside which a path begins, `(paths,)`; where the knee is not balanced
            there, the path is not walked. By default paths begin at their own first stations.

    Returns:
        The paths.
    """
    variant, length = np.zeros_like(station), np.full(len(station), station.shape[1])
    if origin is None:
        return paths(found, variant, station, length)
    length[~found.known[0, origin]] = 0
    q, meeting = (
        np.nan_to_num(here[0, origin] - own[origin])
        for here, own in zip((found.q, found.meeting), found.own, strict=True)
    )
    return paths(found, variant, station, length, q, meeting, origin)


def arms(found: Found, middle: np.ndarray, points: int, way: int) -> Paths:
    """From the middle of each line to one of its ends, at each station."""
    size = found.status.shape[1]
    place = middle % points
    length = points - 1 - place if way > 0 else place
    # A line of a single point has arms of no length, on one node that is never walked.
    walked = np.minimum(np.arange(1, max(points, 2)), length[:, None])
    variant = np.repeat(middle[:, None] + way * walked, size, axis=0)
    station = np.broadcast_to(np.tile(np.arange(size), len(middle))[:, None], variant.shape)
    away = _away(found, found.q[middle], found.meeting[middle])
    return paths(found, variant, station, np.repeat(length, size), *away)


def _away(found: Found, q: np.ndarray, meeting: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far poses `(rows, stations, ...)` are from the own motion; none where they are lost."""
    lost = np.asarray(np.isnan(q).any(axis=-1)).reshape(-1)
    away_q = (q - found.own[0]).reshape(-1, 5)
    away_meeting = (meeting - found.own[1]).reshape(-1, *meeting.shape[2:])
    return (
        np.where(lost[:, None], 0.0, away_q),
        np.where(lost[:, None, None], np.nan, away_meeting),
    )


def gaps(
    found: Found, segments: list[np.ndarray], ways: tuple[int, ...] = (1, -1), inner: bool = False
) -> Paths:
    """Rows of stations that are not balanced, beginning beside one that is.

    Args:
        found: so far.
        segments: of stations; no row leads from one to another.
        ways: 1 for rows to later stations, -1 for rows to earlier ones.
        inner: only those that end beside a balanced station as well.

    Returns:
        The paths.
    """
    follows = np.zeros(found.status.shape[1] + 1, bool)
    for segment in segments:
        follows[segment[1:]] = True
    return joined(*(_gaps(found, follows, way, inner) for way in ways))


def _gaps(found: Found, follows: np.ndarray, way: int, inner: bool) -> Paths:
    known, follows = found.known[:, ::way], follows[:-1] if way > 0 else follows[:0:-1]
    variants, size = known.shape
    # Nodes until the next one that is known, or to the end of the segment.
    length, ends_known = np.zeros((2, variants, size + 1), int)
    goes_on = np.append(follows[1:], False)
    for s in range(size - 1, -1, -1):
        length[:, s] = np.where(known[:, s], 0, 1 + goes_on[s] * length[:, s + 1])
        ends_known[:, s] = known[:, s] | (goes_on[s] & ends_known[:, s + 1])
    begins = known[:, :-1] & ~known[:, 1:] & follows[1:]
    if inner:
        begins &= ends_known[:, 1:-1] > 0
    row, before = np.nonzero(begins)
    length = length[row, before + 1]
    along = before[:, None] + 1 + np.arange(max(length, default=1))
    station = np.minimum(along, size - 1)
    if way < 0:
        station, before = size - 1 - station, size - 1 - before
    variant = np.broadcast_to(row[:, None], station.shape)
    q, meeting = (
        here[row, before] - own[before]
        for here, own in zip((found.q, found.meeting), found.own, strict=True)
    )
    return paths(found, variant, station, length, q, meeting, before)


def joined(*parts: Paths) -> Paths:
    """All of several kinds of paths."""
    fields = [f.name for f in dataclasses.fields(Paths)]
    longest = max(part.station.shape[1] for part in parts)

    def stretched(x: np.ndarray) -> np.ndarray:
        return np.pad(x, ((0, 0), (0, longest - x.shape[1])), "edge")

    even = [
        dataclasses.replace(part, variant=stretched(part.variant), station=stretched(part.station))
        for part in parts
    ]
    return Paths(*(np.concatenate([getattr(part, name) for part in even]) for name in fields))
