"""Programs that are traced once: kept on disk, as JAX exports them, beside what XLA has compiled.

XLA's cache spares the second run of a command the compiler, not the tracing: Python runs through
all of the mechanics to learn what to compile, in a warm `calibrate` 5 of 9 s. A kept program is
what tracing found. It is looked up by what it was traced from: the function, the shapes of its
arguments, all that is static about them, the versions of JAX and the source files of this package.
Whatever is wrong with a file, the function is traced as if there were none.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import pickle
import re
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
from jax import export

_PACKAGE = Path(__file__).parents[1]
#: What the text of a static value must not hold to stand for it: where it lies in memory, or an
#: array of which only a part is written.
_NOT_ALL = re.compile(r" at 0x[0-9a-f]+|\.\.\.")
#: Set to anything, functions are traced in every process: for who replaces parts of kneejax.
_TRACE_ANEW = "KNEEJAX_TRACE_ANEW"

_kept_in: Path | None = None


def keep_programs(folder: str | os.PathLike[str]) -> None:
    """Keep programs from here on, in a folder that is made when there is one to keep."""
    global _kept_in
    _kept_in = None if os.environ.get(_TRACE_ANEW) else Path(folder)


def kept(function: Callable, static_argnums: tuple[int, ...]) -> Callable:
    """A function that JAX traces once for all processes.

    Args:
        function: of arrays in any containers that can be pickled; it must not be differentiated.
        static_argnums: arguments that are no arrays.

    Returns:
        The same function, for `jax.jit`.
    """

    @functools.wraps(function)
    def from_disk(*arguments: Any) -> Any:
        given = [None if i in static_argnums else x for i, x in enumerate(arguments)]
        leaves, tree = jax.tree.flatten(given)
        static = {i: arguments[i] for i in static_argnums}
        file = _kept_in and _file_of(_kept_in, function, tree, leaves, static)
        if not file:
            return function(*arguments)

        def flat(*leaves: jax.Array) -> Any:
            own = jax.tree.unflatten(tree, leaves)
            return function(*(static.get(i, x) for i, x in enumerate(own)))

        flat.__name__ = function.__name__
        program = _read(file) or _written(file, flat, leaves)
        if program is None:
            return function(*arguments)
        call, answers = program
        return jax.tree.unflatten(jax.tree.structure(answers), call(*leaves))

    return from_disk


def _file_of(folder: Path, function: Callable, tree, leaves, static) -> Path | None:
    """Where a program is kept; None if what it is traced from has no text of its own."""
    shapes = [(leaf.shape, str(leaf.dtype), leaf.weak_type) for leaf in leaves]
    name = f"{function.__module__}.{function.__qualname__}"
    text = "\n".join([name, str(tree), repr(shapes), repr(static), _made_of()])
    if _NOT_ALL.search(text):
        return None
    return folder / f"{function.__name__.strip('_')}-{hashlib.sha256(text.encode()).hexdigest()}"


@functools.cache
def _made_of() -> str:
    """Versions, and the state of every source file of this package."""
    import equinox
    import jaxlib
    import optimistix

    packages = [f"{one.__name__} {one.__version__}" for one in (jax, jaxlib, equinox, optimistix)]
    setting = f"{jax.default_backend()} x64={jax.config.read('jax_enable_x64')}"
    sources = sorted(_PACKAGE.rglob("*.py"))
    files = [f"{x} {x.stat().st_size} {x.stat().st_mtime_ns}" for x in sources]
    return "\n".join([*packages, setting, *files])


def _read(file: Path) -> tuple[Callable, Any] | None:
    # A cache is allowed to be empty, of another version, or broken: then it is no cache.
    with contextlib.suppress(Exception):
        program, answers = pickle.loads(file.read_bytes())
        return export.deserialize(program).call, answers
    return None


def _written(file: Path, flat: Callable, leaves) -> tuple[Callable, Any] | None:
    """Trace, keep, and read again: the next process then compiles the very same program."""
    answers = None

    def traced(*leaves: jax.Array) -> list[jax.Array]:
        nonlocal answers
        found, tree = jax.tree.flatten(flat(*leaves))
        answers = jax.tree.unflatten(tree, range(len(found)))
        return found

    traced.__name__ = flat.__name__
    like = [jax.ShapeDtypeStruct(x.shape, x.dtype, weak_type=x.weak_type) for x in leaves]
    # What JAX does not export is traced in every process.
    with contextlib.suppress(OSError, NotImplementedError, ValueError, pickle.PicklingError):
        program = export.export(jax.jit(traced))(*like).serialize()
        file.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=file.parent, delete=False) as whole:
            whole.write(pickle.dumps((bytes(program), answers)))
        os.replace(whole.name, file)
        return _read(file)
    return None
