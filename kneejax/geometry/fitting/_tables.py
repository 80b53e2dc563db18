"""Least-squares fits of surfaces given by powers of two variables.

A polynomial is linear in its coefficients: one factorisation fits it.
"""

from __future__ import annotations

import numpy as np
from jax.typing import ArrayLike

from kneejax.geometry._pose import Frame
from kneejax.geometry.fitting._fitting import finished, in_frame, points_and_weights
from kneejax.geometry.surfaces import Condyle, Plateau


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
    """
    frame = Frame() if frame is None else frame
    p, w = points_and_weights(points, weights, 1, "condyle")
    x, y, z = in_frame(frame, p).T
    angle, limits = 0.5 * np.pi - np.arctan2(x, -y), np.deg2rad(angle_deg)
    here = (angle > limits[0]) & (angle < limits[1]) & (z > width_mm[0]) & (z < width_mm[1])
    coefficients = _polynomial_fit(
        (angle[here], limits), (z[here], width_mm), np.hypot(x, y)[here], w[here], degree,
        total_degree, "condyle",
    )
    return finished(Condyle(coefficients, limits, width_mm, frame), p[here], w[here])


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
    powers = [
        (i, j)
        for i in range(degree[0] + 1)
        for j in range(degree[1] + 1)
        if total_degree is None or i + j <= total_degree
    ]
    if len(values) < len(powers):
        raise ValueError(
            f"{what}: {len(values)} points in the region; "
            f"degree {degree} has {len(powers)} coefficients and needs at least as many"
        )
    s, t = _unit(*first), _unit(*second)
    # Chebyshev columns keep the factorisation accurate; the result is stored as plain powers.
    columns = [
        np.polynomial.chebyshev.chebval(s, np.eye(i + 1)[i])
        * np.polynomial.chebyshev.chebval(t, np.eye(j + 1)[j])
        for i, j in powers
    ]
    root = np.sqrt(weights)
    solution, *_ = np.linalg.lstsq(np.stack(columns, 1) * root[:, None], values * root, rcond=None)
    table = np.zeros((degree[0] + 1, degree[1] + 1))
    for (i, j), c in zip(powers, solution, strict=True):
        left = np.polynomial.chebyshev.cheb2poly(np.eye(i + 1)[i])
        right = np.polynomial.chebyshev.cheb2poly(np.eye(j + 1)[j])
        table[: i + 1, : j + 1] += c * np.outer(left, right)
    return table


def _unit(value, limits):
    return 2.0 * (value - limits[0]) / (limits[1] - limits[0]) - 1.0
