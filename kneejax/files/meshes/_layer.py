"""Thickness of the layer that femoral and tibial cartilage form together: down to the bones."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.polynomial import polynomial

from kneejax.files.meshes._anatomy import Cloud, Femur, in_frame, joined
from kneejax.files.meshes._health import Sheet
from kneejax.files.meshes._surfaces import SheetFit
from kneejax.files.reading import InputProblem

#: Thickness of both cartilages where nothing is known of it, mm.
ASSUMED_MM = 6.0
#: A field is nowhere thinner than this, mm: else it is taken simpler.
_THINNEST_MM = 0.5
_DEGREES = (3, 2, 1)
#: Bone is looked for this far below and above the cartilage's surface, mm.
DEEPEST_MM, HIGHEST_MM = 12.0, 4.0
#: Cartilage may end below the bone's surface at its rims: meshes are refused where more than this
#: share of the area lies deeper than this, mm.
MOST_NEGATIVE, TOUCHING_MM = 0.2, 0.1
_CELL_MM = 5.0


class Layer(NamedTuple):
    """Thickness of a compartment's layer: mean over the contact region, how it was found, and a
    polynomial over the plateau's scaled parameters that is added, or None."""

    thickness_mm: float
    source: str
    variation: np.ndarray | None = None


def find_layer(
    name: str,
    condyle: SheetFit,
    plateau: SheetFit,
    femur: Femur,
    sheet: Sheet,
    bones: tuple[list[Sheet], list[Sheet]] | None,
    kind: str,
    findings: list[str],
) -> Layer:
    """Measure the layer of a compartment between the surfaces of the bones, where they are known:
    `constant`, or a `field` over the plateau's parameters. Raises where cartilage lies below its
    bone."""
    if bones is None:
        return Layer(ASSUMED_MM, "assumed: no bone meshes")
    # Points of the condyle's contact region with their normals.
    wanted = {tuple(p) for p in condyle.fit.points[condyle.region].tolist()}
    on_condyle = femur.cloud.kept([tuple(p) in wanted for p in femur.cloud.points.tolist()])
    tibial = joined([sheet])
    above_femur = thickness(on_condyle, bones[0], f"{name} femoral")
    above_tibia = thickness(tibial, bones[1], f"{name} tibial")
    known = np.isfinite(above_femur)
    femoral = float(np.average(above_femur[known], weights=on_condyle.areas[known]))
    known = np.isfinite(above_tibia)
    here = known & plateau.region
    own = float(np.average(above_tibia[here], weights=tibial.areas[here]))
    findings.append(
        f"{name}: cartilage {femoral:.2f} mm thick on the femur and {own:.2f} mm on the tibia, on "
        "average over the contact region."
    )
    mean = femoral + own
    if mean < _THINNEST_MM:
        value = f"{mean:.2f} mm in the {name} contact region"
        expected = f"cartilage of at least {_THINNEST_MM:g} mm on both bones together"
        raise InputProblem(sheet.name, "thickness", value, expected)
    source = "mean distance along the normal from cartilage to bone, both bones, contact region"
    if kind == "constant":
        return Layer(mean, source)
    surface = plateau.fit.surface
    s, t = (
        2.0 * (c - lower) / (upper - lower) - 1.0
        for c, (lower, upper) in zip(
            in_frame(surface.frame, tibial.points[known]).T[[0, 2]],
            (np.asarray(x) for x in (surface.x, surface.z)), strict=True)
    )
    # The femoral share is its mean, since that part moves. What lies outside the contact region
    # steers a field little, and keeps it in bounds.
    weights = np.where(plateau.region, 1.0, 0.1)[known] * tibial.areas[known]
    s, t, values, weights = _with_corners(s, t, femoral + above_tibia[known] - mean, weights)
    grid = np.linspace(-1.0, 1.0, 25)
    for degree in _DEGREES:
        table = _fitted(s, t, values, weights, degree)
        field = mean + polynomial.polygrid2d(grid, grid, table)
        if field.min() >= _THINNEST_MM:
            off = values - polynomial.polyval2d(s, t, table)
            rms = float(np.sqrt(np.average(off**2, weights=weights)))
            findings.append(
                f"{name}: thickness from {field.min():.1f} to {field.max():.1f} mm as a polynomial "
                f"of degree {degree}, {rms:.2f} mm rms from the measured."
            )
            return Layer(mean, source, table)
    findings.append(f"{name}: the thickness varies too much for a smooth field; constant instead.")
    return Layer(mean, source)


