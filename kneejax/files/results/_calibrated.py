"""A calibration's result.json, read back: which knee, with which numbers."""

from __future__ import annotations

import dataclasses
import os
from typing import Annotated, Any

from pydantic import ConfigDict, PlainValidator, model_validator

from kneejax.files import reading
from kneejax.files.reading import Flag, InputProblem, Mistakes, Part, Text, meaning, reads, wrong
from kneejax.geometry import FREE_COORDINATES
from kneejax.mechanics import Knee, range_of_parameter
from kneejax.parameters import MEANING, fibres_summed


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
        of_fibres: whether the file is older than stiffnesses that are sums over a structure's
            fibres: its values are their means, and `of_structures` converts them.
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
    of_fibres: bool = False

    @property
    def values(self) -> dict[str, float]:
        """Parameter -> value; those that the study fixed, then those that it found."""
        return self.fixed | self.found

    def of_structures(self, knee: Knee) -> Calibrated:
        """The same with a structure's stiffness as the sum over its fibres.

        Args:
            knee: that was calibrated; it says how many fibres a structure has.
        """
        if not self.of_fibres:
            return self
        fixed, found, errors = (
            {name: value * fibres_summed(knee, name) for name, value in values.items()}
            for values in (self.fixed, self.found, self.standard_error)
        )
        return dataclasses.replace(
            self, fixed=fixed, found=found, standard_error=errors, of_fibres=False
        )


def _estimate(value: Any, name: str) -> Estimate:
    """What was found of a parameter, or of a constant between frames."""
    found, mistakes = Estimate.model_validate(value), Mistakes()
    with mistakes.gathered("value"):
        number = reading.number(found.value, range_of_parameter(name))
        return found.model_copy(update={"value": number})
    raise reading.together(mistakes)


def _coordinate(name: str) -> str:
    """The name of a free coordinate, perhaps with its unit, as in older files."""
    if name.removesuffix("_deg").removesuffix("_mm") not in FREE_COORDINATES:
        raise wrong(name, FREE_COORDINATES)
    return name


class Written(Part):
    """A part of a file that the package wrote; what else it says is of no concern."""

    model_config = ConfigDict(extra="ignore")


class Estimate(Written):
    """What was found of a number."""

    value: Any = meaning("in its own unit")
    standard_error: Annotated[float, reads(reading.number)] | None = meaning("if known", None)


#: Parameter -> value.
Numbers = Annotated[
    dict[str, float],
    PlainValidator(
        reading.mapping_of(lambda x, name: reading.number(x, range_of_parameter(name)), "a mapping")
    ),
]


class StudySettings(Written):
    """What the study said."""

    knee: Text | None = meaning("name or file", None)
    path: Any = meaning("of the study", None)
    patella: Flag = meaning("whether the knee had its patella", False)
    overrides: Numbers | None = meaning("what the study set", None)
    start: Numbers | None = meaning("where it began", None)


class Correlation(Written):
    """Of the estimates; nothing stands for zero."""

    parameters: Annotated[tuple[Text, ...], reading.entries("names", empty=True)] = meaning(
        "names", ()
    )
    matrix: Any = meaning("rows")

    @model_validator(mode="after")
    def _check_square(self) -> Correlation:
        if self.matrix:
            count = len(reading.items([*self.parameters], "names"))
            every = [[0.0 if x is None else x for x in reading.items(row, "numbers", count)]
                     for row in reading.items(self.matrix, "rows", count)]  # fmt: skip
            object.__setattr__(self, "matrix", tuple(reading.rows(every, count)))
        return self


class ResultFile(Written):
    """What of a result.json is read again."""

    title: Any = meaning("of the study", None)
    knee: Text = meaning("name or file, in older files", "")
    parameters: Annotated[
        dict[str, Estimate], PlainValidator(reading.mapping_of(_estimate, "a mapping"))
    ] | None = meaning("parameter -> estimate", None)
    settings: StudySettings | None = meaning("of the study", None)
    noise: dict[str, Annotated[float, reads(reading.number)] | None] | None = meaning(
        "estimated", None
    )
    frame_offset: Annotated[
        dict[str, Estimate], PlainValidator(reading.mapping_of(_estimate, "a mapping", _coordinate))
    ] | None = meaning("free coordinate -> constant between frames", None)
    correlation: Correlation | None = meaning("of the estimates", None)
    stiffness_of: Annotated[str, reading.one_of(MEANING.values())] | None = meaning(
        "of what a structure's stiffness is", None
    )

    @model_validator(mode="after")
    def _check_knee(self) -> ResultFile:
        if not self.knee and not (self.settings and self.settings.knee):
            raise wrong("missing", "this field", at="knee")
        return self


def read_calibrated(path: str | os.PathLike[str]) -> Calibrated:
    """Read the result.json that `kneejax calibrate` wrote.

    Args:
        path: the file.

    Returns:
        The knee and its numbers; `kneejax.load_knee` of the same file puts them into it. Numbers of
        an older file await `of_structures`.

    Raises:
        InputProblem: the file cannot be read or is no such result.
    """
    file, expected = os.fspath(path), "a result.json of kneejax calibrate"
    document = reading.load_json(path, expected)
    if not isinstance(document, dict) or "parameters" not in document:
        raise InputProblem(file, "parameters", "missing", expected)
    whole = reading.checked(ResultFile, document, file, nulls=True)
    settings, found = whole.settings or StudySettings(), whole.parameters or {}
    words = [word if isinstance(word, str) else "" for word in (whole.title, settings.path)]
    named = whole.correlation
    return Calibrated(
        settings.knee or whole.knee,
        {**(settings.overrides or {}), **(settings.start or {})},
        {name: one.value for name, one in found.items()},
        {name.removesuffix("_deg").removesuffix("_mm"): one.value
         for name, one in (whole.frame_offset or {}).items()},
        f"{words[0]} ({words[1]})" if all(words) else words[0] or words[1],
        {name: sd for name, sd in (whole.noise or {}).items() if sd},
        {name: one.standard_error for name, one in found.items() if one.standard_error is not None},
        (named.parameters, named.matrix) if named and named.matrix else ((), ()),
        settings.patella,
        whole.stiffness_of is None,
    )  # fmt: skip
