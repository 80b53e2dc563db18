"""A calibration's result.json, read back: which knee, with which numbers."""

from __future__ import annotations

import dataclasses
import json
import os

from kneejax.files.reading import Field, InputProblem, read_text
from kneejax.geometry import FREE_COORDINATES
from kneejax.mechanics import Range, range_of_parameter


@dataclasses.dataclass(frozen=True)
class Calibrated:
    """What a calibration found.

    Attributes:
        knee: name or file of the knee that was calibrated.
        values: parameter -> value; those that the study fixed, then those that it found.
        frame_offset: free coordinate -> what is added to the knee's motion to compare it with the
            measured one, mm or degrees.
    """

    knee: str
    values: dict[str, float]
    frame_offset: dict[str, float]


def read_calibrated(path: str | os.PathLike[str]) -> Calibrated:
    """Read the result.json that `kneejax calibrate` wrote.

    Args:
        path: the file.

    Returns:
        The knee and its numbers; `kneejax.parameters.with_values` puts them into it.

    Raises:
        InputProblem: the file cannot be read or is no such result.
    """
    file, expected = os.fspath(path), "a result.json of kneejax calibrate"
    try:
        document = json.loads(read_text(path, expected))
    except json.JSONDecodeError as error:
        raise InputProblem(file, f"line {error.lineno}", error.msg, "JSON") from None
    if not isinstance(document, dict) or "parameters" not in document:
        raise InputProblem(file, "parameters", "missing", expected)
    whole = Field(file, "", document)
    settings = _fields(whole, "settings")
    overrides = _fields(whole["settings"], "overrides") if settings else {}
    values = {name: one.number(range_of_parameter(name)) for name, one in overrides.items()}
    values |= {
        name: _value(one, range_of_parameter(name))
        for name, one in _fields(whole, "parameters").items()
    }
    shifts = {
        name.removesuffix("_deg").removesuffix("_mm"): one
        for name, one in _fields(whole, "frame_offset").items()
    }
    offsets = {name: _value(one) for name, one in shifts.items() if name in FREE_COORDINATES}
    knee = settings.get("knee") or _found(whole, "knee")
    return Calibrated(knee.text(), values, offsets)


def _fields(of: Field, name: str) -> dict[str, Field]:
    """What a mapping holds; nothing where it is missing or null."""
    if of.value.get(name) is None:
        return {}
    field = of[name]
    if not isinstance(field.value, dict):
        raise field.problem("a mapping")
    return {key: field[key] for key in field.value}


def _value(of: Field, allowed: Range | None = None) -> float:
    return _found(of, "value").number(allowed)


def _found(of: Field, name: str) -> Field:
    if not isinstance(of.value, dict):
        raise of.problem(f"a mapping with the field {name}")
    if name not in of:
        place = f"{of.path}.{name}" if of.path else name
        raise InputProblem(of.file, place, "missing", "this field")
    return of[name]
