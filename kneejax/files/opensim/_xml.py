"""XML that remembers where each byte of it stands, so that a number can be replaced in place."""

from __future__ import annotations

import bisect
import codecs
import dataclasses
import os
import re
from collections.abc import Iterator
from pathlib import Path
from xml.parsers import expat

from kneejax.files.reading import InputProblem, read_bytes

_DECLARED = re.compile(rb"<\?xml[^>]*?encoding\s*=\s*[\"']([A-Za-z0-9._-]+)[\"']")
_START_TAG = re.compile(rb"<(?:[^\"'>]|\"[^\"]*\"|'[^']*')*>")
_NOT_TEXT = re.compile(rb"<!--.*?-->|<!\[CDATA\[|\]\]>|<\?.*?\?>", re.DOTALL)
_SPACE = re.compile(rb"\s*\Z")
_COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)
_BARE = re.compile(rb"&(?!#\d+;|#x[0-9A-Fa-f]+;|(?:amp|lt|gt|apos|quot);)")
#: Marks that begin a file in UTF-16; a UTF-8 mark is a character that stays where it is.
#: Codecs of Python that no document is written in: names of hosts, escapes, and slow ones.
_NO_ENCODINGS = ("punycode", "idna", "unicode_escape", "raw_unicode_escape", "undefined", "utf-7")
_MARKS = ((codecs.BOM_UTF16_LE, "utf-16-le"), (codecs.BOM_UTF16_BE, "utf-16-be"))


class Element:
    """An element, its place in the file, and its children.

    Attributes:
        tag: kind of element.
        attributes: name -> value.
        parent: the element around it; None for the root.
        children: in their order.
        line: where it begins, from 1.
        start: first byte of its start tag.
        inner: first byte and end of what stands between its tags.
        end: first byte after its end tag.
    """

    __slots__ = (
        "tag",
        "attributes",
        "parent",
        "children",
        "line",
        "start",
        "inner",
        "end",
        "pieces",
    )

    def __init__(self, tag: str, attributes: dict[str, str], parent: Element | None, line: int):
        self.tag = tag
        self.attributes = attributes
        self.parent = parent
        self.children: list[Element] = []
        self.line = line
        self.start, self.inner, self.end = 0, (0, 0), 0
        self.pieces: list[str] = []

    @property
    def name(self) -> str:
        """The attribute `name`, without surrounding space; empty if there is none."""
        return self.attributes.get("name", "").strip()

    @property
    def text(self) -> str:
        """Its own text, without surrounding space."""
        return "".join(self.pieces).strip()

    def child(self, *tags: str) -> Element | None:
        """The first child with the first of these tags that any child has."""
        for tag in tags:
            for child in self.children:
                if child.tag == tag:
                    return child
        return None

    def inside(self, *tags: str) -> list[Element]:
        """Children of the element reached by following one tag after the other."""
        here: Element | None = self
        for tag in tags:
            here = None if here is None else here.child(tag)
        return [] if here is None else here.children

    def word(self, *tags: str, default: str = "") -> str:
        """Text of a child; `default` if it is absent or empty."""
        child = self.child(*tags)
        return (child.text if child is not None else "") or default

    def walk(self) -> Iterator[Element]:
        """It and everything within it, in the order of the file."""
        yield self
        for child in self.children:
            yield from child.walk()

    def ancestors(self) -> Iterator[Element]:
        """The elements around it, from the nearest."""
        here = self.parent
        while here is not None:
            yield here
            here = here.parent


@dataclasses.dataclass(frozen=True)
class XmlFile:
    """A parsed file.

    Attributes:
        path: the file.
        original: its bytes.
        data: the same text in UTF-8; places of elements count its bytes.
        encoding: how to encode `data` again.
        mark: bytes before the text.
        root: the outermost element.
    """

    path: Path
    original: bytes
    data: bytes
    encoding: str
    mark: bytes
    root: Element

    def problem(self, element: Element, field: str, value, expected: str, nearest=None):
        """The error at an element: its kind, name, line, and a field of it."""
        name = f" {element.name}" if element.name else ""
        place = f"{element.tag}{name} (line {element.line})"
        return InputProblem(
            self.path, f"{place}: {field}" if field else place, value, expected, nearest
        )

    def spliced(self, edits: list[tuple[int, int, bytes]]) -> bytes:
        """The file with some bytes replaced, in its own encoding.

        Args:
            edits: first byte and end of what is replaced in `data`, and what replaces it.
        """
        if not edits:
            return self.original
        pieces, last = [], 0
        for start, end, new in sorted(edits, key=lambda edit: edit[:2]):
            pieces += [self.data[last:start], new]
            last = end
        pieces.append(self.data[last:])
        return self.mark + b"".join(pieces).decode("utf-8").encode(self.encoding)


