"""`kneejax reproduce PAPER`: published claims, computed."""

from __future__ import annotations

import argparse
import importlib

from kneejax.files import InputProblem


def run(arguments: argparse.Namespace) -> int:
    """Reproduce one of papers 1 to 5.

    A claim that is not reproduced is an answer like any other: status 0. Status 1 says that
    something computed on the way is doubtful.
    """
    for option in ("knee", "patella"):
        said = getattr(arguments, option)
        if said and arguments.paper != "1":
            expected = "none of it: paper 1 alone takes one"
            raise InputProblem(f"--{option}", "option", said, expected)
    return importlib.import_module(f"kneejax.cli.papers._paper{arguments.paper}").run(arguments)
