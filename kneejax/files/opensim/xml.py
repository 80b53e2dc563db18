"""XML of OpenSim by lxml: words of elements, errors with lines, changes written back."""

import codecs
import os
import re
from collections.abc import Collection, Sequence
from decimal import Decimal
from pathlib import Path
from typing import NamedTuple

import lxml.etree as etree
import numpy as np

from kneejax.files.opensim.exact import Point, read_decimal
from kneejax.files.reading import InputProblem, read_bytes

_DECLARED = re.compile(rb"<\?xml[^>]*?encoding\s*=\s*[\"']([A-Za-z0-9._-]+)[\"']")
_MARKS = ((codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF16_LE, "utf-16"),
          (codecs.BOM_UTF16_BE, "utf-16"))
#: Codecs of Python that no document is written in: names of hosts, escapes, and slow ones.
_NO_ENCODINGS = ("punycode", "idna", "unicode_escape", "raw_unicode_escape", "undefined", "utf-7")
_BEFORE_ROOT = re.compile(r"(?:\s|<\?.*?\?>|<!--.*?-->|<!DOCTYPE[^\[>]*(?:\[.*?\]\s*)?>)*", re.S)
_COMMENT = re.compile(r"<!--.*?-->", re.S)
_BARE = re.compile(r"&(?!#\d+;|#x[0-9A-Fa-f]+;|(?:amp|lt|gt|apos|quot);)")
_MISMATCH = re.compile(r"Opening and ending tag mismatch: (\S+) line (\d+) and (\S+)")
_EMPTY = re.compile(r"<([\w.:-]++)([^<>]*[^<>/])?></\1>")
# What stands in lxml's tree for a bare `&` and for hyphens in a comment, which OpenSim's parser
# lets pass, and for nothing between two tags, which lxml would write as one.
_AMPERSAND, _HYPHEN, _NOTHING = "\ue000", "\ue001", "\ue002"
_AS_IT_WAS = str.maketrans({_AMPERSAND: "&", _HYPHEN: "-", _NOTHING: None})


def last_word(path: str) -> str:
    """The last name of a path of components."""
    return path.rstrip("/").rsplit("/", 1)[-1]


class Element(etree.ElementBase):
    """An element of lxml that reads its properties, and says where it stands where one is wrong."""

    @property
    def name(self) -> str:
        """The attribute `name`, without surrounding space; empty if there is none."""
        return self.get("name", "").translate(_AS_IT_WAS).strip()

    @property
    def content(self) -> str:
        """Its own text, without comments and surrounding space."""
        pieces = [self.text, *(child.tail for child in self)]
        return "".join(x for x in pieces if x).translate(_AS_IT_WAS).strip()

    @property
    def children(self) -> "list[Element]":
        """Elements within it, without comments."""
        return [*self.iterchildren("*")]

    @property
    def applied(self) -> bool:
        """Whether a force acts or a constraint holds; some are switched off."""
        on = self.truth("appliesForce", True) and self.truth("isEnforced", True)
        return on and not self.truth("isDisabled", False)

    def problem(self, field: str, value, expected: str, nearest=None) -> InputProblem:
        """The error of a field of it: with file, kind, name and line."""
        name = f" {self.name}" if self.name else ""
        place = f"{self.tag}{name} (line {self.sourceline})"
        file = self.getroottree().docinfo.URL or ""
        return InputProblem(file, f"{place}: {field}" if field else place, value, expected, nearest)

    def child(self, *tags: str) -> "Element | None":
        """The first child with the first of these tags that any child has."""
        return next((x for x in map(self.find, tags) if x is not None), None)

    def word(self, *tags: str, default: str = "") -> str:
        """Text of a child, or of that of its class in the model's `<defaults>`, or `default`."""
        child = self.child(*tags)
        if child is None or not child.content:
            usual = self.getroottree().getroot().find("Model/defaults")
            same = [] if usual is None else [*usual.iterchildren(self.tag)]
            child = same[-1].child(*tags) if same and same[-1] is not self else None
        return (child.content if child is not None else "") or default

    def last_word(self, *tags: str) -> str:
        """The last name of a path that is the text of a child."""
        return last_word(self.word(*tags))

    def numbers(self, tag: str, count: int, default: str = "") -> list[Decimal]:
        """As many finite numbers of a child, or InputProblem; of `default` if it is absent."""
        word = self.word(tag, default=default)
        try:
            values = [read_decimal(part) for part in word.split()]
        except (ValueError, ArithmeticError):
            values = []
        if len(values) != count:
            what = "a number" if count == 1 else f"{count} numbers"
            raise self.problem(tag, word or "missing", what)
        return values

    def number(self, tag: str, default: str = "") -> float:
        """One of them."""
        return float(self.numbers(tag, 1, default)[0])

    def point(self, tag: str, default: str = "0 0 0") -> Point:
        """Three of them."""
        return np.array(self.numbers(tag, 3, default), object)

    def truth(self, tag: str, default: bool) -> bool:
        """A yes or no of a child."""
        word = self.word(tag).lower()
        if word in ("", "true", "1", "false", "0"):
            return word in ("true", "1") if word else default
        raise self.problem(tag, self.word(tag), "true or false")

    def set_words(self, words: Sequence[str], changed: Collection[int]) -> None:
        """Write those words that changed, or all where it has not as many; comments stay."""
        if len(self.content.split()) != len(words):
            del self[:]
            self.text = " ".join(words)
            return
        numbered = enumerate(words)

        def written(found: re.Match[str]) -> str:
            k, word = next(numbered)
            return word if k in changed else found[0]

        self.text = re.sub(r"\S+", written, self.text or "") or None
        for comment in self:
            comment.tail = re.sub(r"\S+", written, comment.tail or "") or None

    def add(self, tag: str, text: str) -> None:
        """Add a child at the end, indented like the last one."""
        new = self.makeelement(tag)
        new.text = text
        if len(self):
            self[-1].add_after(new)
        else:
            self.append(new)

    def add_after(self, new: etree.ElementBase) -> None:
        """Put an element behind this one, indented like it."""
        before = self.getprevious()
        lead = (self.getparent().text if before is None else before.tail) or ""
        lead = "" if lead.strip() else lead
        for one in new.iter():
            one.text = (one.text or "").replace("\n", lead) or None
            one.tail = (one.tail or "").replace("\n", lead) or None
        tail = self.tail
        self.addnext(new)
        self.tail, new.tail = lead or None, tail

    def take_out(self) -> None:
        """Remove it from the tree, with the space before it."""
        before, parent, tail = self.getprevious(), self.getparent(), self.tail
        parent.remove(self)
        if before is not None:
            before.tail = tail
        else:
            parent.text = tail


