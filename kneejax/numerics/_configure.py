"""What a program asks of JAX before anything is computed: cores, compiler, kept programs."""

__all__ = [
    "beside", "collect_seldom", "compiled", "compiler_options", "compiling", "configure",
    "on_all_cores", "share_memory_between_threads", "use_shared_fusion",
]

import concurrent.futures
import contextlib
import ctypes
import functools
import gc
import os
import sys
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Literal, TypeAlias, TypeVar

import jax
import numpy as np
from jax.core import eval_context

from kneejax.numerics._kept_programs import check_executables, keep_programs, kept
from kneejax.numerics._lanes import traced

Part = TypeVar("Part")
Answer = TypeVar("Answer")


def on_all_cores(work: Callable[[Part], Answer], parts: Iterable[Part]) -> list[Answer]:
    """Do some work for each of several parts, on as many threads as this process has cores.

    Programs of JAX leave Python's lock while they compute. The threads stay for the next call:
    starting them took longer than evaluating 500 poses. Work must not deal out work itself.

    Args:
        work: of one part.
        parts: in any number.

    Returns:
        The answers in the order of the parts.

    Raises:
        Exception: what the first part that failed has raised, at once; likewise Ctrl-C. Parts that
            were not begun are dropped.

    Example:
        >>> on_all_cores(abs, [-1, 2, -3])
        [1, 2, 3]
    """
    parts = list(parts)
    if len(parts) < 2:
        return [work(part) for part in parts]
    futures = [_threads().submit(work, part) for part in parts]
    try:
        return [future.result() for future in futures]
    except BaseException:
        for future in futures:
            future.cancel()
        raise


@contextlib.contextmanager
def beside(work: Callable[..., Any], *arguments: Any) -> Iterator[None]:
    """Do some work on a thread of its own while a block runs; its end waits for the work.

    One program compiles while another one does: the compiler leaves Python's lock, and takes one
    core. Tracing does not leave it: the work begins when the first program of the block is traced,
    or at its end. Where the block fails, nobody waits, and what has not begun never will.

    Args:
        work: a function of the arguments.

    Raises:
        Exception: what the work has raised.

    Example:
        >>> found = []
        >>> with beside(found.append, 1):
        ...     pass
        >>> found
        [1]
    """
    begun: list[concurrent.futures.Future] = []

    def begin() -> None:
        if not begun:
            begun.append(_one_thread().submit(work, *arguments))

    _to_begin.append(begin)
    try:
        yield
        begin()
        begun[0].result()
    finally:
        with contextlib.suppress(ValueError):
            _to_begin.remove(begin)


#: What begins when a program has been traced. Until then it is not on the thread: blocks may stand
#: within each other, and nothing there waits for anything.
_to_begin: list[Callable[[], None]] = []


@functools.cache
def _one_thread() -> concurrent.futures.ThreadPoolExecutor:
    return concurrent.futures.ThreadPoolExecutor(1, "kneejax beside")


@functools.cache
def _threads() -> concurrent.futures.ThreadPoolExecutor:
    # Cores that this process may use: those of its affinity, where the system knows of any.
    affinity = getattr(os, "sched_getaffinity", None)
    cores = len(affinity(0)) if affinity else os.cpu_count()
    return concurrent.futures.ThreadPoolExecutor(cores, "kneejax")


_CACHE = "jax_compilation_cache_dir"


