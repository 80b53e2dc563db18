"""What was traced once is not traced again, and a file that is no program is no error."""

import dataclasses
import functools
import json
import pickle
import re
import zlib
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import monitoring

import kneejax as kj
from kneejax._whole_files import read_sealed, write_sealed
from kneejax.numerics import _kept_programs as programs
from kneejax.numerics import compiled


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True, slots=True)
class Pair:
    """Two arrays, as vectors have three."""

    x: jax.Array
    y: jax.Array


class Answer(eqx.Module):
    """Arrays, some of them in other containers, and a word."""

    whole: jax.Array
    parts: dict[str, jax.Array]
    pair: Pair
    word: str = eqx.field(static=True)


@dataclasses.dataclass(frozen=True)
class Power:
    """A static argument whose text says all of it."""

    exponent: int


@pytest.fixture(autouse=True)
def counted(monkeypatch):
    """Functions of this file are taken for the package's own."""
    monkeypatch.setattr(programs, "_COUNTED", ("kneejax", __name__.split(".")[0]))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.delenv("KNEEJAX_TRACE_ANEW", raising=False)
    monkeypatch.setattr(programs, "_kept_in", None)
    programs.keep_programs(tmp_path / "traced")
    return tmp_path / "traced"


#: Shapes for which `squares` was traced.
TIMES = []


def squares(x, power):
    TIMES.append(x.shape)
    if x.shape[0] > 9:
        raise ValueError("nine at most")
    y = jax.lax.fori_loop(0, power.exponent, lambda _, y: y * x, jnp.ones_like(x))
    return Answer(y, {"sum": jnp.sum(y)}, Pair(y, 2.0 * y), "squares")


@pytest.fixture
def fresh():
    """Makes the function anew, as another process would, with how often it was traced."""
    TIMES.clear()
    return lambda: jax.jit(programs.kept(squares, (1,)), static_argnums=1), TIMES


X = np.linspace(0.5, 2.0, 5)


def test_another_process_traces_nothing_and_answers_the_same(folder, fresh):
    make, times = fresh
    first, second = make()(X, Power(2)), make()(X, Power(2))
    assert times == [(5,)] and len(list(folder.iterdir())) == 1
    assert jax.tree.structure(first) == jax.tree.structure(second) and second.word == "squares"
    np.testing.assert_array_equal(first.whole, second.whole)
    np.testing.assert_array_equal(second.pair.y, 2.0 * second.whole)
    np.testing.assert_allclose(second.whole, X**2, rtol=1e-15)


def test_other_shapes_static_values_and_sources_are_other_programs(folder, fresh, monkeypatch):
    make, times = fresh
    make()(X, Power(2))
    np.testing.assert_allclose(make()(X[:3], Power(2)).whole, X[:3] ** 2)
    np.testing.assert_allclose(make()(X, Power(3)).whole, X**3)
    np.testing.assert_allclose(make()(X.astype(np.float32), Power(2)).whole, X**2, rtol=1e-6)
    monkeypatch.setattr(programs, "_made_of", lambda: "another version")
    make()(X, Power(2))
    assert len(times) == 5 and len(list(folder.iterdir())) == 5


