"""A ligament as a band between two areas of bone: fibres at the points of a quadrature.

A band of Young's modulus `E` and cross-section `A` carries the integral of its fibres' tensions
over the cross-section. The areas are ellipses, images of one unit disc, and a fibre joins the
images of one point of it. The points are those of a product rule on the disc: Gauss's points in
the square of the radius on `rings` circles, equal angles on each, exact for polynomials of degree
`4 rings - 1` below the number of angles. So force and moment of a band that is taut all over
converge faster than any power of the number of fibres. Where a part of it is slack, the law's
corner at the border of that part leaves an order of about 1 in the number of fibres (neo-Hookean)
or 3/2 and more (Blankevoort, whose tension begins with a parabola).
"""

__all__ = ["AttachmentArea", "FibreField", "disc_quadrature", "fibre_field", "untwisted"]

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike


class AttachmentArea(NamedTuple):
    """An ellipse on a bone, in the bone's frame.

    Attributes:
        centre: shape `(3,)`, mm.
        half_axes: two conjugate half diameters, shape `(2, 3)`, mm: the image of a point `(u, v)`
            of the unit disc is `centre + u half_axes[0] + v half_axes[1]`.
    """

    centre: np.ndarray
    half_axes: np.ndarray

    @classmethod
    def of_points(cls, points: ArrayLike, weights: ArrayLike | None = None) -> "AttachmentArea":
        """The ellipse of points that are spread over an area: the same mean, and the same second
        moments.

        Args:
            points: shape `(n, 3)`, mm: of a footprint, or middles of triangles.
            weights: the part of the area that each stands for, `(n,)`; evenly spread without.

        Raises:
            ValueError: fewer than three points, or points on a line.

        Example:
            >>> a, r = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False), np.sqrt([0.1, 0.5, 0.9])
            >>> disc = np.array([[x * np.cos(t), 0.0, x * np.sin(t)] for x in r for t in a])
            >>> area = AttachmentArea.of_points(disc * [6.0, 1.0, 3.0])
            >>> np.round(np.linalg.norm(area.half_axes, axis=1), 6).tolist()
            [6.0, 3.0]
        """
        points = np.asarray(points, float)
        if points.ndim != 2 or points.shape[1] != 3 or len(points) < 3:
            raise ValueError(f"points of shape {points.shape}; expected (n, 3), n at least 3")
        share = np.ones(len(points)) if weights is None else np.asarray(weights, float)
        share = share / share.sum()
        centre = share @ points
        spread = np.sqrt(share)[:, None] * (points - centre)
        _, sizes, directions = np.linalg.svd(spread, full_matrices=False)
        half = 2.0 * sizes[:2]  # a disc's second moment is r^2 / 4
        if not half[1] > 1e-9 * half[0]:
            raise ValueError("points on a line; expected points spread over an area")
        return cls(centre, half[:, None] * directions[:2])

    @classmethod
    def of_outline(cls, outline: ArrayLike) -> "AttachmentArea":
        """The ellipse with the mean and the second moments of the area inside an outline.

        Args:
            outline: corners in order, shape `(n, 3)`, mm, nearly in a plane.

        Raises:
            ValueError: fewer than three corners, or corners on a line.

        Example:
            >>> square = [[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]]
            >>> area = AttachmentArea.of_outline(square)
            >>> np.round(np.linalg.norm(area.half_axes, axis=1), 4).tolist()
            [1.1547, 1.1547]
        """
        corners = np.asarray(outline, float)
        plane = cls.of_points(corners)  # its directions span the plane of the outline
        units = plane.half_axes / np.linalg.norm(plane.half_axes, axis=1, keepdims=True)
        x, y = (corners - plane.centre) @ units.T, np.roll(corners - plane.centre, -1, axis=0)
        y = y @ units.T
        twice = x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0]
        area = 0.5 * twice.sum()
        middle = (twice[:, None] * (x + y)).sum(axis=0) / (6.0 * area)
        pairs = np.einsum("ni,nj->nij", x, x) + np.einsum("ni,nj->nij", y, y)
        pairs = pairs + np.einsum("ni,nj->nij", x + y, x + y)
        moments = np.einsum("n,nij->ij", twice, pairs) / (24.0 * area) - np.outer(middle, middle)
        squares, directions = np.linalg.eigh(moments)
        half = 2.0 * np.sqrt(squares[::-1])[:, None] * directions.T[::-1]
        return cls(plane.centre + middle @ units, half @ units)

    def half(self, towards: ArrayLike) -> "AttachmentArea":
        """The half that lies in a direction, as the ellipse with its mean and second moments. A
        point of the disc keeps its place in it, so that a band is twisted as before.

        Args:
            towards: a direction in the bone's frame, shape `(3,)`.

        Example:
            >>> whole = AttachmentArea(np.zeros(3), np.array([[6.0, 0.0, 0.0], [0.0, 0.0, 3.0]]))
            >>> whole.half([1.0, 0.0, 0.0]).centre.round(3).tolist()
            [2.546, 0.0, 0.0]
        """
        along = self.half_axes @ np.asarray(towards, float)
        if not np.any(along):
            raise ValueError("a direction across the area; expected one along it")
        turn = along / np.linalg.norm(along)
        middle = 4.0 / (3.0 * np.pi)  # of half a disc
        width = 2.0 * np.sqrt(0.25 - middle**2)
        narrower = np.eye(2) - (1.0 - width) * np.outer(turn, turn)
        return AttachmentArea(
            self.centre + middle * turn @ self.half_axes, narrower @ self.half_axes
        )

    def at(self, disc: np.ndarray) -> np.ndarray:
        """Images of points of the unit disc, `(n, 2)`: shape `(n, 3)`, mm."""
        return self.centre + disc @ self.half_axes


