"""Tests and doctests compute in float64, share what they compile, and keep within memory maps."""

import csv
import gc
import os
import shutil
import time
from pathlib import Path

# Tests wait for the compiler. With shared fusion, as the command sets it, and without optimising
# machine code a motion compiles in a third of the time. XLA reads its flags once, hence here.
# Its older emitters, with which a command's programs compile, are for no others: a derivative's
# took 17 s instead of 2, a joint's tables 100 s, and a process died.
# The level is that of files which ask for `optimised_code`: JAX keeps all others from it.
os.environ.setdefault(
    "XLA_FLAGS",
    "--xla_backend_extra_options=xla_cpu_use_multi_output_fusion,xla_cpu_disable_loop_unrolling"
    " --xla_backend_optimization_level=1 --xla_llvm_disable_expensive_passes=true",
)
# Processes side by side leave the threads of each other's linear algebra only to wait. NumPy reads
# this once too: what pytest-xdist starts inherits it.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# What one file compiles, the next need not, nor the next run. JAX reads this when it is imported.
os.environ.setdefault(
    "JAX_COMPILATION_CACHE_DIR", str(Path(__file__).parent / ".pytest_cache" / "compiled")
)
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")

import jax
import pytest

from kneejax.numerics import counted_programs, keep_programs

jax.config.update("jax_enable_x64", True)
# Who gives flags of their own gets what they ask for.
QUICKLY = "--xla_llvm_disable_expensive_passes" in os.environ["XLA_FLAGS"]
jax.config.update("jax_disable_most_optimizations", QUICKLY)
# Tests replace parts of commands, never of what is traced.
keep_programs(Path(os.environ["JAX_COMPILATION_CACHE_DIR"]) / "traced")

#: Some thousand small programs, and some 3 GB. Linux grants a process 65,530 maps.
MOST_MAPS = 8_000
COMPILED = Path(__file__).parent / ".pytest_cache" / "compiled"
#: Programs of about ten runs, each after a change of what everything is made of: 0.7 GB.
MOST_PROGRAMS = 60_000

#: Files that take more than a minute of a core: who begins with them does not wait
#: for one of them in the end. Neighbours compile different programs: they run side by side.
LONGEST = (
    "statics/test_second_derivatives.py",
    "experiments/test_extensor.py",
    "explore/test_page.py",
    "explore/test_beginning.py",
    "mechanics/contact/test_points_force.py",
    "statics/test_three_bones.py",
    "validation/test_lenhart2015.py",
    "parameters/test_leaves.py",
    "experiments/test_gradients.py",
    "experiments/laboratory/test_by_machine.py",
    "test_scripts.py",
    "mechanics/contact/test_contact_forms.py",
    "cohorts/test_kills.py",
    "dynamics/test_derivatives.py",
    "cohorts/test_workers.py",
    "experiments/test_activity.py",
    "mechanics/contact/test_ring.py",
    "inference/fit/test_frames.py",
    "geometry/paths/test_wrapping.py",
)


#: Programs that a test file may make, where `tests/programs.csv` does not grant it more.
USUAL_PROGRAMS = 150
with open(Path(__file__).parent / "tests" / "programs.csv", encoding="utf-8", newline="") as _file:
    GRANTED = {row["file"]: int(row["programs"]) for row in csv.DictReader(_file)}

#: Files with slow tests, where these are asked for: what they compile is optimised.
COMPUTING = set()


def pytest_configure(config):
    """Begin anew once there are many programs that nobody asks for any more."""
    if not hasattr(config, "workerinput") and COMPILED.is_dir():
        if sum(1 for _ in os.scandir(COMPILED)) > MOST_PROGRAMS:
            shutil.rmtree(COMPILED, ignore_errors=True)


def pytest_collection_finish():
    """Modules and tests stay: let the collector not walk through all of them again and again."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(100_000, 20, 20)


def pytest_collection_modifyitems(items):
    """The longest files first, all others as they come; and which files compute for long."""
    if os.environ.get("KNEEJAX_TESTS_OPTIMISED"):
        COMPUTING.update(item.path for item in items if item.get_closest_marker("slow"))
    place = {Path(__file__).parent / "tests" / name: i for i, name in enumerate(LONGEST)}
    items.sort(key=lambda item: place.get(item.path, len(place)))


@pytest.fixture(scope="module")
def optimised_code():
    """Optimise machine code a little, for a file that computes longer than it compiles.

    Compiling takes half as long again, and a search a fifth of the time: 20 files of calibration,
    maps, cohorts and ramps took 222 s instead of 349; files that compile lose by it.

    Without, a kernel that sums over fibres and writes a stack computes the sums anew wherever it
    reads them: 64 lanes of a body in ten cables take 100 ms a look instead of 0.5. A knee with two
    contacts has no such kernel, and compiles in two thirds of the time.
    """
    before = jax.config.read("jax_disable_most_optimizations")
    jax.config.update("jax_disable_most_optimizations", False)
    yield
    jax.config.update("jax_disable_most_optimizations", before)


@pytest.fixture(autouse=True, scope="module")
def _code(request):
    """Files with slow tests ask for `optimised_code`; others mostly compile."""
    if request.path in COMPUTING:
        request.getfixturevalue("optimised_code")


@pytest.fixture(autouse=True, scope="module")
def _compiled_programs():
    """Forget compiled programs after a file, once there are many.

    Every program takes memory maps, of which all tests in one process need more than there are,
    and the process dies without a word. Small programs are the same in most files: they are kept.
    """
    yield
    if _memory_maps() > MOST_MAPS:
        jax.clear_caches()


@pytest.fixture(autouse=True, scope="module")
def _few_programs(request):
    """A file makes no more programs than `tests/programs.csv` grants it: each costs a wait.

    With KNEEJAX_TESTS_PROGRAMS a file is named to which the numbers of this run are appended, each
    file beginning with nothing compiled: so the numbers granted are found.
    """
    record = os.environ.get("KNEEJAX_TESTS_PROGRAMS")
    if record:
        jax.clear_caches()
    begun = time.process_time()
    with counted_programs() as programs:
        yield
    made = len(programs.compiled) + programs.read
    name = request.path.relative_to(Path(__file__).parent).as_posix()
    if record:
        spent, seconds = time.process_time() - begun, programs.summary()["seconds"]
        with open(record, "a", encoding="utf-8") as file:
            file.write(f"{name},{made},{seconds:.1f},{spent:.1f}\n")
        return
    most = GRANTED.get(name, USUAL_PROGRAMS)
    assert made <= most, f"{name} makes {made} programs, {most} are granted in tests/programs.csv"


def _memory_maps() -> float:
    try:
        return Path("/proc/self/maps").read_bytes().count(b"\n")
    except OSError:  # not Linux: nobody counts them
        return float("inf")
