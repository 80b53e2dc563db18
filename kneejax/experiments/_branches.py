"""Branches of equilibria: second balances at one flexion, and what divides them."""

__all__ = ["Branch", "branches", "second_balances"]

import dataclasses
from collections.abc import Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from kneejax.experiments._curves import Curves
from kneejax.experiments._motion import Motion, apart_mm, balanced_near, in_rows, passive_flexion
from kneejax.geometry import COLUMNS, FREE_COORDINATES, scales, table_units
from kneejax.mechanics import Knee, Load, add_lane_axis
from kneejax.numerics import Named, compiled, needs_numbers
from kneejax.statics import (
    Equilibrium,
    Guess,
    LoadCases,
    Status,
    balance_one,
    converged,
    force,
    solve_equilibrium,
    sound,
)

#: Fields of a balance from which a search begins.
GUESSED = "q", "contact_points"
#: Neighbours farther apart than this may lie on two branches, mm (rotations at 30 mm).
_JUMP_MM = 2.0
#: Parts of the change that are still missing, one search each. A ligament of a hundredth of its
#: stiffness still holds a knee that nothing else holds.
_MISSING = 0.1, 0.01, 0.0


def guesses(equilibrium: Equilibrium) -> dict[str, np.ndarray]:
    """Its `GUESSED`, arrays begin with the load case."""
    return {x: np.moveaxis(np.asarray(getattr(equilibrium, x)), -1, 0) for x in GUESSED}


def changed_in_steps(
    before: Knee, knee: Knee, load_cases: LoadCases, begin: Sequence[np.ndarray]
) -> dict[str, np.ndarray] | None:
    """Balances, as `in_rows` has them, of a knee under loads under which another one balances,
    whose numbers turn into its own in steps: the cutting of a ligament, while the loads act.

    It begins at `GUESSED` of the other knee; None where the knees are not of one structure. A
    stable balance is that which the knee comes to rest in when it is changed so slowly; where that
    one vanishes on the way, the one that is found next.
    """
    (own, structure), (its, other) = jax.tree.flatten(before), jax.tree.flatten(knee)
    if structure != other or [*map(np.shape, own)] != [*map(np.shape, its)]:
        return None
    begin, found = [np.array(x) for x in begin], None
    for missing in _MISSING:
        part = jax.tree.map(lambda a, b, m=missing: _between(a, b, m), before, knee)
        found = in_rows(balanced_near(part, load_cases, begin))
        # What was lost is sought again from where it was last.
        good = np.asarray(converged(found["status"]))
        for values, name in zip(begin, GUESSED, strict=True):
            values[good] = found[name][good]
    return found


def _between(a, b, missing: float):
    """A number of the knee, with a part of the change still missing; infinite ones stay so."""
    a, b = np.asarray(a), np.asarray(b)
    if not (missing and np.issubdtype(b.dtype, np.floating)):
        return b
    known = np.isfinite(a) & np.isfinite(b) & (a != b)
    return np.where(known, missing * np.where(known, a, 0.0) + (1.0 - missing) * b, b)


class SecondBalances:
    """Stable balances beside those that are reported (`main`: `GUESSED` and `status`, arrays begin
    with the load case), as far as they are known: `found`, `GUESSED` too, NaN where none is."""

    #: Balances farther apart than this are two, mm (rotations at 30 mm).
    APART_MM = 1.0

    def __init__(self, knee: Knee, load_cases: LoadCases, main: Mapping[str, np.ndarray]):
        self._knee, self._load_cases, self.main = knee, load_cases, main
        self.found = {name: np.full_like(main[name], np.nan) for name in GUESSED}

    @property
    def known(self) -> np.ndarray:
        """Where there is one, `(load_cases,)`."""
        return ~np.isnan(self.found["q"]).any(axis=1)

    def poses(self, flexion_deg: np.ndarray) -> np.ndarray:
        """Where they are, degrees and mm, `(load_cases, 6)`, at these flexions; NaN likewise."""
        free = self.found["q"][:, : len(FREE_COORDINATES)] * table_units(FREE_COORDINATES)
        return np.c_[np.where(self.known, flexion_deg, np.nan), free]

    def add(self, rows: np.ndarray, other: Mapping[str, np.ndarray]) -> np.ndarray:
        """Keep what was found in another way at some load cases where it is stable and lies apart
        from what is reported, and say where that is, `(rows,)`."""
        apart = apart_mm(self._load_cases.free, self.main["q"][rows], other["q"])
        same = np.asarray(converged(self.main["status"][rows])) & (apart <= self.APART_MM)
        second = np.asarray(sound(other["status"])) & ~same
        for name, values in self.found.items():
            values[rows[second]] = other[name][second]
        return second

    def follow(self, lines: np.ndarray) -> None:
        """Follow them from neighbour to neighbour, as far as there are some. Where what is reported
        jumps, each side is tried as the second balance of the other.

        Rows of `lines` are load cases that follow each other, `(lines, length)`.
        """
        main, q = self.main, self.found["q"]
        pairs = [(a, b) for line in lines for a, b in zip(line[:-1], line[1:], strict=True)]
        pairs += [(b, a) for a, b in pairs]
        untried = ~self.known
        while True:
            source: dict[int, list[np.ndarray]] = {}
            for row, by in pairs:
                known = not np.isnan(q[by]).any()
                apart = apart_mm(self._load_cases.free, main["q"][by], main["q"][row])
                if untried[row] and row not in source and (known or apart > _JUMP_MM):
                    source[row] = [(self.found if known else main)[x][by] for x in GUESSED]
            if not source:
                return
            rows = np.array([*source])
            untried[rows] = False
            begin = map(np.stack, zip(*source.values(), strict=True))
            at = self._load_cases.take(rows)
            self.add(rows, balanced_near(self._knee, at, begin).in_nodes())


