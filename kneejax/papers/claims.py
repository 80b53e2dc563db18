"""A published claim: read from its paper's file, judged by what was computed, printed, written.

`paperN.yaml` has what is claimed, the criterion, the printed value and, where it is always the
same, the reason of a verdict; `paperN.py` computes the `Finding` of each claim.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from kneejax.files import write_rows, write_text
from kneejax.files.reading import load_yaml
from kneejax.inference import versions

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Verdicts. The last is for what this software has no part for, or no data.
REPRODUCED, NOT_REPRODUCED, CANNOT_BE_JUDGED = "reproduced", "not reproduced", "cannot be judged"
VERDICTS = (REPRODUCED, NOT_REPRODUCED, CANNOT_BE_JUDGED)
#: Verdict -> colour of its badge on the page.
_BADGES = {REPRODUCED: "good", NOT_REPRODUCED: "doubtful", CANNOT_BE_JUDGED: "none"}

#: Called with a stage, equilibria done and requested; and a block that shows it while it lasts.
Progress = Callable[[str, int, int], None]
Stages = Callable[[str], contextlib.AbstractContextManager[Progress]]


@contextlib.contextmanager
def silent(stage: str) -> Iterator[Progress]:
    """Progress that nobody sees; of the `stage` nothing is shown."""
    yield lambda stage, done, total: None


class Finding(NamedTuple):
    """What was computed for a claim.

    Attributes:
        holds: whether the criterion holds; None where it cannot be judged.
        ours: the computed numbers, in words.
        reason: of the verdict; None for the one in the paper's file, if any.
    """

    holds: bool | None
    ours: str
    reason: str | None = None


@dataclasses.dataclass(frozen=True)
class Claim:
    """A judged claim: one row of reproduction.csv, in the order of its columns.

    Attributes:
        number: e.g. `1.4`.
        statement: what is claimed, in our words.
        criterion: what has to hold of computed numbers; the reason says so if it was changed after
            they were seen.
        printed: what the paper prints for it.
        ours: what was computed; `-` if nothing.
        verdict: one of `VERDICTS`.
        reason: why the verdict is what it is, where that needs saying.
    """

    number: str
    statement: str
    criterion: str
    printed: str
    ours: str
    verdict: str
    reason: str = ""

    def __post_init__(self):
        if self.verdict not in VERDICTS:
            raise ValueError(f"Claim.verdict is {self.verdict!r}; expected one of {VERDICTS}")


@dataclasses.dataclass(frozen=True)
class Reproduction:
    """A paper's claims with everything that was computed for them.

    Attributes:
        paper: its number.
        claims: judged.
        figures: name of the file -> figure, or figure and caption where the paper's file has none.
        tables: name of the file -> columns and rows.
        settings: everything needed to run it again.
        doubts: sentences that a reader must know before the verdicts.
        words: what stands for the names in braces of the page's first paragraphs.
        documents: name of the file -> what it holds as JSON.
    """

    paper: int
    claims: tuple[Claim, ...]
    figures: Mapping[str, Figure | tuple[Figure, str]]
    tables: Mapping[str, tuple[Sequence[str], Iterable[Sequence[Any]]]]
    settings: Mapping[str, Any]
    doubts: Sequence[str] = ()
    words: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    documents: Mapping[str, Any] = dataclasses.field(default_factory=dict)


@functools.cache
def claimed(paper: int) -> dict[str, Any]:
    """What stands in a paper's file: title, paragraphs, captions, claims by number."""
    return load_yaml(Path(__file__).with_name(f"paper{paper}.yaml"), "paper")


