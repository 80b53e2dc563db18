"""Functions of two variables in which a surface's table is meant: polynomials, cubic splines.

All rows of a coefficient table advance together along the second variable by Horner's rule and
are then summed along the first. Each derivative has a chain of its own: chains that shared their
terms would be a kernel for each of these. Derivatives that vanish whatever the variables are known
zeros. The derivative of a table of partial derivatives is a table of one order more: stating that
as the rule, instead of letting it be traced through Horner's rule, halves the operations of a
contact force.

Knots are uniform over the region, so a point meets the 4 x 4 control values around its cell and
nothing else: their cost does not grow with the table. They are gathered from the flat table: every
basis function at every point takes fifteen times as long (docs/performance.md).
"""

__all__ = ["BASES", "CUBIC_SPLINE", "POWER", "partials"]

import functools
import math
import operator
from collections.abc import Callable, Sequence
from functools import partial
from itertools import accumulate
from typing import TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.custom_derivatives import SymbolicZero

from kneejax.geometry._vectors import Component, times

#: Powers of both variables, and control values of a uniform cubic B-spline.
POWER, CUBIC_SPLINE = "power", "cubic_spline"
BASES = (POWER, CUBIC_SPLINE)
# Derivatives by both variables up to a total order, None for those that vanish everywhere.
_Partials: TypeAlias = tuple[tuple[Array | None, ...], ...]


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
    return _scaled(_partials(coefficients, s, t, order))


def _scaled(table: _Partials, by: tuple[Component, Component] = (1.0, 1.0)):
    """Partial derivatives, 0.0 for None, times a factor for each time that one was taken."""
    powers = [list(accumulate(len(table) * [x], times, initial=1.0)) for x in by]
    return tuple(
        tuple(
            0.0 if x is None else times(x, times(powers[0][i], powers[1][j]))
            for j, x in enumerate(row)
        )
        for i, row in enumerate(table)
    )


def _up_to(order: int, one: Callable[[int, int], Array | None]) -> _Partials:
    rows = range(order + 1)
    return tuple(tuple(one(i, j) for j in range(order - i + 1)) for i in rows)


@partial(jax.custom_jvp, nondiff_argnums=(3,))
def _by_horner(coefficients: Array, s: Array, t: Array, order: int) -> _Partials:
    powers, batch = coefficients.shape[:2], coefficients.shape[2:]
    missing = max(jnp.ndim(s), jnp.ndim(t)) - len(batch)
    table = coefficients.reshape(powers + (1,) * missing + batch)
    shape = jnp.broadcast_shapes(jnp.shape(s), jnp.shape(t), batch)
    # Columns are taken: kernels that turned them into rows were wrong by two of XLA's emitters.
    lines = [_horner(table, t, j, axis=1) for j in range(order + 1)]

    def one(i: int, j: int) -> Array | None:
        found = None if lines[j] is None else _horner(lines[j], s, i, axis=0)
        return None if found is None else jnp.broadcast_to(found, shape)

    return _up_to(order, one)


@partial(_by_horner.defjvp, symbolic_zeros=True)
def _by_horner_jvp(order, primals, tangents):
    more = _by_horner(*primals, order + 1)
    moved = not isinstance(tangents[0], SymbolicZero)
    linear = _by_horner(tangents[0], *primals[1:], order) if moved else None
    return _changed(more, linear, tangents[1:], order)


# One program where a surface is asked outside of what is traced, not one for each operation.
_partials = jax.jit(_by_horner, static_argnums=(3,), inline=True)


def _changed(more: _Partials, linear: _Partials | None, changes, order: int):
    """Partial derivatives up to an order and their change, from those of one order more, from those
    of the coefficients' change, None where they stay, and the variables' changes."""

    def rate(i: int, j: int) -> Array | None:
        if (here := more[i][j]) is None:
            return None
        terms = [] if linear is None else [linear[i][j]]
        for by, slope in zip(changes, (more[i + 1][j], more[i][j + 1]), strict=True):
            if slope is not None and not isinstance(by, SymbolicZero):
                terms.append(slope * by)
        whole = functools.reduce(operator.add, terms) if terms else 0.0
        return jnp.broadcast_to(whole, here.shape)

    return _up_to(order, lambda i, j: more[i][j]), _up_to(order, rate)


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


