"""Running a command, also again: float64, the compilation cache, and errors in a line each."""

import contextlib
import functools
import os
import sys
import time
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path

from kneejax.cli import options
from kneejax.cli._command import Command, Written
from kneejax.cli._line import CommandLine
from kneejax.cli._settings import VERSIONS, asked_for, check_inputs
from kneejax.cli._streams import STOPPED, Printed, open_standard_streams, stopped_at_once
from kneejax.cli.options.knees import ExportOsim, Init, Knees
from kneejax.cli.options.studies import Completion, Rerun
from kneejax.files import InputProblem

DONE, DOUBTFUL, BAD_INPUT = 0, 1, 2
#: Commands that compute nothing themselves. All others begin with JAX: seconds of imports.
_WITHOUT_JAX = (Knees, Init, Completion, Rerun)
#: Variables that say on what JAX computes.
_PLATFORMS = ("JAX_PLATFORMS", "JAX_PLATFORM_NAME")


@functools.cache
def line() -> CommandLine:
    """The command line of kneejax."""
    return CommandLine(options.COMMANDS, options.ABOVE, options.EXAMPLE)


def main(arguments: Sequence[str] | None, begun: float) -> int:
    """Run the `kneejax` command, with imports counted from `begun` (`time.perf_counter`)."""
    readable, writes = open_standard_streams(), False
    with contextlib.redirect_stdout(Printed(sys.stdout)) as printed:
        try:
            with stopped_at_once():
                asked = line().read(sys.argv[1:] if arguments is None else arguments)
            writes = hasattr(asked, "out")
            if not readable and not writes:
                raise InputProblem("stdout", "stream", "closed", "a place to print to")
            status = DONE if asked is None else carry_out(asked, begun)
            printed.flush()
        except ValueError as problem:
            if not _says_what_to_mend(problem):
                raise
            return _refused(*map(str, getattr(problem, "problems", (problem,))))
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


def carry_out(asked: Command, begun: float | None = None) -> int:
    """Run a command that was read, in a process that began then (`time.perf_counter`)."""
    begun = time.perf_counter() if begun is None else begun
    with stopped_at_once():
        if (out := getattr(asked, "out", None)) is not None:
            from kneejax.cli._results_folder import try_out

            try_out(out, folder=not isinstance(asked, ExportOsim | Init))
        check_inputs(asked, Path())
        computes = not isinstance(asked, _WITHOUT_JAX)
        # Importing JAX takes seconds, for which a terminal would show nothing.
        terminal = sys.stderr if computes and sys.stderr.isatty() else None
        if terminal:
            print("starting", end="", file=terminal, flush=True)
        try:
            if computes:
                prepare_jax()
            asked.work()
        finally:
            if terminal:
                print("\r        \r", end="", file=terminal, flush=True)
    with _doubts_in_words():
        if not isinstance(asked, Written):
            return asked.run()
        from kneejax.cli._results_folder import ResultsFolder
        from kneejax.inference import versions
        from kneejax.numerics import counted_programs
        from kneejax.parameters import MEANING

        settings = asked_for(asked)
        asked._results = results = ResultsFolder(asked.out, time.perf_counter() - begun)
        with results.gathered(vars(asked), asked.resumes()), counted_programs() as programs:
            status = asked.run()
            if status != BAD_INPUT:
                settings |= {**MEANING, VERSIONS: versions()}
                results.commit(settings, programs=programs.summary())
        if asked.verbose:
            print(programs.sentence(), file=sys.stderr)
        return status


def rerun(asked: Rerun) -> int:
    """Print which versions differ, and run the command as its settings say."""
    from kneejax.cli import _settings

    folder, file = asked.folder, asked.folder / _settings.FILE
    settings = _settings.read_settings(folder)
    out = (folder if asked.out is None else asked.out).resolve()
    again = _settings.command_again(settings, line().commands, file, out)
    prepare_jax()
    _settings.check_meaning(settings, file)
    from kneejax.inference import versions

    then, now = settings[_settings.VERSIONS], versions()
    changes = [f"{name} {then.get(name, 'unknown')} then, {now.get(name, 'unknown')} now"
               for name in {**now, **then} if then.get(name) != now.get(name)]  # fmt: skip
    if changes:
        print(f"versions differ from those of {folder}: {'; '.join(changes)}", flush=True)
    # Paths lead from where the command ran; without one, it may run anywhere.
    there = _settings.worked_in(settings)
    with contextlib.chdir(there) if there.is_dir() else contextlib.nullcontext():
        return carry_out(again)


def completion(asked: Completion) -> int:
    """Print the script by which a shell completes commands, options, bundled names and files."""
    script = line().app(completing=True).generate_completion(shell=asked.shell)
    # In the place of the name of a bundled knee or study, a file may be meant.
    print(script.replace("complete -F _kneejax", "complete -o default -F _kneejax"))
    return 0


def _refused(*sentences: str) -> int:
    for sentence in sentences:
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
        mark = {"DoubtfulValue": "doubtful", "Assumption": "assumed"}.get(category.__name__)
        if mark is None:
            usual(message, category, *where, **more)
        elif str(message) not in said:
            said.add(str(message))
            print(f"{mark}: {message}", file=sys.stderr)

    warnings.showwarning = show
    try:
        yield
    finally:
        warnings.showwarning = usual


def _says_what_to_mend(problem: ValueError) -> bool:
    """Whether it is about what a person gave; anything else is a fault of the package."""
    if isinstance(problem, InputProblem):
        return True
    from kneejax.mechanics import Implausible
    from kneejax.numerics import MissingPackage
    from kneejax.parameters import UnknownParameter, UnsuitableData

    return isinstance(problem, UnknownParameter | UnsuitableData | Implausible | MissingPackage)


def prepare_jax() -> None:
    """Float64, and the compilation cache; JAX is imported."""
    # XLA tells whoever develops it how long it compiled ("Very slow compile"): a command says
    # itself what it waits for, so that only what ends a process is left to XLA.
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
        if not os.environ.get(name):
            continue
        import jax

        try:  # JAX itself would refuse it in the middle of work
            jax.devices()
        except RuntimeError:
            expected = "a platform that this machine has, as cpu, or this variable not set"
            raise InputProblem("environment", name, os.environ[name], expected) from None
