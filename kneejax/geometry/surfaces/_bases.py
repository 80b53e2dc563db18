"""The functions of two variables in which a surface's table of coefficients is meant."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.geometry._vectors import Component, times
from kneejax.geometry.surfaces._polynomials import partials
from kneejax.geometry.surfaces._splines import spline_partials

#: Powers of both variables, and control values of a uniform cubic B-spline.
POWER, CUBIC_SPLINE = "power", "cubic_spline"
BASES = (POWER, CUBIC_SPLINE)


def table_partials(
    basis: str,
    coefficients: Array,
    place: tuple[Array, Array],
    region: tuple[Array, Array],
    order: int,
) -> tuple[tuple[Component, ...], ...]:
    """Partial derivatives of a table in one of the `BASES`; see `partials`.

    Args:
        basis: one of `BASES`.
        coefficients: shape `(m, n, ...)`.
        place: both variables, each in its own unit; derivatives are in these.
        region: limits of both, `(2, ...)`, over which the table's variables are -1..1.
        order: highest total order.
    """
    ends = jnp.stack(jnp.broadcast_arrays(*region))
    middle, by = 0.5 * (ends[:, 0] + ends[:, 1]), 2.0 / (ends[:, 1] - ends[:, 0])
    s, t = place[0] - middle[0], place[1] - middle[1]
    if basis == POWER:
        # Coefficients in the variables' units: one product each, instead of one a derivative.
        powers, lanes = coefficients.shape[:2], coefficients.shape[2:]
        table = coefficients.reshape(powers + (1,) * (by.ndim - 1 - len(lanes)) + lanes)
        each = by ** np.arange(float(max(powers))).reshape(-1, *(1,) * by.ndim)
        return partials(table * each[: powers[0], None, 0] * each[: powers[1], 1], s, t, order)
    found = spline_partials(coefficients, s * by[0], t * by[1], order)
    return tuple(
        tuple(times(x, by[0] ** i * by[1] ** j) for j, x in enumerate(row))
        for i, row in enumerate(found)
    )


def checked_basis(basis: str, shape: tuple[int, ...], what: str) -> None:
    """Refuse an unknown basis, or a table too small for it.

    Raises:
        ValueError: `basis` is none of `BASES`, or a spline has fewer than 4 rows or columns.
    """
    if basis not in BASES:
        raise ValueError(f"{what}.basis is {basis!r}; expected one of {BASES}")
    if basis == CUBIC_SPLINE and min(shape[:2]) < 4:
        raise ValueError(f"{what}: a cubic spline has at least 4 x 4 control values, not {shape}")
