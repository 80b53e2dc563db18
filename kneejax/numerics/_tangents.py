"""Tangents in rules of differentiation."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero


def instantiate(tree):
    """Tangents of which those known to vanish are arrays of zeros, as `jax.jvp` wants them.

    Args:
        tree: tangents as a rule with `symbolic_zeros=True` gets them.
    """
    return jax.tree.map(
        lambda t: jnp.zeros(t.shape, t.dtype) if isinstance(t, SymbolicZero) else t,
        tree,
        is_leaf=lambda t: isinstance(t, SymbolicZero),
    )