def configure() -> None:
    """Prepare JAX for kneejax, in all of this process: call it before anything is computed.

    It switches float64 on, lets XLA fuse operations without copying shared values
    (`use_shared_fusion`, five times faster), and keeps programs between runs, as they are traced
    and as they are compiled: in `JAX_COMPILATION_CACHE_DIR` if that is set, otherwise in `kneejax`
    of the user's cache folder (`XDG_CACHE_HOME`, or `~/.cache`). What is damaged there is made
    again; what XLA compiled is machine code, so nobody else may write into that folder. `kneejax`
    on the command line begins with it; importing the package changes nothing. To call it again
    does no harm.

    Warns:
        RuntimeWarning: JAX has begun to compute without it. float64 holds from here on; arrays
            that exist stay as they are, and solves are slower.

    Example:
        >>> import kneejax as kj
        >>> kj.configure()  # doctest: +SKIP
    """
    jax.config.update("jax_enable_x64", True)
    # By name: jax makes these attributes, of which type checkers know nothing.
    # Set to nothing, it is not set: programs would be kept wherever a command is called.
    if not getattr(jax.config, _CACHE):
        base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
        jax.config.update(_CACHE, str(Path(base) / "kneejax"))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    check_executables()
    keep_programs(Path(getattr(jax.config, _CACHE)) / "traced")
    if not use_shared_fusion():
        warnings.warn(
            "kneejax.configure() comes too late: JAX has begun to compute. float64 is on from "
            "here, but solves stay slower and programs may not be kept; call it first",
            RuntimeWarning,
            stacklevel=2,
        )


#: `M_ARENA_MAX` of GNU's malloc.h.
_ARENA_MAX = -8
_SHARED_FUSION = "xla_cpu_use_multi_output_fusion"
_ASKED = f"--xla_backend_extra_options={_SHARED_FUSION},xla_cpu_disable_loop_unrolling"


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
    os.environ["XLA_FLAGS"] = f"{flags} {_ASKED}".strip()
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


#: How much is made of a program.
Effort: TypeAlias = Literal["least", "usual", "most"]
#: Under shared fusion XLA's older emitters compile in half the time (docs/performance.md).
_OLDER = {"xla_cpu_use_fusion_emitters": False, "xla_llvm_disable_expensive_passes": True}
#: Machine code as it comes.
_AS_IT_COMES = {"xla_backend_optimization_level": 0}


@functools.cache
def _older() -> Mapping[str, Any]:
    """What asks XLA for its older emitters, as long as it has them."""
    try:
        jax.jit(lambda: 0.0, compiler_options=_OLDER).lower().compile()
    except jax.errors.JaxRuntimeError:
        return {}
    return _OLDER


def compiled(
    static_argnums: tuple[int, ...] = (), *, effort: Effort = "usual"
) -> Callable[[Callable], Callable]:
    """Compile a function with `compiler_options`; inside another `jax.jit`, without.

    JAX takes compiler options at the outermost `jit` only and raises for an inner one. A person's
    own `jit` around a motion must work all the same; it compiles more slowly unless it is given
    the options as well. Where `configure` was called, what is traced is kept for other processes.

    Args:
        static_argnums: as in `jax.jit`.
        effort: least for what is computed once or twice, most for what computes for minutes, or
            runs derivatives backwards: sums of padded arrays, which XLA's older emitters write out
            again for each array, 17 s instead of 1.

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
            options = dict(compiler_options())
            if not (within or options or effort == "most"):
                options |= _older()
            if effort == "least":
                options |= _AS_IT_COMES
            own = said(function if within else kept(function, static_argnums))
            return jax.jit(own, static_argnums=static_argnums, compiler_options=options)

        def said(own: Callable) -> Callable:
            @functools.wraps(function)
            def begun(*arguments: Any) -> Any:
                _compiling[threading.get_ident()] = function.__name__.strip("_")
                answer = own(*arguments)
                with contextlib.suppress(IndexError):  # another thread may take the last
                    while _to_begin:
                        _to_begin.pop()()
                return answer

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
    _of_c_library("mallopt", _ARENA_MAX, os.cpu_count() or 1)


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
    _of_c_library("malloc_trim", 0)


def _of_c_library(name: str, *numbers: int) -> None:
    if sys.platform == "linux":
        with contextlib.suppress(OSError, AttributeError):
            getattr(ctypes.CDLL(None), name)(*numbers)
