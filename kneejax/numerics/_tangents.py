"""Tangents in rules of differentiation."""

__all__ = ["as_known", "instantiate", "jvp_of_moved", "none_of", "ruled", "unknown_where"]

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.custom_derivatives import SymbolicZero
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir


def instantiate(tree):
    """Tangents of which those known to vanish are arrays of zeros, as `jax.jvp` wants them.

    Args:
        tree: tangents as a rule with `symbolic_zeros=True` gets them.
    """

    def array(tangent):
        if not _vanishes(tangent):
            return tangent
        # Whole numbers have tangents of a type that only NumPy knows.
        xp = np if tangent.dtype == jax.dtypes.float0 else jnp
        return xp.zeros(tangent.shape, tangent.dtype)

    return jax.tree.map(array, tree, is_leaf=_vanishes)


def _vanishes(tangent: Any) -> bool:
    return isinstance(tangent, SymbolicZero)


def none_of(tree):
    """Tangents of answers that have no derivative, truth values among them, as a rule returns them.

    Args:
        tree: the answers.

    Example:
        >>> from jax.dtypes import float0
        >>> none_of(jnp.array([True])).dtype == float0
        True
    """
    return jax.tree.map(
        lambda x: jnp.zeros_like(x) if jnp.issubdtype(x.dtype, jnp.floating)
        else np.zeros(jnp.shape(x), jax.dtypes.float0),
        tree,
    )  # fmt: skip


def jvp_of_moved(function: Callable, primals: tuple, tangents: tuple) -> tuple[Any, Any]:
    """`jax.jvp`, through whatever is not perturbed as through a constant.

    Args:
        function: of the primals.
        primals: containers of arrays.
        tangents: as a rule with `symbolic_zeros=True` gets them.

    Returns:
        The function's value and its change.

    Example:
        >>> one, zero = jnp.ones(()), jnp.zeros(())
        >>> value, change = jvp_of_moved(jnp.multiply, (2.0 * one, 3.0 * one), (one, zero))
        >>> float(value), float(change)
        (6.0, 3.0)
    """
    leaves, structure = jax.tree.flatten(primals)
    rates = jax.tree.leaves(tangents, is_leaf=_vanishes)
    moved = [k for k, rate in enumerate(rates) if not _vanishes(rate)]

    def of_moved(*some: Array) -> Any:
        every = list(leaves)
        for k, leaf in zip(moved, some, strict=True):
            every[k] = leaf
        return function(*jax.tree.unflatten(structure, every))

    own = [leaves[k] for k in moved], [rates[k] for k in moved]
    return jax.jvp(of_moved, *own) if moved else (value := function(*primals), none_of(value))


def ruled(rule: Callable, value: Any, *arguments: Any) -> Any:
    """A value that has been found, whose change by what it was found from is told by a rule.

    As `jax.custom_jvp`, which JAX forgets where a loop is differentiated backwards (`lax.scan`,
    `lax.cond`): second derivatives of what was found within it would be wrong without a word. A
    primitive keeps its rule.

    Args:
        rule: of the value, the arguments and their changes (`SymbolicZero` where none); returns the
            value, or a better one, and its change. The value that it gets has this rule again.
        value: containers of arrays; nothing is differentiated through it.
        arguments: likewise, what it was found from.
    """
    leaves, structure = jax.tree.flatten((value, arguments))
    count, own = len(jax.tree.leaves(value)), jax.tree.structure(value)
    given = map(jnp.asarray, leaves)
    found = _ruled.bind(*given, rule=rule, structure=structure, count=count)
    return jax.tree.unflatten(own, found)


def _values(*leaves: Array, count: int, **_: Any) -> list[Array]:
    return list(leaves[:count])


def _ruled_jvp(primals, rates, *, rule: Callable, structure, count: int):
    value, arguments = jax.tree.unflatten(structure, primals)
    still = [SymbolicZero(t.aval) if isinstance(t, ad.Zero) else t for t in rates]
    _, changes = jax.tree.unflatten(structure, still)
    out, change = rule(ruled(rule, value, *arguments), arguments, changes)
    out = [jnp.asarray(x) for x in jax.tree.leaves(out)]
    moves = [
        t if jnp.issubdtype(x.dtype, jnp.floating) else ad.Zero(jax.typeof(x).to_tangent_aval())
        for x, t in zip(out, jax.tree.leaves(change), strict=True)
    ]
    return out, moves


