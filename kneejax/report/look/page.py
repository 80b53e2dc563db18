"""What a command answers, as a person meets it: on the screen, in files and on a page."""

import contextlib
import dataclasses
import enum
import functools
import gc
import json
import math
import os
import re
import time
import tomllib
from collections.abc import Callable, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

from kneejax.report.look.style import Figure, picture_svg, save_figure, write_whole
from kneejax.report.look.tables import Table, json_safe, number, wrapped

_TEMPLATES = resources.files("kneejax.report.look") / "templates"


class Verdict(enum.Enum):
    """How far an answer can be trusted; its value is a CSS class of the page's badge."""

    GOOD = "good"
    DOUBTFUL = "doubtful"
    FAILED = "failed"


class Drawing:
    """A figure, drawn once its answer is written; templates/prose.toml has its caption."""

    def __init__(self, figure: Callable[..., Figure], *given: Any, more: str = "", **named: Any):
        self.draw: Callable[[], Figure] = functools.partial(figure, *given, **named)
        self.caption = f"{_prose().get(figure.__name__, '')} {more}".strip()


@dataclasses.dataclass(frozen=True)
class Section:
    """What stands below the first screen, folded unless `opened`; a terminal shows it if `printed`.

    Tables are those of the answer, by name, or of the page alone; drawings are the answer's.
    """

    title: str
    text: Sequence[str] = ()
    tables: Sequence[str | Table] = ()
    drawings: Sequence[str] = ()
    opened: bool = False
    printed: bool = False

    def terminal(self, known: Mapping[str, Table] | None = None) -> str:
        """Title, paragraphs and tables, of which some may be named as those that are `known`."""
        lines = wrapped(self.title) if self.text else []
        for paragraph in self.text:
            lines += wrapped(paragraph)
        for one in self.tables:
            lines += [""] * bool(lines)
            lines.append((known or {})[one].text() if isinstance(one, str) else one.text())
        return "\n".join(lines)


@dataclasses.dataclass(frozen=True)
class Answer:
    """What was found, for people: the first screen, what stands below it, and the files.

    Attributes:
        title: what was computed, of which knee.
        asked: one sentence: the question with its knee, loads, angles and data.
        verdict: of the whole; by default doubtful where there are doubts.
        badge: its words; those of the verdict where it is empty.
        sentence: the answer in one or two sentences, beside the badge.
        tables: name -> table; `NAME.csv` holds all of its columns. Those in `main` stand on the
            first screen.
        main: names of the tables that answer the question.
        drawings: name -> figure, saved as `figures/NAME.png`.
        picture: name of the figure that shows the answer, the first by default; empty for none.
        doubts: sentences on what to doubt; none if there is nothing.
        facts: a few numbers under their names, at the head of the page.
        sections: in order; those without text, tables and drawings are left out.
        text: sentences that a terminal shows in the place of tables and sections.
        document: what `result.json` holds; None for no such file.
        exit_status: of the command, by default 0 of a good answer, otherwise 1.

    Example:
        >>> from kneejax.report.look.tables import Column
        >>> laxity = Table([Column("flexion_deg"), Column("range_mm")], [[0.0, 6.1], [30.0, 9.8]])
        >>> found = Answer("Drawer of a knee", "How far 100 N move it.", tables={"laxity": laxity},
        ...                main=["laxity"])
        >>> "<td class=\\"n\\">9.800</td>" in found.page({})
        True
        >>> print(found.terminal())
        Drawer of a knee
        How far 100 N move it.
        <BLANKLINE>
        flexion  range
            deg     mm
              0  6.100
          30.00  9.800
    """

    title: str
    asked: str
    verdict: Verdict | None = None
    badge: str = ""
    sentence: str = ""
    tables: Mapping[str, Table] = dataclasses.field(default_factory=dict)
    main: Sequence[str | Table] = ()
    drawings: Mapping[str, Drawing] = dataclasses.field(default_factory=dict)
    picture: str | None = None
    doubts: Sequence[str] = ()
    facts: Sequence[tuple[str, str]] = ()
    sections: Sequence[Section] = ()
    text: Sequence[str] = ()
    document: Mapping[str, Any] | None = None
    exit_status: int | None = None

    def __post_init__(self):
        verdict = self.verdict or (Verdict.DOUBTFUL if self.doubts else Verdict.GOOD)
        usual = {"verdict": verdict, "picture": next(iter(self.drawings), ""),
                 "exit_status": int(verdict is not Verdict.GOOD)}  # fmt: skip
        filled = [one for one in self.sections if one.text or one.tables or one.drawings]
        known = {name: x for name in usual if (x := getattr(self, name)) is not None}
        vars(self).update({**usual, **known, "sections": filled})

    def page(
        self, pictures: Mapping[str, str], settings: Mapping[str, Any] | None = None,
        versions: Mapping[str, str] | None = None, seconds: Mapping[str, float] | None = None,
    ) -> str:
        """The page of the answer, which needs no other file and no network.

        Args:
            pictures: name -> SVG element of each drawing that the page shows.
            settings: of the command: at the foot of the page, folded.
            versions: package -> version, likewise.
            seconds: part of the work -> how long it took, likewise.

        Returns:
            An HTML document.
        """
        asked_again = json_safe(dict(settings or {}))
        return _environment().get_template("answer.html.j2").render(
            answer=self, pictures=pictures,
            table=lambda one: self.tables[one] if isinstance(one, str) else one,
            settings=[(name, as_setting(value)) for name, value in asked_again.items()],
            versions=list((versions or {}).items()),
            seconds=[(name, number(value, 3)) for name, value in (seconds or {}).items()],
        )  # fmt: skip

    def terminal(self) -> str:
        """What a terminal shows: the answer with its main tables, and what to doubt."""
        lines = [*wrapped(self.title), *wrapped(self.asked)]
        for sentence in self.text or [self.sentence, "; ".join(map(": ".join, self.facts))]:
            lines += wrapped(sentence)
        parts = [Section("", tables=self.main), *(one for one in self.sections if one.printed)]
        for part in [] if self.text else parts:
            lines += ["", part.terminal(self.tables)]
        lines += [""] * bool(self.doubts)
        for doubt in self.doubts:
            first, *details = doubt.split("\n")
            lines += [*wrapped(first.strip(), "warning: "), *details]
        return "\n".join(lines)

    def json(self) -> str:
        """The text of `result.json`."""
        return json.dumps(json_safe(dict(self.document or {})), indent=1) + "\n"


