"""Smoothed cubic B-splines through the points of an articular surface.

The spline minimises the squared normal distances of the points, each weighted by the area that it
stands for, plus a bending energy. How fine its cells are and how much bending costs is chosen by
the distances of points that were held out, a patch at a time: a point's neighbours would tell too
much about it.
"""

__all__ = ["SplineFit", "fit_condyle_spline", "fit_plateau_spline"]

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from jax.typing import ArrayLike

from kneejax.geometry._articular import Condyle, Plateau
from kneejax.geometry._bases import CUBIC_SPLINE
from kneejax.geometry._fit_surface import (
    S,
    SurfaceFit,
    around_axis,
    finished,
    in_frame,
    points_and_weights,
)
from kneejax.geometry._pose import Frame

#: Sizes of cells and lengths of smoothing that are tried, mm.
CELLS_MM = (8.0, 6.0, 4.5, 3.5, 2.6)
SMOOTHINGS_MM = (0.1, 0.2, 0.4, 0.8)

_FOLDS = 5
_MOST_POINTS = 12000
# The coarsest cells whose held-out distance is within this factor of the best.
_AS_GOOD = 1.05
# Places this far from every point, on a grid of this distance, keep a spline in bounds; each has
# this share of a point's weight.
_FAR_MM, _ANCHOR_MM, _LIGHT = 1.5, 1.0, 0.02


@dataclasses.dataclass(frozen=True)
class SplineFit(SurfaceFit[S]):
    """A fitted spline surface, what is left over, and how it was chosen.

    Attributes:
        cells: number along both parameters.
        smoothing_mm: bends much shorter than this are smoothed away.
        held_out_rms: root of the weighted mean square distance of points that were held out, mm.
        tried: `(cell size mm, smoothing mm, held-out rms mm)` of everything that was tried.

    Example:
        >>> x, z = np.meshgrid(np.linspace(-12.0, 12.0, 20), np.linspace(-12.0, 12.0, 20))
        >>> points, half = np.stack([x, 0.01 * x**2, z], -1).reshape(-1, 3), (-12.0, 12.0)
        >>> found = fit_plateau_spline(points, half, half, cell_mm=8.0, smoothing_mm=0.1)
        >>> found.cells, bool(abs(found.residual).max() < 0.01)
        ((3, 3), True)
    """

    cells: tuple[int, int] = (1, 1)
    smoothing_mm: float = 0.0
    held_out_rms: float = float("nan")
    tried: tuple[tuple[float, float, float], ...] = ()


def fit_condyle_spline(
    points: ArrayLike,
    angle_deg: tuple[float, float],
    width_mm: tuple[float, float],
    frame: Frame | None = None,
    weights: ArrayLike | None = None,
    cell_mm: float | Sequence[float] = CELLS_MM,
    smoothing_mm: float | Sequence[float] = SMOOTHINGS_MM,
    patch_mm: float = 4.0,
) -> SplineFit[Condyle]:
    """Fit a radius over angle and width about a transverse axis, as a smoothed spline.

    Args:
        points: shape `(n, 3)`, mm, femur frame; those outside the region are left out.
        angle_deg: region from anterior (0) through distal (90) to posterior (180).
        width_mm: region along the axis.
        frame: the axis (its Z); the femur's Z by default.
        weights: area that each point stands for, shape `(n,)`; equal by default.
        cell_mm: size of the cells, or sizes to choose from.
        smoothing_mm: length below which bends are smoothed away, or lengths to choose from.
        patch_mm: size of the patches that are held out.

    Returns:
        A `SplineFit` of a `Condyle`.

    Raises:
        ValueError: fewer than 16 points in the region.

    Example:
        >>> turns, z = np.meshgrid(np.linspace(0.3, 2.9, 40), np.linspace(-12.0, 12.0, 20))
        >>> points = np.stack([20.0 * np.cos(turns), -20.0 * np.sin(turns), z], -1).reshape(-1, 3)
        >>> found = fit_condyle_spline(
        ...     points, (20.0, 160.0), (-12.0, 12.0), cell_mm=8.0, smoothing_mm=0.1
        ... )
        >>> bool(abs(found.residual).max() < 0.01)
        True
    """
    frame, limits = Frame() if frame is None else frame, np.deg2rad(angle_deg)
    p, w, angle, z, radius = around_axis(frame, points, weights, limits, width_mm)
    _enough(p, "condyle")
    mean = float(np.average(radius, weights=w))
    # Along the arc in mm, so that cells and bends are as long in both directions.
    region = ((mean * limits[0], mean * limits[1]), width_mm)
    sheet = _Sheet(mean * angle, z, radius, w, region)
    table, how = _choose(sheet, cell_mm, smoothing_mm, patch_mm, fall=2.0)
    surface = Condyle(table, limits, width_mm, frame, CUBIC_SPLINE)
    return SplineFit(**vars(finished(surface, p, w)), **how)


