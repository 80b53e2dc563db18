"""A map of an objective over two parameters, of passive motion or under load, block by block."""

from __future__ import annotations

import abc
import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from kneejax.geometry import FREE_COORDINATES, convert
from kneejax.inference.fit import Problem, without
from kneejax.inference.sensitivity._parameter_map import BlockStore, ParameterMap, worst_condition
from kneejax.mechanics import Knee
from kneejax.parameters import Selection, UnsuitableData, unphysiological
from kneejax.statics import (
    Equilibria,
    LoadCases,
    Progress,
    Slopes,
    Status,
    Vary,
    balance_lines,
    balance_many,
    converged,
)


class _Part(NamedTuple):
    """Load cases with the same ligaments cut."""

    rows: np.ndarray  # theirs
    knee: Knee  # whose fibres cannot tear where they are cut
    vary: Vary  # what varies and cuts it
    load_cases: LoadCases  # these
    own: Equilibria  # balances there at `base`


#: Balances of a block, about: enough to fill all cores, few enough to hold in memory. A map that
#: was stopped goes on with its next block.
_BLOCK = 100_000
#: Rows of a block at least, so that there are always lanes to fill.
_FEWEST_ROWS = 16


@dataclasses.dataclass
class Maps(abc.ABC):
    """What all maps of a call share."""

    knee: Knee  # gives all that does not vary
    selection: Selection  # parameters of all pairs
    base: np.ndarray  # their values where searches begin, `(p,)`
    load_cases: LoadCases  # at which every grid point is balanced
    weights: np.ndarray  # of the objective, `(5,)`, per degree^2 and per mm^2
    # Number of poses or load cases that count nowhere.
    left_out: int = dataclasses.field(init=False)
    start_objective: float = dataclasses.field(init=False)  # at `base`
    parts: list[_Part] = dataclasses.field(init=False, default_factory=list)

    def _at_home(self, rows, knee: Knee, vary: Vary, load_cases: LoadCases) -> Equilibria:
        """Add a part; balances of the knee's own values there."""
        itself = np.asarray(self.selection.read(self.knee))
        both = balance_many(knee, vary, np.stack([self.base, itself]), load_cases)
        self.parts.append(_Part(rows, knee, vary, load_cases, both.at([0])))
        return both.at([1])

    def _lines(self, values, begin, near, progress=None) -> list[Equilibria]:
        """Balance lines of grid points, as `kneejax.statics.balance_lines`, part by part."""
        found, done = [], 0
        for number, part in enumerate(self.parts):

            def report(count: int, of: int, before: int = done) -> None:
                if progress is not None:
                    progress(before + count, of)

            found.append(balance_lines(
                part.knee, part.vary, values, part.load_cases, begin,
                near=near and near[number], progress=report,
            ))  # fmt: skip
            done += values.shape[0] * values.shape[1] * len(part.rows)
        return found

    @abc.abstractmethod
    def _reduced(self, values, found: list[Equilibria]) -> dict[str, np.ndarray]:
        """What a map keeps of grid points: `objective`, `partial`, `condition`, `lost`."""

    def map(self, pair, x, y, store: BlockStore | None, report: Progress) -> ParameterMap:
        """One map over two parameters, with values `(nx,)` and `(ny,)`, block by block; the store
        keeps finished blocks."""
        column, row = (self.selection.names.index(name) for name in pair)
        middle = int(np.abs(x - self.base[column]).argmin())
        # One block's rows do not depend on another's: all begin at the same column.
        spine = self._values(x[middle : middle + 1], y, column, row).swapaxes(0, 1)
        begin = int(np.abs(y - self.base[row]).argmin())
        near, parts, size = None, [], len(self.load_cases)
        rows = max(_FEWEST_ROWS, _BLOCK // (x.size * size))
        for first in range(0, y.size, rows):
            block = slice(first, min(first + rows, y.size))
            name = f"{pair[0]}-{pair[1]}-{first}"
            known = store.load(name) if store else None
            if known is None:
                if near is None:
                    near = self._lines(spine, np.array([begin]), None)
                values = self._values(x, y[block], column, row)
                here = self._lines(
                    values, np.full(len(values), middle), [one.at(0, block) for one in near],
                    lambda done, _, before=first: report(before * x.size * size + done, 0),
                )  # fmt: skip
                known = self._reduced(values, here)
                if store:
                    store.save(name, known)
            parts.append(known)
            report(block.stop * x.size * size, 0)
        whole = {key: np.concatenate([part[key] for part in parts], axis=-2) for key in parts[0]}
        units = (self.selection.unit(column), self.selection.unit(row))
        start = (float(self.base[column]), float(self.base[row]))
        return ParameterMap(
            (pair[0], pair[1]), units, x, y, whole["objective"], whole["partial"],
            whole["condition"], whole["lost"], start, self.start_objective, self.left_out,
            self.weights,
        )  # fmt: skip

    def _values(self, x, y, column: int, row: int) -> np.ndarray:
        values = np.tile(self.base, (y.size, x.size, 1))
        values[..., column], values[..., row] = x, y[:, None]
        return values


@dataclasses.dataclass
class LoadedMaps(Maps):
    """Of poses and tests under load."""

    problem: Problem  # what is observed
    offsets: tuple[str, ...]  # coordinates of poses whose best constant each grid point takes
    failures: tuple[Status, ...]  # statuses of balances that count for nothing

    def __post_init__(self) -> None:
        """The knee's own balances say what counts and what is physiological; searches begin at
        those of `base`."""
        every, homes = self.load_cases.of(self.knee), []
        for number, names in enumerate(self.problem.cases.cuts):
            rows = np.flatnonzero(self.problem.cases.cut == number)
            if len(rows):
                varied = without(self.knee, self.selection, names)
                homes.append(self._at_home(rows, *varied, every.take(rows)))
        used = converged(self._joined(homes, "status")[0])
        if not used.any():
            raise UnsuitableData("nothing measured has a balance with the knee's own parameters")
        self.own_table = self._joined(homes, "table")[0]
        self.cases = dataclasses.replace(self.problem.with_used(used).cases, offsets=self.offsets)
        self.left_out = int((~self.cases.counted).sum())
        here = [part.own for part in self.parts]
        self.start_objective = float(self._misfit(self.base[None], here)[0][0])

    def _reduced(self, values, found: list[Equilibria]) -> dict[str, np.ndarray]:
        shape, counted = values.shape[:-1], self.cases.counted
        table, status = (self._joined(found, name) for name in ("table", "status"))
        strange = unphysiological(table, self.own_table)[..., counted]
        objective, partial = self._misfit(values.reshape(-1, values.shape[-1]), found)
        return {
            "objective": objective.reshape(shape),
            "partial": partial.reshape(5, *shape),
            "condition": worst_condition(status[..., counted], strange, self.failures),
            "lost": (~converged(status[..., counted])).sum(axis=-1),
        }

    def _misfit(self, values: np.ndarray, found: list[Equilibria]) -> tuple[np.ndarray, np.ndarray]:
        """Sums of squares over all that was observed, `(points,)`, each as it is weighed, and of
        errors by coordinate, `(5, points)`, as they are."""
        axis = found[0].status.ndim - 1

        def nodes(name: str) -> np.ndarray:
            x = self._joined(found, name)
            return x.reshape(len(values), *x.shape[axis:])

        # Nothing is differentiated; slopes of the right shape are asked for all the same.
        size = values.shape[1] if self.cases.readings is not None else 1
        q = nodes("q")
        still = np.broadcast_to(0.0, (*q.shape, size))
        stiff = np.broadcast_to(0.0, (*q.shape, q.shape[-1]))
        rest = nodes("contact_points"), stiff, nodes("status")
        slopes = Slopes(values[:, :size], q, still, *rest)
        error, residual = self.cases.error(slopes)[0], self.cases.residual(slopes)[0]
        return (residual**2).sum(axis=1), np.moveaxis((error**2).sum(axis=1), -1, 0)

    def _joined(self, found: Sequence[Equilibria], name: str) -> np.ndarray:
        """A field of all parts' balances, load cases in their order."""
        axis = found[0].status.ndim - 1
        whole = np.concatenate([getattr(one, name) for one in found], axis)
        return np.take(whole, np.argsort(np.concatenate([p.rows for p in self.parts])), axis)


@dataclasses.dataclass
class PassiveMaps(Maps):
    """Of poses without loads: each flexion is balanced once, however many poses have it."""

    back: np.ndarray  # which flexion each pose has; of those that count in the end, as the next
    measured: np.ndarray
    offsets: tuple[str, ...]
    convention: str
    failures: tuple[Status, ...]

    def __post_init__(self) -> None:
        """The knee's own motion says what counts and what is physiological; searches begin at the
        motion of `base`."""
        rows = np.arange(len(self.load_cases))
        home = self._at_home(rows, self.knee, self.selection.apply, self.load_cases)
        self.own_table, used = home.table[0], home.converged[0][self.back]
        if not used.any():
            raise UnsuitableData("no measured flexion has a balance with the knee's own parameters")
        self.left_out = int((~used).sum())
        self.back, self.measured = self.back[used], self.measured[used]
        self.start_objective = float(self.weights @ self._partial(self.parts[0].own.table)[:, 0])

    def _reduced(self, values, found: list[Equilibria]) -> dict[str, np.ndarray]:
        (own,) = found
        partial, status = self._partial(own.table), own.status[..., np.unique(self.back)]
        strange = unphysiological(own.table, self.own_table)
        return {
            # Not by a product of matrices, whose rounding depends on how arrays lie in memory.
            "objective": (self.weights[:, None, None] * partial).sum(axis=0),
            "partial": partial,
            "condition": worst_condition(status, strange, self.failures),
            "lost": (~converged(own.status[..., self.back])).sum(axis=-1),
        }

    def _partial(self, table: np.ndarray) -> np.ndarray:
        """Sums of squared errors, coordinates first; `table` is `(..., load_cases, 5)`."""
        tables = table[..., self.back, :], self.measured[:, 1:]
        here, seen = (in_convention(x, self.measured[:, 0], self.convention) for x in tables)
        error = here - seen
        for name in self.offsets:
            column = FREE_COORDINATES.index(name)
            error[..., column] -= error[..., column].mean(axis=-1, keepdims=True)
        return np.moveaxis((error**2).sum(axis=-2), -1, 0)


def in_convention(table: np.ndarray, flexion_deg: np.ndarray, convention: str) -> np.ndarray:
    """Free coordinates as another convention defines them.

    Args:
        table: femoral, degrees and mm, `(..., poses, 5)`.
        flexion_deg: of the poses, `(poses,)`.
        convention: one of `kneejax.geometry.CONVENTIONS`.

    Returns:
        Degrees and mm, `(..., poses, 5)`.

    Example:
        >>> table = np.array([[30.0, 0.0, 0.0, 1.0, 0.0, 0.0]])
        >>> in_convention(table[:, 1:], table[:, 0], "femoral")[0, 2].tolist()
        1.0
    """
    if convention == "femoral":
        return table
    flexion = np.broadcast_to(flexion_deg, table.shape[:-1])
    units = np.r_[np.full(3, 180.0 / np.pi), np.ones(3)]
    poses = np.moveaxis(np.concatenate([flexion[..., None], table], axis=-1) / units, -1, 0)
    seen = np.moveaxis(np.asarray(convert(poses, "femoral", convention)), 0, -1)
    return (seen * units)[..., 1:]
