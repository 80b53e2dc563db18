"""Which nodes predict each other: rows of variants at stations, and what is found at them.

Distances are from the motion of the knee itself, the own motion.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from kneejax.statics._status import Status, converged
from kneejax.statics.walk._routes import Chain

#: Free coordinates `(stations, free)` and meeting points `(stations, n, 2)` of the own motion.
Own = tuple[np.ndarray, np.ndarray]


@dataclasses.dataclass(frozen=True)
class Found:
    """What is known of every variant at every station, filled in place; arrays begin with both.

    Attributes:
        own: motion from which distances are predicted.
        q: `(variants, stations, free)`, NaN where there is no balance.
        meeting: `(variants, stations, n, 2)`, likewise.
        status: `Status` values.
        steps: Newton steps taken, of all searches.
        share: part of the stride to a lost node at which the last balance was.
        softness: see `softness_of`, at the last balance before a node or where the search ended.
        fault: see `Settled`, of the last search; `NOT_CONVERGED` where nothing was searched.
        holding: what holds the balances, fields of `Settled` by name, `(variants, stations, ...)`;
            None where nobody asks.
    """

    own: Own
    q: np.ndarray
    meeting: np.ndarray
    status: np.ndarray
    steps: np.ndarray
    share: np.ndarray
    softness: np.ndarray
    fault: np.ndarray
    holding: dict[str, np.ndarray] | None = None

    @classmethod
    def nothing(
        cls, variants: int, own: Own, holding: dict[str, np.ndarray] | None = None
    ) -> Found:
        """Nothing known yet: every node counts as not balanced."""
        size = variants, len(own[0])
        return cls(
            own,
            np.full((*size, own[0].shape[1]), np.nan),
            np.full((*size, *own[1].shape[1:]), np.nan),
            np.full(size, int(Status.NOT_CONVERGED), np.int8),
            np.zeros(size, np.int32),
            np.zeros(size),
            np.full(size, np.nan),
            np.full(size, int(Status.NOT_CONVERGED), np.int8),
            holding,
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
        source: variant from which it is predicted, -1 for the knee itself, `(paths,)`.
        q: how far the first node is expected from the own motion, `(paths, free)`.
        meeting: likewise, `(paths, n, 2)`; NaN where it is not known.
    """

    variant: np.ndarray
    station: np.ndarray
    length: np.ndarray
    origin: np.ndarray
    source: np.ndarray
    q: np.ndarray
    meeting: np.ndarray

    def __len__(self) -> int:
        return len(self.length)

    def take(self, rows) -> Paths:
        """Some of the paths."""
        return Paths(*(getattr(self, f.name)[rows] for f in dataclasses.fields(self)))


def paths(
    found: Found, variant, station, length, q=0.0, meeting=np.nan, origin=None, source=None,
) -> Paths:  # fmt: skip
    """Paths whose first node is expected so far from the own motion, as at the origin."""
    count, patches, free = len(length), found.meeting.shape[2], found.q.shape[2]
    return Paths(
        variant,
        station,
        length,
        station[:, :1].reshape(-1) if origin is None else origin,
        variant[:, :1].reshape(-1) if source is None else source,
        np.broadcast_to(q, (count, free)),
        np.broadcast_to(meeting, (count, patches, 2)),
    )


def single_nodes(found: Found, variants: np.ndarray, near: Own | None) -> Paths:
    """Some variants at all stations, each a path of one node.

    Args:
        found: so far.
        variants: rows.
        near: where each node is expected, `(variants, stations, ...)`; the own motion by default.
    """
    size = found.status.shape[1]
    variant, station = (
        x.reshape(-1, 1) for x in np.meshgrid(variants, np.arange(size), indexing="ij")
    )
    one = np.ones(len(variant), int)
    if near is None:
        itself = np.full(len(variant), -1)
        return paths(found, variant, station, one, meeting=0.0, source=itself)
    return paths(found, variant, station, one, *_away(found, *near))


def along_chains(
    found: Found, chains: Sequence[Chain], variants: np.ndarray, again: bool = True
) -> Paths:
    """Some variants along chains of stations.

    Args:
        found: so far; where a variant is not balanced at the origin, the chain is not walked.
        chains: at least one.
        variants: rows.
        again: whether chains whose first node is balanced already are walked all the same.

    Returns:
        The paths, chain after chain.
    """
    longest = max(max(len(chain.nodes) for chain in chains), 1)
    stations = np.array([np.resize(chain.nodes or (chain.origin,), longest) for chain in chains])
    origin = np.repeat([chain.origin for chain in chains], len(variants))
    length = np.repeat([len(chain.nodes) for chain in chains], len(variants))
    variant = np.tile(variants, len(chains))
    begins = found.known[variant, origin]
    if not again:
        begins &= ~found.known[variant, np.repeat(stations[:, 0], len(variants))]
    q, meeting = (
        np.nan_to_num(here[variant, origin] - own[origin])
        for here, own in zip((found.q, found.meeting), found.own, strict=True)
    )
    return paths(
        found,
        np.broadcast_to(variant[:, None], (len(variant), longest)),
        np.repeat(stations, len(variants), axis=0),
        np.where(begins, length, 0),
        q,
        meeting,
        origin,
    )


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
    return paths(
        found, variant, station, np.repeat(length, size), *away, source=np.repeat(middle, size)
    )


def _away(found: Found, q: np.ndarray, meeting: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far poses `(rows, stations, ...)` are from the own motion; none where they are lost."""
    lost = np.asarray(np.isnan(q).any(axis=-1)).reshape(-1)
    away_q = (q - found.own[0]).reshape(-1, q.shape[-1])
    away_meeting = (meeting - found.own[1]).reshape(len(lost), *meeting.shape[2:])
    return (
        np.where(lost[:, None], 0.0, away_q),
        np.where(lost[:, None, None], np.nan, away_meeting),
    )


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
