"""`kneejax reproduce PAPER`: published claims, computed."""

from __future__ import annotations

import importlib

from kneejax.cli.options import Reproduce


def run(arguments: Reproduce) -> int:
    """Reproduce one of papers 1 to 5.

    A claim that is not reproduced is an answer like any other: status 0. Status 1 says that
    something computed on the way is doubtful.
    """
    given = {name: getattr(arguments, name) for name in ("knee", "patella")}
    options = {name: value for name, value in given.items() if value}
    # A wrong option is answered before anything that computes is imported.
    from kneejax.papers.claims import summary, write
    from kneejax.studies import stages_on_terminal

    paper = importlib.import_module(f"kneejax.papers.paper{arguments.paper}")
    found = paper.reproduce(stages_on_terminal, **options)
    files = write(found, arguments.out, arguments.svg)
    print(summary(found.claims))
    for doubt in found.doubts:
        print(f"! {doubt}")
    print(f"written: {arguments.out}/{', '.join(files)}, settings.json, figures/")
    return int(bool(found.doubts))
