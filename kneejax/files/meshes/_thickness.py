"""Thickness of cartilage: from its surface along the normal to the bone."""

from __future__ import annotations

import numpy as np

from kneejax.files.meshes._anatomy import Cloud
from kneejax.files.meshes._health import Sheet
from kneejax.files.reading import InputProblem

#: Bone is looked for this far below and above the cartilage's surface, mm.
DEEPEST_MM, HIGHEST_MM = 12.0, 4.0
#: Cartilage may end below the bone's surface at its rims: meshes are refused where more than this
#: share of the area lies deeper than this, mm.
MOST_NEGATIVE, TOUCHING_MM = 0.2, 0.1
_CELL_MM = 5.0


def distances_along(
    points: np.ndarray, directions: np.ndarray, sheets: list[Sheet]
) -> np.ndarray:
    """Signed distance along lines to the nearest bone surface that is met from outside.

    Args:
        points: shape `(n, 3)`, mm.
        directions: unit vectors into the bone, shape `(n, 3)`.
        sheets: of the bone, closed or open; an open one may face either way.

    Returns:
        Distances, mm, shape `(n,)`; negative where the bone's surface lies above the point, NaN
        where there is none from `HIGHEST_MM` above to `DEEPEST_MM` below.

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
    """Thickness of a cartilage at its corners, mm; NaN where no bone lies below.

    Args:
        cartilage: its articular surface.
        bone: the bone's surface in the same frame.
        what: how an error calls the cartilage.

    Raises:
        InputProblem: no bone lies below most of it, or it lies below the bone's surface.
    """
    found = distances_along(cartilage.points, -cartilage.normals, bone)
    known = np.isfinite(found)
    name = bone[0].name
    share = float(np.average(known, weights=cartilage.areas))
    if share < 0.5:
        expected = f"bone below the {what} cartilage; do both meshes have one frame?"
        value = f"below {100 * share:.0f} % of the cartilage"
        raise InputProblem(name, "place", value, expected)
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
