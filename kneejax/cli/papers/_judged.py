"""What every reproduction ends with: its claims as a table and on the terminal, and its doubts."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from kneejax.files import write_rows
from kneejax.reproduction import Claim

TABLE = "reproduction.csv"


def write_claims(claims: Sequence[Claim], out: Path) -> None:
    """Write the claims as a table.

    Args:
        claims: judged.
        out: folder of the results.
    """
    from kneejax.report import CLAIM_COLUMNS

    rows = [[getattr(claim, column) for column in CLAIM_COLUMNS] for claim in claims]
    write_rows(out / TABLE, list(CLAIM_COLUMNS), rows)


def say_claims(
    claims: tuple[Claim, ...], out: Path, files: Sequence[str] = (), doubts: Sequence[str] = ()
) -> int:
    """Print the claims, what is to be doubted, and what was written.

    Args:
        claims: judged.
        out: folder of the results.
        files: written besides the claims' table, page, settings and figures.
        doubts: a sentence each.

    Returns:
        The exit status: 1 where there is something to doubt.
    """
    from kneejax.report import claims_summary

    print(claims_summary(claims))
    for doubt in doubts:
        print(f"! {doubt}")
    written = ", ".join([TABLE, *files, "report.html, settings.json, figures/"])
    print(f"written: {out}/{written}")
    return int(bool(doubts))
