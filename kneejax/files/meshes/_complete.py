"""Whether the file of a mesh is complete: parsers read a part without a word."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from kneejax.files.reading import InputProblem, counted, plain_number

#: Bytes of a number of a PLY file.
_BYTES = {"char": 1, "uchar": 1, "short": 2, "ushort": 2, "int": 4, "uint": 4, "float": 4,
          "double": 8, "int8": 1, "uint8": 1, "int16": 2, "uint16": 2, "int32": 4, "uint32": 4,
          "float32": 4, "float64": 8}  # fmt: skip
_COUNTED_BY = {"char": "b", "uchar": "B", "int8": "b", "uint8": "B", "short": "h", "ushort": "H",
               "int16": "h", "uint16": "H", "int": "i", "uint": "I", "int32": "i",
               "uint32": "I"}  # fmt: skip
_STL_HEAD, _STL_FACET = 84, 50


class _Element(NamedTuple):
    """A kind of row of a PLY file: how many, and the type of each property, two for a list."""

    name: str
    count: int
    properties: list[tuple[str, ...]]


def check_complete(path: Path, data: bytes) -> None:
    """Refuse a mesh of which a part is missing, or that has more than its header counts.

    Args:
        path: the file.
        data: its content.

    Raises:
        InputProblem: the header or the rows are not what they should be.
    """
    COMPLETE[path.suffix[1:].lower()](path, data)


def _ply(path: Path, data: bytes) -> None:
    form, elements, body = _ply_header(path, data)
    expected = " and ".join(f"{one.count} rows of {one.name}" for one in elements)
    if form == "ascii":
        rows = [line.split() for line in body.split(b"\n") if line.strip()]
        first = 0
        for one in elements:
            for number, row in enumerate(rows[first : first + one.count], 1):
                if len(row) != _cells(row, one):
                    found = counted(len(row), "number")
                    raise InputProblem(path, f"{one.name}, row {number}", found, "a whole row")
            first += one.count
        if len(rows) != first:
            raise InputProblem(path, "rows", len(rows), f"{expected}, as the header says")
        return
    there, needed = len(body), 0
    order = "<" if form == "binary_little_endian" else ">"
    for one in elements:
        needed = _end(body, needed, one, order)
        if needed > there:
            found = f"the end of the file in {one.name}"
            raise InputProblem(path, "rows", found, f"{expected}, as the header says")
    if body[needed:].strip():
        found = counted(there - needed, "byte") + " more"
        raise InputProblem(path, "rows", found, f"{expected}, as the header says")


def _ply_header(path: Path, data: bytes) -> tuple[str, list[_Element], bytes]:
    found = re.match(rb"ply\r?\n(?P<lines>.*?)end_header[ \t]*(\r\n|\n|\r)", data, re.DOTALL)
    if found is None:
        raise InputProblem(path, "header", "not complete", "a triangle mesh in PLY")
    form, elements = "", []
    for line in found["lines"].decode("ascii", "replace").splitlines():
        match line.split():
            case ["format", ("ascii" | "binary_little_endian" | "binary_big_endian") as form, _]:
                pass
            case ["element", name, count] if re.fullmatch("[0-9]{1,9}", count):
                elements.append(_Element(name, int(count), []))
            case ["property", "list", count, kind, _] if elements and count in _COUNTED_BY:
                elements[-1].properties.append((count, kind))
            case ["property", kind, _] if elements and kind in _BYTES:
                elements[-1].properties.append((kind,))
            case [("comment" | "obj_info"), *_] | []:
                pass
            case _:
                raise InputProblem(path, "header", line, "a line of the header of a PLY mesh")
    if not form or not elements:
        found_words = "no format" if not form else "no elements"
        raise InputProblem(path, "header", found_words, "a triangle mesh in PLY")
    return form, elements, data[found.end() :]


def _cells(row: list[bytes], element: _Element) -> int:
    """Numbers that a row of an ASCII file should have; lists say how long they are."""
    place = 0
    for kinds in element.properties:
        if len(kinds) == 1:
            place += 1
        elif place < len(row) and row[place].isdigit():
            place += 1 + int(row[place][:9])
        else:
            return -1
    return place


def _end(body: bytes, begin: int, element: _Element, order: str) -> int:
    """Where the rows of an element end in a binary file that is long enough."""
    if all(len(kinds) == 1 for kinds in element.properties):
        return begin + element.count * sum(_BYTES[kind] for (kind,) in element.properties)
    if len(element.properties) == 1:
        # Faces are triangles as a rule: all rows at once, if each says three.
        count, kind = element.properties[0]
        head, size = _BYTES[count], _BYTES[count] + 3 * _BYTES.get(kind, 1)
        rows = body[begin : begin + element.count * size]
        if len(rows) == element.count * size:
            table = np.frombuffer(rows, np.uint8).reshape(element.count, size)[:, :head]
            says = np.ascontiguousarray(table).view(order + _COUNTED_BY[count])
            if (says == 3).all():
                return begin + element.count * size
    for _ in range(element.count):
        for kinds in element.properties:
            if len(kinds) == 1:
                begin += _BYTES[kinds[0]]
                continue
            head = body[begin : begin + _BYTES[kinds[0]]]
            if len(head) < _BYTES[kinds[0]]:
                return len(body) + 1
            says = int(np.frombuffer(head, order + _COUNTED_BY[kinds[0]])[0])
            begin += len(head) + max(says, 0) * _BYTES.get(kinds[1], 1)
    return begin


def _stl(path: Path, data: bytes) -> None:
    """A binary file is as long as it says; one of text ends with the word for its end."""
    says = int.from_bytes(data[80:_STL_HEAD], "little") if len(data) >= _STL_HEAD else -1
    if says >= 0 and len(data) == _STL_HEAD + says * _STL_FACET:
        return
    words = data.split()
    if not words or words[0].lower() != b"solid" or b"\x00" in data:
        expected = "a triangle mesh in STL"
        if says >= 0:
            expected += f": {_STL_HEAD} bytes, then {says} triangles of {_STL_FACET}"
        raise InputProblem(path, "file", counted(len(data), "byte"), expected)
    lower = [word.lower() for word in words]
    loops = {word: lower.count(word) for word in (b"outer", b"endloop", b"endfacet", b"vertex")}
    if loops[b"outer"] and b"endsolid" not in lower:
        raise InputProblem(path, "file", "no endsolid at its end", "a whole triangle mesh in STL")
    whole = loops[b"endfacet"] == loops[b"endloop"] == loops[b"outer"]
    if not whole or loops[b"vertex"] != 3 * loops[b"outer"]:
        found = f"{loops[b'vertex']} corners of {counted(loops[b'outer'], 'triangle')}"
        raise InputProblem(path, "file", found, "three corners of each triangle")


def _obj(path: Path, data: bytes) -> None:
    for number, words in _lines(data):
        if words[0] == b"v":
            good = len(words) >= 4 and all(_is_number(word) for word in words[1:4])
            expected = "three coordinates of a corner"
        else:
            good = len(words) >= 4 and all(_CORNER.fullmatch(word) for word in words[1:])
            expected = "three corners of a face or more"
        if not good:
            found = b" ".join(words).decode("utf-8", "replace")
            raise InputProblem(path, f"line {number}", found, expected)


_CORNER = re.compile(rb"-?[0-9]+(?:/-?[0-9]*){0,2}")


def _lines(data: bytes) -> Iterator[tuple[int, list[bytes]]]:
    for number, line in enumerate(data.splitlines(), 1):
        words = line.split(b"#")[0].split()
        if words and words[0] in (b"v", b"f"):
            yield number, words


def _is_number(word: bytes) -> bool:
    return plain_number(word.decode("ascii", "replace")) is not None


#: Ending of a file that says how much it holds -> its check.
COMPLETE = {"ply": _ply, "stl": _stl, "obj": _obj}
