"""A calibration's result.json, read back: which knee, with which numbers."""

from __future__ import annotations

import dataclasses
import json
import math
import os
from typing import Any

from kneejax.files._problem import InputProblem
from kneejax.files._text import read_text
from kneejax.geometry import FREE_COORDINATES


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
        The knee and its numbers; `kneejax.inference.with_values` puts them into it.

    Raises:
        InputProblem: the file cannot be read or is no such result.
    """
    file = os.fspath(path)
    try:
        document = json.loads(read_text(path, "a calibration's result.json"))
    except json.JSONDecodeError as error:
        raise InputProblem(file, f"line {error.lineno}", error.msg, "JSON") from None
    if not isinstance(document, dict) or not isinstance(document.get("parameters"), dict):
        raise InputProblem(file, "parameters", "missing", "the result.json of kneejax calibrate")
    settings = document.get("settings") or {}
    values = {name: _number(file, name, x) for name, x in settings.get("overrides", {}).items()}
    for name, one in document["parameters"].items():
        values[name] = _number(file, name, (one or {}).get("value"))
    offsets = {}
    for name, one in (document.get("frame_offset") or {}).items():
        coordinate = name.removesuffix("_deg").removesuffix("_mm")
        if coordinate in FREE_COORDINATES:
            offsets[coordinate] = _number(file, name, (one or {}).get("value"))
    return Calibrated(str(settings.get("knee") or document.get("knee")), values, offsets)


def _number(file: str, name: str, value: Any) -> float:
    if not isinstance(value, int | float) or not math.isfinite(value):
        raise InputProblem(file, name, value, "a finite number")
    return float(value)
