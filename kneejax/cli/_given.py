"""Numbers as words of a command, held against what such a quantity can be at all."""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Iterable, Iterator, Mapping

from kneejax.files import InputProblem
from kneejax.mechanics import (
    NAMED_LOADS,
    RANGES,
    Implausible,
    Knee,
    Range,
    load_called,
    range_of_parameter,
)
from kneejax.parameters import UnknownParameter, with_values


def read_pairs(option: str, words: Iterable[str]) -> dict[str, float]:
    """Read `NAME=NUMBER`, each name once.

    Args:
        option: where they stand.
        words: one each.

    Raises:
        InputProblem: a word of another form, a number that is not finite, a name given twice.
    """
    pairs: dict[str, float] = {}
    for word in words:
        name, found, value = word.partition("=")
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if not found or not math.isfinite(number):
            raise InputProblem(option, name, value, "NAME=NUMBER with a finite number")
        if name in pairs:
            raise InputProblem(option, name, word, "every name once")
        pairs[name] = number
    return pairs


def read_loads(words: Iterable[str]) -> dict[str, float]:
    """Read loads on the tibia, `NAME=SIZE`.

    Args:
        words: one each, with the names of `kneejax.mechanics.NAMED_LOADS`.

    Returns:
        All of these names -> size, zero where nothing was asked for; empty without any word.

    Raises:
        InputProblem: an unknown name (with the one that is meant), or a size out of range.
    """
    given = read_pairs("--load", words)
    for name, size in given.items():
        if name not in NAMED_LOADS:
            known = f"one of {', '.join(NAMED_LOADS)}"
            raise InputProblem("--load", "name", name, known, load_called(name) or NAMED_LOADS)
        check_within("--load", name, [size], RANGES[name])
    return {name: given.get(name, 0.0) for name in NAMED_LOADS} if given else {}


def check_within(option: str, name: str, values: Iterable[float], allowed: Range | None) -> None:
    """Refuse the first value that is out of its range.

    Args:
        option: where the values come from.
        name: of what they are.
        values: finite numbers.
        allowed: what they may be; None for a name that is not known, which is said elsewhere.

    Raises:
        InputProblem: a value is out of range.
    """
    for value in values:
        if allowed is not None and not allowed.holds(value):
            raise InputProblem(option, name, f"{value:g}", allowed.expected(value))


def check_parameter(option: str, name: str, values: Iterable[float]) -> None:
    """Refuse values that a parameter cannot have; as `check_within`."""
    check_within(option, name, values, range_of_parameter(name))


def check_width(option: str, name: str, width: float) -> None:
    """Refuse a standard deviation that a parameter cannot have; as `check_within`."""
    allowed = range_of_parameter(name)
    check_within(option, name, [width], allowed and allowed.spread)


def knee_with(
    knee: Knee, values: Mapping[str, float], given_in: str | os.PathLike[str]
) -> Knee:
    """The knee with some parameters set by name.

    Args:
        knee: any knee.
        values: parameter -> value.
        given_in: the file or the option that says so.

    Raises:
        InputProblem: a value that no knee has, or one that leads to such a knee.
        UnknownParameter: the knee has no parameter of this name.
    """
    try:
        with parameters_named_in(given_in):
            return with_values(knee, dict(values))
    except Implausible as problem:
        field = f"{problem.fibre}.{problem.quantity}"
        raise InputProblem(given_in, field, problem.value, problem.expected) from None


@contextlib.contextmanager
def parameters_named_in(place: str | os.PathLike[str]) -> Iterator[None]:
    """Let an `UnknownParameter` say where the name stands: the file or the option."""
    try:
        yield
    except UnknownParameter as problem:
        raise UnknownParameter(f"{os.fspath(place)}: {problem}") from None
