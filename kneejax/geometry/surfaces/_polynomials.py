"""Polynomials of two variables and all their partial derivatives, elementwise over lanes.

All rows of a coefficient table advance together along the second variable by Horner's rule and
are then summed along the first. Each derivative has a chain of its own: chains that shared their
terms would be a kernel for each of these. Derivatives that vanish whatever the variables are known
zeros. The derivative of a table of partial derivatives is a table of one order more: stating that
as the rule, instead of letting it be traced through Horner's rule, halves the operations of a
contact force.
"""

from __future__ import annotations

import functools
import math
import operator
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.custom_derivatives import SymbolicZero

from kneejax.geometry._vectors import Component


def partials(
    coefficients: Array, s: Array, t: Array, order: int
) -> tuple[tuple[Component, ...], ...]:
    """Partial derivatives of `sum_ij c_ij s^i t^j` up to a total order.

    Args:
        coefficients: shape `(m + 1, n + 1, ...)`.
        s: first variable, any shape.
        t: second variable, same shape.
        order: highest total order.

    Returns:
        `d` with `d[i][j]` the derivative taken `i` times by `s` and `j` times by `t`,
        for `i + j <= order`; the number 0.0 where the degree is less.

    Example:
        >>> import jax.numpy as jnp
        >>> d = partials(jnp.array([[1.0, 2.0], [3.0, 4.0]]), jnp.array(0.5), jnp.array(2.0), 1)
        >>> float(d[0][0]), float(d[1][0]), float(d[0][1])
        (10.5, 11.0, 4.0)
    """
    found = _partials(coefficients, s, t, order)
    return tuple(tuple(0.0 if x is None else x for x in row) for row in found)


@partial(jax.custom_jvp, nondiff_argnums=(3,))
def _partials(
    coefficients: Array, s: Array, t: Array, order: int
) -> tuple[tuple[Array | None, ...], ...]:
    """As `partials`, None for 0.0."""
    powers, lanes = coefficients.shape[:2], coefficients.shape[2:]
    missing = max(jnp.ndim(s), jnp.ndim(t)) - len(lanes)
    table = coefficients.reshape(powers + (1,) * missing + lanes)
    shape = jnp.broadcast_shapes(jnp.shape(s), jnp.shape(t), lanes)
    # Columns are taken: kernels that turned them into rows were wrong by two of XLA's emitters.
    lines = [_horner(table, t, j, axis=1) for j in range(order + 1)]

    def one(i: int, j: int) -> Array | None:
        found = None if lines[j] is None else _horner(lines[j], s, i, axis=0)
        return None if found is None else jnp.broadcast_to(found, shape)

    return tuple(tuple(one(i, j) for j in range(order - i + 1)) for i in range(order + 1))


@partial(_partials.defjvp, symbolic_zeros=True)
def _partials_jvp(order, primals, tangents):
    coefficients, s, t = primals
    more = _partials(coefficients, s, t, order + 1)
    moved = not isinstance(tangents[0], SymbolicZero)
    linear = _partials(tangents[0], s, t, order) if moved else None
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

    def rate(i: int, j: int) -> Array | None:
        if more[i][j] is None:
            return None
        terms = [] if linear is None else [linear[i][j]]
        for by, slope in ((d_s, more[i + 1][j]), (d_t, more[i][j + 1])):
            if slope is not None and not isinstance(by, SymbolicZero):
                terms.append(slope * by)
        whole = functools.reduce(operator.add, terms) if terms else 0.0
        return jnp.broadcast_to(whole, more[i][j].shape)

    rows = range(order + 1)
    value = tuple(tuple(more[i][: order - i + 1]) for i in rows)
    return value, tuple(tuple(rate(i, j) for j in range(order - i + 1)) for i in rows)


def _horner(table: Array, x: Array, order: int, axis: int) -> Array | None:
    """Derivative of polynomials in `x` with coefficients along an axis; None where it vanishes."""
    if order >= table.shape[axis]:
        return None
    factors = [math.perm(power, order) for power in range(order, table.shape[axis])]
    wide = [1] * table.ndim
    wide[axis] = len(factors)
    terms = lax.slice_in_dim(table, order, None, axis=axis)
    terms = terms * np.array(factors, float).reshape(wide) if order else terms
    each = [lax.index_in_dim(terms, k, axis, keepdims=False) for k in range(len(factors))]
    return functools.reduce(lambda value, term: value * x + term, reversed(each))
