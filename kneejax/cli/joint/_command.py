"""`kneejax joint fit|compare|export`: each runs in a file of its own."""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Sequence

from kneejax.files import InputProblem
from kneejax.geometry import COLUMNS


def run(arguments: argparse.Namespace) -> int:
    """Run the command that was asked for."""
    return importlib.import_module(f"kneejax.cli.joint._{arguments.kind}").run(arguments)


def renamed_columns(asked: Sequence[str] | None) -> dict[str, str]:
    """Column of the package -> column of the table.

    Args:
        asked: words `NAME=COLUMN`.

    Returns:
        The names, empty if nothing was asked.

    Raises:
        InputProblem: a word is something else, or a name is unknown or there twice.
    """
    names: dict[str, str] = {}
    for word in asked or ():
        name, _, column = word.partition("=")
        if name not in COLUMNS:
            raise InputProblem("--column", "name", name, f"one of {', '.join(COLUMNS)}", COLUMNS)
        if not column or name in names:
            raise InputProblem("--column", name, column, f"one {name}=COLUMN of the table")
        names[name] = column
    return names
