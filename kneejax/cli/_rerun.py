"""`kneejax rerun FOLDER`: the command that wrote a folder, once more."""

from __future__ import annotations

import argparse
import contextlib

from kneejax.cli import main
from kneejax.cli._commands import build_parser
from kneejax.cli._main import _prepare_jax
from kneejax.cli._settings import (
    FILE,
    changed_versions,
    check_meaning,
    read_settings,
    words_again,
    worked_in,
)


def run(arguments: argparse.Namespace) -> int:
    """Say which versions differ, and run the command as its settings say."""
    folder = arguments.folder
    settings = read_settings(folder)
    words = words_again(settings, build_parser(), folder / FILE)
    out = (folder if arguments.out is None else arguments.out).resolve()
    _prepare_jax()
    check_meaning(words, settings, folder / FILE)
    if changes := changed_versions(settings):
        print(f"versions differ from those of {folder}: {'; '.join(changes)}", flush=True)
    # Paths lead from where the command ran; without one, it may run anywhere.
    there = worked_in(settings)
    with contextlib.chdir(there) if there.is_dir() else contextlib.nullcontext():
        return main([*words, f"--out={out}"])