def fit_plateau_spline(
    points: ArrayLike,
    x_mm: tuple[float, float],
    z_mm: tuple[float, float],
    frame: Frame | None = None,
    weights: ArrayLike | None = None,
    cell_mm: float | Sequence[float] = CELLS_MM,
    smoothing_mm: float | Sequence[float] = SMOOTHINGS_MM,
    patch_mm: float = 4.0,
    outline: ArrayLike | None = None,
) -> SplineFit[Plateau]:
    """Fit a height over a plane, as a smoothed spline.

    Args:
        points: shape `(n, 3)`, mm, tibia frame; those outside the region are left out.
        x_mm: region, anterior-posterior.
        z_mm: region, medial-lateral.
        frame: the plane (its Y is up); the tibia's by default.
        weights: area that each point stands for, shape `(n,)`; equal by default.
        cell_mm: size of the cells, or sizes to choose from.
        smoothing_mm: length below which bends are smoothed away, or lengths to choose from.
        patch_mm: size of the patches that are held out.
        outline: border of the sheet, corners `(x, z)`, handed to the surface.

    Returns:
        A `SplineFit` of a `Plateau`.

    Raises:
        ValueError: fewer than 16 points in the region.

    Example:
        >>> x, z = np.meshgrid(np.linspace(-12.0, 12.0, 20), np.linspace(-12.0, 12.0, 20))
        >>> points, half = np.stack([x, 0.01 * x**2, z], -1).reshape(-1, 3), (-12.0, 12.0)
        >>> fit_plateau_spline(points, half, half, cell_mm=8.0, smoothing_mm=0.1).cells
        (3, 3)
    """
    frame = Frame() if frame is None else frame
    p, w = points_and_weights(points, weights, 1, "plateau")
    x, y, z = in_frame(frame, p).T
    here = (x >= x_mm[0]) & (x <= x_mm[1]) & (z >= z_mm[0]) & (z <= z_mm[1])
    _enough(p[here], "plateau")
    sheet = _Sheet(x, z, y, w, (x_mm, z_mm)).part(here)
    table, how = _choose(sheet, cell_mm, smoothing_mm, patch_mm, fall=0.0)
    surface = Plateau(table, x_mm, z_mm, frame, CUBIC_SPLINE, outline)
    return SplineFit(**vars(finished(surface, p[here], w[here])), **how)


@dataclasses.dataclass(frozen=True)
class _Sheet:
    """Values over two lengths, all in mm."""

    a: np.ndarray
    b: np.ndarray
    value: np.ndarray
    weight: np.ndarray
    region: tuple[tuple[float, float], tuple[float, float]]

    def part(self, rows: np.ndarray | slice) -> "_Sheet":
        a, b, value, weight = (x[rows] for x in (self.a, self.b, self.value, self.weight))
        return _Sheet(a, b, value, weight, self.region)

    def beyond(self, fall: float) -> "_Sheet":
        """Places of the region far from every point, where a spline would go where it likes, with
        little weight: the nearest point's value less `fall` times the distance, at least half."""
        axes = [
            np.linspace(lower, upper, max(2, round((upper - lower) / _ANCHOR_MM)))
            for lower, upper in self.region
        ]
        a, b = (x.ravel() for x in np.meshgrid(*axes, indexing="ij"))
        from scipy.spatial import KDTree  # 0.1 s that no other command should wait for

        away, near = map(np.asarray, KDTree(np.c_[self.a, self.b]).query(np.c_[a, b]))
        far = away > _FAR_MM
        value = self.value[near[far]]
        value = np.maximum(value - fall * away[far], np.minimum(value, 0.5 * value))
        weight = np.full(far.sum(), _LIGHT * float(np.mean(self.weight)))
        return _Sheet(a[far], b[far], value, weight, self.region)


