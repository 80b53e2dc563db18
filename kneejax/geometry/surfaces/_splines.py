"""Cubic B-splines of two variables and all their partial derivatives, elementwise over lanes.

Knots are uniform over the region, so a point meets the 4 x 4 control values around its cell and
nothing else: their cost does not grow with the table. They are gathered from the flat table: every
basis function at every point takes fifteen times as long (docs/performance.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.custom_derivatives import SymbolicZero

from kneejax.geometry.surfaces._polynomials import change_of_table


class SplineTables(eqx.Module):
    """Tables of several splines, of which each point asks one.

    Attributes:
        values: all tables as one, `(rows, columns, ...)`, narrow ones filled up.
        begins: the row where a point's table begins; as many axes as the variables have.
        rows: of that table.
        columns: likewise.
    """

    values: Array
    begins: Array
    rows: Array
    columns: Array

    @classmethod
    def of(cls, tables: Sequence[Array]) -> SplineTables:
        """Tables `(rows, columns, ...)` under one another, the first axis of the rest theirs."""
        lanes = jnp.broadcast_shapes(*(table.shape[2:] for table in tables))
        rows, columns = np.array([table.shape[:2] for table in tables]).T
        values = []
        for table in tables:
            whole = jnp.broadcast_to(table, (*table.shape[:2], *lanes))
            more = columns.max() - table.shape[1]
            values.append(jnp.pad(whole, ((0, 0), (0, more), *((0, 0) for _ in lanes))))
        each = np.cumsum(rows) - rows, rows, columns
        numbers = (jnp.asarray(x.reshape(-1, *(1,) * len(lanes)), jnp.int32) for x in each)
        return cls(jnp.concatenate(values), *numbers)


@partial(jax.custom_jvp, nondiff_argnums=(3,))
def spline_partials(
    coefficients: Array | SplineTables, s: Array, t: Array, order: int
) -> tuple[tuple[Array, ...], ...]:
    """Partial derivatives of a uniform cubic B-spline over -1..1 x -1..1 up to a total order.

    The spline is twice continuously differentiable; third derivatives are constant in each cell,
    higher ones zero. Beyond the region the outermost cells continue.

    Args:
        coefficients: control values, shape `(m + 3, n + 3, ...)` for `m x n` cells; or tables.
        s: first variable, any shape.
        t: second variable, same shape.
        order: highest total order.

    Returns:
        `d` with `d[i][j]` the derivative taken `i` times by `s` and `j` times by `t`,
        for `i + j <= order`.

    Source: de Boor, A Practical Guide to Splines (1978), chapter IX, for equal distances.

    Example:
        >>> import jax.numpy as jnp
        >>> plane = jnp.arange(5.0)[:, None] + jnp.zeros((5, 4))
        >>> d = spline_partials(plane, jnp.array(0.5), jnp.array(0.1), 1)
        >>> float(round(d[0][0], 9)), float(round(d[1][0], 9)), float(abs(round(d[0][1], 9)))
        (2.5, 1.0, 0.0)
    """
    if isinstance(coefficients, SplineTables):
        table, begins = coefficients.values, coefficients.begins
        rows, columns = coefficients.rows, coefficients.columns
    else:
        table, begins = coefficients, 0
        rows, columns = table.shape[:2]
    across, lanes = table.shape[1], table.shape[2:]
    first, in_first = _cell(s, rows - 3)
    second, in_second = _cell(t, columns - 3)
    by_s, by_t = _weights(in_first, rows - 3, order), _weights(in_second, columns - 3, order)
    table, size = table.reshape(-1), int(np.prod(lanes))
    corner = size * ((begins + first) * across + second)
    if size > 1:  # each lane reads its own control values
        corner = corner + jnp.arange(size, dtype=corner.dtype).reshape(lanes)

    def control(i: int, j: int) -> Array:
        # The cell is known to exist: a check of every index would double the cost.
        return table.at[corner + size * (i * across + j)].get(mode="promise_in_bounds")

    near = [[control(i, j) for j in range(4)] for i in range(4)]
    lines = [[_sum(near[i], by_t[k]) for i in range(4)] for k in range(order + 1)]
    return tuple(
        tuple(_sum(lines[j], by_s[i]) for j in range(order - i + 1)) for i in range(order + 1)
    )


@partial(spline_partials.defjvp, symbolic_zeros=True)
def _spline_partials_jvp(order, primals, tangents):
    coefficients, s, t = primals
    more, change = spline_partials(coefficients, s, t, order + 1), tangents[0]
    if isinstance(coefficients, SplineTables):
        begins, change = coefficients.begins, change.values
        rows, columns = coefficients.rows, coefficients.columns
    else:
        begins, (rows, columns) = 0, coefficients.shape[:2]
    moved = not isinstance(change, SymbolicZero)
    linear = _by_all(change, begins, rows, columns, s, t, order) if moved else None
    return change_of_table(more, linear, tangents[1], tangents[2], order)


def _by_all(change: Array, begins, rows, columns, s: Array, t: Array, order: int):
    """Partial derivatives by a changed table, from every basis function at every point.

    Without a gather: transposed it is a scatter, and where that is fused XLA (jaxlib 0.10.2) ends
    the process while it compiles a derivative backwards.
    """
    lanes = change.shape[2:]
    table = change.reshape(*change.shape[:2], *(1,) * (jnp.ndim(s) - len(lanes)), *lanes)
    down = _among_all(s, rows - 3, begins, len(table), order)
    across = _among_all(t, columns - 3, 0, table.shape[1], order)
    lines = [jnp.sum(table * of_columns, axis=1) for of_columns in across]
    return tuple(
        tuple(jnp.sum(lines[j] * down[i], axis=0) for j in range(order - i + 1))
        for i in range(order + 1)
    )


def _among_all(x: Array, cells, begins, count: int, order: int) -> list[Array]:
    """Weights of all rows, or columns, of a table at each point, `(count, ...)`: four are not 0."""
    first, inside = _cell(x, cells)
    number = jnp.arange(count).reshape(-1, *(1,) * jnp.ndim(x))
    return [
        sum(jnp.where(begins + first + k == number, w, 0.0) for k, w in enumerate(four))
        for four in _weights(inside, cells, order)
    ]


def _cell(x: Array, count: Array | int) -> tuple[Array, Array]:
    """Number of the cell and place in it, 0..1, which is NaN where `x` is."""
    along = (0.5 * count) * (x + 1.0)
    below = jnp.clip(jnp.floor(along), 0, count - 1)
    # A NaN may become any whole number.
    return jnp.clip(below.astype(jnp.int32), 0, count - 1), along - below


def _weights(x: Array, count: Array | int, order: int) -> list[tuple[Array, ...]]:
    """The four basis functions of a cell and their derivatives in the scaled variable."""
    y, zero = 1.0 - x, jnp.zeros_like(x)
    rows = (
        (y * y * y / 6.0, ((3.0 * x - 6.0) * x * x + 4.0) / 6.0,
         ((3.0 * y - 6.0) * y * y + 4.0) / 6.0, x * x * x / 6.0),
        (-0.5 * y * y, (1.5 * x - 2.0) * x, (2.0 - 1.5 * y) * y, 0.5 * x * x),
        (y, 3.0 * x - 2.0, 3.0 * y - 2.0, x),
        (zero - 1.0, zero + 3.0, zero - 3.0, zero + 1.0),
    )  # fmt: skip
    nothing = (zero,) * 4
    factors = (1.0, *((0.5 * count) ** k for k in range(1, order + 1)))
    return [
        tuple(factor * w if k else w for w in (rows[k] if k < len(rows) else nothing))
        for k, factor in enumerate(factors)
    ]


def _sum(values, weights) -> Array:
    a, b, c, d = (x * w for x, w in zip(values, weights, strict=True))
    return (a + b) + (c + d)
