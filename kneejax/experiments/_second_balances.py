"""Balances of a knee that was changed, as by a cut, reached from those of the knee before."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import jax
import numpy as np

from kneejax.geometry import scales
from kneejax.mechanics import Knee
from kneejax.statics import LoadCases, balance_near, converged, itself, sound

#: Fields of a balance from which a search begins.
GUESSED = "q", "contact_points"
#: Balances farther apart than this are two, mm (rotations at 30 mm).
APART_MM = 1.0
#: Neighbours farther apart than this may lie on two branches, mm (rotations at 30 mm).
_JUMP_MM = 2.0
#: Parts of the change that are still missing, one search each. A ligament of a hundredth of its
#: stiffness still holds a knee that nothing else holds.
_MISSING = 0.1, 0.01, 0.0


def changed_in_steps(
    before: Knee, knee: Knee, load_cases: LoadCases, begin: Sequence[np.ndarray]
) -> dict[str, np.ndarray] | None:
    """Balances of a knee under loads under which another one balances, whose numbers turn into its
    own in steps: the cutting of a ligament, while the loads act.

    Args:
        before: the other knee, of the same structure.
        knee: that was changed.
        load_cases: what acts and is prescribed.
        begin: balances of the other knee: `GUESSED`, arrays begin with the load case.

    Returns:
        Fields of the balances as `Equilibria.in_nodes` has them, and `reached`; None where the
        knees are not of one structure. A stable balance is that which the knee comes to rest in
        when it is changed so slowly; where that one vanishes on the way, the one that is found
        next.
    """
    if not _alike(before, knee):
        return None
    begin, nodes = [np.array(x) for x in begin], None
    for missing in _MISSING:
        part = jax.tree.map(lambda a, b, m=missing: _between(a, b, m), before, knee)
        found = balance_near(part, itself, np.zeros(1), load_cases, *(x[None] for x in begin))
        nodes = found.in_nodes() | {"reached": np.asarray(found.reached[0])}
        # What was lost is sought again from where it was last.
        good = np.asarray(converged(nodes["status"]))
        for values, name in zip(begin, GUESSED, strict=True):
            values[good] = nodes[name][good]
    return nodes


def _alike(one: Knee, other: Knee) -> bool:
    leaves = [jax.tree.flatten(knee) for knee in (one, other)]
    shapes = [[np.shape(x) for x in own] for own, _ in leaves]
    return leaves[0][1] == leaves[1][1] and shapes[0] == shapes[1]


def _between(a, b, missing: float):
    """A number of the knee, with a part of the change still missing; infinite ones stay so."""
    a, b = np.asarray(a), np.asarray(b)
    if not (missing and np.issubdtype(b.dtype, np.floating)):
        return b
    known = np.isfinite(a) & np.isfinite(b) & (a != b)
    return np.where(known, missing * np.where(known, a, 0.0) + (1.0 - missing) * b, b)


def second_of(
    load_cases: LoadCases, main: dict[str, np.ndarray], other: dict[str, np.ndarray]
) -> np.ndarray:
    """Where a stable balance lies apart from the one that is reported, `(load_cases,)`.

    Args:
        load_cases: of both.
        main: fields of the balances that are reported, `q` and `status`.
        other: likewise, of those found in another way.
    """
    units = np.array(scales(load_cases.free))
    apart = np.abs((main["q"] - other["q"]) / units).max(axis=-1)
    known = np.asarray(sound(other["status"]))
    return known & ~(np.asarray(converged(main["status"])) & (apart <= APART_MM))


def follow_second(
    knee: Knee,
    load_cases: LoadCases,
    main: Mapping[str, np.ndarray],
    second: dict[str, np.ndarray],
    lines: np.ndarray,
) -> None:
    """Follow second balances from neighbour to neighbour, as far as there are some. Where what is
    reported jumps, each side is tried as the second balance of the other.

    Args:
        knee: that balances.
        load_cases: what acts and is prescribed.
        main: fields of the balances that are reported: `GUESSED` and `status`.
        second: `GUESSED` of the second ones, NaN where none is known; written to.
        lines: rows of load cases that follow each other, `(lines, length)`.
    """
    units = np.array(scales(load_cases.free))
    pairs = [(a, b) for line in lines for a, b in zip(line[:-1], line[1:], strict=True)]
    pairs += [(b, a) for a, b in pairs]
    untried = np.asarray(np.isnan(second["q"]).any(axis=1))
    while True:
        source: dict[int, dict[str, np.ndarray]] = {}
        for row, by in pairs:
            known = not np.isnan(second["q"][by]).any()
            apart = np.abs((main["q"][by] - main["q"][row]) / units).max()
            if untried[row] and row not in source and (known or apart > _JUMP_MM):
                source[row] = {x: (second if known else main)[x][by] for x in GUESSED}
        if not source:
            return
        rows = np.array([*source])
        untried[rows] = False
        begin = [np.stack([one[name] for one in source.values()])[None] for name in GUESSED]
        at = jax.tree.map(lambda x, r=rows: np.asarray(x)[r], load_cases)
        found = balance_near(knee, itself, np.zeros(1), at, *begin).in_nodes()
        here = second_of(at, {name: main[name][rows] for name in ("q", "status")}, found)
        for name, values in second.items():
            values[rows[here]] = found[name][here]
