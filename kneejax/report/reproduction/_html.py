"""The report of a reproduction: claims, criteria, numbers and verdicts on one page."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kneejax.report.look import (
    json_safe,
    page,
    picture,
    save_and_inline,
    section,
    table,
    warnings_box,
    write_whole,
)
from kneejax.reproduction import CANNOT_BE_JUDGED, NOT_REPRODUCED, REPRODUCED, Claim

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Verdict -> colour of its badge.
_BADGES = {REPRODUCED: "good", NOT_REPRODUCED: "doubtful", CANNOT_BE_JUDGED: "none"}
_STYLE = """
.badge.none { background: #5c6670; }
.badge { white-space: nowrap; font-size: .8125rem; }
article { border-bottom: 1px solid #e6e8ea; padding: .8rem 0; break-inside: avoid; }
article h3 { margin: 0 0 .3rem; display: flex; gap: .7rem; align-items: baseline; }
article h3 span.n { color: #555; min-width: 2.2rem; text-align: left; }
article h3 span.s { flex: 1; }
article dl { display: grid; grid-template-columns: 5.5rem 1fr; gap: .15rem .8rem;
  margin: 0 0 0 2.9rem; }
article dt { font-size: .875rem; }
article dd { font-size: .875rem; font-weight: 400; overflow-wrap: anywhere; }
"""


def write_reproduction(
    title: str,
    about: Sequence[str],
    claims: Sequence[Claim],
    figures: Mapping[str, tuple[Figure, str]],
    doubts: Sequence[str],
    settings: Mapping[str, Any],
    versions: Mapping[str, str],
    folder: str | os.PathLike[str],
    *,
    svg: bool = False,
) -> list[Path]:
    """Write the report of a reproduction with its figures.

    Args:
        title: of the page.
        about: paragraphs under it: what was computed, and what the words mean.
        claims: in the order of the page.
        figures: name of the files -> figure and caption.
        doubts: sentences that a reader must know before the verdicts.
        settings: everything needed to run it again.
        versions: package -> version.
        folder: where; made if needed. Files of the same names are replaced.
        svg: whether figures are saved as SVG as well; the page holds them in any case.

    Returns:
        `report.html`, which needs no other file, then `figures/NAME.png`.
    """
    folder, paths, pictures = Path(folder), [], ""
    for name, (figure, caption) in figures.items():
        written, drawn = save_and_inline(figure, folder / "figures", name, svg=svg)
        paths += written
        pictures += picture(drawn, caption)
    body = [
        _head(title, about, claims, doubts),
        section("Claims", "".join(_article(claim) for claim in claims)),
        section("Figures", pictures) if pictures else "",
        section("How to run it again", _again(settings, versions)),
    ]
    whole = page(title, body, _STYLE)
    return [write_whole(folder / "report.html", whole.encode()), *paths]


def _head(title: str, about: Sequence[str], claims: Sequence[Claim], doubts: Sequence[str]) -> str:
    verdicts = [claim.verdict for claim in claims]
    boxes = "".join(
        f"<div><dt>{escape(word.capitalize())}</dt><dd>{verdicts.count(word)}</dd></div>"
        for word in _BADGES
    )
    words = "".join(f"<p>{escape(paragraph)}</p>\n" for paragraph in about)
    listed = warnings_box("Doubts", doubts)
    return f"<header>\n<h1>{escape(title)}</h1>\n{words}<dl>{boxes}</dl>\n</header>\n{listed}"


def _article(claim: Claim) -> str:
    rows = [("Criterion", claim.criterion), ("Printed", claim.printed), ("Ours", claim.ours)]
    if claim.verdict == CANNOT_BE_JUDGED and claim.ours == "-":
        rows = [("Printed", claim.printed)]
    rows += [("Reason", claim.reason)] * bool(claim.reason)
    facts = "".join(f"<dt>{escape(k)}</dt><dd>{escape(v)}</dd>" for k, v in rows)
    return (
        f'<article>\n<h3><span class="n">{escape(claim.number)}</span>'
        f'<span class="s">{escape(claim.statement)}</span>'
        f'<strong class="badge {_BADGES[claim.verdict]}">{escape(claim.verdict)}</strong></h3>\n'
        f"<dl>{facts}</dl>\n</article>\n"
    )


def _again(settings: Mapping[str, Any], versions: Mapping[str, str]) -> str:
    rows = [
        [str(key), value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)]
        for key, value in json_safe(settings).items()
    ]
    text = "<h3>Settings</h3>\n" + table(["Setting", "Value"], rows, (0, 1))
    rows = [[name, version] for name, version in versions.items()]
    return text + "<h3>Versions</h3>\n" + table(["Package", "Version"], rows, (0, 1))
