"""Arrays filled up, so that one compiled program serves tables of several lengths."""

__all__ = ["filled", "lanes_for", "needs_numbers", "numpy_for", "traced"]

from types import ModuleType
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer


def lanes_for(count: int) -> int:
    """Lanes of a call for so many poses: one compiled program serves tables of several lengths.

    Compiling takes some hundred times as long as the lanes that are filled up.

    Args:
        count: poses.

    Returns:
        The next power of two, 32 at least and 1024 at most; more poses take multiples of that.

    Example:
        >>> [lanes_for(n) for n in (1, 25, 33, 1025)]
        [32, 32, 64, 2048]
    """
    return min(max(32, 1 << (count - 1).bit_length()), -(-count // 1024) * 1024)


def filled(x: Any) -> np.ndarray:
    """An array whose last axis is filled up to `lanes_for` with its last entry.

    Args:
        x: shape `(..., poses)`, one pose at least.

    Returns:
        Shape `(..., lanes)`.

    Example:
        >>> filled([[1.0, 2.0]]).shape
        (1, 32)
    """
    x = np.asarray(x)
    more = lanes_for(x.shape[-1]) - x.shape[-1]
    return np.pad(x, [(0, 0)] * (x.ndim - 1) + [(0, more)], "edge")


def traced(*trees: Any) -> bool:
    """Whether numbers are unknown yet, because JAX traces the caller.

    Example:
        >>> import jax
        >>> traced(1.0), bool(jax.jit(lambda x: jnp.array(traced(x)))(1.0))
        (False, True)
    """
    return any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(trees))


def numpy_for(*trees: Any) -> ModuleType:
    """NumPy where all numbers are known, otherwise that of JAX.

    Outside of what it traces, JAX compiles a program for every operation and every shape: some
    hundred of a command's programs were of that kind, 30 ms each.

    Example:
        >>> numpy_for([1.0, 2.0]).__name__
        'numpy'
    """
    return jnp if traced(*trees) else np


def needs_numbers(function: str, instead: str, *trees: Any) -> None:
    """Say of a function that decides by numbers that JAX can neither trace nor differentiate it.

    Args:
        function: its name.
        instead: what can be differentiated.
        trees: its arguments.

    Raises:
        TypeError: JAX traces the caller.

    Example:
        >>> needs_numbers("branches", "passive_flexion", 1.0)
    """
    if traced(*trees):
        raise TypeError(
            f"{function}: has no derivatives, since it decides by numbers; expected it outside of "
            f"jax.grad, jax.jit and jax.vmap: {instead} can be differentiated"
        )
