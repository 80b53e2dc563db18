"""`kneejax reproduce PAPER`: published claims, computed."""

from __future__ import annotations

import importlib

from kneejax.cli.options import Reproduce


def run(arguments: Reproduce) -> int:
    """Reproduce one of papers 1 to 5.

    A claim that is not reproduced is an answer like any other: status 0. Status 1 says that
    something computed on the way is doubtful.
    """
    return importlib.import_module(f"kneejax.cli.papers._paper{arguments.paper}").run(arguments)
