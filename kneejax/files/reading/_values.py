"""Single values of a file, each read and checked by itself, and as fields of a model."""

__all__ = [
    "Choice", "Distinct", "Flag", "Name", "Number", "Text", "by_parameter", "choice", "deviation",
    "entries", "interval", "items", "mapping_of", "meaning", "name", "named", "number", "numbers",
    "numbers_within", "one_of", "parameter_name", "parse_flexion", "parse_range", "plain", "reads",
    "rows", "text", "whole", "within",
]

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, get_args

from pydantic import AfterValidator, BeforeValidator, Field, GetCoreSchemaHandler
from pydantic_core import core_schema

from kneejax.files.reading._model import Mistakes, together
from kneejax.files.reading._text import InputProblem, plain_number, wrong
from kneejax.quantities import RANGES, Range, nearest_name, range_of_parameter

if TYPE_CHECKING:
    import numpy as np

_T = TypeVar("_T")
#: No seed and no count is larger.
MOST = 2**32 - 1
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_+-]*")
#: Numbers of a range at most.
_MOST_VALUES = 10_000
_PARAMETER = re.compile(r"[A-Za-z*?][\w*?+-]*(\.[\w*?]+)*")


def number(value: Any, allowed: Range | None = None) -> float:
    """A finite number, within a range."""
    expected = f"a number {allowed}" if allowed else "a number"
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise wrong(value, expected)
    try:
        x = float(value)
    except OverflowError:
        x = math.inf
    if not math.isfinite(x):
        raise wrong(value, f"{expected}, finite")
    if allowed and not allowed.holds(x):
        raise wrong(value, allowed.expected(x))
    return x


def whole(value: Any, at_least: int, at_most: int = MOST) -> int:
    """A whole number."""
    is_whole = isinstance(value, int) and not isinstance(value, bool)
    if not is_whole or not at_least <= value <= at_most:
        limits = f"at least {at_least}" if at_most == MOST else f"from {at_least} to {at_most}"
        raise wrong(value, f"a whole number {limits}")
    return value


def text(value: Any) -> str:
    """A text that is not empty."""
    if not isinstance(value, str) or not value.strip():
        raise wrong(value, "a text")
    return value.strip()


def choice(value: Any, options: Iterable[str]) -> str:
    """One of several texts."""
    options = tuple(options)
    if not isinstance(value, str) or value not in options:
        raise wrong(value, options)
    return value


def _flag(value: Any) -> bool:
    if not isinstance(value, bool):
        raise wrong(value, "true or false")
    return value


def items(value: Any, kind: str, count: int | None = None) -> list:
    """A list of at least one entry, or of as many as `count`."""
    if isinstance(value, tuple) or hasattr(value, "dtype"):
        value = plain(value)
    miscounted = count is not None and isinstance(value, list) and len(value) != count
    if not isinstance(value, list) or not value or miscounted:
        raise wrong(value, f"a list of {count} {kind}" if count else f"a list of {kind}")
    return value


def numbers(
    value: Any, count: int | None = None, allowed: Range | None = None
) -> tuple[float, ...]:
    """A list of finite numbers, each within a range."""
    return tuple(_in_list(items(value, "numbers", count), number, allowed))


def interval(value: Any, allowed: Range | None = None) -> tuple[float, float]:
    """Two finite numbers, the first below the second."""
    lower, upper = numbers(value, 2, allowed)
    if lower >= upper:
        raise wrong(value, "a lower and a larger upper limit")
    return lower, upper


def rows(
    value: Any, columns: int | None = None, allowed: Range | None = None
) -> list[tuple[float, ...]]:
    """A rectangular table of finite numbers, a list of rows."""
    table = [*_in_list(items(value, "rows of numbers"), numbers, columns, allowed)]
    if len({len(row) for row in table}) != 1:
        raise wrong(value, "rows of equal length")
    return table


