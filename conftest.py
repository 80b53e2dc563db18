"""Tests and doctests compute in float64, and keep within a process's memory maps."""

import os
from pathlib import Path

# Tests wait for the compiler. With shared fusion, as the command sets it, and without optimising
# machine code a motion compiles in two thirds of the time. XLA reads this once, hence here.
os.environ.setdefault(
    "XLA_FLAGS",
    "--xla_backend_extra_options=xla_cpu_use_multi_output_fusion"
    " --xla_backend_optimization_level=0",
)
# Processes side by side leave the threads of each other's linear algebra only to wait. NumPy reads
# this once too: what pytest-xdist starts inherits it.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import jax
import pytest

jax.config.update("jax_enable_x64", True)

#: Some thousand small programs, and about 1 GB. Linux grants a process 65,530 maps.
MOST_MAPS = 5_000


@pytest.fixture(autouse=True, scope="module")
def _compiled_programs():
    """Forget compiled programs after a file, once there are many.

    Every program takes memory maps, of which all tests in one process need more than there are,
    and the process dies without a word. Small programs are the same in most files: they are kept.
    """
    yield
    if _memory_maps() > MOST_MAPS:
        jax.clear_caches()


def _memory_maps() -> float:
    try:
        return Path("/proc/self/maps").read_bytes().count(b"\n")
    except OSError:  # not Linux: nobody counts them
        return float("inf")
