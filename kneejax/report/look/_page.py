"""Pieces of an HTML page: sections, tables and pictures."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from html import escape


def section(title: str, body: str) -> str:
    return f"<section>\n<h2>{escape(title)}</h2>\n{body}</section>\n"


def table(
    header: Sequence[str], rows: Iterable[Sequence[str]], words: Sequence[int] = (0,)
) -> str:
    """A table of plain text; columns in `words` are words, the others numbers."""

    def cells(tag: str, row: Sequence[str]) -> str:
        return "".join(
            f"<{tag}{'' if i in words else ' class=n'}>"
            f"{escape(text).replace('-', chr(8722)) if i not in words else escape(text)}</{tag}>"
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


def picture(svg: str, caption: str) -> str:
    width = re.search(r'<svg[^>]*? width="([\d.]+)pt"', svg)
    if width:
        svg = svg.replace("<svg", f'<svg style="max-width:{float(width[1]) / 9.33:.1f}rem"', 1)
    return (
        f'<figure><div class="wide">{svg}</div>'
        f"<figcaption>{escape(caption)}</figcaption></figure>\n"
    )