def judged(paper: int, findings: Mapping[str, Finding], **words: Any) -> tuple[Claim, ...]:
    """Judge the claims of a paper.

    Args:
        paper: its number.
        findings: number of a claim -> what was computed; a claim without one cannot be judged.
        words: what stands for the names in braces in the paper's file.

    Returns:
        The claims in the order of the file.
    """
    entries = claimed(paper)["claims"]
    if not findings.keys() <= entries.keys():
        raise ValueError(f"paper{paper}.yaml lacks {sorted(findings.keys() - entries.keys())}")
    verdicts = {True: REPRODUCED, False: NOT_REPRODUCED, None: CANNOT_BE_JUDGED}
    claims = []
    for number, entry in entries.items():
        text = {key: value.format(**words) for key, value in entry.items()}
        holds, ours, reason = findings.get(number, Finding(None, "-"))
        holds = None if holds is None else bool(holds)
        if reason is None:
            reason = text.get("reason") or ("" if holds else text.get("otherwise", ""))
        claims.append(
            Claim(
                number, text["statement"], text["criterion"], text["printed"], ours,
                verdicts[holds], reason,
            )
        )  # fmt: skip
    return tuple(claims)


def summary(claims: Sequence[Claim]) -> str:
    """Say on a terminal what was reproduced: number, verdict, statement, and what was computed."""
    from kneejax.report.look import wrapped

    lines = []
    for claim in claims:
        first = f"{claim.number:<5} {claim.verdict:<16} "
        lines += wrapped(claim.statement, first)
        # Of what cannot be judged, the reason; else the numbers.
        lines += wrapped(claim.reason if claim.ours == "-" else claim.ours, " " * len(first))
    verdicts = [claim.verdict for claim in claims]
    counts = [f"{verdicts.count(word)} {word}" for word in dict.fromkeys(verdicts)]
    return "\n".join([*lines, "", ", ".join(counts)])


def write(found: Reproduction, out: Path, svg: bool = False) -> list[str]:
    """Write claims, tables, figures and the page that shows them.

    Args:
        found: what to write.
        out: folder of the results; made if needed, files of the same names are replaced.
        svg: whether figures are saved as SVG as well; the page holds them in any case.

    Returns:
        Names of the files: reproduction.csv first, then tables and documents, then the page.
    """
    columns = [field.name for field in dataclasses.fields(Claim)]
    rows = map(dataclasses.astuple, found.claims)
    tables = {"reproduction.csv": (columns, rows), **found.tables}
    for name, (header, body) in tables.items():
        write_rows(out / name, list(header), body)
    for name, document in found.documents.items():
        write_text(out / name, json.dumps(document, indent=1) + "\n")
    _write_page(found, out, svg)
    return [*tables, *found.documents, "report.html"]


def _write_page(found: Reproduction, out: Path, svg: bool) -> None:
    """report.html, which needs no other file, and `figures/NAME.png`."""
    from kneejax.report.look import as_setting, json_safe, rendered, save_and_inline, write_whole

    document, pictures = claimed(found.paper), []
    for name, drawn in found.figures.items():
        figure, caption = drawn if isinstance(drawn, tuple) else (drawn, document["figures"][name])
        _, inline = save_and_inline(figure, out / "figures", name, svg=svg)
        pictures.append((name, inline, caption))
    words = {"verdicts": ", ".join(VERDICTS), **found.words}
    verdicts = [claim.verdict for claim in found.claims]
    page = rendered(
        "claims.html.j2",
        title=document["title"],
        about=[text.format(**words) for text in document["about"]],
        counts=[(word.capitalize(), verdicts.count(word)) for word in _BADGES],
        doubts=found.doubts,
        claims=[(claim, _BADGES[claim.verdict], _rows(claim)) for claim in found.claims],
        pictures=pictures,
        settings=[(k, as_setting(value)) for k, value in json_safe(found.settings).items()],
        versions=[*versions().items()],
    )
    write_whole(out / "report.html", page.encode())


def _rows(claim: Claim) -> list[tuple[str, str]]:
    rows = [("Criterion", claim.criterion), ("Printed", claim.printed), ("Ours", claim.ours)]
    if claim.verdict == CANNOT_BE_JUDGED and claim.ours == "-":
        rows = [("Printed", claim.printed)]
    return rows + [("Reason", claim.reason)] * bool(claim.reason)
