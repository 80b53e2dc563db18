"""An answer becomes files, a page and what is printed: the same for every command."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

from kneejax.cli._settings import options_of
from kneejax.files import write_rows, write_text

if TYPE_CHECKING:
    from kneejax.report.look import Answer


def deliver(
    answer: Answer,
    arguments: argparse.Namespace,
    written: Sequence[str] = (),
    seconds: dict[str, float] | None = None,
) -> int:
    """Write tables, figures, result.json and report.html; then print what was found.

    Args:
        answer: what a command found.
        arguments: of the command: where results go, and what the page says was asked for.
        written: names of files that the command has written itself.
        seconds: part of the work -> how long it took; `figures` is added.

    Returns:
        The exit status.

    Raises:
        InputProblem: a file cannot be written.
    """
    from kneejax.inference import versions
    from kneejax.report.look import save_and_inline, wrapped

    out = arguments.out
    for name, table in answer.tables.items():
        write_rows(out / f"{name}.csv", table.names, table.rows)
    pictures, begun = {}, time.perf_counter()
    for name, drawing in answer.drawings.items():
        _, pictures[name] = save_and_inline(
            drawing.draw(), out / "figures", name, svg=arguments.svg
        )
    if seconds is not None:
        seconds["figures"] = time.perf_counter() - begun
    if answer.document is not None:
        write_text(out / "result.json", answer.json())
    settings = {"command": arguments.command, **options_of(arguments)}
    write_text(out / "report.html", answer.page(pictures, settings, versions(), seconds))
    if answer.text:
        print(answer.text)
    files = ["report.html", *(f"{name}.csv" for name in answer.tables), *written]
    files += ["result.json"] * (answer.document is not None) + ["settings.json"]
    files += ["figures/"] * bool(pictures)
    print("\n".join(wrapped(f"{out}/{', '.join(files)}", "written: ")))
    return answer.exit_status
