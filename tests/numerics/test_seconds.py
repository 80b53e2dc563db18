"""Parts of the time add up to the whole; compiling counts once."""

import time

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from kneejax.numerics import adding_up, counted_programs, lap, stopwatch


def test_parts_add_up_and_compiling_is_told_apart():
    inner = jax.jit(lambda x: jnp.sin(x) * 2.0)
    program = jax.jit(lambda x: inner(x) + jnp.cos(inner(2.0 * x)).sum())
    begun = time.perf_counter()
    with stopwatch() as whole:
        time.sleep(0.02)
        lap("reading")
        with stopwatch() as part:
            program(jnp.ones(1237)).block_until_ready()
            lap("search")
        time.sleep(0.01)
    passed = time.perf_counter() - begun
    found = adding_up(whole.parts)
    assert found["total"] == pytest.approx(passed, abs=0.005)
    assert found["total"] == pytest.approx(sum(x for k, x in found.items() if k != "total"))
    assert found["reading"] >= 0.02 and found["other"] >= 0.01
    assert found["compile"] > 0 and all(x > -1e-9 for x in found.values())
    assert part.parts["compile"] == pytest.approx(found["compile"], abs=1e-3)
    with stopwatch() as warm:
        program(jnp.ones(1237)).block_until_ready()
    assert warm.parts["compile"] < found["compile"]


def test_what_lies_within_another_span_counts_once():
    from kneejax.numerics._seconds import Seconds

    one = Seconds()
    time.sleep(0.03)
    one.compiled(0.01)
    one.compiled(0.02)
    time.sleep(0.01)
    one.compiled(0.005)
    one.compiled(10.0)  # no longer than since it began
    one.lap("search")
    assert sum(one.parts.values()) == pytest.approx(one.parts["compile"], abs=2e-3)


def test_programs_are_counted_with_their_names_and_read_ones_apart():
    # A number that no cache has seen.
    shift = np.random.default_rng().uniform()

    def doubled_and_shifted(x):
        return 2.0 * x + shift

    x = np.ones(1238)
    with counted_programs() as first:
        jax.jit(doubled_and_shifted)(x).block_until_ready()
    with counted_programs() as warm:
        pass
    # Another process, as it were: JAX forgets, its cache on disk does not.
    jax.clear_caches()
    with counted_programs() as second:
        jax.jit(doubled_and_shifted)(x).block_until_ready()
    assert [name for name, _ in first.compiled] == ["doubled_and_shifted"] and first.read == 0
    assert warm.summary() == {"compiled": 0, "seconds": 0.0, "large": 0, "read": 0}
    assert second.read == 1 and not second.compiled
    assert first.sentence().startswith("1 program compiled in ")
