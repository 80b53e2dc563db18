"""`kneejax reproduce PAPER`: published claims, computed."""

from __future__ import annotations

import importlib

from kneejax.cli._deliver import deliver
from kneejax.cli.options import Reproduce
from kneejax.studies import stages_on_terminal


def run(arguments: Reproduce) -> int:
    """Reproduce one of papers 1 to 5.

    A claim that is not reproduced is an answer like any other: status 0. Status 1 says that
    something computed on the way is doubtful.
    """
    given = {name: getattr(arguments, name) for name in ("knee", "patella")}
    options = {name: value for name, value in given.items() if value}
    paper = importlib.import_module(f"kneejax.papers.paper{arguments.paper}")
    return deliver(paper.reproduce(stages_on_terminal, **options), arguments)
