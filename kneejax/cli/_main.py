"""Running a command: float64, the compilation cache, and errors in one line."""

from __future__ import annotations

import argparse
import os
import sys
import time

from kneejax.cli._commands import build_parser
from kneejax.cli._parser import BAD_INPUT

DONE, DOUBTFUL = 0, 1
#: Commands that compute nothing themselves. All others begin with JAX: seconds of imports.
_WITHOUT_JAX = ("knees", "completion", "rerun")
#: Commands that write a file elsewhere, or let another command write.
_WITHOUT_SETTINGS = ("export", "rerun")


def main(arguments: list[str] | None = None) -> int:
    """Run the `kneejax` command.

    Args:
        arguments: words after `kneejax`; those of the process by default.

    Returns:
        Exit status: 0 done; 1 done, but something is doubtful (the results say what); 2 bad
        input, nothing written.
    """
    begun = time.perf_counter()
    parser = build_parser()
    chosen, unknown = parser.parse_known_args(arguments)
    if unknown:
        chosen.parser.error(f"unrecognized arguments: {' '.join(unknown)}")
    if chosen.command is None:
        parser.print_help()
        return DONE
    # Of a command that is cut short: files may be missing, a mere answer was read as far as wanted.
    status = DOUBTFUL if hasattr(chosen, "out") else DONE
    try:
        _prepare(chosen)
        chosen.imports_s = time.perf_counter() - begun
        status = _run(chosen)
        sys.stdout.flush()
        return status
    except ValueError as problem:
        if not _says_what_to_mend(problem):
            raise
        print(f"kneejax: {' '.join(str(problem).split())}", file=sys.stderr)
        return BAD_INPUT
    except BrokenPipeError:
        # Whoever reads has seen enough (`kneejax describe ... | head`). Python flushes once more
        # when it ends, and would complain.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return status
    except OSError as problem:
        said = f"{problem.filename}: {problem.strerror}" if problem.filename else str(problem)
        print(f"kneejax: {' '.join(said.split())}", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        print("kneejax: stopped; no half-written files are left", file=sys.stderr)
        return 130


def _run(chosen: argparse.Namespace) -> int:
    """Run a command; its results take the place of an earlier run's when it has ended."""
    if not hasattr(chosen, "out") or chosen.command in _WITHOUT_SETTINGS:
        return chosen.run(chosen)
    from kneejax.cli._results_folder import ResultsFolder
    from kneejax.cli._settings import asked_for, with_versions

    settings = asked_for(chosen)  # before the command fills in what it was not told
    chosen.results = ResultsFolder(chosen.out)
    with chosen.results.gathered(chosen):
        status = chosen.run(chosen)
        if status != BAD_INPUT:
            chosen.results.commit(with_versions(settings))
    return status


def _prepare(chosen: argparse.Namespace) -> None:
    """What comes before a command: a place for its results, and JAX."""
    if getattr(chosen, "out", None) is not None:
        from kneejax.cli._out import try_out

        try_out(chosen.out, folder=chosen.command != "export")
    if chosen.command not in _WITHOUT_JAX:
        _prepare_jax()


def _says_what_to_mend(problem: ValueError) -> bool:
    """Whether it is about what a person gave; anything else is a fault of the package."""
    from kneejax.files import InputProblem

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
    from kneejax.numerics import collect_seldom, configure, share_memory_between_threads

    share_memory_between_threads()
    collect_seldom()
    configure()