def disc_quadrature(fibres: int) -> tuple[np.ndarray, np.ndarray]:
    """Points of the unit disc, and the part of its area that each stands for.

    Args:
        fibres: number of points; one is the middle. A number with a divisor near the root of its
            third serves best: 6, 12, 24, 48, 96.

    Returns:
        Points, shape `(fibres, 2)`, ring by ring, and weights, `(fibres,)`, whose sum is 1.

    Example:
        >>> points, weights = disc_quadrature(24)
        >>> [round(float(weights @ points[:, 0] ** n), 6) for n in (2, 4)]  # 1/4 and 1/8
        [0.25, 0.125]
    """
    if fibres < 1:
        raise ValueError(f"fibres is {fibres}; expected 1 or more")
    if fibres == 1:
        return np.zeros((1, 2)), np.ones(1)
    divisors = [k for k in range(1, fibres) if fibres % k == 0 and fibres // k >= 3] or [1]
    rings = min(divisors, key=lambda k: abs(k - np.sqrt(fibres / 3.0)))
    square, weight = np.polynomial.legendre.leggauss(rings)
    angles = 2.0 * np.pi * np.arange(fibres // rings) / (fibres // rings)
    radius = np.repeat(np.sqrt(0.5 * (1.0 + square)), len(angles))
    angle = np.tile(angles, rings) + np.pi / len(angles) * np.repeat(np.arange(rings), len(angles))
    points = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return points, np.repeat(0.5 * weight, len(angles)) / len(angles)


class FibreField(NamedTuple):
    """Fibres of a band, in the order of `disc_quadrature`.

    Attributes:
        femoral: attachments, shape `(n, 3)`, mm, in the frame of the first bone.
        tibial: likewise, in that of the second.
        area: cross-section that each stands for, `(n,)`, mm^2.
        stiffness: Young's modulus times that, `(n,)`, N per unit strain.
        prestretch: at the reference pose, `(n,)`.
    """

    femoral: np.ndarray
    tibial: np.ndarray
    area: np.ndarray
    stiffness: np.ndarray
    prestretch: np.ndarray


def fibre_field(
    femoral: AttachmentArea,
    tibial: AttachmentArea,
    youngs_modulus: float,
    area: float,
    prestretch: float | Sequence[float] = 1.0,
    fibres: int = 24,
) -> FibreField:
    """The fibres of a band between two areas of bone.

    Args:
        femoral: where it begins.
        tibial: where it ends; its half diameters belong to those of `femoral`, first to first, and
            so tell how the band is twisted (`untwisted`).
        youngs_modulus: MPa.
        area: cross-section, mm^2.
        prestretch: length at the reference pose over slack length; one for all fibres, or two, at
            `-half_axes[0]` and at `+half_axes[0]` of `femoral`, linear between.
        fibres: see `disc_quadrature`.

    Returns:
        Attachments and numbers of every fibre.

    Example:
        >>> end = AttachmentArea(np.zeros(3), np.array([[6.0, 0.0, 0.0], [0.0, 0.0, 3.0]]))
        >>> field = fibre_field(end, end, 100.0, 40.0, [1.02, 1.06])
        >>> round(float(field.stiffness.sum()), 6), len(field.femoral)
        (4000.0, 24)
    """
    disc, weights = disc_quadrature(fibres)
    low, high = np.broadcast_to(np.asarray(prestretch, float), 2)
    stretch = 0.5 * (low + high) + 0.5 * (high - low) * disc[:, 0]
    areas = float(area) * weights
    return FibreField(femoral.at(disc), tibial.at(disc), areas, youngs_modulus * areas, stretch)


def untwisted(femoral: AttachmentArea, tibial: AttachmentArea) -> AttachmentArea:
    """The second area with those half diameters that twist the band least.

    Args:
        femoral: where the band begins.
        tibial: where it ends; both in axes that are parallel at the reference pose.

    Returns:
        The same ellipse; its half diameters are turned around it, and their sense is changed where
        that brings the ends of fibres nearer to each other.

    Example:
        >>> axes = np.array([[6.0, 0.0, 0.0], [0.0, 0.0, 3.0]])
        >>> end, other = (AttachmentArea(np.zeros(3), x) for x in (axes, -axes[::-1]))
        >>> untwisted(end, other).half_axes.round(9).tolist()
        [[6.0, 0.0, 0.0], [0.0, 0.0, 3.0]]
    """
    # The nearest orthogonal matrix (Procrustes) between the two pairs of half diameters.
    left, _, right = np.linalg.svd(femoral.half_axes @ tibial.half_axes.T)
    return AttachmentArea(tibial.centre, left @ right @ tibial.half_axes)