def parse_xml(path: str | os.PathLike[str], kind: str, data: bytes | None = None) -> XmlFile:
    """Parse an XML file.

    Args:
        path: the file.
        kind: what it should be, for the error.
        data: its bytes, if they are at hand.

    Returns:
        The root with everything in it.

    Raises:
        InputProblem: it cannot be read or is not well-formed XML (with line and column).
    """
    original = read_bytes(path, kind) if data is None else data
    text, encoding, mark = _decoded(original, path, kind)
    try:
        try:
            root = _parsed(text, text, [])
        except expat.ExpatError:
            root = _parsed(text, *_tolerated(text))
    except expat.ExpatError as error:
        place = f"line {error.lineno}, column {error.offset + 1}"
        found = expat.ErrorString(error.code)
        raise InputProblem(path, place, found, f"{kind} in well-formed XML") from None
    return XmlFile(Path(path), original, text, encoding, mark, root)


def tokens(file: XmlFile, leaf: Element) -> list[tuple[int, int]]:
    """First byte and end of each word of an element's text; comments are no words."""
    start, end = leaf.inner
    plain = _NOT_TEXT.sub(lambda found: b" " * len(found.group()), file.data[start:end])
    return [(start + m.start(), start + m.end()) for m in re.finditer(rb"\S+", plain)]


def inserted(file: XmlFile, parent: Element, tag: str, text: str) -> tuple[int, int, bytes]:
    """The edit that gives an element one more child at its end, indented like its last one.

    Args:
        file: the file.
        parent: the element.
        tag: of the new child.
        text: of the new child.
    """
    child = f"<{tag}>{text}</{tag}>".encode()
    if parent.children:
        last = parent.children[-1]
        space = _SPACE.search(file.data, 0, last.start)
        lead = file.data[space.start() : last.start] if space else b""
        return last.end, last.end, lead + child
    start, end = parent.inner
    if file.data[start:end] == b"/":  # <X/> has no inside yet
        return start, parent.end, b">" + child + f"</{parent.tag}>".encode()
    return start, start, child


def _tolerated(text: bytes) -> tuple[bytes, list[int]]:
    """The text without what OpenSim's parser lets pass, and where it is four bytes longer.

    That is a bare `&`, and `--` in a comment.
    """
    if b"<!DOCTYPE" in text or b"<![CDATA[" in text:
        return text, []
    plain = _COMMENT.sub(lambda found: re.sub(rb"[^\r\n]", b" ", found.group()), text)
    places = [found.start() + 4 * i for i, found in enumerate(_BARE.finditer(plain))]
    return _BARE.sub(b"&amp;", plain), places


def _parsed(text: bytes, well_formed: bytes, longer: list[int]) -> Element:
    """The root of a text; places are counted in the text itself."""
    parser = expat.ParserCreate(encoding="UTF-8")
    parser.buffer_text = True
    reader = _Reader(parser, text, longer)
    parser.StartElementHandler = reader.begin
    parser.EndElementHandler = reader.finish
    parser.CharacterDataHandler = reader.characters
    parser.Parse(well_formed, True)
    assert reader.root is not None  # expat refuses a file without an element
    return reader.root


class _Reader:
    """Builds elements from the parser's events."""

    def __init__(self, parser, data: bytes, longer: list[int]):
        self.parser, self.data, self.longer = parser, data, longer
        self.root: Element | None = None
        self.here: Element | None = None

    def begin(self, tag: str, attributes: dict[str, str]) -> None:
        element = Element(tag, attributes, self.here, self.parser.CurrentLineNumber)
        element.start = self.place()
        found = _START_TAG.match(self.data, element.start)
        end = found.end() if found else element.start
        element.inner = (end, end)
        if self.here is None:
            self.root = element
        else:
            self.here.children.append(element)
        self.here = element

    def finish(self, tag: str) -> None:
        element = self.here
        assert element is not None
        start = element.inner[0]
        if self.data[start - 2 : start] == b"/>":
            element.inner, element.end = (start - 2, start - 1), start
        else:
            close = self.place()
            element.inner, element.end = (start, close), self.data.index(b">", close) + 1
        self.here = element.parent

    def place(self) -> int:
        at = self.parser.CurrentByteIndex
        return at - 4 * bisect.bisect_left(self.longer, at)

    def characters(self, text: str) -> None:
        if self.here is not None:
            self.here.pieces.append(text)


def _decoded(original: bytes, path, kind: str) -> tuple[bytes, str, bytes]:
    """The text in UTF-8, how it was encoded, and the mark before it."""
    encoding, mark = "", b""
    if b"\x00" in original and not original.startswith((_MARKS[0][0], _MARKS[1][0])):
        raise InputProblem(path, "file", "binary data", f"{kind}, which is text")
    for bytes_, name in _MARKS:
        if original.startswith(bytes_):
            encoding, mark = name, bytes_
    if not encoding:
        found = _DECLARED.match(original.removeprefix(codecs.BOM_UTF8).lstrip())
        encoding = found.group(1).decode("ascii") if found else "utf-8"
    try:
        if codecs.lookup(encoding).name in _NO_ENCODINGS:
            raise LookupError(f"{encoding} is no encoding of a document")
        text = original.removeprefix(mark).decode(encoding)
        faithful = text.encode(encoding) == original.removeprefix(mark)
    except (UnicodeError, LookupError) as error:
        raise InputProblem(path, "encoding", str(error), f"{kind} in its encoding") from None
    if not faithful:
        raise InputProblem(path, "encoding", encoding, f"{kind} in UTF-8")
    return text.encode("utf-8"), encoding, mark
