"""Pieces of an HTML page: sections, tables and pictures."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from html import escape

from kneejax.report.look._page_style import CSS


def page(title: str, sections: Iterable[str], style: str = "") -> str:
    """A complete HTML document, which needs no other file.

    Args:
        title: plain text; it is escaped.
        sections: HTML, one after the other.
        style: CSS beside that of all pages.
    """
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{CSS}{style}</style>\n</head>\n"
        f"<body>\n<main>\n{''.join(sections)}</main>\n</body>\n</html>\n"
    )


def boxes(facts: Iterable[tuple[str, str]]) -> str:
    """Facts at the head of a page, each under its name; plain text."""
    each = (f"<div><dt>{escape(k)}</dt><dd>{escape(v)}</dd></div>" for k, v in facts)
    return f"<dl>{''.join(each)}</dl>"


def warnings_box(title: str, sentences: Iterable[str]) -> str:
    """Sentences of plain text that nobody should miss; nothing without any."""
    items = "".join(f"<li>{escape(sentence)}</li>\n" for sentence in sentences)
    if not items:
        return ""
    return f'<div class="warnings"><h2>{escape(title)}</h2>\n<ul>\n{items}</ul></div>\n'


def section(title: str, body: str) -> str:
    """A section of a page under its heading.

    Args:
        title: plain text; it is escaped.
        body: HTML.

    Returns:
        The `<section>` element.

    Example:
        >>> print(section("Poses", "<p>All balanced.</p>"), end="")
        <section>
        <h2>Poses</h2>
        <p>All balanced.</p></section>
    """
    return f"<section>\n<h2>{escape(title)}</h2>\n{body}</section>\n"


def table(
    header: Sequence[str], rows: Iterable[Sequence[str]], words: Sequence[int] = (0,)
) -> str:
    """A table of plain text; columns in `words` are words, the others numbers."""

    def cells(tag: str, row: Sequence[str]) -> str:
        return "".join(
            f"<{tag}{'' if i in words else ' class=n'}>"
            f"{_minus(escape(text), i in words)}</{tag}>"
            for i, text in enumerate(row)
        )

    body = "".join(f"<tr>{cells('td', row)}</tr>\n" for row in rows)
    head = "".join(
        f"<th{'' if i in words else ' class=n'}>{escape(text)}</th>"
        for i, text in enumerate(header)
    )
    return (
        f'<div class="wide"><table>\n<thead><tr>{head}</tr></thead>\n'
        f"<tbody>\n{body}</tbody>\n</table></div>\n"
    )


def _minus(text: str, words: bool) -> str:
    """A number, or limits in words, with a minus where a hyphen would be too short."""
    if words and not re.fullmatch(r"(above |below )?-?[\d.]+( to -?[\d.]+)?", text):
        return text
    return text.replace("-", "\u2212")


def picture(svg: str, caption: str) -> str:
    """A figure with its caption, drawn no wider than it was made.

    Args:
        svg: the `<svg>` element, as `save_and_inline` returns it.
        caption: plain text; it is escaped.

    Returns:
        The `<figure>` element.
    """
    width = re.search(r'<svg[^>]*? width="([\d.]+)pt"', svg)
    if width:
        svg = svg.replace("<svg", f'<svg style="max-width:{float(width[1]) / 9.33:.1f}rem"', 1)
    return (
        f'<figure><div class="wide">{svg}</div>'
        f"<figcaption>{escape(caption)}</figcaption></figure>\n"
    )
