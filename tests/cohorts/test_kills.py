"""Whoever is killed, at whatever moment: what is there in the end is what nobody disturbed.

One moment each; `KNEEJAX_KILLS=10` asks for ten.
"""

import contextlib
import csv
import os
import random
import re
import signal
import subprocess
import sys
import time

import pytest

from kneejax.cli import main

psutil = pytest.importorskip("psutil")
pytest.importorskip("distributed")
pytestmark = pytest.mark.slow
MOMENTS = range(int(os.environ.get("KNEEJAX_KILLS", "1")))
#: A command whose programs are compiled takes about as long.
LONGEST_S = 12.0
#: What all commands are asked for: two rounds of tasks.
ASKED = ("--bootstrap", "6")


@pytest.fixture(scope="module")
def made_up(tmp_path_factory):
    """Three knees in two tasks: the last states another noise."""
    folder = tmp_path_factory.mktemp("made_up")
    assert main(["cohort", "synthesise", "--knees", "3", "--out", str(folder)]) == 0
    with open(folder / "knees.csv") as file:
        head, *rows = csv.reader(file)
    with open(folder / "knees.csv", "w", newline="") as file:
        table = csv.writer(file)
        table.writerow([*head, "noise_mm"])
        table.writerows([*row, "0.2" if k < 2 else "0.21"] for k, row in enumerate(rows))
    return folder


@pytest.fixture(scope="module")
def undisturbed(made_up, numbers):
    """Numbers of a run in one process, and its exit status."""
    out = made_up.parent / "undisturbed"
    status = command(made_up, out).wait()
    return numbers(out), status


def command(cohort, out, *words, **more):
    """The command, in a process of its own."""
    asked = ("calibrate", str(cohort), "--out", str(out), *ASKED, *words)
    return started("-m", "kneejax", *asked, **more)


def started(*words, **more):
    # What is computed does not depend on the settings of tests.
    environment = {k: x for k, x in os.environ.items() if k != "XLA_FLAGS"}
    more = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "text": True} | more
    return subprocess.Popen([sys.executable, *words], env=environment, **more)


def finished(made_up, out, undisturbed, numbers):
    """Let the command go on in one process; it finds what it would have found."""
    assert command(made_up, out).wait() == undisturbed[1]
    assert numbers(out) == undisturbed[0]


def moment(kind, number):
    """Seconds until somebody is killed."""
    return random.Random(f"{kind} {number}").uniform(0.0, LONGEST_S)


def workers_below(process):
    """Processes of Dask's workers of a command."""
    with contextlib.suppress(psutil.NoSuchProcess):
        every = psutil.Process(process.pid).children(recursive=True)
        return [one for one in every if "spawn_main" in " ".join(one.cmdline())]
    return []


@pytest.mark.parametrize("number", MOMENTS)
def test_the_command_is_killed(made_up, undisturbed, numbers, number):
    out = made_up.parent / f"command{number}"
    process = command(made_up, out, "--jobs", "2")
    time.sleep(moment("command", number))
    orphans = workers_below(process)
    process.kill()
    process.wait()
    # Workers end with whom they work for.
    _, alive = psutil.wait_procs(orphans, timeout=30.0)
    assert not alive
    finished(made_up, out, undisturbed, numbers)


@pytest.mark.parametrize("number", MOMENTS)
def test_a_worker_is_killed(made_up, undisturbed, numbers, number):
    out = made_up.parent / f"worker{number}"
    process = command(made_up, out, "--jobs", "2")
    while not (found := workers_below(process)) and process.poll() is None:
        time.sleep(0.1)
    time.sleep(moment("worker", number))
    found = workers_below(process)
    if found:  # otherwise all was done
        random.Random(number).choice(found).kill()
    # The command itself sees to it that nothing is lost.
    assert process.wait() == undisturbed[1]
    assert numbers(out) == undisturbed[0]


@pytest.mark.parametrize("number", MOMENTS)
def test_the_scheduler_is_killed(made_up, undisturbed, numbers, number, tmp_path):
    out = made_up.parent / f"scheduler{number}"
    with cluster(tmp_path) as (scheduler, address):
        process = command(made_up, out, "--scheduler", address, stderr=subprocess.PIPE)
        time.sleep(moment("scheduler", number))
        scheduler.kill()
        _, said = process.communicate(timeout=120.0)
    if process.returncode != undisturbed[1]:  # it had not been done
        (line,) = said.strip().splitlines()
        assert process.returncode == 2 and line.startswith("kneejax: --scheduler: address: tcp")
    finished(made_up, out, undisturbed, numbers)


@contextlib.contextmanager
def cluster(folder):
    """A scheduler and two workers of it, processes of their own."""
    local = ("--host", "127.0.0.1", "--no-dashboard")
    scheduler = started("-m", "distributed.cli.dask_scheduler", *local, "--port", "0", cwd=folder,
                        stderr=subprocess.PIPE)  # fmt: skip
    every = [scheduler]
    try:
        line = ""
        while not (found := re.search(r"tcp://[\d.]+:\d+", line)):
            line = scheduler.stderr.readline()
        address = found[0]
        words = ("-m", "distributed.cli.dask_worker", address, "--nthreads", "1", "--no-nanny",
                 "--no-dashboard", "--local-directory", str(folder))  # fmt: skip
        every += [started(*words) for _ in range(2)]
        yield scheduler, address
    finally:
        for one in every:
            one.send_signal(signal.SIGKILL)
            one.communicate()


def test_workers_of_an_outside_scheduler_find_the_same_bits(
    made_up, undisturbed, numbers, tmp_path
):
    """A scheduler knows nothing of 64 bits: what it opened on its way became numbers of 32."""
    out = made_up.parent / "outside"
    with cluster(tmp_path) as (_, address):
        assert command(made_up, out, "--scheduler", address).wait() == undisturbed[1]
    assert numbers(out) == undisturbed[0]
