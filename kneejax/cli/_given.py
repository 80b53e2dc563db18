"""What was given as words of a command: its knee, its loads, and numbers within their range."""

from __future__ import annotations

from collections.abc import Mapping

from kneejax.cli.options import Simulate
from kneejax.files import InputProblem, load_knee, said_of
from kneejax.geometry import COLUMNS
from kneejax.mechanics import NAMED_LOADS, RANGES, Knee, Range, load_called, load_opposite_to
from kneejax.parameters import cut


def read_loads(given: Mapping[str, float]) -> dict[str, float]:
    """Loads on the tibia, as `kneejax.mechanics.NAMED_LOADS` has them: name -> size, zero where
    nothing was asked for, empty without any; refuses other names, and sizes out of range."""
    for name, size in given.items():
        if name not in NAMED_LOADS:
            known, meant = f"one of {', '.join(NAMED_LOADS)}", load_opposite_to(name)
            near = f"{meant}={-size:g}" if meant else load_called(name) or NAMED_LOADS
            raise InputProblem("--load", "name", name, known, near)
        check_within("--load", name, size, RANGES[name])
    return {name: given.get(name, 0.0) for name in NAMED_LOADS} if given else {}


def check_within(option: str, name: str, value: float, allowed: Range | None) -> None:
    """Refuse a value of an option that is out of its range, which is None where it may be any."""
    if allowed is not None and not allowed.holds(value):
        raise InputProblem(option, name, f"{value:g}", allowed.expected(value))


def check_columns(names: Mapping[str, str]) -> None:
    """Refuse columns of a table (column of the package -> column of the table) that are none of the
    package's, or stand for nothing."""
    for name, column in names.items():
        if name not in COLUMNS:
            raise InputProblem("--column", "name", name, COLUMNS)
        if not column:
            raise InputProblem("--column", name, column, f"one {name}=COLUMN of the table")


def whole_knee(arguments: Simulate, *, patella: bool = False) -> Knee:
    """The knee with the parameters that were set, before anything is cut."""
    knee = load_knee(arguments.knee, patella=patella)
    with said_of("--set"):
        return knee.replace(arguments.values)


def asked_knee(arguments: Simulate, *, patella: bool = False) -> Knee:
    """The knee in which what was cut does not act."""
    return cut(whole_knee(arguments, patella=patella), arguments.cut)


def knee_words(arguments: Simulate, knee: Knee) -> str:
    """What a knee is called, with what was cut."""
    return knee.name + (f" without {', '.join(arguments.cut)}" if arguments.cut else "")
