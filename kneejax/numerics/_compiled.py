"""Compilation of functions that contain a solve.

A solve is some thousand operations on short arrays whose values are used again and again. As XLA
fuses them by itself, every kernel that reads a shared value computes it anew. Without fusion each
operation goes through memory, in as long, but compiles in half the time: that can be asked for
function by function, and kneejax does. With shared fusion, a setting of the whole process that XLA
reads once (`use_shared_fusion`), a solve takes a fifth of either: docs/performance.md.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import gc
import os
import sys
import threading
from collections.abc import Callable, Mapping
from typing import Any

import jax
import numpy as np
from jax.core import eval_context

from kneejax.numerics._kept_programs import kept
from kneejax.numerics._lanes import traced

#: `M_ARENA_MAX` of GNU's malloc.h.
_ARENA_MAX = -8
_SHARED_FUSION = "--xla_backend_extra_options=xla_cpu_use_multi_output_fusion"


#: Names of what is being compiled, by threads.
_compiling: dict[int, str] = {}


def compiling() -> str | None:
    """What is being traced and compiled at this moment, if anything is.

    Example:
        >>> compiling()
    """
    return next(iter(_compiling.copy().values()), None)


def use_shared_fusion() -> bool:
    """Let XLA fuse operations without copying shared values, in all of this process.

    Solves run several times faster. The setting is experimental in XLA and applies to whatever
    else is compiled in the process; there, a program full of slices and concatenations may get
    slower. XLA reads it once: call this before JAX computes anything.

    Returns:
        Whether the setting is in force; False if JAX has begun to compute without it.

    Example:
        In a process that has computed already it is too late; `kj.configure()` calls it in time.

        >>> import kneejax as kj
        >>> kj.use_shared_fusion() in (True, False)
        True
    """
    flags = os.environ.get("XLA_FLAGS", "")
    if _SHARED_FUSION in flags:
        return True
    if jax._src.xla_bridge.backends_are_initialized():  # pyright: ignore[reportAttributeAccessIssue]
        return False
    os.environ["XLA_FLAGS"] = f"{flags} {_SHARED_FUSION}".strip()
    return True


def compiler_options() -> Mapping[str, Any]:
    """For a `jax.jit` of your own around a solve: `jax.jit(f, compiler_options=...)`.

    Example:
        >>> import jax
        >>> function = jax.jit(lambda x: 2.0 * x, compiler_options=dict(compiler_options()))
        >>> float(function(3.0))
        6.0
    """
    shared = _SHARED_FUSION in os.environ.get("XLA_FLAGS", "")
    return {} if shared else {"xla_disable_hlo_passes": "fusion"}


#: Machine code as it comes: for what is computed once or twice (docs/performance.md).
_AS_IT_COMES = {"xla_backend_optimization_level": 0}


def compiled(
    static_argnums: tuple[int, ...] = (), *, optimised: bool = True
) -> Callable[[Callable], Callable]:
    """Compile a function with `compiler_options`; inside another `jax.jit`, without.

    JAX takes compiler options at the outermost `jit` only and raises for an inner one. A person's
    own `jit` around a motion must work all the same; it compiles more slowly unless it is given
    the options as well. Where `configure` was called, what is traced is kept for other processes.

    Args:
        static_argnums: as in `jax.jit`.
        optimised: false for what is computed once or twice after it was compiled.

    Returns:
        A decorator.

    Example:
        >>> import jax.numpy as jnp
        >>> area = compiled()(lambda radius: jnp.pi * radius**2)
        >>> round(float(area(2.0)), 3)
        12.566
    """

    def decorate(function: Callable) -> Callable:
        plain = jax.jit(function, static_argnums=static_argnums)

        @functools.cache
        def quick(within: bool) -> Callable:
            # Made at the first call: until then the process may still choose shared fusion.
            options = dict(compiler_options()) | ({} if optimised else _AS_IT_COMES)
            own = said(function if within else kept(function, static_argnums))
            return jax.jit(own, static_argnums=static_argnums, compiler_options=options)

        def said(own: Callable) -> Callable:
            @functools.wraps(function)
            def begun(*arguments: Any) -> Any:
                _compiling[threading.get_ident()] = function.__name__.strip("_")
                return own(*arguments)

            return begun

        @functools.wraps(function)
        def call(*arguments: Any) -> Any:
            within = traced(arguments)
            program = quick(within)
            programs = program._cache_size()
            try:
                if within:
                    answer = program(*arguments)
                else:
                    # Known numbers under `jax.jacfwd`, too: there JAX would compile anew.
                    with eval_context():
                        answer = program(*_unplaced(arguments, static_argnums))
            except ValueError:
                if not within:
                    raise
                # JAX refuses the options in another program; any other fault comes again.
                return plain(*arguments)
            finally:
                _compiling.pop(threading.get_ident(), None)
            if program._cache_size() > programs:
                _hand_back_memory()
            return answer

        return call

    return decorate


def _unplaced(arguments: tuple, static_argnums: tuple[int, ...]) -> tuple:
    """The same numbers, bound to no device.

    What a kept program returns is bound to the device that computed it, and JAX compiles a program
    for such arguments apart from the one for all others: a path that went on from what its last
    call returned was compiled twice.
    """

    def free(x: Any) -> Any:
        return np.asarray(x) if isinstance(x, jax.Array) and x.committed else x

    return tuple(
        x if i in static_argnums else jax.tree.map(free, x) for i, x in enumerate(arguments)
    )


def share_memory_between_threads() -> None:
    """Let threads allocate from as many pools as there are cores, where the C library can.

    GNU's library has eight times as many, and each keeps what was freed in it: a process that
    compiles a search grows to 0.92 GB instead of 1.04, at the same speed. It holds for the whole
    process: for programs, not for libraries. Call it before there are threads.

    Example:
        >>> share_memory_between_threads()
    """
    if sys.platform == "linux":
        with contextlib.suppress(OSError, AttributeError):
            ctypes.CDLL(None).mallopt(_ARENA_MAX, os.cpu_count() or 1)


def collect_seldom() -> None:
    """Let Python look for circles of objects seldom. For programs, not for libraries.

    Tracing makes millions of objects that stay, and figures many that go by themselves: to look
    through all of them again and again takes a twelfth of a first run, and a fifth of a worker's
    time.

    Example:
        >>> collect_seldom()
    """
    gc.set_threshold(100_000, 20, 20)


def _hand_back_memory() -> None:
    """Give the system what the compiler has freed, where the C library can.

    A search takes 0.5 GB to compile, and GNU's library keeps it: a process with a map stays at
    0.9 GB, and everything that is imported later comes on top; with this it falls to 0.5 GB.
    """
    if sys.platform == "linux":
        with contextlib.suppress(OSError, AttributeError):
            ctypes.CDLL(None).malloc_trim(0)
