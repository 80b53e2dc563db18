"""Words of a command line as values of a field's type, and what the type expects in words."""

from __future__ import annotations

import dataclasses
import math
import re
import types
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, Union, get_args, get_origin

from pydantic.fields import FieldInfo

from kneejax.files import InputProblem
from kneejax.files.reading import plain_number

#: Last words of options that are units.
_UNITS = ("N", "Nm", "mm", "deg", "s", "ms", "kg", "m")


@dataclasses.dataclass(frozen=True)
class Split:
    """Numbers in one word: `41x61`, `3/20`, `0:1.5`; a single one counts twice if that may be."""

    by: str
    expected: str
    form: str
    single: bool = False


def plain_type(annotation: Any) -> Any:
    """A type without None and without what is noted beside it.

    Example:
        >>> plain_type(float | None)
        <class 'float'>
    """
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


def read_value(field: FieldInfo, value: Any, command: str, option: str) -> Any:
    """Read words as the type of a field; a value that is no words is left as it is. Refuses a word
    that is no number, a name twice, a pair in another form."""
    form = next((one.form for one in field.metadata if hasattr(one, "form")), "")
    for mark in field.metadata:
        if isinstance(mark, Split) and isinstance(value, str):
            return _split(mark, value, command, option)
    kind = plain_type(field.annotation)
    if get_origin(kind) in (dict, Mapping) and isinstance(value, list | tuple):
        return _pairs(get_args(kind)[1], value, option, form)
    return _as_type(kind, value, command, option)


def _as_type(kind: Any, value: Any, command: str, option: str) -> Any:
    kind, origin = plain_type(kind), get_origin(plain_type(kind))
    if origin in (list, tuple) and isinstance(value, list | tuple):
        inner = get_args(kind)[0]
        return [_as_type(inner, one, command, option) for one in value]
    if not isinstance(value, str):
        return value
    if not value.strip():
        raise InputProblem(command, option, value, "a value, not an empty text")
    if kind is float and (number := plain_number(value)) is not None:
        return number
    if kind is int and re.fullmatch(r"[-+]?[0-9]{1,18}", value.strip()):
        return int(value)
    if kind in (float, int):
        expected = "a number" if kind is float else "a whole number"
        several = "; several have blanks between them, as 0 90" if re.search("[:,]", value) else ""
        raise InputProblem(command, option, value, expected + several)
    if origin is Literal and value not in get_args(kind) and value[:1] in get_args(kind):
        # A side by its word, or by its first letter.
        return value[0] if value in ("right", "left") else value
    if origin is Literal and value in ("r", "l") and "right" in get_args(kind):
        return {"r": "right", "l": "left"}[value]
    return value


def _split(mark: Split, text: str, command: str, option: str) -> list[float]:
    numbers = [plain_number(part) for part in text.lower().split(mark.by)]
    if len(numbers) == 1 and mark.single:
        numbers *= 2
    if len(numbers) != 2 or None in numbers:
        raise InputProblem(command, option, text, mark.expected)
    return [int(x) if x is not None and x.is_integer() else x for x in numbers]


def _pairs(kind: Any, words: list[str], option: str, form: str) -> dict[str, Any]:
    """`NAME=VALUE`, each name once; values of several numbers have colons between them."""
    found: dict[str, Any] = {}
    wanted = plain_type(kind)
    several = get_origin(wanted) is tuple
    counts = form.partition(",")[0].count(":") + 1
    for word in words:
        if not str(word).strip():
            raise InputProblem(option, "value", word, "a value, not an empty text")
        name, given, text = str(word).partition("=")
        if name in found:
            raise InputProblem(option, name, word, "every name once")
        if not given and wanted is not kind:  # None says: as usual
            found[name] = None
            continue
        if wanted is str:
            found[name] = text
            continue
        numbers = [plain_number(part) for part in text.split(":")]
        good = None not in numbers and len(numbers) in ((counts,) if several else (1,))
        if several and wanted is not kind and "[" in form:
            good = None not in numbers and 2 <= len(numbers) <= counts
        if not several and good:
            good = math.isfinite(numbers[0] or 0.0)
        if not given or not good:
            raise InputProblem(option, name, text, form if several else f"{form}, a finite number")
        found[name] = numbers if several else numbers[0]
    return found


def expected_of(field: FieldInfo, error: Mapping[str, Any]) -> str:
    """What a field takes, in words."""
    if choices := choices_of(field.annotation):
        return f"one of {', '.join(choices)}"
    kind = plain_type(field.annotation)
    limits = {}
    for mark in field.metadata:
        for name in ("gt", "ge", "lt", "le"):
            if (limit := getattr(mark, name, None)) is not None:
                limits[name] = f"{limit:,.0f}" if limit >= 1e4 else f"{limit:g}"
    number = "a whole number" if kind is int else "a number"
    if error.get("type") == "finite_number":
        return "a finite number"
    unit = (field.alias or "").rpartition("-")[2]
    unit = f" {unit}" if unit in _UNITS else ""
    if {"ge", "le"} <= limits.keys():
        return f"{number} between {limits['ge']} and {limits['le']}{unit}"
    words = {"gt": "above", "ge": "of at least", "lt": "below", "le": "of at most"}
    if limits:
        return f"{number} " + " and ".join(f"{words[x]} {limits[x]}" for x in limits)
    if get_origin(kind) is tuple and error["type"] in ("missing", "too_short", "too_long"):
        return f"{len(get_args(kind))} numbers"
    if kind in (float, int):
        return number
    if kind is Path or kind is str:
        return "a text"
    return "true or false" if kind is bool else "a value of another kind"
