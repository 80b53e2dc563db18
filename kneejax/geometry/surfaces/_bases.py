"""The functions of two variables in which a surface's table of coefficients is meant."""

from __future__ import annotations

from jax import Array

from kneejax.geometry.surfaces._polynomials import partials
from kneejax.geometry.surfaces._splines import spline_partials

#: Powers of both variables, and control values of a uniform cubic B-spline.
POWER, CUBIC_SPLINE = "power", "cubic_spline"
BASES = (POWER, CUBIC_SPLINE)


def table_partials(
    basis: str, coefficients: Array, s: Array, t: Array, order: int
) -> tuple[tuple[Array, ...], ...]:
    """Partial derivatives of a table in one of the `BASES`; see `partials`.

    Args:
        basis: one of `BASES`.
        coefficients: shape `(m, n, ...)`.
        s: first variable, scaled to -1..1 over the region.
        t: second variable, likewise.
        order: highest total order.
    """
    function = partials if basis == POWER else spline_partials
    return function(coefficients, s, t, order)


def checked_basis(basis: str, shape: tuple[int, ...], what: str) -> None:
    """Refuse an unknown basis, or a table too small for it.

    Raises:
        ValueError: `basis` is none of `BASES`, or a spline has fewer than 4 rows or columns.
    """
    if basis not in BASES:
        raise ValueError(f"{what}.basis is {basis!r}; expected one of {BASES}")
    if basis == CUBIC_SPLINE and min(shape[:2]) < 4:
        raise ValueError(f"{what}: a cubic spline has at least 4 x 4 control values, not {shape}")