def _choose(
    sheet: _Sheet, cell_mm, smoothing_mm, patch_mm: float, fall: float
) -> tuple[np.ndarray, dict[str, Any]]:
    """Control values, and how they were chosen: what a `SplineFit` has beside a `SurfaceFit`."""
    sizes = sorted(np.atleast_1d(cell_mm).tolist(), reverse=True)
    lengths = sorted(np.atleast_1d(smoothing_mm).tolist())
    step = -(-len(sheet.a) // _MOST_POINTS)
    sheet = sheet.part(slice(None, None, step))
    sheet = dataclasses.replace(sheet, weight=sheet.weight * step)
    anchors = sheet.beyond(fall)
    # Slopes of a first fit say what a difference of value is along the normal.
    spline = _Spline(sheet.region, sizes[0])
    first = spline.solve(spline.equations(sheet) + spline.equations(anchors), lengths[-1])
    by_a, by_b = (spline.rows(sheet, *orders) @ first for orders in ((1, 0), (0, 1)))
    sheet = dataclasses.replace(sheet, weight=sheet.weight / (1.0 + by_a**2 + by_b**2))
    # Patches that touch along an edge are in different folds.
    i, j = (
        np.floor((x - lower) / patch_mm).astype(int)
        for x, (lower, _) in zip((sheet.a, sheet.b), sheet.region, strict=True)
    )
    parts = [sheet.part((i + 2 * j) % _FOLDS == number) for number in range(_FOLDS)]
    # Smoothing and size hardly depend on each other: first one, then the other.
    middle = [lengths[(len(lengths) - 1) // 2]]
    tried = [(size, *row) for size in sizes for row in _held_out(parts, anchors, size, middle)]
    best = min(rms for *_, rms in tried)
    size = next(size for size, _, rms in tried if rms <= _AS_GOOD * best)
    rest = [length for length in lengths if length not in middle]
    tried += [(size, *row) for row in _held_out(parts, anchors, size, rest)]
    _, length, rms = min((row for row in tried if row[0] == size), key=lambda row: row[2])
    spline = _Spline(sheet.region, size)
    cells = spline.cells
    how = {"cells": cells, "smoothing_mm": length, "held_out_rms": rms, "tried": tuple(tried)}
    values = spline.solve(spline.equations(sheet) + spline.equations(anchors), length)
    return values.reshape(cells[0] + 3, cells[1] + 3), how


def _held_out(parts: list[_Sheet], anchors: _Sheet, size: float, lengths: list[float]):
    """Each smoothing, with the rms distance of every part from a fit to the others, mm."""
    spline = _Spline(anchors.region, size)
    each = [spline.equations(part) for part in parts]
    whole = sum(each, start=spline.equations(anchors))
    weight = sum(part.weight.sum() for part in parts)
    for length in lengths:
        square = 0.0
        for part, own in zip(parts, each, strict=True):
            found = spline.rows(part) @ spline.solve(whole - own, length)
            square += float(np.sum(part.weight * (part.value - found) ** 2))
        yield length, float(np.sqrt(square / weight))


class _Spline:
    """Cubic B-splines of equal cells, about `size` mm long, over a region, and their equations."""

    def __init__(self, region: tuple[tuple[float, float], tuple[float, float]], size: float):
        self.region = region
        (a0, a1), (b0, b1) = region
        self.cells = max(1, round((a1 - a0) / size)), max(1, round((b1 - b0) / size))
        (a0, a1, a2), (b0, b1, b2) = (
            tuple(_products(limits, count, k) for k in range(3))
            for limits, count in zip(region, self.cells, strict=True)
        )
        self.bending = np.kron(a2, b0) + 2.0 * np.kron(a1, b1) + np.kron(a0, b2)

    def rows(self, sheet: _Sheet, by_a: int = 0, by_b: int = 0) -> np.ndarray:
        """What each control value adds at each point, or to a derivative there."""
        a = _basis(sheet.a, self.region[0], self.cells[0], by_a)
        b = _basis(sheet.b, self.region[1], self.cells[1], by_b)
        return (a[:, :, None] * b[:, None, :]).reshape(len(a), a.shape[1] * b.shape[1])

    def equations(self, sheet: _Sheet) -> np.ndarray:
        """Normal equations of the points of a sheet, the right side as the last column."""
        rows = self.rows(sheet)
        return (rows * sheet.weight[:, None]).T @ np.c_[rows, sheet.value]

    def solve(self, equations: np.ndarray, smoothing_mm: float) -> np.ndarray:
        """Control values with a bending energy whose weight is the smoothing's fourth power."""
        matrix = equations[:, :-1] + smoothing_mm**4 * self.bending
        # Control values that no point and no bending reaches stay where they are: at zero.
        matrix = matrix + 1e-12 * np.trace(matrix) / len(matrix) * np.eye(len(matrix))
        return np.linalg.solve(matrix, equations[:, -1])


def _products(limits: tuple[float, float], count: int, order: int) -> np.ndarray:
    """Integrals of products of basis functions' derivatives over the region."""
    size = (limits[1] - limits[0]) / count
    node, weight = np.polynomial.legendre.leggauss(4)
    x = (limits[0] + size * (np.arange(count)[:, None] + 0.5 * (1.0 + node))).ravel()
    basis = _basis(x, limits, count, order)
    return basis.T @ (basis * np.tile(0.5 * size * weight, count)[:, None])


def _basis(x: np.ndarray, limits: tuple[float, float], count: int, order: int) -> np.ndarray:
    """Cubic B-splines of `count` equal cells, or a derivative of theirs, shape `(n, count + 3)`."""
    from scipy.interpolate import BSpline  # 0.1 s that no other command should wait for

    size = (limits[1] - limits[0]) / count
    knots = limits[0] + size * np.arange(-3, count + 4)
    return BSpline(knots, np.eye(count + 3), 3)(x, order)


def _enough(points: np.ndarray, what: str) -> None:
    if len(points) < 16:
        raise ValueError(f"{what}: {len(points)} points in the region; a spline needs 16 at least")
