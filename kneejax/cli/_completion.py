"""`kneejax completion bash|zsh|fish`."""

from __future__ import annotations

import argparse
from pathlib import Path

import shtab

from kneejax.cli._commands import build_parser
from kneejax.cli._settings import NAME_OR_FILE


def run(arguments: argparse.Namespace) -> int:
    """Print the script."""
    parser = build_parser()
    _offer_files(parser)
    print(shtab.complete(parser, arguments.shell))
    return 0


def _offer_files(parser: argparse.ArgumentParser) -> None:
    """Where a file is expected, the shell shall offer those that there are."""
    for action in parser._actions:
        if action.type is Path or action.dest in NAME_OR_FILE:
            found = shtab.DIRECTORY if action.dest == "folder" else shtab.FILE
            action.complete = found  # pyright: ignore[reportAttributeAccessIssue]
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():
                _offer_files(below)
