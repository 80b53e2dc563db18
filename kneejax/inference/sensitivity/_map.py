"""The objective over two parameters, the others kept: paper 1's Figures 11 to 13."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import jax.numpy as jnp
import numpy as np

from kneejax.geometry import FREE_COORDINATES, convert
from kneejax.inference.fit import DEFAULT_WEIGHTS
from kneejax.inference.sensitivity._condition import Condition, worst_condition
from kneejax.mechanics import Knee
from kneejax.numerics import imported
from kneejax.parameters import (
    Selection,
    UnknownParameter,
    UnsuitableData,
    select,
    stated_bounds,
    unphysiological,
)
from kneejax.statics import (
    FAILURES,
    Balances,
    Progress,
    Stations,
    Status,
    balance_lines,
    converged,
    own_motion,
)

#: Balances of a block, about: enough to fill all cores, few enough to hold in memory. A map that
#: was stopped goes on with its next block.
_BLOCK = 100_000
#: Rows of a block at least, so that there are always lanes to fill.
_FEWEST_ROWS = 16


class BlockStore(Protocol):
    """Keeps the finished blocks of a map, so that it can go on where it was stopped."""

    def load(self, name: str) -> dict[str, np.ndarray] | None:
        """The arrays of a finished block, or None."""
        ...

    def save(self, name: str, arrays: Mapping[str, np.ndarray]) -> None:
        """Keep the arrays of a finished block."""
        ...


@dataclasses.dataclass(frozen=True)
class ParameterMap:
    """Objective and partial objectives over two parameters.

    Attributes:
        names: of the parameters along x and y.
        units: of the parameters.
        x: values of the first, `(nx,)`.
        y: values of the second, `(ny,)`.
        objective: weighted sum of squares, `(ny, nx)`; NaN where a pose has no balance.
        partial_objectives: unweighted sums of squares by coordinate, mm^2 or degree^2,
            `(5, ny, nx)`, in the order of `kneejax.geometry.FREE_COORDINATES`.
        condition: `Condition` values, `(ny, nx)`.
        lost: number of poses without a balance, `(ny, nx)`.
        start: values of the two in the knee itself, or those of `at`.
        start_objective: objective there; NaN where a pose has no balance.
        left_out: number of measured poses that count nowhere, since the knee itself has no
            balance there.
        weights: of the objective, `(5,)`, per degree^2 and per mm^2.
    """

    names: tuple[str, str]
    units: tuple[str, str]
    x: np.ndarray
    y: np.ndarray
    objective: np.ndarray
    partial_objectives: np.ndarray
    condition: np.ndarray
    lost: np.ndarray
    start: tuple[float, float]
    start_objective: float
    left_out: int
    weights: np.ndarray

    @property
    def drawn(self) -> np.ndarray:
        """Where the map may be coloured, `(ny, nx)`."""
        return self.condition <= Condition.OUTSIDE_REGION

    @property
    def minimum(self) -> tuple[float, float, float] | None:
        """Values of the two and the objective at the best grid point that may be coloured."""
        if not self.drawn.any():
            return None
        best = np.where(self.drawn, self.objective, np.inf)
        row, column = np.unravel_index(np.argmin(best), best.shape)
        return float(self.x[column]), float(self.y[row]), float(best[row, column])

    def to_dataset(self, attributes: Mapping[str, Any] | None = None):
        """The map as an `xarray.Dataset` with coordinates, units and flags.

        Args:
            attributes: of the whole, e.g. the study and the versions.

        Raises:
            UnsuitableData: the package xarray is not installed.
        """
        xarray = imported("xarray", "xarray", "maps")
        column, row = self.names
        axes = (row, column)
        squares = ["degree2", "degree2", "mm2", "mm2", "mm2"]
        words = " ".join(c.word for c in Condition)
        content: dict[str, Any] = {
            "objective": (axes, self.objective, {"units": "1", "long_name": "weighted squares"})
        }
        for name, values, unit in zip(
            FREE_COORDINATES, self.partial_objectives, squares, strict=True
        ):
            note = f"sum of squared errors of {name.replace('_', ' ')}"
            content[name] = (axes, values, {"units": unit, "long_name": note})
        flags = {"flag_values": np.arange(len(Condition), dtype=np.int8), "flag_meanings": words}
        content["condition"] = (axes, self.condition.astype(np.int8), flags)
        content["poses_without_balance"] = (axes, self.lost.astype(np.int32), {"units": "1"})
        coordinates = {
            name: (name, values, {"units": unit or "1", "start": own})
            for name, values, unit, own in zip(
                (column, row), (self.x, self.y), self.units, self.start, strict=True
            )
        }
        named = zip(FREE_COORDINATES, self.weights, strict=True)
        weights = {f"weight_{name}": float(weight) for name, weight in named}
        own = {"start_objective": self.start_objective, "poses_left_out": self.left_out}
        return xarray.Dataset(content, coordinates, {**own, **weights, **(attributes or {})})


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
    at = dict(at or {})
    limits = map_ranges(knee, pairs, grid=grid, bounds=bounds)
    selection = select(knee, tuple(dict.fromkeys((*at, *limits))))
    flexion, back = np.unique(measured[:, 0], return_inverse=True)
    base = np.array(selection.read(knee))
    for name, value in at.items():
        if name not in selection.names:
            raise UnknownParameter(f"{name!r} is many parameters: name each")
        if not np.isfinite(value):
            raise UnsuitableData(f"{name}: {value} is not finite")
        base[selection.names.index(name)] = value
    stations = Stations.at(flexion)
    study = _Study(
        knee, selection, base, stations, back, measured, weights, offsets, convention, failures
    )
    study.check_own_motion()
    total = len(pairs) * grid[0] * grid[1] * len(flexion)
    maps, done = [], 0
    for pair in pairs:
        x, y = (
            np.linspace(limits[name][0], limits[name][1], points)
            for name, points in zip(pair, grid, strict=True)
        )

        def report(count: int, _: int, before: int = done) -> None:
            if progress is not None:
                progress(min(before + count, total), total)

        maps.append(study.map(pair, x, y, store, report))
        done += x.size * y.size * len(flexion)
    return tuple(maps)


def map_ranges(
    knee: Knee,
    pairs: Sequence[tuple[str, str]],
    *,
    grid: tuple[int, int] = (41, 41),
    bounds: Mapping[str, tuple[float, float]] | None = None,
) -> dict[str, tuple[float, float]]:
    """Over which values maps would go; refuses as `sensitivity_maps` does.

    Args:
        knee: that has the parameters.
        pairs: of parameters.
        grid: points along x and y.
        bounds: as in `sensitivity_maps`.

    Returns:
        Parameter of a pair -> its lowest and its highest value.
    """
    selection = select(knee, _distinct_names(knee, pairs))
    lower, upper = stated_bounds(knee, selection, bounds or {})
    if min(grid) < 2:
        shown = f"{grid[0]}x{grid[1]}"
        raise UnsuitableData(f"a grid of {shown} points: expected at least two along each axis")
    ends = zip(lower.tolist(), upper.tolist(), strict=True)
    return dict(zip(selection.names, ends, strict=True))


def _distinct_names(knee: Knee, pairs: Sequence[tuple[str, str]]) -> tuple[str, ...]:
    names: list[str] = []
    if not pairs:
        raise UnsuitableData("no pair of parameters: name two, such as PCL.stiffness ACL.stiffness")
    for first, second in pairs:
        for name in (first, second):
            if name.startswith("*"):
                raise UnknownParameter(f"{name!r} is many parameters: a map takes one per side")
        if first == second:
            raise UnsuitableData(f"{first} with itself: a map needs two different parameters")
        select(knee, [first, second])
        names += [name for name in (first, second) if name not in names]
    return tuple(names)


@dataclasses.dataclass
class _Study:
    """What all maps of a call share."""

    knee: Knee
    selection: Selection
    base: np.ndarray
    stations: Stations
    back: np.ndarray
    measured: np.ndarray
    weights: np.ndarray
    offsets: tuple[str, ...]
    convention: str
    failures: tuple[Status, ...]

    def check_own_motion(self) -> None:
        """The knee's own motion says what counts and what is physiological; searches begin at the
        motion of `base`."""
        vary, own = self.selection.apply, np.asarray(self.selection.read(self.knee))
        here = own_motion(self.knee, vary, jnp.asarray(self.base), self.stations)
        same = np.array_equal(own, self.base)
        home = here if same else own_motion(self.knee, vary, jnp.asarray(own), self.stations)
        self.own, self.own_table = here, home.table[0]
        self.used = home.converged[0][self.back]
        if not self.used.any():
            raise UnsuitableData("no measured flexion has a balance with the knee's own parameters")
        self.start_objective = float(self.weights @ self._partial(here.table)[:, 0])

    def map(self, pair, x, y, store: BlockStore | None, report: Progress) -> ParameterMap:
        column, row = (self.selection.names.index(name) for name in pair)
        middle = int(np.abs(x - self.base[column]).argmin())
        # One block's rows do not depend on another's: all begin at the same column.
        spine = self._values(x[middle : middle + 1], y, column, row).swapaxes(0, 1)
        begin = int(np.abs(y - self.base[row]).argmin())
        near = None
        rows = max(_FEWEST_ROWS, _BLOCK // (x.size * len(self.stations)))
        parts, size = [], len(self.stations)
        for first in range(0, y.size, rows):
            block = slice(first, min(first + rows, y.size))
            name = f"{pair[0]}-{pair[1]}-{first}"
            known = store.load(name) if store else None
            if known is None:
                if near is None:
                    near = self._lines(spine, np.array([begin]), None)
                here = self._lines(
                    self._values(x, y[block], column, row),
                    np.full(y[block].size, middle),
                    near.at(0, block),
                    lambda done, _, before=first: report(before * x.size * size + done, 0),
                )
                known = self._reduced(here)
                if store:
                    store.save(name, known)
            parts.append(known)
            report(block.stop * x.size * size, 0)
        whole = {key: np.concatenate([part[key] for part in parts], axis=-2) for key in parts[0]}
        return ParameterMap(
            (pair[0], pair[1]),
            tuple(self.selection.unit(i) for i in (column, row)),
            x,
            y,
            # Not by a product of matrices, whose rounding depends on how arrays lie in memory.
            (self.weights[:, None, None] * whole["partial"]).sum(axis=0),
            whole["partial"],
            whole["condition"],
            whole["lost"],
            (float(self.base[column]), float(self.base[row])),
            self.start_objective,
            int((~self.used).sum()),
            self.weights,
        )

    def _values(self, x, y, column: int, row: int) -> np.ndarray:
        values = np.tile(self.base, (y.size, x.size, 1))
        values[..., column], values[..., row] = x, y[:, None]
        return values

    def _lines(self, values, begin, near, progress=None) -> Balances:
        vary, base = self.selection.apply, jnp.asarray(self.base)
        return balance_lines(
            self.knee, vary, base, values, self.stations, begin,
            near=near, own=self.own, progress=progress,
        )  # fmt: skip

    def _reduced(self, found: Balances) -> dict[str, np.ndarray]:
        """Of poses, what a map keeps: a few numbers a grid point."""
        table, status = found.table, found.status[..., np.unique(self.back[self.used])]
        strange = unphysiological(table, self.own_table)
        condition = worst_condition(status, strange, self.failures)
        lost = (~converged(found.status[..., self.back[self.used]])).sum(axis=-1)
        return {"partial": self._partial(table), "condition": condition, "lost": lost}

    def _partial(self, table: np.ndarray) -> np.ndarray:
        """Sums of squared errors, coordinates first; `table` is `(..., stations, 5)`."""
        rows = self.back[self.used]
        here = in_convention(table[..., rows, :], self.measured[self.used, 0], self.convention)
        error = here - in_convention(
            self.measured[self.used, 1:], self.measured[self.used, 0], self.convention
        )
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
    """
    if convention == "femoral":
        return table
    flexion = np.broadcast_to(flexion_deg, table.shape[:-1])
    units = np.r_[np.full(3, 180.0 / np.pi), np.ones(3)]
    poses = np.moveaxis(np.concatenate([flexion[..., None], table], axis=-1) / units, -1, 0)
    seen = np.moveaxis(np.asarray(convert(poses, "femoral", convention)), 0, -1)
    return (seen * units)[..., 1:]
