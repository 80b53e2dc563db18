"""Extension and flexion facets of the condyles: regions of a mesh, cylinders, facet centres.

A condyle seen from the side is two arcs (Iwaki et al. 2000, whom paper 5 follows): in extension the
tibia meets the front one, in flexion the rear one, which is rounder. (Monk et al., Bone Joint J
96-B, 2014: of 25 knees the medial front circle is 35 % larger than the rear one.) Across, a condyle
is about as round as along, so that a cylinder fitted to all of it may lie the wrong way: facets are
strips along the crest.
"""

__all__ = [
    "EXTENSION_DEG", "FLEXION_DEG", "CondyleAxes", "Facet", "at_distance", "condyle_axes",
    "touching_rows",
]

import dataclasses

import numpy as np
from jax.typing import ArrayLike

from kneejax.geometry import CylinderFit, Pose, Vector, fit_cylinder
from kneejax.joints._frames import UnsuitableMesh

#: Regions of a condyle's facets, degrees from anterior through distal about the transverse axis.
EXTENSION_DEG, FLEXION_DEG = (65.0, 110.0), (110.0, 190.0)
#: Sides of the femur, in the order of every array of axis points.
SIDES = ("medial", "lateral")
FACETS = ("extension", "flexion")

#: A cylinder through fewer points is refused.
FEWEST_POINTS = 30
# The condyles from distal to posterior, where they are round together; and how far they reach.
_ROUND_DEG, _FARTHEST_MM, _NOTCH_MM = (75.0, 200.0), 45.0, 5.0
_WIDTH_MM = (30.0, 200.0)
_RADIUS_MM, _AXIS_ROUNDS = 24.0, 4
# A facet's axis that is turned further, or known worse, takes the direction of the transverse axis.
_STEEPEST_DEG, _WORST_KNOWN_DEG = 25.0, 10.0
_OUTWARD = 0.3
_ROUND = "condyles that are round below and behind, X anterior, Y superior, Z lateral"
_BIN_MM = 2.0


