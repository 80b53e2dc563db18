"""Least-squares fits of planes, quadrics and polynomials to points (a mesh's vertices).

Spheres and ellipsoids are fitted by Levenberg-Marquardt on the distance. Everything is in mm
and in the bone's frame; the meshes themselves are read in `kneejax.files`.

A polynomial is linear in its coefficients: one factorisation fits it.
"""

__all__ = ["SurfaceFit", "fit_condyle", "fit_ellipsoid", "fit_plane", "fit_plateau", "fit_sphere"]

import dataclasses
from typing import Generic, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jax.typing import ArrayLike
from numpy.polynomial import chebyshev

from kneejax.geometry._articular import Condyle, Plateau
from kneejax.geometry._pose import Frame
from kneejax.geometry._quadrics import Ellipsoid, Plane, Sphere
from kneejax.geometry._surface import Surface

S = TypeVar("S", bound=Surface)


class Fit:
    """What is left over between points and a fit, mm."""

    residual: np.ndarray
    weights: np.ndarray

    @property
    def rms(self) -> float:
        """Root of the weighted mean square of the residual, mm."""
        return float(np.sqrt(np.average(self.residual**2, weights=self.weights)))

    @property
    def maximum(self) -> float:
        """Largest distance of a point from the fit, mm."""
        return float(np.abs(self.residual).max())


@dataclasses.dataclass(frozen=True)
class SurfaceFit(Fit, Generic[S]):
    """A fitted surface and what is left over.

    Attributes:
        surface: the fit.
        points: the points that were used, shape `(n, 3)`, mm, bone frame.
        residual: signed distance of each point from the fit, shape `(n,)`, mm.
        weights: weight of each point.

    Example:
        >>> found = fit_plane([[0, 0, 0], [10, 0, 0], [0, 0, 10], [10, 0.4, 10]])
        >>> found.points.shape, bool(abs(found.residual).max() < 0.11)
        ((4, 3), True)
    """

    surface: S
    points: np.ndarray
    residual: np.ndarray
    weights: np.ndarray


def fit_plane(points: ArrayLike, weights: ArrayLike | None = None, up: ArrayLike = (0, 1, 0)):
    """Fit a plane: the smallest principal direction of the points.

    Args:
        points: shape `(n, 3)`, mm.
        weights: shape `(n,)`; equal by default.
        up: side to which the normal points.

    Returns:
        A `SurfaceFit` of a `Plane`.

    Raises:
        ValueError: fewer than 3 points.

    Example:
        >>> points = [[0, 1, 0], [10, 1, 0], [0, 1, 10], [10, 1, 10]]
        >>> found = fit_plane(points)
        >>> [round(float(x), 6) for x in found.surface.frame.origin]
        [5.0, 1.0, 5.0]
    """
    p, w = points_and_weights(points, weights, 3, "plane")
    center = np.average(p, axis=0, weights=w)
    _, _, axes = np.linalg.svd((p - center) * np.sqrt(w)[:, None], full_matrices=False)
    n = axes[2] * np.sign(axes[2] @ np.asarray(up, float))
    # Rx(a) Rz(c) takes Y to (-sin c, cos a cos c, sin a cos c).
    frame = Frame(center, (np.arctan2(n[2], n[1]), 0.0, -np.arcsin(n[0])))
    local = in_frame(frame, p)
    return finished(Plane(frame, np.abs(local[:, [0, 2]]).max(axis=0)), p, w)


def fit_sphere(points: ArrayLike, weights: ArrayLike | None = None):
    """Fit a sphere by the squared distances of the points.

    Args:
        points: shape `(n, 3)`, mm.
        weights: shape `(n,)`; equal by default.

    Returns:
        A `SurfaceFit` of a `Sphere`.

    Raises:
        ValueError: fewer than 4 points.

    Example:
        >>> points = 20.0 * np.vstack([np.eye(3), -np.eye(3)]) + [0.0, 5.0, 0.0]
        >>> round(float(fit_sphere(points).surface.radius), 6)
        20.0
    """
    p, w = points_and_weights(points, weights, 4, "sphere")
    return _by_distance(lambda y: Sphere(y[3], Frame(y[:3])), center_and_radius(p, w), p, w)