class XmlFile(NamedTuple):
    """A parsed file: its path, its bytes, their text and encoding, and the outermost element."""

    path: Path
    original: bytes
    text: str
    encoding: str
    root: Element

    def written(self) -> bytes:
        """The file with its elements as they are now; what did not change stays to the letter."""
        text, closed = self.text, f"</{self.root.tag}"
        new = etree.tostring(self.root, encoding="unicode", with_tail=False)
        if 2 * text.count(" />") > text.count("/>"):
            spaced = lambda found: " />" if found[0] == "/>" else found[0]  # noqa: E731
            new = re.sub(r"<!--.*?-->|(?<=\S)/>", spaced, new, flags=re.S)
        ends = "\r\n" if "\r\n" in text else "\r" if "\n" not in text else "\n"
        before = _BEFORE_ROOT.match(text)
        assert before is not None  # it matches nothing too
        new = before[0] + new.translate(_AS_IT_WAS).replace("\n", ends)
        new += text[text.index(">", text.rindex(closed)) + 1 :]
        return new.encode(self.encoding, "xmlcharrefreplace")


def parse_xml(path: str | os.PathLike[str], kind: str, data: bytes | None = None) -> XmlFile:
    """Parse a file of a kind, or its bytes; not what is ill-formed or has entities of its own."""
    original = read_bytes(path, kind) if data is None else data
    encoding = next((name for mark, name in _MARKS if original.startswith(mark)), "")
    if b"\x00" in original and encoding != "utf-16":
        raise InputProblem(path, "file", "binary data", f"{kind}, which is text")
    if not encoding:
        found = _DECLARED.match(original.lstrip())
        encoding = found.group(1).decode("ascii") if found else "utf-8"
    try:
        if codecs.lookup(encoding).name in _NO_ENCODINGS:
            raise LookupError(f"{encoding} is no encoding of a document")
        text = original.decode(encoding)
    except (UnicodeError, LookupError) as error:
        raise InputProblem(path, "encoding", str(error), f"{kind} in its encoding") from None
    if "<!ENTITY" in text:
        place = f"line {text[: text.index('<!ENTITY')].count(chr(10)) + 1}"
        raise InputProblem(path, place, "<!ENTITY", f"{kind} without entities of its own")
    root, error = _parsed(text, path)
    if error is not None and "<!DOCTYPE" not in text:
        root, error = _parsed(_BARE.sub(_AMPERSAND, _COMMENT.sub(
            lambda found: f"<!--{found[0][4:-3].replace('-', _HYPHEN)}-->", text)), path)
    if error is not None or root is None:
        place, shown = "line 1, column 1", "no element"
        if error is not None:
            place = f"line {error.line}, column {error.column}"
            shown = _MISMATCH.sub(r"mismatched tag \3 for \1 of line \2", error.message.strip())
        raise InputProblem(path, place, shown, f"{kind} in well-formed XML")
    return XmlFile(Path(path), original, text, encoding, root)


def _parsed(text: str, path: str | os.PathLike[str]):
    """Root and first error of a text; entities stay, and OpenSim's names with `::` are no error."""
    parser = etree.XMLParser(encoding="utf-8", resolve_entities=False, no_network=True,
                             load_dtd=False, huge_tree=False, strip_cdata=False, recover=True)
    parser.set_element_class_lookup(etree.ElementDefaultClassLookup(element=Element))
    try:
        text = _EMPTY.sub(lambda found: found[0].replace("><", f">{_NOTHING}<"), text)
        root = etree.fromstring(text.encode(), parser, base_url=os.fspath(path))
    except etree.XMLSyntaxError:
        root = None
    fatal = (one for one in parser.error_log if one.level == etree.ErrorLevels.FATAL)
    return root, next(fatal, None)