@dataclasses.dataclass(frozen=True)
class TransverseAxis:
    """The axis of the cylinder, of a radius in mm, about which the condyles together are round."""

    center: np.ndarray  # at `Z = 0`, shape `(3,)`, mm
    direction: np.ndarray  # unit vector, to lateral
    radius: float

    def place(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Angle from anterior through distal, degrees; distance from it and Z along it, mm."""
        away = points - self.center
        along = away @ self.direction
        forward = np.array([1.0, 0.0, 0.0]) - self.direction[0] * self.direction
        forward /= np.linalg.norm(forward)
        x, y = away @ forward, away @ np.cross(self.direction, forward)
        return np.rad2deg(0.5 * np.pi - np.arctan2(x, -y)), np.hypot(x, y), along


@dataclasses.dataclass(frozen=True)
class Facet:
    """A region of a condyle and its cylinder.

    Attributes:
        side: `medial` or `lateral`.
        name: `extension` or `flexion`.
        rows: the points of the mesh that belong to it, shape `(n,)`.
        cylinder: fitted to them.
        turned: whether the cylinder's direction is its own; otherwise it is the transverse axis',
            since the points do not tell.
    """

    side: str
    name: str
    rows: np.ndarray
    cylinder: CylinderFit
    turned: bool

    @property
    def center(self) -> np.ndarray:
        """The mean point along the axis, shape `(3,)`, mm."""
        return self.cylinder.center


@dataclasses.dataclass(frozen=True)
class CondyleAxes:
    """Axes of the joint, from the shape of a femur.

    Attributes:
        transverse: of both condyles together.
        facets: medial extension, lateral extension, medial flexion, lateral flexion.
        points: medial and lateral point of the extension, then of the flexion axis, shape
            `(2, 2, 3)`, mm: the facet centres, the lateral flexion centre shifted along its axis
            to the extension centres' distance.
    """

    transverse: TransverseAxis
    facets: tuple[Facet, ...]
    points: np.ndarray


def condyle_axes(
    points: ArrayLike,
    normals: ArrayLike | None = None,
    extension_deg: tuple[float, float] = EXTENSION_DEG,
    flexion_deg: tuple[float, float] = FLEXION_DEG,
    width_mm: float = 10.0,
    touching: tuple[ArrayLike, ArrayLike] | None = None,
) -> CondyleAxes:
    """Fit cylinders to the extension and flexion facets of both condyles.

    Args:
        points: corners of a mesh of the femur or its cartilage, shape `(n, 3)`, mm, X anterior, Y
            superior, Z lateral, with `Z = 0` between the condyles.
        normals: outward at the points, likewise; with them, walls and rear sides are left out.
        extension_deg: region of the extension facets, from anterior through distal.
        flexion_deg: of the flexion facets.
        width_mm: of the strips along the crests.
        touching: instead of the two regions, rows of points that meet the tibia in extension and
            in flexion, as truth values of shape `(n,)`; see `touching_rows`.

    Returns:
        The facets and the axis points.

    Raises:
        UnsuitableMesh: the condyles are not found, a facet has fewer than `FEWEST_POINTS` points or
            no cylinder, or the lateral flexion axis is farther from the medial centre than the
            extension centres are from each other.

    Source: paper 5, section 2.5.1, after Iwaki, Pinskerova and Freeman, J Bone Joint Surg Br 82
    (2000), which was not at hand: nothing here rests on its numbers.
    """
    p = np.asarray(points, float)
    n = None if normals is None else np.asarray(normals, float)
    width = float(np.ptp(p[:, 2])) if len(p) else 0.0
    if not _WIDTH_MM[0] < width < _WIDTH_MM[1]:
        expected = f"{_WIDTH_MM[0]:g} to {_WIDTH_MM[1]:g} mm"
        expected += "; is the mesh in metres?" if width < 1.0 else ""
        raise UnsuitableMesh("width of the femur (along Z)", f"{width:.3g} mm", expected)
    transverse = _transverse_axis(p, n, width_mm)
    angle, _, _ = transverse.place(p)
    facets = []
    for i, (name, limits) in enumerate(zip(FACETS, (extension_deg, flexion_deg), strict=True)):
        region = (angle > limits[0]) & (angle < limits[1])
        words = f"between {limits[0]:g} and {limits[1]:g} degrees"
        if touching is not None:
            region, words = np.asarray(touching[i], bool), "that meet the tibia"
        for side in SIDES:
            facets.append(_facet(side, name, p, n, transverse, region, width_mm, words))
    medial, lateral, rear, _ = (facet.center for facet in facets)
    apart = float(np.linalg.norm(lateral - medial))
    axes = [[medial, lateral], [rear, at_distance(rear, facets[3].cylinder, apart)]]
    return CondyleAxes(transverse, tuple(facets), np.array(axes))


def at_distance(medial: ArrayLike, lateral: CylinderFit, distance: float) -> np.ndarray:
    """The point of the lateral axis at a distance from the medial centre, nearest to its centre.

    Args:
        medial: centre, shape `(3,)`, mm.
        lateral: cylinder whose axis is followed.
        distance: mm.

    Returns:
        Shape `(3,)`, mm.

    Raises:
        UnsuitableMesh: no point of the axis is as near.

    Source: paper 5, section 2.5.1.
    """
    away = lateral.center - np.asarray(medial, float)
    along = away @ lateral.direction
    square = along**2 - (away @ away - distance**2)
    if square < 0:
        found = f"{np.sqrt(away @ away - along**2):.1f} mm from the medial flexion centre"
        expected = f"no farther than the extension centres are apart, {distance:.1f} mm"
        raise UnsuitableMesh("lateral flexion axis", found, expected)
    shifts = -along + np.sqrt(square) * np.array([-1.0, 1.0])
    return lateral.center + shifts[np.argmin(np.abs(shifts))] * lateral.direction


def touching_rows(
    points: ArrayLike, tibial: ArrayLike, pose: Pose, within_mm: float = 4.0
) -> np.ndarray:
    """Which points of the femur lie near the tibia in a pose.

    Args:
        points: of the femur, shape `(n, 3)`, mm.
        tibial: of the tibia, in its frame, shape `(m, 3)`, mm.
        pose: of the tibia in the femur, fields of shape `()`.
        within_mm: how near.

    Returns:
        Truth values, shape `(n,)`.

    Raises:
        UnsuitableMesh: none is as near.

    Example:
        >>> from kneejax.geometry import Pose
        >>> still = Pose.from_table([0.0] * 6)
        >>> touching_rows([[0.0, 0.0, 0.0], [0.0, 30.0, 0.0]], [[0.0, -2.0, 0.0]], still).tolist()
        [True, False]
    """
    from scipy.spatial import KDTree

    there = pose.placement.apply(Vector.of(np.asarray(tibial, float).T))
    distance, _ = KDTree(np.stack([*there], axis=1)).query(np.asarray(points, float))
    touching = distance < within_mm
    if not touching.any():
        what = f"femur and tibia at {np.rad2deg(float(pose.flexion)):.1f} degrees"
        expected = f"corners nearer than {within_mm:g} mm"
        doubt = "are both bones in the frames of the poses?"
        raise UnsuitableMesh(what, f"{distance.min():.1f} mm apart", f"{expected}; {doubt}")
    return touching


def _transverse_axis(p: np.ndarray, normals: np.ndarray | None, width: float) -> TransverseAxis:
    """Cylinder through both crests, sought again in the region that its last axis defines."""
    near = p[p[:, 1] < np.quantile(p[:, 1], 0.01) + 2.0 * _RADIUS_MM]
    center = np.array([near[:, 0].min() + _RADIUS_MM, near[:, 1].min() + _RADIUS_MM, 0.0])
    axis = TransverseAxis(center, np.array([0.0, 0.0, 1.0]), _RADIUS_MM)
    for _ in range(_AXIS_ROUNDS):
        angle, _, _ = axis.place(p)
        region = (angle > _ROUND_DEG[0]) & (angle < _ROUND_DEG[1])
        strips = [_strip(axis, p, normals, region, side, width) for side in SIDES]
        for side, rows in zip(SIDES, strips, strict=True):
            if len(rows) < FEWEST_POINTS:
                found = f"{len(rows)} points below and behind the middle"
                axes = "X anterior, Y superior, Z lateral, mm, Z = 0 between the condyles"
                raise UnsuitableMesh(f"{side} condyle", found, f"at least {FEWEST_POINTS}: {axes}")
        try:
            fit = fit_cylinder(p[np.concatenate(strips)], along=(0.0, 0.0, 1.0))
        except ValueError as error:
            raise UnsuitableMesh("transverse axis", str(error), _ROUND) from None
        tilt = np.rad2deg(np.arccos(min(1.0, fit.direction[2])))
        if tilt > _STEEPEST_DEG:
            expected = f"at most {_STEEPEST_DEG:g}: {_ROUND}"
            raise UnsuitableMesh("transverse axis", f"{tilt:.0f} degrees off Z", expected)
        foot = fit.center - fit.center[2] / fit.direction[2] * fit.direction
        axis = TransverseAxis(foot, fit.direction, fit.radius)
    return axis


def _strip(axis, p, normals, region, side, width) -> np.ndarray:
    """Numbers of the points of a region along a condyle's crest."""
    _, radius, along = axis.place(p)
    sign = -1.0 if side == "medial" else 1.0
    inside = region & (sign * along > _NOTCH_MM) & (radius < _FARTHEST_MM)
    if normals is not None:
        away = p - axis.center
        away = away - np.outer(away @ axis.direction, axis.direction)
        faces_out = np.einsum("ij,ij->i", away, normals)
        inside &= faces_out > _OUTWARD * np.linalg.norm(away, axis=1)
    rows = np.flatnonzero(inside)
    if len(rows) == 0:
        return rows
    # The crest is where points are farthest from the axis, in the mean over the condyle's arc.
    along, radius = along[rows], radius[rows]
    cell = np.floor((along - along.min()) / _BIN_MM).astype(int)
    count = np.bincount(cell)
    mean = np.bincount(cell, radius) / np.maximum(count, 1)
    # Cells with few points are the condyle's rim.
    mean[count < 0.25 * np.median(count[count > 0])] = -np.inf
    crest = float(along.min() + (np.argmax(mean) + 0.5) * _BIN_MM)
    return rows[np.abs(along - crest) < 0.5 * width]


def _facet(side, name, p, normals, axis, region, width_mm, words) -> Facet:
    rows = _strip(axis, p, normals, region, side, width_mm)
    if len(rows) < FEWEST_POINTS:
        expected = f"at least {FEWEST_POINTS} in a strip of {width_mm:g} mm along the crest"
        raise UnsuitableMesh(f"{side} {name} facet", f"{len(rows)} points {words}", expected)
    try:
        own = fit_cylinder(p[rows], along=axis.direction)
        tilt = np.rad2deg(np.arccos(min(1.0, own.direction @ axis.direction)))
        if tilt < _STEEPEST_DEG and own.direction_error_deg < _WORST_KNOWN_DEG:
            return Facet(side, name, rows, own, True)
        kept = fit_cylinder(p[rows], along=axis.direction, turned=False)
    except ValueError as error:
        raise UnsuitableMesh(f"{side} {name} facet", str(error), "part of a cylinder") from None
    return Facet(side, name, rows, kept, False)