def _in_list(values: list, read: Callable[..., _T], *arguments: Any) -> Iterator[_T]:
    """Entries that are read so; a mistake in one says which it is."""
    for place, one in enumerate(values):
        try:
            yield read(one, *arguments)
        except InputProblem as problem:
            at = f"[{place}]{problem.field}"
            raise wrong(problem.value, problem.expected, at=at) from None


def name(value: Any) -> str:
    """A name that a person chooses."""
    if not isinstance(value, str) or not _NAME.fullmatch(value):
        raise wrong(value, "a name of letters, digits, _, + or -, beginning with a letter")
    return value


def plain(value: Any) -> Any:
    """Lists, dictionaries and numbers of Python, as a file would give them."""
    if isinstance(value, Mapping):
        return {key: plain(one) for key, one in value.items()}
    if hasattr(value, "dtype"):  # of NumPy and JAX
        return value.tolist()
    return [plain(one) for one in value] if isinstance(value, list | tuple) else value


def mapping_of(
    read: Callable[[Any, str], Any], kind: str,
    names: Sequence[str] | Callable[[Any], str] | None = None,
) -> Callable[[Any], dict[str, Any]]:  # fmt: skip
    """A reader of a mapping, a `kind` of mapping for the error, whose values are read with the
    names under which they stand: one of `names`, or what these make of a name or refuse."""

    def found(value: Any) -> dict[str, Any]:
        value = plain(value)
        if not isinstance(value, dict):
            raise wrong(value, kind)
        mistakes, values = Mistakes(), {}
        for name, one in value.items():
            if isinstance(names, Sequence) and name not in names:
                expected = f"no such field, but one of {', '.join(names)}"
                near = nearest_name(str(name), names)
                mistakes.append(wrong(one, expected, near, at=str(name)))
                continue
            with mistakes.gathered():
                key = names(name) if callable(names) else str(name)
                with mistakes.gathered(key):
                    values[key] = read(one, key)
        mistakes.check()
        return values

    return found


def by_parameter(read: Callable[[Any, Range | None], Any]) -> Callable[[Any], dict[str, Any]]:
    """A reader of a mapping from names or wildcards of parameters to what is said of them."""
    return mapping_of(lambda value, name: read(value, range_of_parameter(name)),
                      "a mapping from a parameter to its value", parameter_name)


def parameter_name(value: Any) -> str:
    """A name or a wildcard of parameters."""
    name = text(value)
    if not _PARAMETER.fullmatch(name):
        raise wrong(value, "a name such as ACL.stiffness, or a wildcard such as *.stiffness")
    return name


def deviation(value: Any, allowed: Range | None) -> float:
    """A standard deviation of what may be so large."""
    sd = number(value, allowed and allowed.spread)
    if not sd > 0:
        raise wrong(value, "a standard deviation above 0")
    return sd


def parse_flexion(text: str, file: str = "--flexion", field: str = "flexion_deg") -> "np.ndarray":
    """Flexion angles from `FROM:TO:STEP`, both ends included, or from a comma separated list.

    Args:
        text: e.g. `0:120:5` or `0,30,60`; degrees.
        file: where the text stands, for the error.
        field: likewise.

    Returns:
        Shape `(n,)`, degrees.

    Raises:
        InputProblem: the text is something else, the step leads away from the end, or an angle
            is out of range.

    Example:
        >>> parse_flexion("0:20:5").tolist()
        [0.0, 5.0, 10.0, 15.0, 20.0]
    """
    return parse_range(text, file, field, RANGES["flexion_deg"], "angle")


