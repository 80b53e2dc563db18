"""Lines for a terminal: columns and paragraphs in plain ASCII."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

LINE_WIDTH = 98


def aligned(rows: Sequence[Sequence[str]], words: Sequence[int] = (0,)) -> list[str]:
    """Columns two blanks apart; columns in `words` to the left, the others to the right."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return [
        "  ".join(
            text.ljust(width) if i in words else text.rjust(width)
            for i, (text, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


def wrapped(text: str, first: str = "") -> list[str]:
    """A paragraph in lines that a terminal holds.

    Args:
        text: the paragraph, in one line.
        first: what the first line begins with, e.g. `note: `; the others are indented by as much.

    Returns:
        Lines of at most `LINE_WIDTH` characters; none for an empty text.

    Example:
        >>> wrapped("Every pose is balanced.", "note: ")
        ['note: Every pose is balanced.']
    """
    return textwrap.wrap(
        text, LINE_WIDTH, initial_indent=first, subsequent_indent=" " * len(first),
        break_on_hyphens=False,
    )  # fmt: skip
