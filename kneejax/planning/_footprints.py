"""Footprints of ligaments on the bones, and the plane of a map warped onto them.

The curves are aligned by dtaidistance; the distance is the sum of the absolute offsets along the
alignment, as in paper 2 (section 4.3).
"""

__all__ = [
    "DIRECTIONS", "FARTHEST_MM", "SEMI_AXES_MM", "WINDOW", "Footprint", "footprint_of", "octagon",
    "offsets", "warped_distances",
]

import dataclasses
from collections.abc import Callable

import numpy as np

from kneejax.geometry import FEMUR, TIBIA
from kneejax.mechanics import Knee
from kneejax.numerics import imported
from kneejax.parameters import fibre_rows

#: How many places one curve may run ahead of the other, by default.
WINDOW = 5


def offsets(
    curves: np.ndarray, slopes: np.ndarray, reference: np.ndarray, window: int = WINDOW
) -> tuple[np.ndarray, np.ndarray]:
    """Offsets of curves from others along the best alignment of each pair, and their derivative.

    Args:
        curves: `(n, k)`, finite.
        slopes: their derivative by some numbers, `(n, k, numbers)`.
        reference: `(m, k)`.
        window: places by which one may run ahead of the other.

    Returns:
        Offsets of all pairs of places, curve by curve, `(pairs,)`, whose absolute values add up to
        the distance, and their derivative, `(pairs, numbers)`.

    Raises:
        MissingPackage: dtaidistance is not installed.

    Source: distance and window of `dtaidistance.dtw` with `inner_dist="euclidean"`.

    Example:
        >>> import pytest; _ = pytest.importorskip("dtaidistance")
        >>> curve, other = np.array([[0.0], [1.0], [0.0]]), np.array([[0.0], [3.0], [0.0]])
        >>> float(np.abs(offsets(curve, np.ones((3, 1, 1)), other)[0]).sum())
        2.0
    """
    dtw = imported("dtaidistance.dtw", "dtaidistance", "planning")
    found, by = [], []
    for k, (curve, wanted) in enumerate(zip(curves.T, reference.T, strict=True)):
        pair = (np.ascontiguousarray(x, float) for x in (curve, wanted))
        # dtaidistance counts the place itself as within the window.
        path = dtw.warping_path(*pair, window=window + 1, inner_dist="euclidean")
        here, there = np.array(path, int).T
        found.append(curve[here] - wanted[there])
        # Of many alignments the best one stays the best under a small change.
        by.append(slopes[here, k])
    return np.concatenate(found), np.concatenate(by)


def warped_distances(curves: np.ndarray, reference: np.ndarray, window: int = WINDOW) -> np.ndarray:
    """Distances of many curves `(k, n)` from one, `(k,)`, by their `offsets` from it; NaN where a
    number is not finite."""
    dtw = imported("dtaidistance.dtw", "dtaidistance", "planning")
    fast = dtw.distance_fast if dtw.try_import_c() else dtw.distance
    curves, reference = (np.ascontiguousarray(x, float) for x in (curves, reference))
    found = np.full(len(curves), np.nan)
    known = np.isfinite(curves).all(axis=1) & np.isfinite(reference).all()
    for k in np.flatnonzero(known):
        found[k] = fast(curves[k], reference, window=window + 1, inner_dist="euclidean")
    return found


#: Bone -> names of the two coordinates of a tunnel, and their directions in the bone's frame (X
#: anterior, Y superior, Z lateral of a right knee, which stored knees are): tibial plateau and the
#: wall of the notch.
DIRECTIONS = {
    TIBIA: (("anterior", (1.0, 0.0, 0.0)), ("medial", (0.0, 0.0, -1.0))),
    FEMUR: (("anterior", (1.0, 0.0, 0.0)), ("proximal", (0.0, 1.0, 0.0))),
}
#: Bone -> semi-axes of the footprint along them, mm. Tibia 14 mm from front to back and 10 mm
#: across, femur 15 mm long, along the bone here, and 8 mm wide: Siebold et al., Arthroscopy 24
#: (2008), 154 and 585, 50 cadavers; not compared with the printed pages. As ellipses, 110 and
#: 94 mm2, they are rather small: Araki et al. (KSSTA 26, 2018, 1311) scanned 135 and 110 mm2.
SEMI_AXES_MM = {TIBIA: (7.0, 5.0), FEMUR: (4.0, 7.5)}
#: Farthest that a planned point may lie from a bone's mesh, mm.
FARTHEST_MM = 3.0
#: Fibres from which the slope of an insertion is fitted, and their smallest spread, mm.
_ENOUGH_FIBRES, _ENOUGH_MM = 4, 1.0

#: `(n, 3)` -> the nearest points of a bone and its normals there, `(n, 3)`, and distances, mm.
Surface = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]


