"""Programs that are traced once: kept on disk, as JAX exports them, beside what XLA has compiled.

XLA's cache spares the second run of a command the compiler, not the tracing: Python runs through
all of the mechanics to learn what to compile, in a warm `calibrate` 5 of 9 s. A kept program is
what tracing found. It is looked up by what it was traced from: the function, the shapes of its
arguments, the state of all that is static about them, the versions of JAX and the sources of the
rooms that compute. A function that says less of itself than that, a closure above all, is not kept.

A file carries the checksum of its contents, which are numbers, names and StableHLO: nothing in it
is run but arithmetic. Whatever is wrong with a file, the function is traced as if there were none,
and the file is replaced.

What XLA has compiled, JAX takes for whole, warns of an entry that it cannot read, and never
replaces it: a half-written file costs its compilation in every later run, and where entries are
packed without a checksum a flipped bit would be run. So their checksums lie beside them.
"""

__all__ = ["keep_programs"]

import contextlib
import dataclasses
import enum
import functools
import hashlib
import inspect
import json
import os
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jax import export

from kneejax._whole_files import read_sealed, write_sealed, write_whole

_PACKAGE = Path(__file__).parents[1]
#: Rooms that compute: a program is traced from their sources, and functions of others are not kept.
_ROOMS = ("numerics", "geometry", "parameters", "joints", "mechanics", "statics", "dynamics",
          "experiments", "inference", "planning", "papers", "explorer")  # fmt: skip
_COUNTED = tuple(f"{_PACKAGE.name}.{room}" for room in _ROOMS)
#: What the text of a static value must not hold to stand for it: where it lies in memory, or an
#: array of which only a part, or the shape alone, is written.
_NOT_ALL = re.compile(r" at 0x[0-9a-f]+|\.\.\.|\b(bool|[fiuc]\d+)\[")
#: Set to anything, functions are traced in every process: for who replaces parts of kneejax.
_TRACE_ANEW = "KNEEJAX_TRACE_ANEW"
_KIND = "program 2"
#: An operation that calls what is compiled into the process: no program here has one.
_CALLS_OUT = b"custom_call"

_kept_in: Path | None = None


class _Nameless(Exception):
    """Something whose state cannot be written down."""


def keep_programs(folder: str | os.PathLike[str]) -> None:
    """Keep programs from here on, in a folder that is made when there is one to keep."""
    global _kept_in
    _kept_in = None if os.environ.get(_TRACE_ANEW) else Path(folder)


def kept(function: Callable, static_argnums: tuple[int, ...]) -> Callable:
    """A function of arrays in tuples, lists, dicts and dataclasses that JAX traces once for all
    processes, for `jax.jit`; it must not be differentiated."""

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
        return jax.tree.unflatten(answers, call(*leaves))

    return from_disk


def _file_of(folder: Path, function: Callable, tree, leaves, static) -> Path | None:
    """Where a program is kept; None if what it is traced from has no text of its own."""
    shapes = [(leaf.shape, str(leaf.dtype), leaf.weak_type) for leaf in leaves]
    try:
        name, state = _state_of(function), _state_of(static)
    except _Nameless:
        return None
    text = "\n".join([name, str(tree), repr(shapes), state, _made_of()])
    if _NOT_ALL.search(text):
        return None
    return folder / f"{function.__name__.strip('_')}-{hashlib.sha256(text.encode()).hexdigest()}"


