"""Running a command: float64, the compilation cache, and errors in one line."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
import time
import warnings
from collections.abc import Iterator

from kneejax.cli._commands import build_parser
from kneejax.cli._parser import BAD_INPUT
from kneejax.cli._printed import Printed, open_standard_streams
from kneejax.cli._stopped import STOPPED, stopped_at_once
from kneejax.files import InputProblem

DONE, DOUBTFUL = 0, 1
#: Commands that compute nothing themselves. All others begin with JAX: seconds of imports.
_WITHOUT_JAX = ("knees", "completion", "rerun")
#: Variables that say on what JAX computes.
_PLATFORMS = ("JAX_PLATFORMS", "JAX_PLATFORM_NAME")
#: Commands that write a file elsewhere, or let another command write.
_WITHOUT_SETTINGS = ("export", "rerun")


def main(arguments: list[str] | None, begun: float) -> int:
    """Run the `kneejax` command.

    Args:
        arguments: words after `kneejax`; those of the process where None.
        begun: when, by `time.perf_counter`: imports count from there.

    Returns:
        Exit status: 0 done; 1 done, but something is doubtful (the results say what); 2 bad
        input, nothing written.
    """
    readable = open_standard_streams()
    with contextlib.redirect_stdout(Printed(sys.stdout)) as printed:
        try:
            with stopped_at_once():
                chosen = _parsed(arguments)
            writes = hasattr(chosen, "out")
            if not readable and not writes:
                raise InputProblem("stdout", "stream", "closed", "a place to print to")
            _prepare(chosen)
            chosen.imports_s = time.perf_counter() - begun
            with _doubts_in_words():
                status = _run(chosen)
            printed.flush()
        except SystemExit:
            printed.flush()
            raise
        except ValueError as problem:
            if not _says_what_to_mend(problem):
                raise
            several = getattr(problem, "problems", (problem,))
            return max(_refused(str(one)) for one in several)
        except BrokenPipeError:
            printed.flush()
            return DOUBTFUL if writes else DONE
        except OSError as problem:
            return _refused(_of_file(problem))
        except KeyboardInterrupt:
            print("kneejax: stopped; no half-written files are left", file=sys.stderr)
            return STOPPED
    if printed.problem is None or isinstance(printed.problem, BrokenPipeError):
        return status
    _refused(f"stdout: {_of_file(printed.problem)}")
    return status if writes else BAD_INPUT


def _parsed(arguments: list[str] | None) -> argparse.Namespace:
    """What was asked for; ends the process where that is not a command."""
    parser = build_parser()
    chosen, unknown = parser.parse_known_args(arguments)
    if unknown:
        chosen.parser.refuse(unknown)
    if chosen.command is None:
        parser.print_help()
        raise SystemExit(DONE)
    return chosen


def _refused(sentence: str) -> int:
    print(f"kneejax: {' '.join(sentence.split())}", file=sys.stderr)
    return BAD_INPUT


def _of_file(problem: OSError) -> str:
    reason = problem.strerror or str(problem)
    return f"{problem.filename}: {reason}" if problem.filename else reason


@contextlib.contextmanager
def _doubts_in_words() -> Iterator[None]:
    """Print the package's own warnings about values as a line each, every sentence once."""
    said: set[str] = set()
    usual = warnings.showwarning

    def show(message, category, *where, **more) -> None:
        # By its name: importing the class would import JAX for commands that do without.
        if category.__name__ != "DoubtfulValue":
            usual(message, category, *where, **more)
        elif str(message) not in said:
            said.add(str(message))
            print(f"doubtful: {message}", file=sys.stderr)

    warnings.showwarning = show
    try:
        yield
    finally:
        warnings.showwarning = usual


def _run(chosen: argparse.Namespace) -> int:
    """Run a command; its results take the place of an earlier run's when it has ended."""
    if not hasattr(chosen, "out") or chosen.command in _WITHOUT_SETTINGS:
        return chosen.run(chosen)
    from kneejax.cli._results_folder import ResultsFolder
    from kneejax.cli._settings import asked_for, with_versions
    from kneejax.numerics import counted_programs

    settings = asked_for(chosen)  # before the command fills in what it was not told
    chosen.results = ResultsFolder(chosen.out)
    with chosen.results.gathered(chosen), counted_programs() as programs:
        status = chosen.run(chosen)
        if status != BAD_INPUT:
            chosen.results.add_to_result("programs", programs.summary())
            chosen.results.commit(with_versions(settings))
    if getattr(chosen, "verbose", False):
        print(programs.sentence(), file=sys.stderr)
    return status


def _prepare(chosen: argparse.Namespace) -> None:
    """What comes before a command: a place for its results, and JAX."""
    if getattr(chosen, "out", None) is not None:
        from kneejax.cli._out import try_out

        try_out(chosen.out, folder=chosen.command != "export")
    with stopped_at_once():
        if chosen.command not in _WITHOUT_JAX:
            _prepare_jax()
        chosen.run.load()


def _says_what_to_mend(problem: ValueError) -> bool:
    """Whether it is about what a person gave; anything else is a fault of the package."""
    if isinstance(problem, InputProblem):
        return True
    from kneejax.mechanics import Implausible
    from kneejax.numerics import MissingPackage
    from kneejax.parameters import UnknownParameter, UnsuitableData

    return isinstance(problem, UnknownParameter | UnsuitableData | Implausible | MissingPackage)


def _prepare_jax() -> None:
    """Float64, and the compilation cache; JAX is imported.

    XLA tells whoever develops it how long it compiled ("Very slow compile"): a command says itself
    what it waits for, so that only what ends a process is left to XLA, unless somebody asks.
    """
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    asked = [name for name in os.environ if name.startswith("JAX_")]
    try:
        from kneejax.numerics import collect_seldom, configure, share_memory_between_threads
    except ValueError as problem:
        if not asked:
            raise
        names, expected = ", ".join(asked), "values that JAX takes, or these variables not set"
        raise InputProblem("environment", names, str(problem), expected) from None
    share_memory_between_threads()
    collect_seldom()
    configure()
    for name in _PLATFORMS:
        if os.environ.get(name):
            _check_platform(name)


def _check_platform(name: str) -> None:
    """Refuse a platform that this machine does not have, before JAX does in the middle of work."""
    import jax

    try:
        jax.devices()
    except RuntimeError:
        expected = "a platform that this machine has, as cpu, or this variable not set"
        raise InputProblem("environment", name, os.environ[name], expected) from None
