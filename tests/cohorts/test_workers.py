"""Workers of Dask: the very same numbers, whoever computes them and whoever is killed."""

import os
import subprocess
import sys

import pytest

from kneejax.cli import main
from kneejax.files import InputProblem
from kneejax.numerics import MissingPackage

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def made_up(tmp_path_factory):
    folder = tmp_path_factory.mktemp("made_up")
    assert main(["cohort", "synthesise", "--knees", "9", "--out", str(folder)]) == 0
    return folder


@pytest.fixture(scope="module")
def undisturbed(made_up, numbers):
    out = made_up.parent / "undisturbed"
    assert command(made_up, out).wait() in (0, 1)
    return numbers(out)


def command(cohort, out, *words):
    """A process of its own: what it computes does not depend on the settings of tests."""
    environment = {k: x for k, x in os.environ.items() if k != "XLA_FLAGS"}
    return subprocess.Popen(
        [sys.executable, "-m", "kneejax", "calibrate", str(cohort), "--out", str(out), *words],
        env=environment, stdout=subprocess.DEVNULL, start_new_session=True,
    )  # fmt: skip


@pytest.mark.parametrize("jobs", [1, 2, 4])
def test_any_number_of_workers_gives_the_same_bits(made_up, undisturbed, numbers, jobs):
    out = made_up.parent / f"jobs{jobs}"
    assert command(made_up, out, "--jobs", str(jobs)).wait() in (0, 1)
    assert numbers(out) == undisturbed


def test_a_worker_computes_as_the_command_does():
    # One that looked for circles of objects as often as Python does took a fifth longer.
    from kneejax.cohorts import _tasks

    def how_it_runs():
        import gc
        import os

        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1
        names = "OPENBLAS_NUM_THREADS", "MALLOC_TRIM_THRESHOLD_"
        return gc.get_threshold()[0], cores, [os.environ.get(name) for name in names]

    with _tasks.workers(1) as client:
        _tasks._prepare(client)
        (found,) = client.run(how_it_runs).values()
    assert found == (100_000, 1, ["1", None])


def test_a_scheduler_that_does_not_answer_is_one_line(made_up, capsys, monkeypatch):
    monkeypatch.setattr("kneejax.cohorts._tasks._PATIENCE_S", 1.0)
    words = ["--scheduler", "tcp://127.0.0.1:9", "--out", str(made_up.parent / "none")]
    assert main(["calibrate", str(made_up), *words]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()[-1:]
    assert line.startswith("kneejax: --scheduler: address: tcp://127.0.0.1:9: expected")


def test_workers_of_another_version_are_refused(monkeypatch):
    from kneejax.cohorts import _tasks

    class Client:
        def register_plugin(self, _):
            pass

        def run(self, _):
            return {"tcp://a": "0.0.1"}

    with pytest.raises(InputProblem, match=r"version: 0.0.1: expected workers with kneejax"):
        _tasks._prepare(Client())


def test_a_worker_of_another_version_that_comes_late_computes_nothing():
    from kneejax.cohorts import _tasks

    # A task is not even unpacked, which this one could not be.
    with pytest.raises(RuntimeError, match=r"a worker has kneejax .*: expected 0.0.1"):
        _tasks._of_version("0.0.1", b"")


def test_without_dask_workers_are_no_traceback(monkeypatch, made_up):
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    from kneejax.cohorts import workers

    with pytest.raises(MissingPackage, match=r"kneejax\[cohorts\]"), workers(2):
        pass
