"""Least-squares cylinder of points, such as those of a facet of a condyle."""

__all__ = ["CylinderFit", "fit_cylinder", "fit_transverse_axis"]

import dataclasses

import numpy as np
from jax.typing import ArrayLike

from kneejax.geometry._fit_surface import Fit, center_and_radius, points_and_weights
from kneejax.geometry._pose import Frame

# Directions that are tried where none is known, and how many of them are followed to the end.
_DIRECTIONS, _FOLLOWED = 64, 3
# The axis is sought within about 45 degrees of a start, which is then renewed.
_RENEWALS = 2
# Centres of circles that are tried, in standard deviations of the points along their arc.
_CENTERS = np.array([-16.0, -8.0, -4.0, -2.0, -1.0, 1.0, 2.0, 4.0, 8.0, 16.0])
# A cylinder leaves less than this share of what a plane leaves.
_SHARE_OF_PLANE = 0.9


@dataclasses.dataclass(frozen=True)
class CylinderFit(Fit):
    """A fitted cylinder and what is left over.

    Attributes:
        center: point of the axis nearest to the mean of the points, shape `(3,)`, mm.
        direction: unit vector along the axis, shape `(3,)`.
        radius: mm.
        residual: signed distance of each point from the surface, shape `(n,)`, mm.
        weights: weight of each point.
        center_error: standard error of the centre where it is worst known, mm, from what is
            left over; independent errors of the points are assumed.
        direction_error_deg: likewise of the direction.

    Example:
        >>> from kneejax.geometry import fit_cylinder
        >>> turns, z = np.meshgrid(np.linspace(0.0, 2.0, 20), np.linspace(-10.0, 10.0, 9))
        >>> points = np.stack([20.0 * np.cos(turns), 20.0 * np.sin(turns), z], -1).reshape(-1, 3)
        >>> round(fit_cylinder(points).radius, 6)
        20.0
    """

    center: np.ndarray
    direction: np.ndarray
    radius: float
    residual: np.ndarray
    weights: np.ndarray
    center_error: float
    direction_error_deg: float


def fit_cylinder(
    points: ArrayLike,
    weights: ArrayLike | None = None,
    along: ArrayLike | None = None,
    turned: bool = True,
) -> CylinderFit:
    """Fit a cylinder by the squared distances of the points.

    Args:
        points: shape `(n, 3)`, mm.
        weights: shape `(n,)`; equal by default.
        along: direction, within some 45 degrees of the axis, to which the fit's shall point;
            without it every direction is tried.
        turned: whether the axis may turn against `along`.

    Returns:
        The cylinder.

    Raises:
        ValueError: fewer than 6 points, or a plane fits them as well.

    Example:
        >>> angle, height = np.meshgrid(np.linspace(0.0, 1.0, 9), np.linspace(-9.0, 9.0, 7))
        >>> rows = [20.0 * np.cos(angle), 20.0 * np.sin(angle), height]
        >>> found = fit_cylinder(np.stack(rows, axis=-1).reshape(-1, 3), along=(0, 0, 1))
        >>> round(found.radius, 6), found.direction.round(6).tolist()
        (20.0, [0.0, 0.0, 1.0])
    """
    p, w = points_and_weights(points, weights, 6, "cylinder")
    middle = np.average(p, axis=0, weights=w)
    root = np.sqrt(w / w.mean())
    if along is None:
        starts, turned = _starts(p - middle, root), True
    else:
        starts = [np.asarray(along, float) / np.linalg.norm(along)]
    fits = [_followed(p - middle, root, start, turned) for start in starts]
    best = min((fit for fit in fits if fit is not None), key=lambda fit: fit[0], default=None)
    seen = p - middle if turned else (p - middle) @ _across(starts[0])
    flat = np.linalg.svd(seen * root[:, None], compute_uv=False)[-1] ** 2 / len(p)
    if best is None or not best[0] < _SHARE_OF_PLANE**2 * flat:
        raise ValueError("a plane fits as well as a cylinder: is the arc long enough?")
    _, center, direction, radius, jacobian = best
    away = p - middle - center
    residual = np.linalg.norm(away - np.outer(away @ direction, direction), axis=1) - radius
    center_error, direction_error = _errors(jacobian, residual * root)
    return CylinderFit(
        middle + center, direction, radius, residual, w, center_error, direction_error
    )


def fit_transverse_axis(points: ArrayLike, weights: ArrayLike | None = None) -> Frame:
    """Axis of the cylinder, roughly medial-lateral, that lies closest to the points.

    Args:
        points: shape `(n, 3)`, mm, femur frame, of both condyles.
        weights: shape `(n,)`; equal by default.

    Returns:
        A frame on the axis at `z = 0`, whose Z axis is the cylinder's.

    Raises:
        ValueError: fewer than 6 points, or a plane fits them as well.

    Example:
        >>> turns, z = np.meshgrid(np.linspace(0.5, 3.0, 20), np.linspace(-30.0, 30.0, 9))
        >>> points = np.stack([20.0 * np.cos(turns), 5.0 - 20.0 * np.sin(turns), z], -1)
        >>> [round(abs(float(x)), 3) for x in fit_transverse_axis(points.reshape(-1, 3)).origin]
        [0.0, 5.0, 0.0]
    """
    found = fit_cylinder(points, weights, along=(0.0, 0.0, 1.0))
    x, y, z = found.direction
    origin = found.center - found.center[2] / z * found.direction
    # Rx(a) Ry(b) takes Z to (sin b, -sin a cos b, cos a cos b).
    return Frame((*origin[:2], 0.0), (np.arctan2(-y, z), np.arcsin(x), 0.0))


