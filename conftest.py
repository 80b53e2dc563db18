"""Tests and doctests compute in float64, and leave no compiled programs behind."""

import os

# Tests wait for the compiler. Without fusion, as the package compiles by default, and without
# optimising machine code they take two thirds of the time. XLA reads this once, hence here.
os.environ.setdefault(
    "XLA_FLAGS", "--xla_disable_hlo_passes=fusion --xla_backend_optimization_level=0"
)

import jax
import pytest

jax.config.update("jax_enable_x64", True)


@pytest.fixture(autouse=True, scope="module")
def _compiled_programs_of_one_file():
    """Forget what a file compiled.

    Every compiled program takes memory maps, of which Linux grants a process 65,530; all tests
    in one process need more, and the process dies without a word.
    """
    yield
    jax.clear_caches()
