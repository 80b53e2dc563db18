"""Compilation of functions that contain a solve."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import jax

#: For `jax.jit` around a solve. XLA's fusion pass on a CPU writes each shared value anew into
#: every kernel that reads it: without the pass one evaluation over 25 lanes compiles in 7 s
#: instead of 16 and runs in 1.7 ms instead of 55 (benchmarks/compile_options.py).
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