def _ruled_batch(leaves, axes, *, rule: Callable, structure, count: int):
    size = next(x.shape[k] for x, k in zip(leaves, axes, strict=True) if k is not None)
    first = [x if k is None else jnp.moveaxis(x, k, 0) for x, k in zip(leaves, axes, strict=True)]
    values = [
        jnp.broadcast_to(x, (size, *x.shape)) if k is None else x
        for x, k in zip(first[:count], axes, strict=False)
    ]
    each = [None if k is None else 0 for k in axes[count:]]

    def of_all(value: Any, arguments: tuple, changes: tuple) -> tuple[Any, Any]:
        given, own = jax.tree.flatten(arguments)
        rates = jax.tree.leaves(changes, is_leaf=_vanishes)
        moving = [k for k, rate in enumerate(rates) if not _vanishes(rate)]

        def of_one(value: Any, given: list, some: list) -> tuple[Any, Any]:
            known = [SymbolicZero(jax.typeof(x).to_tangent_aval()) for x in given]
            for k, rate in zip(moving, some, strict=True):
                known[k] = rate
            return rule(value, jax.tree.unflatten(own, given), jax.tree.unflatten(own, known))

        along = [each[k] for k in moving]
        return jax.vmap(of_one, (0, each, along))(value, given, [rates[k] for k in moving])

    given = [*values, *first[count:]]
    found = _ruled.bind(*given, rule=of_all, structure=structure, count=count)
    return found, [0] * count


_ruled = Primitive("ruled")
_ruled.multiple_results = True
_ruled.def_impl(_values)
_ruled.def_abstract_eval(_values)
mlir.register_lowering(_ruled, mlir.lower_fun(_values, multiple_results=True))
batching.primitive_batchers[_ruled] = _ruled_batch
ad.primitive_jvps[_ruled] = _ruled_jvp


def as_known(function: Callable, value: Any, *arguments: Any) -> Any:
    """The value of a function that has been computed already, differentiable as the function is.

    A rule of differentiation that uses such a value costs no second evaluation, and the function
    itself is compiled only for who differentiates the rule: for second derivatives.

    Args:
        function: differentiable by its arguments.
        value: what it returns for them; nothing is differentiated through it.
        arguments: of the function.

    Example:
        >>> import jax
        >>> square = jax.jit(lambda x: x**2)
        >>> float(jax.grad(lambda x: as_known(square, 9.0, x))(3.0))
        6.0
    """

    def rule(value: Any, arguments: tuple, changes: tuple) -> tuple[Any, Any]:
        return value, jvp_of_moved(function, arguments, changes)[1]

    return ruled(rule, value, *arguments)


def unknown_where(lost: Array, change: Array) -> Array:
    """A change that is NaN in some lanes, in forward and in reverse mode.

    `jnp.where` would do in forward mode; transposed it gives zero, as if nothing depended on what
    was lost. Here a lost lane hands NaN backwards, unless it hands back nothing: a loss over the
    other lanes keeps its gradient.

    Args:
        lost: which lanes.
        change: a tangent, of a shape to which `lost` broadcasts.

    Example:
        >>> unknown_where(jnp.array([True, False]), jnp.array([1.0, 2.0])).tolist()
        [nan, 2.0]
    """
    return _unknown_where.bind(jnp.broadcast_to(lost, jnp.shape(change)), change, backwards=False)


def _unknown(lost: Array, change: Array, *, backwards: bool) -> Array:
    nothing = backwards & (change == 0.0)
    return jnp.where(lost, jnp.where(nothing, 0.0, jnp.nan), change)


def _unknown_jvp(primals, tangents, *, backwards: bool):
    (lost, change), rate = primals, ad.instantiate_zeros(tangents[1])
    value = _unknown_where.bind(lost, change, backwards=backwards)
    if not backwards:
        return value, _unknown_where.bind(lost, rate, backwards=False)
    # Nothing that was handed back stays nothing.
    nothing = lost & (change == 0.0)
    unknown = _unknown_where.bind(lost & ~nothing, rate, backwards=False)
    return value, jnp.where(nothing, 0.0, unknown)


def _unknown_transpose(cotangent, lost, change, *, backwards: bool):
    if isinstance(cotangent, ad.Zero):
        return None, ad.Zero(change.aval)
    return None, _unknown_where.bind(lost, cotangent, backwards=not backwards)


_unknown_where = Primitive("unknown_where")
_unknown_where.def_impl(jax.jit(_unknown, static_argnames="backwards"))
_unknown_where.def_abstract_eval(lambda lost, change, *, backwards: change)
mlir.register_lowering(_unknown_where, mlir.lower_fun(_unknown, multiple_results=False))
batching.defbroadcasting(_unknown_where)
ad.primitive_jvps[_unknown_where] = _unknown_jvp
ad.primitive_transposes[_unknown_where] = _unknown_transpose