class SplineTables(eqx.Module):
    """Tables of several splines, of which each point asks one."""

    values: Array  # all tables as one, `(rows, columns, ...)`, narrow ones filled up
    begins: Array  # the row where a point's table begins; as many axes as the variables have
    rows: Array  # of that table
    columns: Array  # likewise

    @classmethod
    def of(cls, tables: Sequence[Array]) -> "SplineTables":
        """Tables `(rows, columns, ...)` under one another, the first axis of the rest theirs."""
        batch = jnp.broadcast_shapes(*(table.shape[2:] for table in tables))
        rows, columns = np.array([table.shape[:2] for table in tables]).T
        values = []
        for table in tables:
            whole = jnp.broadcast_to(table, (*table.shape[:2], *batch))
            more = columns.max() - table.shape[1]
            values.append(jnp.pad(whole, ((0, 0), (0, more), *((0, 0) for _ in batch))))
        each = np.cumsum(rows) - rows, rows, columns
        numbers = (jnp.asarray(x.reshape(-1, *(1,) * len(batch)), jnp.int32) for x in each)
        return cls(jnp.concatenate(values), *numbers)


def _known(coefficients: Array | SplineTables) -> tuple[Array, Array | int, Array, Array]:
    """Control values, the row where each point's begin, and numbers of its cells along both."""
    if isinstance(coefficients, SplineTables):
        tables = coefficients
        return tables.values, tables.begins, tables.rows - 3, tables.columns - 3
    rows, columns = coefficients.shape[:2]
    return coefficients, 0, rows - 3, columns - 3


@partial(jax.custom_jvp, nondiff_argnums=(3,))
def _by_spline(coefficients: Array | SplineTables, s: Array, t: Array, order: int) -> _Partials:
    """As `_by_horner`, of a uniform cubic B-spline.

    Variables are counted in cells. The spline is twice continuously differentiable; third
    derivatives are constant in each cell. Beyond the region the outermost cells continue.

    Source: de Boor, A Practical Guide to Splines (1978), chapter IX, for equal distances.
    """
    table, begins, rows, columns = _known(coefficients)
    across, batch = table.shape[1], table.shape[2:]
    (first, in_first), (second, in_second) = _cell(s, rows), _cell(t, columns)
    table, size = table.reshape(-1), int(np.prod(batch))
    corner = size * ((begins + first) * across + second)
    if size > 1:  # each of a batch reads its own control values
        corner = corner + jnp.arange(size, dtype=corner.dtype).reshape(batch)
    # No number without sign counts from the end, for which JAX would look at each.
    corner = corner.astype(jnp.uint32)

    def control(i: int, j: int) -> Array:
        # The cell is known to exist: a check of every index would double the cost.
        place = corner + np.uint32(size * (i * across + j))
        return table.at[place].get(mode="promise_in_bounds")

    by_s, by_t = _weights(in_first), _weights(in_second)
    near = [[control(i, j) for j in range(4)] for i in range(4)]
    lines = [[_sum(near[i], four) for i in range(4)] for four in by_t[: order + 1]]
    return _up_to(order, lambda i, j: _sum(lines[j], by_s[i]) if max(i, j) <= 3 else None)


@partial(_by_spline.defjvp, symbolic_zeros=True)
def _by_spline_jvp(order, primals, tangents):
    coefficients, s, t = primals
    more, linear = _by_spline(coefficients, s, t, order + 1), None
    change = tangents[0].values if isinstance(coefficients, SplineTables) else tangents[0]
    if not isinstance(change, SymbolicZero):
        linear = _by_all(change, *_known(coefficients)[1:], s, t, order)
    return _changed(more, linear, tangents[1:], order)


