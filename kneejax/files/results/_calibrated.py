"""A calibration's result.json, read back: which knee, with which numbers."""

from __future__ import annotations

import dataclasses
import os

from kneejax.files.reading import Field, InputProblem, load_json
from kneejax.geometry import FREE_COORDINATES
from kneejax.mechanics import Range, range_of_parameter

#: Fields of a study's settings with values by parameter, in the order in which they are set.
_FIXED = ("overrides", "start")


@dataclasses.dataclass(frozen=True)
class Calibrated:
    """What a calibration found.

    Attributes:
        knee: name or file of the knee that was calibrated.
        fixed: parameter -> value of the study: those that it set, then those where it began.
        found: parameter -> value that the calibration found.
        frame_offset: free coordinate -> what is added to the knee's motion to compare it with the
            measured one, mm or degrees.
        study: its title and its file; empty where the result does not say.
        noise: free coordinate -> standard deviation of its measurement, degrees and mm, as stated
            or estimated; empty where the result does not say.
        standard_error: parameter -> its standard error; those that the data do not determine are
            left out.
        correlation: parameters, and the correlation of their estimates as rows; empty where the
            result does not say.
        patella: whether the knee had its patella.
    """

    knee: str
    fixed: dict[str, float]
    found: dict[str, float]
    frame_offset: dict[str, float]
    study: str = ""
    noise: dict[str, float] = dataclasses.field(default_factory=dict)
    standard_error: dict[str, float] = dataclasses.field(default_factory=dict)
    correlation: tuple[tuple[str, ...], tuple[tuple[float, ...], ...]] = ((), ())
    patella: bool = False

    @property
    def values(self) -> dict[str, float]:
        """Parameter -> value; those that the study fixed, then those that it found."""
        return self.fixed | self.found


def read_calibrated(path: str | os.PathLike[str]) -> Calibrated:
    """Read the result.json that `kneejax calibrate` wrote.

    Args:
        path: the file.

    Returns:
        The knee and its numbers; `kneejax.load_knee` of the same file puts them into it.

    Raises:
        InputProblem: the file cannot be read or is no such result.
    """
    file, expected = os.fspath(path), "a result.json of kneejax calibrate"
    document = load_json(path, expected)
    if not isinstance(document, dict) or "parameters" not in document:
        raise InputProblem(file, "parameters", "missing", expected)
    whole = Field(file, "", document)
    settings = _fields(whole, "settings")
    stated = [_fields(whole["settings"], name) if settings else {} for name in _FIXED]
    fixed = {
        name: one.number(range_of_parameter(name))
        for fields in stated
        for name, one in fields.items()
    }
    found = {
        name: _value(one, range_of_parameter(name))
        for name, one in _fields(whole, "parameters").items()
    }
    knee = settings.get("knee") or _found(whole, "knee")
    words = [whole.value.get("title"), settings["path"].value if "path" in settings else None]
    title, path = [word if isinstance(word, str) else "" for word in words]
    study = f"{title} ({path})" if title and path else title or path
    noise = {name: one.number() for name, one in _fields(whole, "noise").items() if one.value}
    errors = {
        name: one["standard_error"].number()
        for name, one in _fields(whole, "parameters").items()
        if one.value.get("standard_error") is not None
    }
    patella = "patella" in settings and settings["patella"].boolean()
    return Calibrated(
        knee.text(), fixed, found, _offsets(whole), study, noise, errors, _correlation(whole),
        patella,
    )  # fmt: skip


def _correlation(whole: Field) -> tuple[tuple[str, ...], tuple[tuple[float, ...], ...]]:
    """Names, and rows of a matrix in which nothing stands for zero; empty where it is missing."""
    if not _fields(whole, "correlation"):
        return (), ()
    matrix = _found(whole["correlation"], "matrix")
    if not matrix.value:
        return (), ()
    listed = _found(whole["correlation"], "parameters").items("names")
    names = tuple(item.text() for item in listed)
    rows = [
        tuple(0.0 if x.value is None else x.number() for x in row.items("numbers", len(names)))
        for row in matrix.items("rows", len(names))
    ]
    return names, tuple(rows)


def _offsets(whole: Field) -> dict[str, float]:
    """Constants between frames by coordinate, which older results name with its unit."""
    offsets = {}
    for name, one in _fields(whole, "frame_offset").items():
        coordinate = name.removesuffix("_deg").removesuffix("_mm")
        if coordinate not in FREE_COORDINATES:
            expected = f"one of {', '.join(FREE_COORDINATES)}"
            raise InputProblem(whole.file, "frame_offset", name, expected, FREE_COORDINATES)
        offsets[coordinate] = _value(one)
    return offsets


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