def fit_ellipsoid(points: ArrayLike, weights: ArrayLike | None = None, turned: bool = True):
    """Fit an ellipsoid by the squared (first-order) distances of the points.

    Args:
        points: shape `(n, 3)`, mm.
        weights: shape `(n,)`; equal by default.
        turned: whether its axes may turn against the bone's.

    Returns:
        A `SurfaceFit` of an `Ellipsoid`.

    Raises:
        ValueError: fewer than 9 points.

    Example:
        >>> ball = np.random.default_rng(0).normal(size=(60, 3))
        >>> points = ball / np.linalg.norm(ball, axis=1, keepdims=True) * [30.0, 18.0, 12.0]
        >>> found = fit_ellipsoid(points, turned=False)
        >>> sorted(round(float(x), 3) for x in found.surface.semi_axes)
        [12.0, 18.0, 30.0]
    """
    p, w = points_and_weights(points, weights, 9, "ellipsoid")
    sphere = fit_sphere(p, w).surface
    start = np.r_[np.asarray(sphere.frame.origin), np.log(float(sphere.radius)) * np.ones(3)]
    start = np.r_[start, np.zeros(3)] if turned else start

    def build(y):
        return Ellipsoid(jnp.exp(y[3:6]), Frame(y[:3], y[6:9] if turned else None))

    return _by_distance(build, start, p, w)


