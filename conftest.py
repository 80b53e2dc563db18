"""Tests and doctests compute in float64, and leave no compiled programs behind."""

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
