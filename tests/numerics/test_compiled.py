"""Programs that are compiled quickly compute what optimised ones do, alone and within others."""

import threading

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from kneejax.numerics import _configure, beside, compiled


def length(x, power):
    return jnp.sqrt(jnp.sum(jnp.sin(x) ** power))


@pytest.fixture
def options(monkeypatch):
    """What JAX is asked for, by the function that it compiles."""
    asked = {}
    own = jax.jit

    def jit(function, **given):
        asked.setdefault(function.__name__, []).append(given.get("compiler_options"))
        return own(function, **given)

    monkeypatch.setattr(jax, "jit", jit)
    return asked


@pytest.mark.parametrize(
    ("effort", "level", "older"),
    [("least", {0}, True), ("usual", {None}, True), ("most", {None}, False)],
)
def test_it_answers_alone_in_another_program_and_to_derivatives(effort, level, older, options):
    quick = compiled(static_argnums=(1,), effort=effort)(length)
    x = np.array([0.3, 1.1])
    expected = float(np.sqrt(np.sum(np.sin(x) ** 2)))
    assert float(quick(x, 2)) == pytest.approx(expected, rel=1e-15)
    within = jax.jit(lambda y: 2.0 * quick(y, 2))(x)
    assert float(within) == pytest.approx(2.0 * expected, rel=1e-15)
    slope = jax.grad(quick)(jnp.asarray(x), 2)
    assert slope == pytest.approx(np.sin(x) * np.cos(x) / expected, rel=1e-14)
    asked = [own for own in options["length"] if own is not None]
    assert {own.get("xla_backend_optimization_level") for own in asked} == level
    # What is differentiated keeps XLA's newer emitters, whatever the effort.
    emitters = [own.get("xla_cpu_use_fusion_emitters") for own in asked]
    assert sorted(emitters, key=str) == ([False, None] if older else [None, None])


def test_an_xla_without_its_older_emitters_compiles_with_the_newer(monkeypatch):
    monkeypatch.setattr(_configure, "_OLDER", {"xla_cpu_no_such_emitters": False})
    _configure._older.cache_clear()
    assert float(compiled()(lambda x: 2.0 * x)(3.0)) == 6.0
    _configure._older.cache_clear()


def test_blocks_within_each_other_end_where_nothing_is_compiled():
    """A second fit in one process finds all programs there."""
    done = []
    with beside(done.append, "outer"):
        with beside(done.append, "inner"):
            pass
        assert done == ["inner"]
    assert done == ["inner", "outer"]


def test_work_beside_begins_when_a_program_is_traced():
    begun = threading.Event()

    @compiled()
    def double(x):
        return 2.0 * x

    with beside(begun.set):
        assert not begun.is_set()
        double(np.ones(7))
        assert begun.wait(10.0)


def test_a_block_that_fails_waits_for_nothing_and_one_whose_work_fails_says_so():
    done = []
    with pytest.raises(KeyError), beside(done.append, 1):
        raise KeyError
    with pytest.raises(ZeroDivisionError), beside(divmod, 1, 0):
        pass
    assert not done
