"""A published claim: read from its paper's file, judged by what was computed, and answered.

`paperN.yaml` has what is claimed, the criterion, the printed value and the reason of a verdict;
`paperN.py` computes the `Finding` of each claim.
"""

import contextlib
import dataclasses
import functools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

from kneejax.files.reading import load_yaml
from kneejax.report.look import Answer, Table, as_setting, json_safe, wrapped
from kneejax.report.look.page import Drawing, Section

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Verdicts. The last is for what this software has no part for, or no data.
REPRODUCED, NOT_REPRODUCED, CANNOT_BE_JUDGED = "reproduced", "not reproduced", "cannot be judged"
VERDICTS = (REPRODUCED, NOT_REPRODUCED, CANNOT_BE_JUDGED)

#: Called with a stage, equilibria done and requested; and a block that shows it while it lasts.
Progress = Callable[[str, int, int], None]
Stages = Callable[[str], contextlib.AbstractContextManager[Progress]]


@contextlib.contextmanager
def silent(stage: str) -> Iterator[Progress]:
    """Progress that nobody sees; of the `stage` nothing is shown."""
    yield lambda stage, done, total: None


class Finding(NamedTuple):
    """What was computed for a claim."""

    #: Whether the criterion holds; None where it cannot be judged. Where it has parts, what each is
    #: about -> whether it holds, and the reason begins with those that do not.
    holds: bool | Mapping[str, bool] | None
    ours: str  # the computed numbers, in words
    reason: str | None = None  # of the verdict; None for the one in the paper's file, if any
    numbers: Mapping[str, Any] = MappingProxyType({})  # for the names in braces of that one


@dataclasses.dataclass(frozen=True)
class Claim:
    """A judged claim: one row of reproduction.csv, in the order of its columns."""

    number: str  # e.g. `1.4`
    statement: str  # what is claimed, in our words
    criterion: str  # what has to hold of computed numbers; the reason says if it was changed later
    printed: str  # what the paper prints for it
    ours: str  # what was computed; `-` if nothing
    verdict: str  # one of `VERDICTS`
    reason: str = ""  # why the verdict is what it is, where that needs saying

    def __post_init__(self):
        if self.verdict not in VERDICTS:
            raise ValueError(f"Claim.verdict is {self.verdict!r}; expected one of {VERDICTS}")


@functools.cache
def claimed(paper: int) -> dict[str, Any]:
    """What stands in a paper's file: title, paragraphs, captions, claims by number."""
    return load_yaml(Path(__file__).with_name(f"paper{paper}.yaml"), "paper")


def judged(paper: int, findings: Mapping[str, Finding], **words: Any) -> tuple[Claim, ...]:
    """Judge the claims of a paper."""
    entries, words = claimed(paper)["claims"], claimed(paper).get("words", {}) | words
    if not findings.keys() <= entries.keys():
        raise ValueError(f"paper{paper}.yaml lacks {sorted(findings.keys() - entries.keys())}")
    verdicts = {True: REPRODUCED, False: NOT_REPRODUCED, None: CANNOT_BE_JUDGED}
    claims = []
    for number, entry in entries.items():
        statement, criterion, printed = (
            entry[key].format(**words) for key in ("statement", "criterion", "printed")
        )
        nothing = Finding(None, "-", entry.get("reason", ""))
        holds, ours, reason, numbers = findings.get(number, nothing)
        if isinstance(holds, Mapping):
            holds, reason = all(holds.values()), which(holds) + (reason or "")
        holds = None if holds is None else bool(holds)
        if reason is None:
            reason = entry.get("reason") or ("" if holds else entry.get("otherwise", ""))
            reason = reason.format(**words, **numbers)
        claims.append(Claim(number, statement, criterion, printed, ours, verdicts[holds], reason))
    return tuple(claims)


def in_words(
    numbers: Mapping[Any, Any] | Iterable[tuple[Any, Any]], form: str, apart: str = ", "
) -> str:
    """Numbers by name, each in a form; of a tuple each number has a place in it."""
    every = ((name, x if isinstance(x, tuple) else (x,)) for name, x in dict(numbers).items())
    return apart.join(form.format(name, *x) for name, x in every)


def which(parts: Mapping[str, bool]) -> str:
    """What holds and what does not; empty if all holds."""
    missing, met = ([name for name, x in parts.items() if bool(x) is y] for y in (False, True))
    both = [f"{word}: {', '.join(x)}" for word, x in (("not", missing), ("holds", met)) if x]
    return "; ".join(both) if missing else ""


def answered(
    paper: int, claims: Sequence[Claim], figures: "Mapping[str, Figure | tuple[Figure, str]]",
    tables: Mapping[str, Table], settings: Mapping[str, Any], doubts: Sequence[str] = (),
    words: Mapping[str, Any] | None = None, document: Mapping[str, Any] | None = None,
) -> Answer:
    """A paper's claims with everything that was computed for them."""
    said, values = claimed(paper), {"verdicts": ", ".join(VERDICTS), **(words or {})}
    columns = [field.name for field in dataclasses.fields(Claim)]
    every = [claim.verdict for claim in claims]
    verdicts = Table.of({"number": [claim.number for claim in claims], "verdict": every,
                         "claim": [claim.statement for claim in claims]})
    whole = Table(columns, [dataclasses.astuple(claim) for claim in claims])
    pairs = {name: one if isinstance(one, tuple) else (one, said["figures"][name])
             for name, one in figures.items()}  # fmt: skip
    drawings = {name: Drawing(lambda one=figure: one, more=more)
                for name, (figure, more) in pairs.items()}  # fmt: skip
    kept = {name: as_setting(value) for name, value in json_safe(settings).items()}
    counts = ", ".join(f"{every.count(word)} {word}" for word in dict.fromkeys(every))
    return Answer(
        said["title"], f"Which of the paper's {len(claims)} claims are reproduced?",
        tables={"reproduction": whole, **tables}, main=[verdicts], drawings=drawings,
        facts=[(word.capitalize(), str(every.count(word))) for word in VERDICTS],
        doubts=doubts, document=document,
        sections=[
            Section("About", [text.format(**values) for text in said["about"]], opened=True),
            *(Section(f"{claim.number} {claim.statement}", _reasons(claim)) for claim in claims),
            *[Section("Further figures", drawings=[*drawings][1:])] * (len(drawings) > 1),
            Section("Settings of the computation",
                    tables=[Table.of({"setting": [*kept], "value": [*kept.values()]})]),
        ],
        text=[*(line for claim in claims for line in _printed(claim)), f"{counts}."],
    )  # fmt: skip


def _reasons(claim: Claim) -> list[str]:
    """What stands below a claim: the verdict with everything that led to it."""
    lines = {"Criterion": claim.criterion, "Printed": claim.printed, "Ours": claim.ours}
    if claim.verdict == CANNOT_BE_JUDGED and claim.ours == "-":
        lines = {"Printed": claim.printed}
    lines = {"Verdict": claim.verdict, **lines, "Reason": claim.reason}
    return [f"{name}: {text}" for name, text in lines.items() if text]


def _printed(claim: Claim) -> list[str]:
    """On a terminal: number, verdict, statement, and what was computed, or else the reason."""
    first = f"{claim.number:<5} {claim.verdict:<16} "
    more = claim.reason if claim.ours == "-" else claim.ours
    return [*wrapped(claim.statement, first), *wrapped(more, " " * len(first))]
