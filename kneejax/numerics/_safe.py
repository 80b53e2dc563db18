"""Primitives whose derivatives stay finite where the textbook formula's do not.

`jnp.where` evaluates both branches, and a branch that is not taken still sends NaN into a
derivative. Each function here therefore feeds the dead branch a harmless number first. Nothing
outside this file works around the trap again.
"""

from __future__ import annotations

from collections.abc import Callable

import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike


def branch(
    condition: ArrayLike,
    taken: Callable[[Array], Array],
    otherwise: Callable[[Array], Array],
    x: ArrayLike,
    *,
    inside: float,
    outside: float,
) -> Array:
    """Choose between two functions of `x` without a NaN from the one that is not chosen.

    Args:
        condition: where `taken` applies.
        taken: function used where `condition` holds.
        otherwise: function used elsewhere.
        x: the argument.
        inside: a harmless argument for `taken`, used where it is not chosen.
        outside: a harmless argument for `otherwise`, used where it is not chosen.

    Returns:
        `taken(x)` or `otherwise(x)`, element by element.
    """
    x = jnp.asarray(x)
    left = taken(jnp.where(condition, x, inside))
    right = otherwise(jnp.where(condition, outside, x))
    return jnp.where(condition, left, right)


def safe_sqrt(x: ArrayLike) -> Array:
    """Square root whose derivative at zero (and below) is zero instead of infinite.

    Args:
        x: radicand; negative values give zero.

    Returns:
        The square root, `0` where `x <= 0`.

    Example:
        >>> import jax
        >>> float(jax.grad(safe_sqrt)(0.0))
        0.0
    """
    x = jnp.asarray(x, float)
    return branch(x > 0, jnp.sqrt, jnp.zeros_like, x, inside=1.0, outside=1.0)


def positive_part(x: ArrayLike, width: ArrayLike) -> Array:
    """Smooth stand-in for `max(x, 0)`: `(x + sqrt(x^2 + w^2)) / 2`.

    Infinitely differentiable for `width > 0`, exact in the limit `width -> 0`, and largest in
    error at the corner, where it is `width / 2`.

    Args:
        x: any array.
        width: rounding of the corner, in the unit of `x`; positive.

    Returns:
        The smooth positive part, never negative.

    Example:
        >>> float(positive_part(0.0, 0.2))
        0.1
    """
    x, width = jnp.asarray(x, float), jnp.asarray(width, float)
    return 0.5 * (x + jnp.sqrt(x * x + width * width))
