"""The objective over two parameters, the others kept: paper 1's Figures 11 to 13."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from kneejax.experiments import MeasuredTest
from kneejax.inference.fit import DEFAULT_WEIGHTS, Problem
from kneejax.inference.sensitivity._map_study import LoadedMaps, Maps, PassiveMaps
from kneejax.inference.sensitivity._parameter_map import BlockStore, ParameterMap
from kneejax.mechanics import Knee, Load
from kneejax.parameters import (
    Selection,
    UnknownParameter,
    UnsuitableData,
    doubt_value,
    select,
    stated_bounds,
)
from kneejax.statics import FAILURES, LoadCases, Progress, Status


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
    base = _kept(knee, selection, at or {})
    if loads or tests:
        if convention != "femoral":
            raise UnsuitableData(f"convention {convention}: expected femoral where loads act")
        moved = [test.name for test in tests if test.frames is not None]
        if moved:
            raise UnsuitableData(f"{moved[0]}: a knee in motion; expected tests of a knee at rest")
        problem = Problem.of(knee, selection, measured, weights, (), loads, tests, known)
        study: Maps = LoadedMaps(
            knee, selection, base, problem.cases.load_cases, weights, problem, offsets, failures
        )
    else:
        flexion, back = np.unique(measured[:, 0], return_inverse=True)
        study = PassiveMaps(
            knee, selection, base, LoadCases.at(flexion), weights, back, measured, offsets,
            convention, failures,
        )  # fmt: skip
    each, maps = grid[0] * grid[1] * len(study.load_cases), []
    for pair in pairs:
        x, y = (np.linspace(*limits[name], count) for name, count in zip(pair, grid, strict=True))

        def report(count: int, _: int, before: int = each * len(maps)) -> None:
            if progress is not None:
                progress(min(before + count, each * len(pairs)), each * len(pairs))

        maps.append(study.map(pair, x, y, store, report))
    return tuple(maps)


def _kept(knee: Knee, selection: Selection, at: Mapping[str, float]) -> np.ndarray:
    """Values of the parameters where a map does not vary them, `(p,)`."""
    base = np.array(selection.read(knee))
    for name, value in at.items():
        if name not in selection.names:
            raise UnknownParameter(f"{name!r} is many parameters: name each")
        if not np.isfinite(value):
            raise UnsuitableData(f"{name}: {value} is not finite")
        base[selection.names.index(name)] = value
    return base


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
    for name, end in zip(selection.names, upper.tolist(), strict=True):
        doubt_value(knee, name, end)
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
