"""The objective over two parameters, the others kept: paper 1's Figures 11 to 13."""

__all__ = ["in_convention", "map_ranges", "sensitivity_map", "sensitivity_maps"]

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from kneejax.experiments import MeasuredTest
from kneejax.geometry import convert
from kneejax.inference.fit import DEFAULT_WEIGHTS, TABLE_UNITS, Problem, distinct, without
from kneejax.inference.sensitivity._parameter_map import BlockStore, ParameterMap, worst_condition
from kneejax.mechanics import Knee, Load
from kneejax.parameters import (
    UnknownParameter,
    UnsuitableData,
    doubt_value,
    select,
    stated_bounds,
    unphysiological,
)
from kneejax.statics import (
    FAILURES,
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

#: Balances of a block, about: enough to fill all cores, few enough to hold in memory. A map that
#: was stopped goes on with its next block.
_BLOCK = 100_000
#: Rows of a block at least, so that there are always lanes to fill.
_FEWEST_ROWS = 16


def sensitivity_map(
    knee: Knee, measured: np.ndarray, pair: tuple[str, str], **options: Any
) -> ParameterMap:
    """The objective over one pair of parameters; see `sensitivity_maps`."""
    return sensitivity_maps(knee, measured, [pair], **options)[0]


def sensitivity_maps(
    knee: Knee,
    measured: np.ndarray,
    pairs: Sequence[tuple[str, str]],
    *,
    grid: tuple[int, int] = (41, 41),
    at: Mapping[str, float] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    weights: np.ndarray | None = None,
    offsets: tuple[str, ...] = (),
    convention: str = "femoral",
    loads: Sequence[Load] = (),
    tests: Sequence[MeasuredTest] = (),
    known: np.ndarray | None = None,
    store: BlockStore | None = None,
    progress: Progress | None = None,
    failures: tuple[Status, ...] = FAILURES,
) -> tuple[ParameterMap, ...]:
    """Compute the objective over pairs of parameters, the others kept as the knee has them.

    A column of the grid is balanced first, from the baseline motion; its rows then continue from
    there, each pose predicted from its neighbours.

    Args:
        knee: gives everything else.
        measured: `(n, 6)` in the order of `kneejax.geometry.COLUMNS`, degrees and mm.
        pairs: of parameters; the first of a pair goes along x.
        grid: points along x and y.
        at: parameter -> value, where others than the knee's own are kept. Maps with the same names
            here, of any pair of them, share what is compiled.
        bounds: by name, `*.quantity` or quantity; those of paper 1 by default.
        weights: `(5,)`; by default 8 per degree^2 and 1 per mm^2 (paper 1).
        offsets: free coordinates whose constant difference to the measurement is free: at every
            grid point the best one is taken.
        convention: in whose coordinates errors are taken, one of `kneejax.geometry.CONVENTIONS`;
            paper 1 takes those of the femur in the tibia.
        loads: on the tibia while the poses were measured, each one for all poses or one per pose.
        tests: under load that were made; they count as in a calibration.
        known: standard deviations that are stated, NaN elsewhere, `(5,)`, against which a test
            with its own counts.
        store: keeps finished blocks; what it has is not computed again.
        progress: called now and then with balances done and asked for.
        failures: statuses of balances that count for nothing: such grid points are not drawn.

    Returns:
        One map per pair.

    Raises:
        UnknownParameter: a name that the knee does not have.
        UnsuitableData: a pair of one parameter, a grid of one point, reversed bounds, or a
            knee that balances at no measured flexion.

    Source: paper 1, section 3.3, with Eq 10 squared.
    """
    measured = np.asarray(measured, float)
    weights = DEFAULT_WEIGHTS if weights is None else np.asarray(weights, float)
    limits = map_ranges(knee, pairs, grid=grid, bounds=bounds)
    selection = select(knee, tuple(dict.fromkeys((*(at or ()), *limits))))
    base = np.array(selection.read(knee))
    for name, value in (at or {}).items():
        if name not in selection.names:
            raise UnknownParameter(f"{name!r} is many parameters: name each")
        if not np.isfinite(value):
            raise UnsuitableData(f"{name}: {value} is not finite")
        base[selection.names.index(name)] = value
    if (loads or tests) and convention != "femoral":
        raise UnsuitableData(f"convention {convention}: expected femoral where loads act")
    moved = [test.name for test in tests if test.frames is not None]
    if moved:
        raise UnsuitableData(f"{moved[0]}: a knee in motion; expected tests of a knee at rest")
    problem = Problem.of(knee, selection, measured, weights, offsets, loads, tests, known)
    study = _Maps(problem, base, weights, convention, failures)
    each, maps = grid[0] * grid[1] * study.size, []
    for pair in pairs:
        x, y = (np.linspace(*limits[name], count) for name, count in zip(pair, grid, strict=True))

        def report(count: int, _: int, before: int = each * len(maps)) -> None:
            if progress is not None:
                progress(min(before + count, each * len(pairs)), each * len(pairs))

        maps.append(study.map(pair, x, y, store, report))
    return tuple(maps)


def map_ranges(
    knee: Knee,
    pairs: Sequence[tuple[str, str]],
    *,
    grid: tuple[int, int] = (41, 41),
    bounds: Mapping[str, tuple[float, float]] | None = None,
) -> dict[str, tuple[float, float]]:
    """Parameter of a pair -> its lowest and its highest value in a map; refuses as
    `sensitivity_maps` does, whose arguments these are."""
    if not pairs:
        raise UnsuitableData("no pair of parameters: name two, such as PCL.stiffness ACL.stiffness")
    for pair in pairs:
        for name in pair:
            if name.startswith("*"):
                raise UnknownParameter(f"{name!r} is many parameters: a map takes one per side")
        if pair[0] == pair[1]:
            raise UnsuitableData(f"{pair[0]} with itself: a map needs two different parameters")
    selection = select(knee, tuple(dict.fromkeys(name for pair in pairs for name in pair)))
    lower, upper = stated_bounds(knee, selection, bounds or {})
    for name, end in zip(selection.names, upper.tolist(), strict=True):
        doubt_value(knee, name, end)
    if min(grid) < 2:
        shown = f"{grid[0]}x{grid[1]}"
        raise UnsuitableData(f"a grid of {shown} points: expected at least two along each axis")
    ends = zip(lower.tolist(), upper.tolist(), strict=True)
    return dict(zip(selection.names, ends, strict=True))


class _Maps:
    """What all maps of a call share."""

    def __init__(
        self, problem: Problem, base: np.ndarray, weights: np.ndarray, convention: str,
        failures: tuple[Status, ...],
    ):  # fmt: skip
        """Balances of the knee itself say what counts; searches begin at those of `base`,
        `(p,)`."""
        self.selection, self.weights, self.base = problem.selection, weights, base
        self.convention, self.failures = convention, failures
        cases, knee = problem.cases, problem.knee
        every, both = cases.load_cases.of(knee), np.stack([base, self.selection.read(knee)])
        # Load cases with the same ligaments cut, each of them once, and what varies and cuts a knee
        # whose fibres cannot tear there.
        self.parts: list[tuple[Knee, Vary, LoadCases]] = []
        # Which of these, one part after the other, each observed load case is.
        self.place, self.size = np.zeros(len(every), int), 0
        found: list[Equilibria] = []
        for number, names in enumerate(cases.cuts):
            rows = np.flatnonzero(cases.cut == number)
            if len(rows):
                varied = without(knee, self.selection, names)
                first, place = distinct(every.take(rows))
                once = every.take(rows[first])
                self.parts.append((*varied, once))
                found.append(balance_many(*varied, both, once))
                self.place[rows] = self.size + place
                self.size += len(once)
        used = converged(self._observed(found, "status")[1])
        if not used.any():
            raise UnsuitableData("nothing measured has a balance with the knee's own parameters")
        self.own_table = self._observed(found, "table")[1]
        self.flexion_deg = problem.measured[:, 0]
        target = in_convention(cases.target, self.flexion_deg, convention)
        cases = problem.with_used(used).cases
        self.cases = dataclasses.replace(cases, target=target, offsets=problem.offsets)
        self.left_out = int((~self.cases.used).sum())
        here = [one.at([0]) for one in found]
        self.start_objective = float(self._misfit(base[None], here)[0][0])

    def _observed(self, found: Sequence[Equilibria], name: str) -> np.ndarray:
        """A field of all parts' balances at the load cases as they were observed."""
        axis = found[0].status.ndim - 1
        return np.take(np.concatenate([getattr(x, name) for x in found], axis), self.place, axis)

    def _lines(self, values, begin, near, progress: Progress) -> list[Equilibria]:
        """Balance lines of grid points, as `kneejax.statics.balance_lines`, part by part."""
        found, done = [], 0
        for (knee, vary, load_cases), there in zip(self.parts, near, strict=True):
            found.append(balance_lines(
                knee, vary, values, load_cases, begin, near=there,
                progress=lambda count, of, before=done: progress(before + count, of),
            ))  # fmt: skip
            done += values.shape[0] * values.shape[1] * len(load_cases)
        return found

    def map(self, pair, x, y, store: BlockStore | None, report: Progress) -> ParameterMap:
        """One map over two parameters, `(nx,)` and `(ny,)`; the store keeps finished blocks."""
        column, row = (self.selection.names.index(name) for name in pair)
        middle = int(np.abs(x - self.base[column]).argmin())
        # One block's rows do not depend on another's: all begin at the same column.
        spine = self._values(x[middle : middle + 1], y, column, row).swapaxes(0, 1)
        begin = int(np.abs(y - self.base[row]).argmin())
        near, parts, size = None, [], self.size
        rows = max(_FEWEST_ROWS, _BLOCK // (x.size * size))
        for first in range(0, y.size, rows):
            block = slice(first, min(first + rows, y.size))
            name = f"{pair[0]}-{pair[1]}-{first}"
            known = store.load(name) if store else None
            if known is None:
                if near is None:
                    nothing = [None] * len(self.parts)
                    near = self._lines(spine, np.array([begin]), nothing, lambda *_: None)
                values = self._values(x, y[block], column, row)
                here = self._lines(
                    values, np.full(len(values), middle), [one.at(0, block) for one in near],
                    lambda done, _, before=first: report(before * x.size * size + done, 0),
                )  # fmt: skip
                shape, counted = values.shape[:-1], self.cases.used
                table, status = (self._observed(here, name) for name in ("table", "status"))
                strange = unphysiological(table, self.own_table)[..., counted]
                objective, partial = self._misfit(values.reshape(-1, values.shape[-1]), here)
                known = {
                    "objective": objective.reshape(shape),
                    "partial": partial.reshape(5, *shape),
                    "condition": worst_condition(status[..., counted], strange, self.failures),
                    "lost": (~converged(status[..., counted])).sum(axis=-1),
                }
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

    def _misfit(self, values: np.ndarray, found: list[Equilibria]) -> tuple[np.ndarray, np.ndarray]:
        """Weighed sums of squares, `(points,)`, and unweighed by coordinate, `(5, points)`."""
        axis = found[0].status.ndim - 1

        def nodes(name: str) -> np.ndarray:
            x = self._observed(found, name)
            return x.reshape(len(values), *x.shape[axis:])

        # Nothing is differentiated; slopes of the right shape are asked for all the same.
        size = values.shape[1] if self.cases.readings is not None else 1
        q = nodes("q")
        if self.convention != "femoral":
            own = slice(len(TABLE_UNITS))
            table = in_convention(q[..., own] * TABLE_UNITS, self.flexion_deg, self.convention)
            q[..., own] = table / TABLE_UNITS
        still = np.broadcast_to(0.0, (*q.shape, size))
        stiff = np.broadcast_to(0.0, (*q.shape, q.shape[-1]))
        rest = nodes("contact_points"), stiff, nodes("status")
        slopes = Slopes(values[:, :size], q, still, *rest)
        error, residual = self.cases.error(slopes)[0], self.cases.residual(slopes)[0]
        return (residual**2).sum(axis=1), np.moveaxis((error**2).sum(axis=1), -1, 0)


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
