"""`kneejax rerun FOLDER` repeats the command that wrote a folder; `completion` prints a script."""

from __future__ import annotations

import contextlib

from kneejax.cli import _main
from kneejax.cli._settings import (
    FILE,
    changed_versions,
    check_meaning,
    command_again,
    read_settings,
    worked_in,
)
from kneejax.cli.options import Completion, Rerun


def rerun(asked: Rerun) -> int:
    """Print which versions differ, and run the command as its settings say."""
    folder = asked.folder
    settings = read_settings(folder)
    out = (folder if asked.out is None else asked.out).resolve()
    again = command_again(settings, _main.line().commands, folder / FILE, out)
    _main.prepare_jax()
    check_meaning(settings, folder / FILE)
    if changes := changed_versions(settings):
        print(f"versions differ from those of {folder}: {'; '.join(changes)}", flush=True)
    # Paths lead from where the command ran; without one, it may run anywhere.
    there = worked_in(settings)
    with contextlib.chdir(there) if there.is_dir() else contextlib.nullcontext():
        return _main.carry_out(again)


def completion(asked: Completion) -> int:
    """Print the script by which a shell completes commands, options, bundled names and files."""
    script = _main.line().app(completing=True).generate_completion(shell=asked.shell)
    # In the place of the name of a bundled knee or study, a file may be meant.
    print(script.replace("complete -F _kneejax", "complete -o default -F _kneejax"))
    return 0
