"""Numbers of a knee that a file or an option names: an error says where the name stands."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Mapping

from kneejax.files.reading import InputProblem
from kneejax.mechanics import Implausible, Knee
from kneejax.parameters import UnknownParameter, UnsuitableData, with_values


def knee_with(
    knee: Knee, values: Mapping[str, float], given_in: str | os.PathLike[str]
) -> Knee:
    """The knee with some parameters set by name.

    Args:
        knee: any knee.
        values: parameter -> value, in its own unit.
        given_in: the file or the option that says so.

    Raises:
        InputProblem: a value that no knee has, or one that leads to such a knee.
        UnknownParameter: the knee has no parameter of this name.

    Example:
        >>> from kneejax.files import load_knee
        >>> knee = knee_with(load_knee("four_ligament"), {"ACL.stiffness": 300.0}, "--set")
        >>> float(knee.ligaments.stiffness[0])
        300.0
    """
    try:
        with said_of(given_in):
            return with_values(knee, dict(values))
    except Implausible as problem:
        field = f"{problem.fibre}.{problem.quantity}"
        raise InputProblem(given_in, field, problem.value, problem.expected) from None


@contextlib.contextmanager
def said_of(place: str | os.PathLike[str]) -> Iterator[None]:
    """Let an unknown name, or data that suit nothing, say where it stands: the file or option."""
    try:
        yield
    except (UnknownParameter, UnsuitableData) as problem:
        raise type(problem)(f"{os.fspath(place)}: {problem}") from None
