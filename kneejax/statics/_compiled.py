"""Compilation of functions that contain a solve."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import jax

#: For `jax.jit` around a solve. XLA's fusion pass on a CPU writes each shared value anew into
#: every kernel that reads it: without the pass a solve compiles in a fifth of the time and runs
#: as fast or faster (benchmarks/compile_options.py).
COMPILER_OPTIONS = {"xla_disable_hlo_passes": "fusion"}


def compiled(static_argnums: tuple[int, ...] = ()) -> Callable[[Callable], Callable]:
    """Compile a function with `COMPILER_OPTIONS`; inside another `jax.jit`, without.

    JAX takes compiler options at the outermost `jit` only and raises for an inner one. A person's
    own `jit` around a motion must work all the same; it compiles more slowly unless it is given
    the options as well.

    Args:
        static_argnums: as in `jax.jit`.

    Returns:
        A decorator.
    """

    def decorate(function: Callable) -> Callable:
        plain = jax.jit(function, static_argnums=static_argnums)
        quick = jax.jit(
            function, static_argnums=static_argnums, compiler_options=dict(COMPILER_OPTIONS)
        )

        @functools.wraps(function)
        def call(*arguments: Any) -> Any:
            try:
                return quick(*arguments)
            except ValueError as problem:
                if "compiler_options" not in str(problem):
                    raise
                return plain(*arguments)

        return call

    return decorate
