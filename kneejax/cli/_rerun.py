"""`kneejax rerun FOLDER`: the command that wrote a folder, repeated."""

from __future__ import annotations

import contextlib

from kneejax.cli._main import carry_out, line, prepare_jax
from kneejax.cli._settings import (
    FILE,
    changed_versions,
    check_meaning,
    command_again,
    read_settings,
    worked_in,
)
from kneejax.cli.options import Rerun


def run(asked: Rerun) -> int:
    """Print which versions differ, and run the command as its settings say."""
    folder = asked.folder
    settings = read_settings(folder)
    out = (folder if asked.out is None else asked.out).resolve()
    again = command_again(settings, line().commands, folder / FILE, out)
    prepare_jax()
    check_meaning(settings, folder / FILE)
    if changes := changed_versions(settings):
        print(f"versions differ from those of {folder}: {'; '.join(changes)}", flush=True)
    # Paths lead from where the command ran; without one, it may run anywhere.
    there = worked_in(settings)
    with contextlib.chdir(there) if there.is_dir() else contextlib.nullcontext():
        return carry_out(again)
