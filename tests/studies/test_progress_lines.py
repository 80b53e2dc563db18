"""The line that a person sees who waits, on a terminal and nowhere else."""

import functools
import io
import time

import jax.numpy as jnp
import pytest
from tqdm import tqdm

from kneejax.numerics import compiled, compiling
from kneejax.studies import _progress


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def quick(monkeypatch):
    monkeypatch.setattr(_progress, "_PATIENCE_S", 0.02)
    monkeypatch.setattr(_progress, "_EVERY_S", 0.02)


@pytest.fixture
def terminal(monkeypatch, quick):
    shown = Terminal()
    monkeypatch.setattr(_progress, "tqdm", functools.partial(tqdm, file=shown))
    return shown


def test_a_long_wait_says_what_is_done_and_leaves_no_line(terminal):
    with _progress.stages_on_terminal("calibration"):
        time.sleep(0.3)
    said = terminal.getvalue()
    assert "calibration: computing, 00:00" in said
    assert said.rsplit("\r", 2)[1].strip() == ""


def test_a_stage_takes_the_line(terminal):
    with _progress.stages_on_terminal("maps") as show:
        show("ACL and PCL", 10, 100)
        time.sleep(0.2)
        show("ACL and PCL", 100, 100)
    said = terminal.getvalue()
    assert "ACL and PCL" in said and "100/100" in said and "maps" not in said


def test_what_is_compiled_is_told_while_it_is(terminal):
    seen = []

    @compiled()
    def twice(x):
        seen.append(compiling())
        with _progress.stages_on_terminal("a motion"):
            time.sleep(0.2)
        return 2.0 * x

    assert compiling() is None
    assert float(twice(jnp.ones(3))[0]) == 2.0
    assert seen[0] == "twice" and compiling() is None
    assert "a motion: compiling (kept for later runs)" in terminal.getvalue()


def test_nothing_is_said_in_a_pipe(monkeypatch, quick):
    pipe = io.StringIO()
    monkeypatch.setattr(_progress, "tqdm", functools.partial(tqdm, file=pipe))
    with _progress.stages_on_terminal("calibration") as show:
        show("a stage", 1, 2)
        time.sleep(0.1)
    assert pipe.getvalue() == ""


def test_a_call_from_python_shows_its_line_unless_it_is_told_not_to(terminal):
    with _progress.progress_of(None, "calibration") as show:
        assert show is not None
        show("95 % limits of 8 numbers", 0, 0)
        time.sleep(0.2)
    assert "95 % limits of 8 numbers: computing" in terminal.getvalue()
    terminal.truncate(0)
    told = []
    with _progress.progress_of(False, "calibration") as silent:
        assert silent is None
    with _progress.progress_of(lambda *what: told.append(what), "calibration") as own:
        own("a step", 1, 2)
    assert told == [("a step", 1, 2)] and terminal.getvalue() == ""


def test_a_notebook_gets_the_line_that_a_pipe_does_not(monkeypatch, quick):
    cell = io.StringIO()
    monkeypatch.setattr(_progress, "tqdm", functools.partial(tqdm, file=cell))
    monkeypatch.setattr(_progress, "_in_notebook", lambda: True)
    with _progress.stages_on_terminal("calibration"):
        time.sleep(0.2)
    assert "calibration: computing" in cell.getvalue()