def _by_all(change: Array, begins, rows, columns, s: Array, t: Array, order: int):
    """Partial derivatives by a changed table, from every basis function at every point."""
    # Without a gather: transposed it is a scatter, and where that is fused XLA (jaxlib 0.10.2) ends
    # the process while it compiles a derivative backwards.
    batch = change.shape[2:]
    table = change.reshape(*change.shape[:2], *(1,) * (jnp.ndim(s) - len(batch)), *batch)
    down = _among_all(s, rows, begins, len(table))
    across = _among_all(t, columns, 0, table.shape[1])
    lines = [jnp.sum(table * of_columns, axis=1) for of_columns in across[: order + 1]]

    def one(i: int, j: int) -> Array | None:
        return jnp.sum(lines[j] * down[i], axis=0) if max(i, j) <= 3 else None

    return _up_to(order, one)


def _among_all(x: Array, cells, begins, count: int) -> list[Array]:
    """Weights of all rows, or columns, of a table at each point, `(count, ...)`: four are not 0."""
    first, inside = _cell(x, cells)
    number = jnp.arange(count).reshape(-1, *(1,) * jnp.ndim(x))
    return [
        sum(jnp.where(begins + first + k == number, w, 0.0) for k, w in enumerate(four))
        for four in _weights(inside)
    ]


def _cell(along: Array, count: Array | int) -> tuple[Array, Array]:
    """Number of the cell and place in it, 0..1, which is NaN where `along` is."""
    below = jnp.clip(jnp.floor(along), 0, count - 1)
    # A NaN may become any whole number.
    return jnp.clip(below.astype(jnp.int32), 0, count - 1), along - below


def _weights(x: Array) -> tuple[tuple[Component, ...], ...]:
    """The four basis functions of a cell, then their three derivatives."""
    y = 1.0 - x
    return (
        (y * y * y / 6.0, ((3.0 * x - 6.0) * x * x + 4.0) / 6.0,
         ((3.0 * y - 6.0) * y * y + 4.0) / 6.0, x * x * x / 6.0),
        (-0.5 * y * y, (1.5 * x - 2.0) * x, (2.0 - 1.5 * y) * y, 0.5 * x * x),
        (y, 3.0 * x - 2.0, 3.0 * y - 2.0, x),
        (-1.0, 3.0, -3.0, 1.0),
    )  # fmt: skip


def _sum(values, weights) -> Array:
    a, b, c, d = (x * w for x, w in zip(values, weights, strict=True))
    return (a + b) + (c + d)


def table_partials(
    basis: str,
    coefficients: Array,
    place: tuple[Array, Array],
    region: tuple[Array, Array],
    order: int,
) -> tuple[tuple[Component, ...], ...]:
    """Partial derivatives of a table `(m, n, ...)` in one of the `BASES` by both variables, each in
    its own unit; see `partials`. Over `region`, limits of both, the table's variables are -1..1."""
    ends = jnp.stack(jnp.broadcast_arrays(*region))
    lower, upper = ends[:, 0], ends[:, 1]
    if basis == POWER:
        middle, by = 0.5 * (lower + upper), 2.0 / (upper - lower)
        # Coefficients in the variables' units: one product each, instead of one a derivative.
        powers, batch = coefficients.shape[:2], coefficients.shape[2:]
        table = coefficients.reshape(powers + (1,) * (by.ndim - 1 - len(batch)) + batch)
        each = by ** np.arange(float(max(powers))).reshape(-1, *(1,) * by.ndim)
        table = table * each[: powers[0], None, 0] * each[: powers[1], 1]
        return partials(table, place[0] - middle[0], place[1] - middle[1], order)
    _, _, rows, columns = _known(coefficients)
    by = rows / (upper[0] - lower[0]), columns / (upper[1] - lower[1])
    s, t = ((x - low) * per for x, low, per in zip(place, lower, by, strict=True))
    return _scaled(_by_spline(coefficients, s, t, order), by)