@dataclasses.dataclass(frozen=True)
class Footprint:
    """The insertion of a ligament on one bone.

    Attributes:
        bone: `femur` or `tibia`.
        middle: of the fibres' ends, `(3,)`, mm, in the bone's frame.
        axes: the two directions in the insertion's plane, `(2, 3)`, unit vectors.
        semi_axes_mm: of the ellipse along them.
        fibres: ends of the ligament's own fibres as tunnels, `(fibres, 2)`, mm.
        surface: of the bone, on which tunnels begin; None where the plane stands for it.
    """

    bone: str
    middle: np.ndarray
    axes: np.ndarray
    semi_axes_mm: tuple[float, float]
    fibres: np.ndarray
    surface: Surface | None = None

    @property
    def names(self) -> tuple[str, str]:
        """What the two coordinates of a tunnel are called."""
        (first, _), (second, _) = DIRECTIONS[self.bone]
        return first, second

    def place(self, tunnels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where tunnels are.

        Args:
            tunnels: from the middle along the two axes, `(n, 2)`, mm.

        Returns:
            Points in the bone's frame, `(n, 3)`, mm, and their derivative, `(n, 3, 2)`.
        """
        points = self.middle + tunnels @ self.axes
        slopes = np.broadcast_to(self.axes.T, (len(points), 3, 2))
        if self.surface is None:
            return points, slopes
        points, normals, _ = self.surface(points)
        # The nearest point of a face moves as the plane's point does, but for what leaves the face.
        return points, slopes - normals[:, :, None] * (normals[:, None, :] @ slopes)

    def outside(self, tunnels: np.ndarray) -> np.ndarray:
        """How far out tunnels are, `(n,)`: 0 in the middle, 1 on the ellipse."""
        return np.sqrt(np.sum((tunnels / np.array(self.semi_axes_mm)) ** 2, axis=-1))

    def off_bone(self, tunnels: np.ndarray) -> np.ndarray:
        """Distance of tunnels from the bone's mesh, `(n,)`, mm; 0 without a mesh."""
        points = self.middle + np.atleast_2d(tunnels) @ self.axes
        return np.zeros(len(points)) if self.surface is None else self.surface(points)[2]


def footprint_of(
    knee: Knee, ligament: str, bone: str, semi_axes_mm: tuple[float, float] | None = None,
    surface: Surface | None = None,
) -> Footprint:  # fmt: skip
    """The insertion of a knee's own ligament.

    Its plane is that of the two anatomical directions; where the ligament has four fibres or more
    that spread in both of them, the plane is fitted to their ends and both directions lie in it.

    Args:
        knee: any knee.
        ligament: a fibre or a group of fibres.
        bone: `femur` or `tibia`.
        semi_axes_mm: of the ellipse; means of cadavers by default.
        surface: of the bone.

    Raises:
        UnknownParameter: the knee has no such ligament.

    Example:
        >>> import kneejax as kj
        >>> footprint_of(kj.load_knee("ten_bundle"), "ACL", "tibia").middle.round(1).tolist()
        [16.4, -23.2, 1.0]
    """
    own = knee.ligaments
    every = own.femoral_attachment if bone == FEMUR else own.tibial_attachment
    ends = np.asarray(every)[fibre_rows(knee, ligament)]
    axes = np.array([direction for _, direction in DIRECTIONS[bone]])
    middle = ends.mean(axis=0)
    across = (ends - middle) @ axes.T
    if len(ends) >= _ENOUGH_FIBRES and np.linalg.svd(across)[1][1] > _ENOUGH_MM:
        up = np.cross(*axes)
        tilt = np.linalg.lstsq(across, (ends - middle) @ up, rcond=None)[0]
        axes = axes + tilt[:, None] * up
        axes[0] /= np.linalg.norm(axes[0])
        axes[1] -= axes[0] * (axes[0] @ axes[1])
        axes[1] /= np.linalg.norm(axes[1])
    semi = SEMI_AXES_MM[bone] if semi_axes_mm is None else semi_axes_mm
    return Footprint(bone, middle, axes, semi, (ends - middle) @ axes.T, surface)


def octagon(apothem_mm: float = 10.0) -> np.ndarray:
    """Corners of a regular octagon around the middle of an insertion, `(8, 2)`, mm.

    Args:
        apothem_mm: distance of its sides from the middle; 10 mm in paper 2.

    Returns:
        Tunnels: the first one in front and medial of the middle, then by way of the lateral side.
        Paper 2 does not print where its numbers begin, nor in which sense they run.

    Example:
        >>> octagon().round(2)[0].tolist()
        [10.0, 4.14]
    """
    angle = np.pi / 8.0 - np.pi / 4.0 * np.arange(8)
    return apothem_mm / np.cos(np.pi / 8.0) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