def _state_of(x: Any) -> str:
    """All that a static value is, in words; an array by its checksum."""
    if x is None or isinstance(x, (bool, int, float, complex, str, bytes)):
        return f"{type(x).__name__} {x!r}" if not isinstance(x, enum.Enum) else repr(x)
    if isinstance(x, (np.ndarray, np.generic, jax.Array)):
        whole = np.asarray(x)
        if whole.dtype == object:
            raise _Nameless
        sum_of = hashlib.sha256(np.ascontiguousarray(whole).tobytes()).hexdigest()
        return f"array {whole.shape} {whole.dtype.str} {sum_of}"
    if isinstance(x, functools.partial):
        return f"partial {_state_of((x.func, x.args, x.keywords))}"
    if inspect.ismethod(x):
        return f"method {_state_of((x.__func__, x.__self__))}"
    if inspect.isfunction(x) or isinstance(x, type):
        return _name_of(x)
    kind = _name_of(type(x), anywhere=isinstance(x, (tuple, list, dict, frozenset)))
    if isinstance(x, dict):
        return f"{kind} {[(_state_of(key), _state_of(value)) for key, value in x.items()]}"
    if isinstance(x, (tuple, list)):
        return f"{kind} {[_state_of(one) for one in x]}"
    if isinstance(x, frozenset):
        return f"{kind} {sorted(map(_state_of, x))}"
    if isinstance(x, enum.Enum):
        return f"{kind} {x.name}"
    if not dataclasses.is_dataclass(x):
        raise _Nameless
    fields = [(field.name, getattr(x, field.name, None)) for field in dataclasses.fields(x)]
    return f"{kind} {[(name, _state_of(value)) for name, value in fields]}"


def _name_of(x: Any, anywhere: bool = False) -> str:
    """The name of a function or class that stands for it: its source counts, and it captures
    nothing."""
    name = f"{x.__module__}.{x.__qualname__}"
    if not anywhere and not f"{x.__module__}.".startswith(tuple(f"{one}." for one in _COUNTED)):
        raise _Nameless
    if "<" in name or getattr(x, "__closure__", None):
        raise _Nameless
    return name


@functools.cache
def _made_of() -> str:
    """Versions, and the contents of every source file of the rooms that compute."""
    import jaxlib
    import optimistix

    packages = [f"{one.__name__} {one.__version__}" for one in (jax, jaxlib, eqx, optimistix)]
    setting = f"{jax.default_backend()} x64={jax.config.read('jax_enable_x64')}"
    sources = hashlib.sha256()
    for path in sorted(path for room in _ROOMS for path in (_PACKAGE / room).rglob("*.py")):
        sources.update(f"{path.relative_to(_PACKAGE).as_posix()}\n".encode() + path.read_bytes())
    return "\n".join([*packages, setting, sources.hexdigest()])


def _read(file: Path) -> tuple[Callable, Any] | None:
    # A cache is allowed to be empty, of another version, or broken: then it is no cache.
    with contextlib.suppress(Exception):
        contents = read_sealed(file, _KIND)
        if contents is None or _CALLS_OUT in contents:
            return None
        structure, _, program = contents.partition(b"\n")
        answers = jax.tree.structure(_rebuilt(json.loads(structure)))
        return export.deserialize(bytearray(program)).call, answers
    return None


def _written(file: Path, flat: Callable, leaves) -> tuple[Callable, Any] | None:
    """Trace, keep, and read again: the next process then compiles the very same program."""
    answers = None

    def traced(*leaves: jax.Array) -> list[jax.Array]:
        nonlocal answers
        found, tree = jax.tree.flatten(flat(*leaves))
        answers = jax.tree.unflatten(tree, [_LEAF] * len(found))
        return found

    traced.__name__ = flat.__name__
    like = [jax.ShapeDtypeStruct(x.shape, x.dtype, weak_type=x.weak_type) for x in leaves]
    # What JAX does not export is traced in every process.
    with contextlib.suppress(OSError, NotImplementedError, ValueError, _Nameless):
        program = export.export(jax.jit(traced))(*like).serialize()
        contents = json.dumps(_structure_of(answers)).encode() + b"\n" + bytes(program)
        write_sealed(file, contents, _KIND)
        return _read(file)
    return None


class _Leaf:
    """Stands for an array in the structure of an answer."""


_LEAF = _Leaf()