def second_balances(curves: Curves, before: Knee) -> np.ndarray:
    """Where a knee that was cut has a second stable balance under the loads of a test.

    A test finds what is connected with the unloaded knee. From the other side the intact knee is
    loaded first and cut then: at the ends of each curve and without the test's load. What is found
    there apart from the curve is followed along it, as far as it exists.

    Args:
        curves: of the knee that was cut.
        before: the knee before.

    Returns:
        Poses, degrees and mm, `(flexions, loads, 6)`; NaN where none is known, and in tests in
        which a machine moves or holds the tibia.
    """
    motion, nodes, part = curves.motion, curves.nodes, curves.part
    if curves.test.machine:
        return np.full((*nodes.shape, len(COLUMNS)), np.nan)
    zero = int(np.abs(part).argmin())
    ends = sorted({int(part.argmin()), zero, int(part.argmax())})
    load_cases = motion.load_cases.of(before).take(nodes.ravel())
    main = guesses(motion.equilibrium) | {"status": np.asarray(motion.status)}
    main = {name: values[nodes.ravel()] for name, values in main.items()}
    second = SecondBalances(motion.knee, load_cases, main)
    lines = np.arange(nodes.size).reshape(nodes.shape)
    rows = lines[:, ends].ravel()
    at = load_cases.take(rows)
    whole = {name: np.array(values) for name, values in balance_one(before, at).in_nodes().items()}
    good = np.asarray(converged(whole["status"]))
    # A loose knee snaps over on the way to its load: then what it snaps to from its neutral pose.
    rest = np.repeat(np.arange(len(nodes)) * len(ends) + ends.index(zero), len(ends))
    lost = np.flatnonzero(~good & good[rest])
    if len(lost):
        begin = [whole[name][rest[lost]] for name in GUESSED]
        snapped = balanced_near(before, at.take(lost), begin).in_nodes()
        for name in (*GUESSED, "status"):
            whole[name][lost] = snapped[name]
        good = np.asarray(converged(whole["status"]))
    if good.any():
        begin = [whole[name][good] for name in GUESSED]
        found = changed_in_steps(before, motion.knee, at.take(good), begin)
        if found is not None:
            second.add(rows[good], found)
    second.follow(lines)
    flexion = np.repeat(curves.test.flexion_deg, nodes.shape[1])
    return second.poses(flexion).reshape(*nodes.shape, len(COLUMNS))


#: How far from the balance that a test finds searches begin, degrees twice and mm thrice.
_SPREAD = np.array([10.0, 25.0, 12.0, 12.0, 8.0])
_IN_TABLE, _SCALES = 1.0 / table_units(FREE_COORDINATES), scales(FREE_COORDINATES)
#: Balances nearer than this to each other are one, mm.
_SAME_MM = 0.01
#: Unbalanced force that a balance may have, N (moments at 30 mm).
_LEFT_N = 1e-3
#: Searches of a call.
_LANES = 128


@dataclasses.dataclass(frozen=True)
class Branch(Named):
    """A stable balance.

    Attributes:
        load_case: its place among the flexions that were asked for.
        pose: degrees and mm, in the order of `kneejax.geometry.COLUMNS`, `(6,)`.
        status: of the pose.
        by_test: whether it is the one that a test finds: reached from the reference pose by
            bending without load and then loading.
        apart_mm: distance from that one, mm (rotations at 30 mm); NaN where a test finds none.
        starts: how many of the searches ended here.
    """

    load_case: int
    pose: np.ndarray
    status: Status
    by_test: bool
    apart_mm: float
    starts: int

    OVER = {"": {"load_case": "", "by_test": "", "apart_mm": "", "starts": ""}}

    def _named(self) -> dict[str, tuple]:
        poses = {name: ("", x) for name, x in zip(COLUMNS, self.pose, strict=True)}
        return poses | super()._named() | {"status": ("", self.status.word)}


