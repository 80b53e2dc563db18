"""Polynomials of two variables and all their partial derivatives, elementwise over lanes.

All rows of a coefficient table advance together along the second variable by Horner's rule and
are then summed along the first. The derivative of a table of partial derivatives is a table of
one order more: stating that as the rule, instead of letting it be traced through Horner's rule,
halves the operations of a contact force.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import jax
import jax.numpy as jnp
from jax import Array
from jax.custom_derivatives import SymbolicZero


@partial(jax.custom_jvp, nondiff_argnums=(3,))
def partials(coefficients: Array, s: Array, t: Array, order: int) -> tuple[tuple[Array, ...], ...]:
    """Partial derivatives of `sum_ij c_ij s^i t^j` up to a total order.

    Args:
        coefficients: shape `(m + 1, n + 1, ...)`.
        s: first variable, any shape.
        t: second variable, same shape.
        order: highest total order.

    Returns:
        `d` with `d[i][j]` the derivative taken `i` times by `s` and `j` times by `t`,
        for `i + j <= order`.

    Example:
        >>> import jax.numpy as jnp
        >>> d = partials(jnp.array([[1.0, 2.0], [3.0, 4.0]]), jnp.array(0.5), jnp.array(2.0), 1)
        >>> float(d[0][0]), float(d[1][0]), float(d[0][1])
        (10.5, 11.0, 4.0)
    """
    powers, lanes = coefficients.shape[:2], coefficients.shape[2:]
    missing = max(jnp.ndim(s), jnp.ndim(t)) - len(lanes)
    table = coefficients.reshape(powers + (1,) * missing + lanes)
    # Columns are taken: kernels that turned them into rows were wrong by two of XLA's emitters.
    by_t = _horner([table[:, j] for j in range(powers[1])], t, order)
    columns = [_horner(by_t[j], s, order - j) for j in range(order + 1)]
    return tuple(tuple(columns[j][i] for j in range(order - i + 1)) for i in range(order + 1))


@partial(partials.defjvp, symbolic_zeros=True)
def _partials_jvp(order, primals, tangents):
    coefficients, s, t = primals
    more = partials(coefficients, s, t, order + 1)
    moved = not isinstance(tangents[0], SymbolicZero)
    linear = partials(tangents[0], s, t, order) if moved else None
    return change_of_table(more, linear, tangents[1], tangents[2], order)


def change_of_table(more, linear, d_s, d_t, order: int):
    """A table of partial derivatives and its change, from the table of one order more.

    Args:
        more: the table up to `order + 1`.
        linear: the table of the coefficients' change, up to `order`; None where they stay.
        d_s: change of the first variable, or a symbolic zero.
        d_t: likewise of the second.
        order: highest total order of the answer.

    Returns:
        The table and its change.
    """
    change = [[None] * (order - i + 1) for i in range(order + 1)]

    def add(term) -> None:
        for i in range(order + 1):
            for j in range(order - i + 1):
                change[i][j] = term(i, j) if change[i][j] is None else change[i][j] + term(i, j)

    if not isinstance(d_s, SymbolicZero):
        add(lambda i, j: more[i + 1][j] * d_s)
    if not isinstance(d_t, SymbolicZero):
        add(lambda i, j: more[i][j + 1] * d_t)
    if linear is not None:
        add(lambda i, j: linear[i][j])
    value = tuple(tuple(more[i][: order - i + 1]) for i in range(order + 1))
    return value, tuple(
        tuple(jnp.broadcast_to(c, v.shape) for c, v in zip(row, v_row, strict=True))
        for row, v_row in zip(change, value, strict=True)
    )


def _horner(table: Sequence[Array] | Array, x: Array, order: int) -> list[Array]:
    """Polynomial in `x` with these coefficients, and its derivatives up to `order`."""
    value = table[-1] + 0.0 * x
    slopes = [jnp.zeros_like(value) for _ in range(order)]
    for power in range(len(table) - 2, -1, -1):
        for k in range(order - 1, -1, -1):
            # Horner's chains give f'' / 2, f''' / 6, ...; scaled at the end.
            slopes[k] = slopes[k] * x + (slopes[k - 1] if k else value)
        value = value * x + table[power]
    factorial = 1.0
    scaled = [value]
    for k, slope in enumerate(slopes):
        factorial *= k + 1
        scaled.append(factorial * slope if k else slope)
    return scaled