def center_and_radius(points: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Centre, then radius, of the circle or sphere near the points: a start for distance fits."""
    # |p - c|^2 = r^2 is linear in c and r^2 - |c|^2.
    root = np.sqrt(weights)
    columns = np.c_[2 * points, np.ones(len(points))] * root[:, None]
    solution, *_ = np.linalg.lstsq(columns, root * (points**2).sum(axis=1), rcond=None)
    center = solution[:-1]
    return np.r_[center, np.sqrt(solution[-1] + center @ center)]


def in_frame(frame: Frame, points: np.ndarray) -> np.ndarray:
    """Points of a bone in the frame of a surface, shape `(n, 3)`."""
    return np.stack([np.asarray(c) for c in frame.placement.apply_inverse(points.T)], axis=1)


def _by_distance(build, start, points, weights):
    def residual(y, _):
        return jnp.sqrt(weights) * _level(build(y), points)

    solver = optx.LevenbergMarquardt(rtol=1e-12, atol=1e-12)
    solution = optx.least_squares(residual, solver, jnp.asarray(start), max_steps=500, throw=False)
    if solution.result != optx.RESULTS.successful:
        raise ValueError("the surface fit did not settle: do the points lie on such a surface?")
    return finished(build(np.asarray(solution.value)), points, weights)


# Else each of its some hundred operations is a program of its own, for every number of points.
@jax.jit
def _level(surface, points):
    return surface.level(surface.frame.placement.apply_inverse(points.T))


def finished(surface, points, weights):
    """The `SurfaceFit` of a surface: signed distances of points of its bone, to first order."""
    return SurfaceFit(surface, points, np.asarray(_level(surface, points)), weights)


def points_and_weights(points, weights, least, what):
    """Points `(n, 3)` and weights `(n,)` as arrays, or a ValueError."""
    p = np.asarray(points, float)
    if p.ndim != 2 or p.shape[1] != 3 or len(p) < least:
        raise ValueError(f"{what}: expected at least {least} points (n, 3), got shape {p.shape}")
    if not np.isfinite(p).all():
        raise ValueError(f"{what}: a point is not finite")
    return p, np.ones(len(p)) if weights is None else np.asarray(weights, float)


def fit_condyle(
    points: ArrayLike,
    angle_deg: tuple[float, float],
    width_mm: tuple[float, float],
    degree: tuple[int, int] = (4, 4),
    frame: Frame | None = None,
    weights: ArrayLike | None = None,
    total_degree: int | None = None,
):
    """Fit a radius over angle and width about a transverse axis.

    Args:
        points: shape `(n, 3)`, mm, femur frame; those outside the region are left out.
        angle_deg: region from anterior (0) through distal (90) to posterior (180).
        width_mm: region along the axis.
        degree: highest power of the angle and of the width.
        frame: the axis (its Z); `fit_transverse_axis` finds one. The femur's Z by default.
        weights: shape `(n,)`; equal by default.
        total_degree: limit on the sum of both powers; none by default. `degree=(4, 4)` with
            `total_degree=4` is the polynomial of paper 3.

    Returns:
        A `SurfaceFit` of a `Condyle`.

    Raises:
        ValueError: too few points in the region for the number of coefficients.

    Example:
        >>> turns, z = np.meshgrid(np.linspace(0.3, 2.9, 30), np.linspace(-10.0, 10.0, 9))
        >>> points = np.stack([20.0 * np.cos(turns), -20.0 * np.sin(turns), z], -1).reshape(-1, 3)
        >>> found = fit_condyle(points, (20.0, 160.0), (-10.0, 10.0), degree=(2, 1))
        >>> round(float(found.surface.coefficients[0, 0]), 6)
        20.0
    """
    frame, limits = Frame() if frame is None else frame, np.deg2rad(angle_deg)
    p, w, angle, z, radius = around_axis(frame, points, weights, limits, width_mm)
    coefficients = _polynomial_fit(
        (angle, limits), (z, width_mm), radius, w, degree, total_degree, "condyle"
    )
    return finished(Condyle(coefficients, limits, width_mm, frame), p, w)


def around_axis(frame, points, weights, angle, width_mm) -> tuple[np.ndarray, ...]:
    """Points in a region of angles, rad, and widths, their weights, angles, widths and radii."""
    p, w = points_and_weights(points, weights, 1, "condyle")
    x, y, z = in_frame(frame, p).T
    turn = 0.5 * np.pi - np.arctan2(x, -y)
    here = (turn > angle[0]) & (turn < angle[1]) & (z > width_mm[0]) & (z < width_mm[1])
    return p[here], w[here], turn[here], z[here], np.hypot(x, y)[here]


def fit_plateau(
    points: ArrayLike,
    x_mm: tuple[float, float],
    z_mm: tuple[float, float],
    degree: tuple[int, int] = (4, 4),
    frame: Frame | None = None,
    weights: ArrayLike | None = None,
    total_degree: int | None = 4,
):
    """Fit a height over a plane.

    Args:
        points: shape `(n, 3)`, mm, tibia frame; those outside the elliptical region that touches
            the limits are left out (a plateau has no corners).
        x_mm: region, anterior-posterior.
        z_mm: region, medial-lateral.
        degree: highest power of x and of z.
        frame: the plane (its Y is up); the tibia's by default.
        weights: shape `(n,)`; equal by default.
        total_degree: limit on the sum of both powers.

    Returns:
        A `SurfaceFit` of a `Plateau`.

    Raises:
        ValueError: too few points in the region for the number of coefficients.

    Example:
        >>> x, z = np.meshgrid(np.linspace(-15.0, 15.0, 15), np.linspace(-10.0, 10.0, 15))
        >>> points = np.stack([x, 0.01 * x**2, z], -1).reshape(-1, 3)
        >>> found = fit_plateau(points, (-15.0, 15.0), (-10.0, 10.0), degree=(2, 2))
        >>> bool(abs(found.residual).max() < 1e-9)
        True
    """
    frame = Frame() if frame is None else frame
    p, w = points_and_weights(points, weights, 1, "plateau")
    x, y, z = in_frame(frame, p).T
    s, t = _unit(x, x_mm), _unit(z, z_mm)
    here = s * s + t * t < 1.0
    coefficients = _polynomial_fit(
        (x[here], x_mm), (z[here], z_mm), y[here], w[here], degree, total_degree, "plateau"
    )
    return finished(Plateau(coefficients, x_mm, z_mm, frame), p[here], w[here])


def _polynomial_fit(first, second, values, weights, degree, total_degree, what):
    total = np.add.outer(np.arange(degree[0] + 1), np.arange(degree[1] + 1))
    used = total <= (sum(degree) if total_degree is None else total_degree)
    if len(values) < used.sum():
        raise ValueError(
            f"{what}: {len(values)} points in the region; "
            f"degree {degree} has {used.sum()} coefficients and needs at least as many"
        )
    # Chebyshev columns keep the factorisation accurate; the result is stored as plain powers.
    columns = chebyshev.chebvander2d(_unit(*first), _unit(*second), degree)[:, used.ravel()]
    root = np.sqrt(weights)
    solution, *_ = np.linalg.lstsq(columns * root[:, None], values * root, rcond=None)
    table = np.zeros(used.shape)
    table[used] = solution
    return _to_powers(degree[0]) @ table @ _to_powers(degree[1]).T


def _to_powers(degree: int) -> np.ndarray:
    """What takes Chebyshev coefficients to those of powers, a column for each polynomial."""
    columns = [chebyshev.cheb2poly(one) for one in np.eye(degree + 1)]
    return np.stack([np.pad(c, (0, degree + 1 - len(c))) for c in columns], axis=1)


def _unit(value, limits):
    return 2.0 * (value - limits[0]) / (limits[1] - limits[0]) - 1.0
