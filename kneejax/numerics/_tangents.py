"""Tangents in rules of differentiation."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero


def instantiate(tree):
    """Tangents of which those known to vanish are arrays of zeros, as `jax.jvp` wants them.

    Args:
        tree: tangents as a rule with `symbolic_zeros=True` gets them.
    """
    return jax.tree.map(
        lambda t: _zeros(t) if isinstance(t, SymbolicZero) else t,
        tree,
        is_leaf=lambda t: isinstance(t, SymbolicZero),
    )


def _zeros(tangent):
    # Whole numbers have tangents of a type that only NumPy knows.
    if tangent.dtype == jax.dtypes.float0:
        return np.zeros(tangent.shape, jax.dtypes.float0)
    return jnp.zeros(tangent.shape, tangent.dtype)


def none_of(tree):
    """Tangents of answers that have no derivative, truth values among them, as a rule returns them.

    Args:
        tree: the answers.
    """
    return jax.tree.map(
        lambda x: jnp.zeros_like(x) if jnp.issubdtype(x.dtype, jnp.floating)
        else np.zeros(jnp.shape(x), jax.dtypes.float0),
        tree,
    )  # fmt: skip