def _with_corners(s, t, values, weights):
    """With places beyond the sheet, as thick as the nearest of its own: they hold a field there."""
    grid = np.linspace(-1.0, 1.0, 11)
    a, b = (x.ravel() for x in np.meshgrid(grid, grid))
    apart = (a[:, None] - s) ** 2 + (b[:, None] - t) ** 2
    nearest = np.argmin(apart, axis=1)
    beyond = apart[np.arange(len(a)), nearest] > 0.1**2
    own = np.full(beyond.sum(), 0.5 * weights.sum() / len(a))
    return (
        np.r_[s, a[beyond]], np.r_[t, b[beyond]], np.r_[values, values[nearest[beyond]]],
        np.r_[weights, own],
    )  # fmt: skip


def _fitted(s, t, values, weights, degree: int) -> np.ndarray:
    """Coefficients of the nearest polynomial of a whole degree."""
    table, root = np.zeros((degree + 1, degree + 1)), np.sqrt(weights)
    powers = np.add.outer(range(degree + 1), range(degree + 1)) <= degree
    columns = polynomial.polyvander2d(s, t, [degree, degree])[:, powers.ravel()]
    table[powers] = np.linalg.lstsq(columns * root[:, None], root * values, rcond=None)[0]
    return table


def distances_along(
    points: np.ndarray, directions: np.ndarray, sheets: list[Sheet]
) -> np.ndarray:
    """Signed distance along lines to the nearest bone surface that is met from outside, mm, `(n,)`.

    `points` are `(n, 3)`, mm, `directions` unit vectors into the bone; sheets of the bone may be
    closed or open, which then may face either way. Negative where the bone's surface lies above
    the point, NaN where there is none from `HIGHEST_MM` above to `DEEPEST_MM` below.

    Source: Moeller and Trumbore, Journal of Graphics Tools 2 (1997).
    """
    corner = [np.concatenate([s.points[s.faces[:, k]] for s in sheets]) for k in range(3)]
    sided = np.concatenate([np.full(len(s.faces), s.closed) for s in sheets])
    center = sum(corner) / 3.0
    reach = max(float(np.linalg.norm(c - center, axis=1).max()) for c in corner)
    answer = np.full(len(points), np.nan)
    # Neighbouring lines see the same few triangles.
    _, cell = np.unique(np.floor(points / _CELL_MM).astype(int), axis=0, return_inverse=True)
    order = np.argsort(cell.ravel(), kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(cell.ravel()[order])) + 1):
        down, up = DEEPEST_MM * directions[rows], HIGHEST_MM * directions[rows]
        box = np.r_[points[rows] + down, points[rows] - up]
        near = ((center > box.min(axis=0) - reach) & (center < box.max(axis=0) + reach)).all(axis=1)
        if near.any():
            a, b, c = (x[near] for x in corner)
            answer[rows] = _nearest(points[rows], directions[rows], a, b, c, sided[near])
    return answer


def thickness(cartilage: Cloud, bone: list[Sheet], what: str) -> np.ndarray:
    """Thickness of a cartilage at its corners, mm; NaN where no bone lies below. Raises where none
    lies below most of it, or it lies below the bone's surface."""
    found = distances_along(cartilage.points, -cartilage.normals, bone)
    known = np.isfinite(found)
    name = bone[0].name
    share = float(np.average(known, weights=cartilage.areas))
    if share < 0.5:
        expected = f"bone below the {what} cartilage; do both meshes have one frame?"
        raise InputProblem(name, "place", f"below {100 * share:.0f} % of the cartilage", expected)
    below = float(np.average(found[known] < -TOUCHING_MM, weights=cartilage.areas[known]))
    if below > MOST_NEGATIVE:
        expected = f"a {what} cartilage thicker than zero, above its bone"
        value = f"negative over {100 * below:.0f} % of the cartilage"
        raise InputProblem(name, "thickness", value, expected)
    return found


def _nearest(points, directions, a, b, c, sided) -> np.ndarray:
    ab, ac = b - a, c - a
    normal = np.cross(ab, ac)
    # Positive where a line enters the solid through the triangle.
    entering = -directions @ normal.T
    ok = np.abs(entering) > 1e-12
    scale = np.where(ok, entering, 1.0)
    to_a = points[:, None] - a[None]
    distance = np.einsum("pti,ti->pt", to_a, normal) / scale
    turned = np.cross(to_a, -directions[:, None])
    u = -np.einsum("pti,ti->pt", turned, ac) / scale
    v = np.einsum("pti,ti->pt", turned, ab) / scale
    slack = 1e-9
    hit = ok & (u >= -slack) & (v >= -slack) & (u + v <= 1.0 + slack)
    hit &= (entering > 0) | ~sided
    hit &= (distance > -HIGHEST_MM) & (distance < DEEPEST_MM)
    size = np.where(hit, np.abs(distance), np.inf)
    best = np.argmin(size, axis=1)
    rows = np.arange(len(points))
    return np.where(np.isfinite(size[rows, best]), distance[rows, best], np.nan)