def write_page(
    answer: Answer, folder: str | os.PathLike[str], *, svg: bool = False, figures: bool = True,
    settings: Mapping[str, Any] | None = None, versions: Mapping[str, str] | None = None,
    seconds: dict[str, float] | None = None,
) -> list[Path]:
    """Write the page of an answer, and its figures; each is drawn once.

    Args:
        answer: what a command found.
        folder: where; made if needed. Files of the same names are replaced.
        svg: whether figures are saved as SVG as well; the page holds them in any case.
        figures: whether figures are files at all.
        settings: of the command, at the foot of the page.
        versions: package -> version, likewise.
        seconds: part of the work -> how long it took, likewise; `figures` is added, unless there
            is a `total`.

    Returns:
        `report.html`, which needs no other file, then `figures/NAME.png`.
    """
    folder, paths, pictures = Path(folder), [], {}
    running, begun = gc.isenabled(), time.perf_counter()
    # With many objects alive, garbage collection costs as much as the drawing.
    gc.disable()
    try:
        for name, drawing in answer.drawings.items():
            figure = drawing.draw()
            pictures[name] = picture_svg(figure, name)
            if figures:
                drawn = pictures[name] if svg else False
                paths += save_figure(figure, folder / "figures", name, svg=drawn)
    finally:
        if running:
            gc.enable()
    if seconds is not None and "total" not in seconds:
        seconds["figures"] = time.perf_counter() - begun
    page = answer.page(pictures, settings, versions, seconds)
    return [write_whole(folder / "report.html", page.encode()), *paths]


def as_setting(value: Any) -> str:
    """A setting for people: JSON but for words, `none` for what is empty."""
    if isinstance(value, str):
        return value
    return "none" if value in (None, [], {}) else json.dumps(value, ensure_ascii=False)


def prose(name: str, /, **values: Any) -> str:
    """What pages say whatever was found: a text of `templates/prose.toml`, its names filled in."""
    text = _prose()[name]
    return text.format(**values) if values else text


def paragraphs(name: str, /, **values: Any) -> list[str]:
    """Likewise a text of several paragraphs, one a line; those left empty are dropped."""
    return [line for line in prose(name, **values).splitlines() if line.strip()]


@functools.cache
def _prose() -> dict[str, str]:
    return tomllib.loads((_TEMPLATES / "prose.toml").read_text(encoding="utf-8"))


def minus(text: str) -> str:
    """A number, or limits in words, with a minus where a hyphen would be too short."""
    words = [word for word in text.split() if word not in ("above", "below", "to")]
    with contextlib.suppress(ValueError):
        if words and not any(math.isnan(float(word)) for word in words):
            return text.replace("-", "\u2212")
    return text


def _width(svg: str) -> str:
    """CSS that draws an SVG no wider than it was made: its points in the page's letters."""
    points = re.match(r'[^>]* width="([^"]+)pt"', svg)
    return f"max-width:{float(points[1]) / 9.33:.1f}rem" if points else ""


@functools.cache
def _environment():
    # Jinja takes 50 ms to import, which not every command needs.
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(lambda one: (_TEMPLATES / one).read_text(encoding="utf-8")),
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.filters |= {"minus": minus, "width": _width}
    return environment
