"""Words of a command line as values of a field's type, and what the type expects in words."""

import math
import re
import types
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple, Union, get_args, get_origin

from pydantic.fields import FieldInfo

from kneejax.files.reading import plain_number, wrong

#: Last words of options that are units.
_UNITS = ("N", "Nm", "mm", "deg", "s", "ms", "kg", "m")
_LIMITS = {"gt": "above", "ge": "of at least", "lt": "below", "le": "of at most"}
#: A side in the words of other commands, which say `right` or `r`.
SIDES = {"r": "right", "l": "left", "right": "r", "left": "l"}


class Split(NamedTuple):
    """Numbers in one word: `41x61`, `3/20`, `0:1.5`; a single one counts twice if that may be."""

    by: str
    expected: str
    form: str
    single: bool = False


def plain_type(annotation: Any) -> Any:
    """A type without None and without what is noted beside it: `float` of `float | None`."""
    if hasattr(annotation, "__metadata__"):
        return plain_type(annotation.__origin__)
    if get_origin(annotation) in (Union, types.UnionType):
        known = [one for one in get_args(annotation) if one is not type(None)]
        return plain_type(known[0]) if len(known) == 1 else annotation
    return annotation


def choices_of(annotation: Any) -> tuple[str, ...]:
    """What may be chosen, also where several may; empty where it is no choice."""
    kind = plain_type(annotation)
    if get_origin(kind) in (list, tuple):
        return choices_of(get_args(kind)[0])
    return tuple(map(str, get_args(kind))) if get_origin(kind) is Literal else ()


def read_value(field: FieldInfo, value: Any) -> Any:
    """Read words as the type of a field; a value that is no words is left as it is. Refuses a word
    that is no number, a name twice, a pair in another form."""
    kind = plain_type(field.annotation)
    split = next((mark for mark in field.metadata if isinstance(mark, Split)), None)
    if split and isinstance(value, str):
        numbers = [plain_number(part) for part in value.lower().split(split.by)]
        numbers *= 2 if len(numbers) == 1 and split.single else 1
        if len(numbers) != 2 or None in numbers:
            raise wrong(value, split.expected)
        return [int(x) if x is not None and x.is_integer() else x for x in numbers]
    if get_origin(kind) in (dict, Mapping) and isinstance(value, list | tuple):
        form = next((mark.form for mark in field.metadata if hasattr(mark, "form")), "")
        return _pairs(get_args(kind)[1], value, form)
    return _as_type(kind, value)


def _as_type(kind: Any, value: Any) -> Any:
    kind, origin = plain_type(kind), get_origin(plain_type(kind))
    if origin in (list, tuple) and isinstance(value, list | tuple):
        return [_as_type(get_args(kind)[0], one) for one in value]
    if not isinstance(value, str):
        return value
    if not value.strip():
        raise wrong(value, "a value, not an empty text")
    if kind is float and (number := plain_number(value)) is not None:
        return number
    if kind is int and re.fullmatch(r"[-+]?[0-9]{1,18}", value.strip()):
        return int(value)
    if kind in (float, int):
        expected = "a number" if kind is float else "a whole number"
        several = "; several have blanks between them, as 0 90" if re.search("[:,]", value) else ""
        raise wrong(value, expected + several)
    other = SIDES.get(value)
    known = get_args(kind) if origin is Literal else (value,)
    return other if value not in known and other in known else value


def _pairs(kind: Any, words: Sequence[Any], form: str) -> dict[str, Any]:
    """`NAME=VALUE`, each name once; values of several numbers have colons between them."""
    found: dict[str, Any] = {}
    wanted = plain_type(kind)
    several, most = get_origin(wanted) is tuple, form.partition(",")[0].count(":") + 1
    least = 2 if "[" in form else most
    for word in map(str, words):
        if not word.strip():
            raise wrong(word, "a value, not an empty text", at="value")
        name, given, text = word.partition("=")
        if name in found:
            raise wrong(word, "every name once", at=name)
        if not given and wanted is not kind:  # None says: as usual
            found[name] = None
        elif wanted is str:
            found[name] = text
        else:
            numbers = [plain_number(part) for part in text.split(":")]
            good = given and None not in numbers and least <= len(numbers) <= most
            if not good or not (several or math.isfinite(numbers[0] or 0.0)):
                expected = form if several else f"{form}, a finite number"
                raise wrong(text, expected, at=name or "name")
            found[name] = numbers if several else numbers[0]
    return found


def expected_of(field: FieldInfo, error: Mapping[str, Any]) -> str:
    """What a field takes, in words."""
    if choices := choices_of(field.annotation):
        return f"one of {', '.join(choices)}"
    if error["type"] == "finite_number":
        return "a finite number"
    kind = plain_type(field.annotation)
    number = "a whole number" if kind is int else "a number"
    limits = {name: f"{limit:,.0f}" if limit >= 1e4 else f"{limit:g}"
              for mark in field.metadata for name in _LIMITS
              if (limit := getattr(mark, name, None)) is not None}  # fmt: skip
    unit = (field.alias or "").rpartition("-")[2]
    if {"ge", "le"} <= limits.keys():
        of = f" {unit}" if unit in _UNITS else ""
        return f"{number} between {limits['ge']} and {limits['le']}{of}"
    if limits:
        return f"{number} " + " and ".join(f"{_LIMITS[x]} {limits[x]}" for x in limits)
    if get_origin(kind) is tuple and error["type"] in ("missing", "too_short", "too_long"):
        return f"{len(get_args(kind))} numbers"
    known = {float: number, int: number, Path: "a text", str: "a text", bool: "true or false"}
    return known.get(kind, "a value of another kind")
