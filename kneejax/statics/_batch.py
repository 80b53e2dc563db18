"""Variants at load cases, followed along paths in chunks of one width.

So fits, maps and cohorts of any size share one compiled program. Answers depend neither on the
number of cores nor on who was first.
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np

from kneejax.mechanics import Knee
from kneejax.numerics import compiled, on_all_cores
from kneejax.statics._continuation import Behind, follow
from kneejax.statics._equilibria import Equilibria, of_record, shapes_of_record
from kneejax.statics._flexion_paths import Chain
from kneejax.statics._load_cases import Case, LoadCases, Variants, in_rows

#: Paths side by side. Few are soon filled, many share what an operation costs by itself
#: (docs/performance.md). Over points one path by itself fills the processor.
LANES, _LANES_OVER_POINTS = 64, 8
#: Load cases of all paths from which on a program pays that runs a quarter faster and takes twice
#: the seconds to compile (docs/performance.md).
_MANY, _MANY_OVER_POINTS = 500_000, 10_000
_follow, _follow_many = compiled()(follow), compiled(effort="most")(follow)
#: Load cases ahead of each path in one call.
_AHEAD = 32
#: Paths for each one that a call leaves on its way, where others wait; likewise of one load case.
_ROOM, _ROOM_OF_ONE = 2, 8
#: Paths of a thread's lot, at least and at most, for each lane.
_LOT = (2, 8)

#: Called with paths, places on them, and their records by name, arrays that end in records.
Note = Callable[[np.ndarray, np.ndarray, dict[str, Any]], None]


def follow_in_chunks(
    knee: Knee,
    like: Case,
    cases: Callable[[np.ndarray, np.ndarray], np.ndarray],
    length: np.ndarray,
    behind: Behind,
    give_up: int,
    note: Note,
) -> None:
    """Follow paths to their ends.

    Args:
        knee: gives all numbers that do not vary.
        like: any case, without lanes.
        cases: rows of some paths at some of their places, both index arrays of one shape.
        length: load cases of each path, `(paths,)`.
        behind: what lies behind each; arrays of NumPy.
        give_up: load cases without an equilibrium in a row after which a path ends.
        note: called, by several threads, with what became of some load cases.
    """
    over_points, several = knee.patch_count < len(knee.contacts), length.max(initial=0) > 1
    lanes = _LANES_OVER_POINTS if over_points else LANES
    many = length.sum() >= (_MANY_OVER_POINTS if over_points else _MANY)
    program = _follow_many if many else _follow
    shapes = shapes_of_record(like.load_cases, knee.patch_count)
    ahead, room = np.arange(_AHEAD if several else 1)[:, None], _ROOM if several else _ROOM_OF_ONE

    def follow_lot(lot: np.ndarray) -> None:
        """Chunk after chunk of some paths, the longest first: lanes stay full to the end."""
        place, left = np.zeros(len(lot), int), length[lot]
        own: Behind = jax.tree.map(lambda x: x[..., lot], behind)
        while left.any():
            waiting = np.count_nonzero(left)
            rows = np.argsort(-left, kind="stable")[: min(lanes, waiting)]
            # Lanes beyond the rows have nothing ahead of them.
            lane = rows[np.minimum(np.arange(lanes), len(rows) - 1)]
            counts = np.where(np.arange(lanes) < len(rows), np.minimum(left[lane], _AHEAD), 0)
            at = place[lane] + np.minimum(ahead, np.maximum(counts - 1, 0))
            here = cases(np.broadcast_to(lot[lane], at.shape), at)
            # What is the same everywhere is looked up once.
            here = np.broadcast_to(here, (_AHEAD, *here.shape[1:]))
            # Where others wait, lanes that are through make room for them.
            fewest = lanes // room if waiting > len(rows) else 0
            before = jax.tree.map(lambda x, lane=lane: x[..., lane], own)
            log, after = program(knee, like, here, counts, before, give_up, fewest)
            log = np.asarray(log)
            when, by = np.nonzero(log[:, 0, : len(rows)] >= 0)
            record = of_record(log[when, :, by].T, shapes)
            note(lot[rows[by]], place[rows[by]] + record["place"].astype(int), record)
            place[rows] += np.bincount(by, minlength=len(rows))
            for old, new in zip(jax.tree.leaves(own), jax.tree.leaves(after), strict=True):
                old[..., rows] = np.asarray(new)[..., : len(rows)]
            left = np.where(own.failed < give_up, length[lot] - place, 0)

    count = len(length)
    size = np.clip(-(-count // 2), _LOT[0] * lanes, _LOT[1] * lanes)
    # Neighbours are alike, and the hard ones would all be in the last lot.
    lots = -(-count // size)
    on_all_cores(follow_lot, [np.arange(first, count, lots) for first in range(lots)])


class Batch:
    """Variants at load cases, and what is found of them.

    Attributes:
        found: the balances, `(variants, load_cases)`.
    """

    def __init__(
        self, variants: Variants, load_cases: LoadCases, forces: bool,
        report: Callable[[int], None],
    ):  # fmt: skip
        load_cases = jax.tree.map(np.asarray, load_cases)
        self.variants, self._report, self._free = variants, report, load_cases.free
        shape = len(variants), len(load_cases)
        self.found = Equilibria.nothing(shape, load_cases, variants.knee.patch_count, forces)
        numbers = {leaf: variants.numbers[leaf] for leaf in sorted(variants.numbers)}
        self._numbers = in_rows(numbers, 1) if numbers else np.zeros((0, 0))
        self._marks = in_rows(load_cases, 1)
        self._like = Case(*jax.tree.map(lambda x: np.zeros(x.shape[1:]), (numbers, load_cases)))

    def follow(
        self, variant, load_case, length, give_up: int, *, origin: tuple | None = None,
        near: tuple | None = None,
    ) -> None:  # fmt: skip
        """Follow paths of nodes.

        Args:
            variant: of each node, `(paths, nodes)`; likewise `load_case`.
            length: nodes of each path that count, `(paths,)`.
            give_up: see `follow_in_chunks`.
            origin: variants and load cases of the balances from which paths go on; without one
                there a path is not followed.
            near: without an origin, `q` and contact points near which paths begin; by default, and
                where they are NaN, the reference pose.
        """
        if origin is not None:
            begun = self.found.converged[origin]
            q, points = self.found.q[origin], self.found.contact_points[origin]
            length = np.where(begun, length, 0)
        else:
            knee, count = self.variants.knee, len(length)
            origin, begun = (variant[:, 0], load_case[:, 0]), np.zeros(count, bool)
            q, points = near or (
                np.full((count, len(self._free)), np.nan),
                np.full((count, knee.patch_count, 2), np.nan),
            )
            unknown = np.asarray(np.isnan(q).any(axis=-1))
            q = np.where(unknown[:, None], knee.at_reference.at(self._free), q)
            points = np.where(unknown[:, None, None], np.nan, points)

        def cases(path: np.ndarray, place: np.ndarray) -> np.ndarray:
            return self._rows_of(variant[path, place], load_case[path, place])

        def note(path: np.ndarray, place: np.ndarray, record: dict[str, Any]) -> None:
            self.found.note((variant[path, place], load_case[path, place]), record)
            self._report(len(path))

        q, points = np.moveaxis(q, 0, -1), np.moveaxis(points, 0, -1)
        behind = Behind.at(self._rows_of(*origin).T, q, points, begun.astype(int))
        follow_in_chunks(self.variants.knee, self._like, cases, length, behind, give_up, note)

    def _rows_of(self, variant, load_case) -> np.ndarray:
        return np.concatenate([self._numbers[variant], self._marks[load_case]], axis=-1)

    def follow_chains(
        self, chains: Sequence[Chain], variants: np.ndarray, give_up: int, *,
        anew: bool = True, from_reference: bool = False,
    ) -> None:  # fmt: skip
        """Some variants along chains of load cases, each from its origin, or from the reference
        pose; not anew: only those whose first load case is not known."""
        chains = [chain for chain in chains if chain.nodes]
        if not chains or not len(variants):
            return
        longest = max(len(chain.nodes) for chain in chains)
        rows, variant = np.divmod(np.arange(len(chains) * len(variants)), len(variants))
        variant = np.asarray(variants)[variant]
        load_case = np.array([np.resize(chain.nodes, longest) for chain in chains])[rows]
        length = np.array([len(chain.nodes) for chain in chains])[rows]
        if not anew:
            length = np.where(self.found.converged[variant, load_case[:, 0]], 0, length)
        origin = variant, np.array([chain.origin for chain in chains])[rows]
        nodes = np.broadcast_to(variant[:, None], load_case.shape)
        self.follow(nodes, load_case, length, give_up, origin=None if from_reference else origin)