def test_a_broken_file_is_as_good_as_none_and_is_mended(folder, fresh):
    make, times = fresh
    make()(X, Power(2))
    (file,) = folder.iterdir()
    whole = file.read_bytes()
    flipped = [bytearray(whole) for _ in range(3)]
    for k, broken in enumerate(flipped):
        broken[-1 - k * (len(whole) // 3)] ^= 1 << k
    for count, broken in enumerate((b"", b"no program", whole[: len(whole) // 2], *flipped)):
        file.write_bytes(broken)
        np.testing.assert_allclose(make()(X, Power(2)).whole, X**2)
        assert len(times) == count + 2 and file.read_bytes() == whole
    assert [x.name for x in folder.iterdir()] == [file.name]


def test_a_file_cannot_run_code(folder, fresh):
    """Whoever can write a file with a right checksum names classes at most, and only ours."""
    make, times = fresh
    make()(X, Power(2))
    (file,) = folder.iterdir()
    whole = file.read_bytes()
    contents = read_sealed(file, programs._KIND)
    structure, _, program = contents.partition(b"\n")
    pickled = pickle.dumps((program, None))
    elsewhere = json.dumps(["module", "subprocess", "Popen", {"args": "array"}]).encode()
    for bad in (pickled, elsewhere + b"\n" + program, contents + b"custom_call"):
        write_sealed(file, bad, programs._KIND)
        np.testing.assert_allclose(make()(X, Power(2)).whole, X**2)
        assert file.read_bytes() == whole
    assert len(times) == 4


def times_two(x):
    return 2.0 * x


def of_captured(function):
    def outer(x):
        return function(x)

    return outer


def test_what_captures_something_is_never_another_function(folder, monkeypatch):
    """Two closures of one name: the second got the first one's program, and its numbers."""
    two, three = (
        jax.jit(programs.kept(of_captured(f), ())) for f in (times_two, lambda x: 3.0 * x)
    )
    np.testing.assert_allclose(two(X), 2.0 * X)
    np.testing.assert_allclose(three(X), 3.0 * X)
    nameless = jax.jit(programs.kept(lambda x: 5.0 * x, ()))
    np.testing.assert_allclose(nameless(X), 5.0 * X)
    # Sources of others are not counted: their functions may have changed.
    monkeypatch.setattr(programs, "_COUNTED", ("kneejax",))
    np.testing.assert_allclose(jax.jit(programs.kept(times_two, ()))(X), 2.0 * X)
    assert not folder.exists()


@dataclasses.dataclass(frozen=True, eq=False)
class Table:
    """A static argument that does not print all of its state."""

    numbers: np.ndarray = dataclasses.field(repr=False)

    def apply(self, x):
        return self.numbers[0] * x


def applied(x, function):
    return function(x)


def test_static_arguments_count_with_all_of_their_state(folder):
    one, other = Table(np.arange(5000.0) + 1.0), Table(np.arange(5000.0) + 2.0)
    for table in (one, other, one):
        for function in (table.apply, functools.partial(Table.apply, table)):
            found = jax.jit(programs.kept(applied, (1,)), static_argnums=1)(X, function)
            np.testing.assert_allclose(found, table.numbers[0] * X)
    assert len(list(folder.iterdir())) == 4
    jax.jit(programs.kept(applied, (1,)), static_argnums=1)(X, of_captured(times_two))
    assert len(list(folder.iterdir())) == 4


def test_what_jax_compiled_is_checked_and_mended_too(tmp_path):
    class Store:
        """JAX's, of one folder."""

        eviction_enabled = False

        def get(self, key):
            file = tmp_path / f"{key}-cache"
            return file.read_bytes() if file.exists() else None

    cache = programs._Checked(Store(), tmp_path, zlib.decompress)
    entry = zlib.compress(b"machine code" * 99)
    cache.put("key", entry)
    assert cache.get("key") == entry
    file = tmp_path / "key-cache"
    for broken in (b"", entry[:20], entry[:-1] + bytes([entry[-1] ^ 1]), b"not a cache"):
        file.write_bytes(broken)
        assert cache.get("key") is None and not file.exists()
        cache.put("key", entry)
        assert cache.get("key") == entry
    # Entries from before have no checksum: they count when they can be unpacked.
    (tmp_path / "key-sha256").unlink()
    assert cache.get("key") == entry and (tmp_path / "key-sha256").exists()
    (tmp_path / "key-sha256").unlink()
    file.write_bytes(entry[:20])
    assert cache.get("key") is None


def test_a_folder_that_cannot_be_written_is_no_error(fresh, monkeypatch, tmp_path):
    (tmp_path / "file").touch()
    monkeypatch.setattr(programs, "_kept_in", tmp_path / "file" / "below")
    np.testing.assert_allclose(fresh[0]()(X, Power(2)).whole, X**2)


def test_a_static_value_that_does_not_say_what_it_is_is_not_kept(folder, fresh):
    class Nameless:
        exponent = 2

    np.testing.assert_allclose(fresh[0]()(X, Nameless()).whole, X**2)
    assert not folder.exists()


def test_errors_of_the_function_reach_the_caller(folder, fresh):
    with pytest.raises(ValueError, match="nine at most"):
        fresh[0]()(np.ones(10), Power(2))


@pytest.fixture
def programs_compiled():
    """Names of the programs that are compiled while the test runs."""
    heard = []

    def listener(event, _, fun_name="", **__):
        heard.extend([fun_name] if "backend_compile" in event else [])

    monitoring.register_event_duration_secs_listener(listener)
    yield heard
    monitoring.unregister_event_duration_listener(listener)


@compiled()
def doubled(x):
    return Answer(2.0 * x, {"sum": jnp.sum(x)}, Pair(x, x), "doubled")


def test_what_a_kept_program_returned_is_no_other_argument(folder, programs_compiled):
    """A walk goes on from where its last call stopped: that is the same program once more."""
    first = doubled(np.ones(6))
    assert programs_compiled.count("jit(doubled)") == 1
    np.testing.assert_array_equal(doubled(first.whole).whole, np.full(6, 4.0))
    assert programs_compiled.count("jit(doubled)") == 1


@pytest.mark.parametrize("within", [jax.jacfwd, jax.jacrev, jax.jit, jax.vmap])
def test_known_numbers_are_computed_by_the_same_program_wherever_they_stand(
    folder, programs_compiled, within
):
    """A motion under `jax.jacfwd` is found by the search that found it outside."""
    doubled(X)
    del programs_compiled[:]
    found = []

    def of_known_numbers(y):
        found.append(np.asarray(doubled(X).whole))
        return y

    within(of_known_numbers)(X)
    assert "jit(doubled)" not in programs_compiled
    np.testing.assert_array_equal(found[0], 2.0 * X)


def test_nothing_is_kept_where_somebody_forbids_it(monkeypatch, fresh, tmp_path):
    make, times = fresh
    monkeypatch.setattr(programs, "_kept_in", None)
    monkeypatch.setenv("KNEEJAX_TRACE_ANEW", "1")
    programs.keep_programs(tmp_path)
    make()(X, Power(2)), make()(X, Power(2))
    assert len(times) == 2 and not list(tmp_path.iterdir())


def test_all_that_is_compiled_is_in_rooms_whose_sources_are_counted():
    """A function elsewhere would be traced anew in every process."""
    package = Path(kj.__file__).parent
    rooms = {
        path.relative_to(package).parts[0]
        for path in package.rglob("*.py")
        if re.search(r"^@?\w*( = )?compiled\(", path.read_text("utf-8"), re.MULTILINE)
    }
    assert {"statics", "experiments"} <= rooms <= set(programs._ROOMS)