def parse_range(text: str, file: str, field: str, allowed: Range, of: str) -> "np.ndarray":
    """Numbers from `FROM:TO:STEP`, both ends included, or from a comma separated list.

    Args:
        text: as of `parse_flexion`.
        file: where the text stands, for the error.
        field: likewise.
        allowed: what each number may be.
        of: what one of them is, in a word.

    Returns:
        Shape `(n,)`.

    Raises:
        InputProblem: as of `parse_flexion`.

    Example:
        >>> from kneejax.mechanics import Range
        >>> lengths = Range(-20.0, 60.0, "mm")
        >>> parse_range("0:-4:-2", "--quadriceps-mm", "lengths", lengths, "length").tolist()
        [0.0, -2.0, -4.0]
    """
    import numpy as np

    def refused(expected: str) -> InputProblem:
        return InputProblem(file, field, text, expected)

    is_range = ":" in text
    stated = [plain_number(part) for part in text.split(":" if is_range else ",")]
    numbers = [x for x in stated if x is not None]
    is_stated = len(numbers) == (3 if is_range else len(stated)) == len(stated)
    if not is_stated or (is_range and not np.isfinite(numbers).all()):
        raise refused(f"FROM:TO:STEP or a comma separated list, {allowed}")
    if not all(allowed.holds(x) for x in (numbers[:2] if is_range else numbers)):
        raise refused(f"{of}s {allowed}")
    if not is_range:
        return np.array(numbers, float)
    first, last, step = numbers
    if step == 0 or (last - first) / step < 0:
        raise refused(f"a step that leads from the first {of} to the last")
    count = np.floor((last - first) / step + 1e-9) + 1
    if count > _MOST_VALUES:
        raise refused(f"at most {_MOST_VALUES} {of}s")
    return first + step * np.arange(int(count))


def meaning(description: str = "", default: Any = ..., **more: Any) -> Any:
    """A field: what it means, and its default, or what makes it."""
    kind = "default_factory" if callable(default) else "default"
    return Field(**{kind: default}, description=description or None, **more)


def reads(read: Callable[..., Any], *arguments: Any) -> BeforeValidator:
    """A value that is read so."""
    return BeforeValidator(lambda value: read(value, *arguments))


def within(quantity: str) -> BeforeValidator:
    """A finite number in the range of this name (`kneejax.mechanics.RANGES`)."""
    return reads(number, RANGES[quantity])


def numbers_within(count: int | None, quantity: str) -> BeforeValidator:
    """So many numbers in the range of this name; any number of them where None."""
    return reads(numbers, count, RANGES[quantity])


def one_of(options: Iterable[str]) -> BeforeValidator:
    """One of these texts."""
    return reads(choice, tuple(options))


class Choice:
    """One of the texts of a `Literal`; a mistake names the nearest."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler):
        options = get_args(source)
        return core_schema.no_info_before_validator_function(
            lambda value: choice(value, options), handler(source)
        )


def entries(kind: str, *, empty: bool = False, count: int | None = None) -> BeforeValidator:
    """A list with something in it; an empty one where `empty`."""

    def listed(value: Any) -> list:
        value = plain(value)
        return [] if value == [] and empty else items(value, kind, count)

    return BeforeValidator(listed)


def named(kind: str, *, empty: bool = False) -> BeforeValidator:
    """A mapping from names that a person chooses; with something in it, unless `empty`."""

    def mapping(value: Any) -> dict:
        if not isinstance(value, dict) or not (value or empty):
            raise wrong(value, f"a mapping from a name to {kind}")
        return value

    return BeforeValidator(mapping)


def _distinct(values: tuple[_T, ...]) -> tuple[_T, ...]:
    """Refuse a list with an entry twice."""
    twice = [i for i, value in enumerate(values) if value in values[:i]]
    if twice:
        raise together([wrong(values[i], "every name once", at=f"[{i}]") for i in twice])
    return values


Distinct = AfterValidator(_distinct)
Name = Annotated[str, reads(name)]
Text = Annotated[str, reads(text)]
Flag = Annotated[bool, reads(_flag)]
#: A number in the range of the name of its field.
Number = Annotated[
    float, BeforeValidator(lambda value, info: number(value, RANGES[info.field_name or ""]))
]
