"""What maps are held against where the knee was loaded: load cases, some of a cut knee."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from kneejax.inference.fit import Observations, Problem, without
from kneejax.inference.sensitivity._condition import worst_condition
from kneejax.mechanics import Knee
from kneejax.parameters import UnsuitableData, unphysiological
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
    """Load cases with the same ligaments cut: their rows, a knee whose fibres cannot tear where
    they are cut, what varies and cuts it, the load cases, and its balances there at `base`."""

    rows: np.ndarray
    knee: Knee
    vary: Vary
    load_cases: LoadCases
    own: Equilibria


@dataclasses.dataclass(frozen=True)
class MapCases:
    """Load cases of a problem, balanced at every grid point.

    Attributes:
        cases: those that the knee's own values balance count.
        parts: the cases by what was cut.
        own_table: where the knee itself is, degrees and mm, `(cases, 5)`.
        failures: statuses of balances that count for nothing.
        base: values of what varies where searches begin, `(p,)`.
    """

    cases: Observations
    parts: tuple[_Part, ...]
    own_table: np.ndarray
    failures: tuple[Status, ...]
    base: np.ndarray

    @classmethod
    def of(cls, problem: Problem, offsets: tuple[str, ...], base: np.ndarray, failures) -> MapCases:
        """Balance the knee itself at all load cases.

        Args:
            problem: whose selection is what maps vary.
            offsets: free coordinates of poses whose best constant is taken at each grid point.
            base: values where searches begin, `(p,)`.
            failures: statuses of balances that count for nothing.

        Raises:
            UnsuitableData: the knee balances nowhere.
        """
        selection, every = problem.selection, problem.cases.load_cases.of(problem.knee)
        itself, parts, homes = np.asarray(selection.read(problem.knee)), [], []
        for number, names in enumerate(problem.cases.cuts):
            rows = np.flatnonzero(problem.cases.cut == number)
            if not len(rows):
                continue
            knee, vary = without(problem.knee, selection, names)
            load_cases = every.take(rows)
            both = balance_many(knee, vary, np.stack([base, itself]), load_cases)
            homes.append(both.at([1]))
            parts.append(_Part(rows, knee, vary, load_cases, both.at([0])))
        table, used = _joined(parts, homes, "table"), converged(_joined(parts, homes, "status")[0])
        if not used.any():
            raise UnsuitableData("nothing measured has a balance with the knee's own parameters")
        counted = problem.with_used(used).cases
        cases = dataclasses.replace(counted, offsets=offsets)
        return cls(cases, tuple(parts), table[0], failures, base)

    @property
    def left_out(self) -> int:
        """Load cases that count nowhere."""
        return int((~self.cases.counted).sum())

    @property
    def start_objective(self) -> float:
        """Where searches begin; NaN where something has no balance there."""
        return float(self._misfit(self.base[None], [part.own for part in self.parts])[0][0])

    def lines(
        self,
        values: np.ndarray,
        begin: np.ndarray,
        near: list[Equilibria] | None,
        progress: Progress,
    ) -> list[Equilibria]:
        """Balance lines of variants, as `kneejax.statics.balance_lines`, part by part."""
        found, done = [], 0
        for number, part in enumerate(self.parts):

            def report(count: int, of: int, before: int = done) -> None:
                progress(before + count, of)

            found.append(balance_lines(
                part.knee, part.vary, values, part.load_cases, begin,
                near=near and near[number], progress=report,
            ))  # fmt: skip
            done += values.shape[0] * values.shape[1] * len(part.rows)
        return found

    def reduced(self, values: np.ndarray, found: list[Equilibria]) -> dict[str, np.ndarray]:
        """What a map keeps of grid points, arrays of their shape."""
        shape, counted = values.shape[:-1], self.cases.counted
        table, status = (_joined(self.parts, found, name) for name in ("table", "status"))
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
            x = _joined(self.parts, found, name)
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


def _joined(parts: Sequence[_Part], found: Sequence[Equilibria], name: str) -> np.ndarray:
    """A field of all parts' balances, load cases in their order."""
    axis = found[0].status.ndim - 1
    whole = np.concatenate([getattr(one, name) for one in found], axis)
    return np.take(whole, np.argsort(np.concatenate([part.rows for part in parts])), axis)