def _starts(p: np.ndarray, root: np.ndarray) -> list[np.ndarray]:
    """The directions along which the points look most like an arc of a circle."""
    k = np.arange(_DIRECTIONS) + 0.5
    height, turn = k / _DIRECTIONS, np.pi * (1.0 + np.sqrt(5.0)) * k
    ring = np.sqrt(1.0 - height**2)
    directions = np.stack([ring * np.cos(turn), ring * np.sin(turn), height], axis=1)
    return sorted(directions, key=lambda d: _circle(p @ _across(d), root)[1])[:_FOLLOWED]


def _across(direction: np.ndarray) -> np.ndarray:
    """Two unit vectors normal to a direction and to each other, shape `(3, 2)`."""
    _, _, axes = np.linalg.svd(direction[None])
    return axes[1:].T


def _circle(flat: np.ndarray, root: np.ndarray) -> tuple[np.ndarray, float]:
    """Centre and radius of a circle near points of a plane, and its mean square."""
    # The linear fit is drawn to small circles where points scatter about a short arc, so circles on
    # either side of the points are tried beside it.
    _, size, axes = np.linalg.svd(flat * root[:, None], full_matrices=False)
    length = size[0] / np.sqrt(len(flat))
    beside = np.outer(length * _CENTERS, axes[1])
    centers = np.vstack([center_and_radius(flat, root**2)[:2], beside])
    distance = np.linalg.norm(flat - centers[:, None], axis=2)
    radius = np.average(distance, axis=1, weights=root**2)
    mean_square = np.mean(((distance - radius[:, None]) * root) ** 2, axis=1)
    best = int(np.argmin(mean_square))
    return np.r_[centers[best], radius[best]], float(mean_square[best])


def _followed(p: np.ndarray, root: np.ndarray, direction: np.ndarray, turned: bool):
    """Mean square, centre, direction, radius and Jacobian of the cylinder near a direction, None if
    there is none. Unknown are the axis' foot in the plane through the origin across the start, its
    two slopes against the start, and the radius."""
    from scipy.optimize import least_squares  # 0.2 s that no other command should wait for

    solution, foot, wanted = None, np.zeros(3), direction
    free = np.array([True, True, turned, turned, True])

    def whole(y: np.ndarray) -> np.ndarray:
        return np.r_[y[:2], y[2:4] if turned else (0.0, 0.0), y[-1]]

    for _ in range(_RENEWALS if turned else 1):
        axes = np.c_[_across(direction), direction]
        local = p @ axes
        circle, _ = _circle(local[:, :2], root)
        start = np.r_[circle[:2], 0.0, 0.0, circle[2]]
        solution = least_squares(
            lambda y, local=local: _distances(whole(y), local)[0] * root, start[free],
            lambda y, local=local: _distances(whole(y), local)[1][:, free] * root[:, None],
            method="lm", xtol=1e-12, ftol=1e-15, gtol=1e-15, max_nfev=200,
            x_scale=np.array([1.0, 1.0, 0.1, 0.1, 1.0])[free],
        )  # fmt: skip
        if not np.isfinite(solution.x).all():
            return None
        y = whole(solution.x)
        foot, direction = axes @ np.r_[y[:2], 0.0], axes @ np.r_[y[2:4], 1.0]
        direction = direction / np.linalg.norm(np.r_[y[2:4], 1.0])
    if solution is None or solution.status <= 0:
        return None
    center = foot - (foot @ direction) * direction
    direction = direction * (1.0 if direction @ wanted >= 0 else -1.0)
    mean_square = 2.0 * solution.cost / len(p)
    return mean_square, center, direction, float(solution.x[-1]), solution.jac


def _distances(y: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances of points from a cylinder with the axis `(y0, y1, 0) + s (y2, y3, 1)` and the
    radius `y4`, and their derivatives by the five numbers."""
    along = np.r_[y[2:4], 1.0]
    size = np.linalg.norm(along)
    from_foot = p - np.r_[y[:2], 0.0]
    place = from_foot @ along / size
    away = from_foot - np.outer(place, along / size)
    distance = np.linalg.norm(away, axis=1)
    toward = -away[:, :2] / distance[:, None]
    slopes = np.c_[toward, toward * (place / size)[:, None], -np.ones(len(p))]
    return distance - y[4], slopes


def _errors(jacobian: np.ndarray, residual: np.ndarray) -> tuple[float, float]:
    """Standard errors of centre, mm, and direction, degrees, where each is worst known."""
    free = len(residual) - jacobian.shape[1]
    variance = residual @ residual / max(free, 1)
    try:
        covariance = variance * np.linalg.inv(jacobian.T @ jacobian)
    except np.linalg.LinAlgError:
        return float("inf"), float("inf")
    # A direction that is kept has no slopes among the unknowns, and no error.
    pairs = (covariance[:2, :2], covariance[2:4, 2:4] if len(covariance) == 5 else np.zeros((2, 2)))
    center, slope = (np.sqrt(max(np.linalg.eigvalsh(pair)[-1], 0.0)) for pair in pairs)
    return float(center), float(np.rad2deg(slope))
