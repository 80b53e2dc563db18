"""Values between calibration angles: straight or monotone lines, constant outside."""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array


def between(knots: Array, values: Array, slopes: Array | None, x: Array) -> Array:
    """Values between knots, piece by piece; the first and last value outside.

    The answer is the first value and what every interval adds to it, each with its argument
    clipped to its ends: no interval is looked for, and derivatives exist by everything. At a knot
    a derivative by `x` is the mean of those on both sides.

    Args:
        knots: shape `(k,)`, increasing.
        values: shape `(k, ...)`.
        slopes: at the knots, shape `(k, ...)`, of cubic pieces; None for straight ones.
        x: where, shape `(lanes,)`.

    Returns:
        Shape `(..., lanes)`.
    """
    answer = jnp.broadcast_to(values[0][..., None], (*values.shape[1:], *x.shape))
    for i in range(len(knots) - 1):
        width = knots[i + 1] - knots[i]
        u = jnp.clip((x - knots[i]) / width, 0.0, 1.0)
        rise = (values[i + 1] - values[i])[..., None]
        if slopes is None:
            answer = answer + rise * u
            continue
        first, last = width * slopes[i][..., None], width * slopes[i + 1][..., None]
        # Hermite's cubic, in powers of u.
        bend, twist = 3 * rise - 2 * first - last, first + last - 2 * rise
        answer = answer + u * (first + u * (bend + u * twist))
    return answer


def monotone_slopes(knots: Array, values: Array) -> Array:
    """Slopes of the cubic pieces that rise and fall only where the values do (PCHIP).

    A slope has no derivative with respect to the values where a value equals both neighbours;
    zero is given.

    Args:
        knots: shape `(k,)`, increasing, two or more.
        values: shape `(k, ...)`.

    Returns:
        Shape `(k, ...)`; as those of `scipy.interpolate.PchipInterpolator`.

    Source: Fritsch and Butland, SIAM J Sci Stat Comput 5 (1984); at the ends Moler, Numerical
    Computing with Matlab (2004), section 3.4.
    """
    width = jnp.diff(knots).reshape(-1, *[1] * (values.ndim - 1))
    secant = jnp.diff(values, axis=0) / width
    if len(knots) == 2:
        return jnp.concatenate([secant, secant])
    left, right = secant[:-1], secant[1:]
    wide, narrow = 2 * width[1:] + width[:-1], width[1:] + 2 * width[:-1]
    same = left * right > 0
    # A weighted harmonic mean of the secants, zero at a turning point.
    inverse = wide / jnp.where(same, left, 1.0) + narrow / jnp.where(same, right, 1.0)
    inner = jnp.where(same, (wide + narrow) / jnp.where(same, inverse, 1.0), 0.0)
    first = _end_slope(width[0], width[1], secant[0], secant[1])
    last = _end_slope(width[-1], width[-2], secant[-1], secant[-2])
    return jnp.concatenate([first[None], inner, last[None]])


def _end_slope(width: Array, next_width: Array, secant: Array, next_secant: Array) -> Array:
    """Slope of the parabola through three points, kept from turning round."""
    slope = ((2 * width + next_width) * secant - width * next_secant) / (width + next_width)
    slope = jnp.where(slope * secant > 0, slope, 0.0)
    overshoots = (secant * next_secant <= 0) & (jnp.abs(slope) > 3 * jnp.abs(secant))
    return jnp.where(overshoots, 3 * secant, slope)