def branches(
    knee: Knee, flexion_deg: ArrayLike, loads: tuple[Load, ...] | list[Load] = (), starts: int = 64
) -> tuple[Branch, ...]:
    """Look for every stable balance of a knee at prescribed flexion, not only the one of a test.

    A lax or injured knee may rest in several poses under the same load. Searches begin at poses
    spread evenly around the one that a test finds (by 10 and 25 degrees, 12, 12 and 8 mm), and at
    those that were found at the other angles, and run downhill in energy. What is found exists;
    that nothing else does, no search can tell.

    Args:
        knee: any knee.
        flexion_deg: prescribed angles, `(poses,)`.
        loads: as in `passive_flexion`.
        starts: searches at each angle.

    Returns:
        The balances in the order of the angles; at each that of a test first, then the nearest.

    Example:
        >>> import kneejax as kj
        >>> found = kj.branches(kj.load_knee("four_ligament"), [20.0], starts=4)
        >>> found[0].by_test
        True
    """
    needs_numbers("branches", "passive_flexion", knee, flexion_deg, loads)
    motion = passive_flexion(knee, flexion_deg, loads)
    load_cases = LoadCases.at(flexion_deg, loads)
    own = np.asarray(motion.to_table())
    found: list[list[Branch]] = [[] for _ in range(len(load_cases))]
    for load_case in np.flatnonzero(motion.stable).tolist():
        status = Status(int(motion.status[load_case]))
        found[load_case].append(Branch(load_case, own[load_case], status, True, 0.0, 0))
    row, q = np.repeat(np.arange(len(load_cases)), starts), _around(knee, motion, starts)
    while len(row):
        equilibrium, new = _searched(knee, load_cases, row, q), []
        table = np.asarray(equilibrium.pose.to_table())
        for lane in np.flatnonzero(equilibrium.stable):
            load_case, pose = int(row[lane]), table[lane]
            here = found[load_case]
            same = [i for i, b in enumerate(here) if _distance_mm(b.pose, pose) < _SAME_MM]
            if same:
                again = here[same[0]]
                here[same[0]] = dataclasses.replace(again, starts=again.starts + 1)
                continue
            apart, status = _distance_mm(own[load_case], pose), int(equilibrium.status[lane])
            here.append(Branch(load_case, pose, Status(status), False, apart, 1))
            new.append(here[-1])
        # What rests at one angle may rest at the others too.
        others = [(at, b) for b in new for at in range(len(load_cases)) if at != b.load_case]
        row = np.array([at for at, _ in others], int)
        q = np.array([branch.pose[1:] * _IN_TABLE for _, branch in others])
    for here in found:
        here.sort(key=lambda branch: (not branch.by_test, branch.apart_mm))
    return tuple(branch for here in found for branch in here)


def _around(knee: Knee, motion: Motion, starts: int) -> np.ndarray:
    """Coordinates at which searches begin, `(load_cases * starts, 5)`."""
    reference = np.asarray(knee.at_reference.at(FREE_COORDINATES))
    middle = np.asarray(motion.equilibrium.q).T
    middle = np.where(np.isfinite(middle), middle, reference)
    from scipy.stats import qmc  # half a second to import

    points = qmc.Sobol(5, scramble=False).random_base2((starts - 1).bit_length())[:starts]
    return (middle[:, None] + (2.0 * points - 1.0) * _SPREAD * _IN_TABLE).reshape(-1, 5)


def _searched(knee: Knee, load_cases: LoadCases, row: np.ndarray, q: np.ndarray) -> Equilibrium:
    """Searches downhill from coordinates `(searches, 5)`, each at one of the load cases."""
    parts = []
    for first in range(0, len(row), _LANES):
        # Filled up with the last one: one shape, one compilation.
        lanes = np.minimum(np.arange(first, first + _LANES), len(row) - 1)
        equilibrium = _search(knee, load_cases.take(row[lanes]), q[lanes].T)
        parts.append(jax.tree.map(np.asarray, equilibrium))
    return jax.tree.map(lambda *x: np.concatenate(x, axis=-1)[..., : len(row)], *parts)


@compiled()
def _search(knee: Knee, load_cases: LoadCases, q: jax.Array) -> Equilibrium:
    lanes, held = load_cases.load(add_lane_axis(knee)), load_cases.prescribed
    equilibrium = solve_equilibrium(lanes, held, Guess(q))
    # A search from afar may carry its contact points along to places where surfaces are close, but
    # not closest: what does not balance with points found anew is nothing.
    left, _ = force(lanes, held, equilibrium.q)
    left = jnp.max(jnp.abs(left * jnp.asarray(_SCALES)[:, None]), axis=0)
    status = jnp.where(left < _LEFT_N, equilibrium.status, int(Status.NOT_CONVERGED))
    return dataclasses.replace(equilibrium, status=status)


def _distance_mm(one: np.ndarray, other: np.ndarray) -> float:
    """Between two poses, rotations at 30 mm; NaN where one is not known."""
    return float(apart_mm(FREE_COORDINATES, one[1:] * _IN_TABLE, other[1:] * _IN_TABLE))