def _structure_of(x: Any) -> Any:
    """Containers of an answer, as JSON: their kinds, what is static about them, their contents."""
    if isinstance(x, _Leaf):
        return "array"
    if x is None:
        return "none"
    if dataclasses.is_dataclass(x):
        fields = {}
        for field in dataclasses.fields(x):
            value, static = getattr(x, field.name), field.metadata.get("static", False)
            fields[field.name] = ["static", _static(value)] if static else _structure_of(value)
        return ["module", type(x).__module__, type(x).__qualname__, fields]
    if isinstance(x, tuple) and hasattr(x, "_fields"):
        parts = [_structure_of(one) for one in x]
        return ["named", type(x).__module__, type(x).__qualname__, parts]
    if type(x) is dict and all(isinstance(key, (str, int)) for key in x):
        return ["dict", [[key, _structure_of(value)] for key, value in x.items()]]
    if type(x) in (tuple, list):
        return [type(x).__name__, [_structure_of(one) for one in x]]
    raise _Nameless


def _static(x: Any) -> Any:
    if type(x) is tuple:
        return ["tuple", [_static(one) for one in x]]
    if x is None or type(x) in (bool, int, float, str):
        return ["value", x]
    raise _Nameless


def _rebuilt(x: Any) -> Any:
    """The containers of an answer around numbers; classes are looked up, not imported."""
    if x == "array":
        return 0
    if x == "none":
        return None
    kind, *rest = x
    if kind == "dict":
        return {key: _rebuilt(value) for key, value in rest[0]}
    if kind in ("tuple", "list"):
        return {"tuple": tuple, "list": list}[kind](_rebuilt(one) for one in rest[0])
    module, name, contents = rest
    found: Any = functools.reduce(getattr, name.split("."), sys.modules[module])
    fields = getattr(found, "_fields", ())
    if kind == "named" and issubclass(found, tuple) and len(fields) == len(contents):
        return tuple.__new__(found, [_rebuilt(one) for one in contents])
    names = [field.name for field in dataclasses.fields(found)]
    if kind != "module" or names != list(contents):
        raise ValueError(f"{kind} {module}.{name}")
    made = object.__new__(found)
    for key, value in contents.items():
        is_static = isinstance(value, list) and value[0] == "static"
        object.__setattr__(made, key, _static_of(value[1]) if is_static else _rebuilt(value))
    return made


def _static_of(x: Any) -> Any:
    kind, value = x
    return tuple(_static_of(one) for one in value) if kind == "tuple" else value


_SUM = "-sha256"


def check_executables() -> None:
    """Check entries of JAX's compilation cache from here on.

    Where a version of JAX keeps them in another way, it keeps them as it does.
    """
    try:
        from jax._src import compilation_cache as cache

        usual = cache.get_file_cache
        if getattr(usual, "checks", False):
            return

        def checked(path: str) -> Any:
            found = usual(path)
            return found and (_Checked(found[0], Path(path), cache.decompress_executable), path)

        checked.checks = True
        cache.get_file_cache = checked
    except (ImportError, AttributeError):
        pass


class _Checked:
    """A cache of JAX beside whose entries their checksums lie.

    An entry without one, from JAX without kneejax, gets it when it can be unpacked.
    """

    def __init__(self, cache: Any, folder: Path, unpack: Any):
        self._cache, self._folder, self._unpack = cache, folder, unpack

    def __getattr__(self, name: str) -> Any:
        return getattr(self._cache, name)

    def get(self, key: str) -> bytes | None:
        entry, file = self._cache.get(key), self._folder / f"{key}{_SUM}"
        if entry is None:
            return None
        try:
            if file.exists():
                sound = file.read_bytes() == _sum_of(entry)
            else:
                self._unpack(entry)
                sound = True
                write_whole(file, _sum_of(entry), at_once=True)
        except OSError:
            return entry
        except Exception:  # what cannot be unpacked, whatever it was packed with
            sound = False
        if not sound:
            for end in ("-cache", _SUM):
                (self._folder / f"{key}{end}").unlink(missing_ok=True)
        return entry if sound else None

    def put(self, key: str, entry: bytes) -> None:
        if self._cache.get(key) is not None:
            return
        if not getattr(self._cache, "eviction_enabled", True):
            # As JAX does, but whole.
            write_whole(self._folder / f"{key}-cache", entry, at_once=True)
        else:
            self._cache.put(key, entry)
        write_whole(self._folder / f"{key}{_SUM}", _sum_of(entry), at_once=True)


def _sum_of(entry: bytes) -> bytes:
    return hashlib.sha256(entry).hexdigest().encode()
