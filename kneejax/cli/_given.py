"""Numbers as words of a command, held against what such a quantity can be at all."""

from __future__ import annotations

import argparse
import contextlib
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence

from kneejax.files import InputProblem
from kneejax.files.reading import plain_number
from kneejax.mechanics import NAMED_LOADS, RANGES, Range, load_called, load_opposite_to
from kneejax.numerics import WrongValue
from kneejax.studies import Identify, Map, Sensitivity

#: Arguments that an option gives under another name.
_OPTION_OF = {"flexion_deg": "--flexion", "held": "--hold"}


def given(arguments: argparse.Namespace, option: str) -> bool:
    """Whether an option was given, be it as 0, which equals False."""
    value = getattr(arguments, option)
    return value is not None and value is not False and value != []


def refused(command: str, problem: WrongValue) -> InputProblem:
    """What a calculation does not take, said of the option that gave it.

    Args:
        command: which was asked for.
        problem: of the calculation.
    """
    option = _OPTION_OF.get(problem.field, f"--{problem.field}")
    return InputProblem(command, option, problem.found, problem.expected)


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
        number = plain_number(value)
        if not found or number is None or not math.isfinite(number):
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
            known, meant = f"one of {', '.join(NAMED_LOADS)}", load_opposite_to(name)
            near = f"{meant}={-size:g}" if meant else load_called(name) or NAMED_LOADS
            raise InputProblem("--load", "name", name, known, near)
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


def read_texts(option: str, words: Iterable[str]) -> dict[str, str]:
    """Read `NAME=TEXT`, or a name alone, each name once.

    Args:
        option: where they stand.
        words: one each.

    Raises:
        InputProblem: a name given twice.
    """
    texts: dict[str, str] = {}
    for word in words:
        name, _, text = word.partition("=")
        if name in texts:
            raise InputProblem(option, name, word, "every name once")
        texts[name] = text
    return texts


def read_numbers(
    option: str, texts: Mapping[str, str], form: str, counts: Sequence[int]
) -> dict[str, tuple[float, ...]]:
    """Read numbers with colons between them; what they may be is for the study to say.

    Args:
        option: where they stand.
        texts: name -> text.
        form: of a word, for the error.
        counts: how many numbers there may be.

    Raises:
        InputProblem: a text of another form.
    """
    found: dict[str, tuple[float, ...]] = {}
    for name, text in texts.items():
        stated = [plain_number(part) for part in text.split(":")]
        found[name] = tuple(x for x in stated if x is not None)
        if len(stated) not in counts or len(found[name]) < len(stated):
            raise InputProblem(option, name, text, form)
    return found


@contextlib.contextmanager
def said_of_options(asked: type[Identify | Map | Sensitivity]) -> Iterator[None]:
    """Let what is wrong with options name the option where it was asked."""
    try:
        yield
    except InputProblem as problem:
        if problem.file not in asked.model_fields:
            raise
        option = {"indices": "--global"}.get(problem.file, "--" + problem.file.replace("_", "-"))
        raise InputProblem(
            option, problem.field, problem.value, problem.expected, problem.nearest
        ) from None
