"""What may be asked of a study: one model a command, whose fields are the command's options.

An option has the name of its field, but for `indices`, which is `--global`. No JAX is imported.
"""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import PlainValidator, model_validator

from kneejax.files.reading import Field, InputProblem
from kneejax.quantities import RANGES, Range
from kneejax.studies._checked import (
    Choice,
    Flag,
    Intervals,
    Options,
    Seed,
    Text,
    by_parameter,
    entries,
    reads,
    said,
    whole,
)

if TYPE_CHECKING:
    from kneejax.inference import Candidate
else:
    Candidate = Any


def _noise(name: str):
    # Nothing is measured without noise.
    return reads(lambda field: field.number(dataclasses.replace(RANGES[name], or_zero=False)))


def _spread(field: Field, allowed: Range | None) -> float:
    return field.number(allowed and allowed.spread)


def _normal(field: Field, allowed: Range | None) -> tuple[float, float]:
    """Mean and standard deviation, which may be infinite."""
    mean, width = (item.value for item in field.items("numbers", 2))
    Field(field.file, field.path, mean).number(allowed)
    place = Field(field.file, field.path, width)
    return mean, width if width == math.inf else _spread(place, allowed)


def _points(field: Field) -> list[int]:
    return [Field("", "points", one.value).integer(2, 2000) for one in field.items("points", 2)]


def _line(field: Field, allowed: Range | None) -> tuple[float, ...] | None:
    """A first and a last value, and how many; None for the usual ones."""
    if field.value is None:
        return None
    if not isinstance(field.value, list) or len(field.value) not in (2, 3):
        raise field.problem("a first and a last value, and how many if not as many as usual")
    ends = Field(field.file, field.path, field.value[:2]).interval(allowed)
    return ends + tuple(item.integer(2, 1000) for item in field.items("numbers")[2:])


class Identify(Options):
    """Asks what the data can tell, what they cannot, and what should be measured next."""

    noise_mm: Annotated[float, _noise("noise_mm")] | None = said(
        "standard deviation of measured positions; the study's otherwise", None
    )
    noise_deg: Annotated[float, _noise("noise_deg")] | None = said(
        "standard deviation of measured rotations; the study's otherwise", None
    )
    prior: Annotated[dict[str, tuple[float, float]], PlainValidator(by_parameter(_normal))] = said(
        "mean and standard deviation, which may be infinite, of a normal prior of a parameter or "
        "wildcard, for the posterior", dict,
    )  # fmt: skip
    posterior: Flag = said("sample it (packages BlackJAX and ArviZ)", False)
    chains: Annotated[int, whole(1, 1000)] = said("of the posterior's samples", 4)
    draws: Annotated[int, whole(1, 1_000_000)] = said("of each chain, after warm-up", 1000)
    seed: Seed = said("of the random numbers", 0)
    next_tests: Annotated[int, whole(1, 1000)] = said("how many tests to choose", 3)
    criterion: Annotated[Literal["D", "A"], Choice()] = said(
        "what they make small: the volume of the confidence region (D), or the mean squared "
        "standard error (A)", "D",
    )  # fmt: skip
    candidates: tuple[Candidate, ...] | None = said(
        "tests to choose from; a usual set otherwise", None
    )


class Map(Options):
    """Asks how the objective looks over pairs of parameters."""

    pair: Annotated[tuple[tuple[Text, Text], ...], entries("pairs", empty=True)] = said(
        "two parameters, the first along x", ()
    )
    all_pairs: Flag = said("every pair of the study's parameters", False)
    grid: Annotated[tuple[int, int], reads(_points)] = said("points along x and y", (41, 41))
    range: Intervals = said(
        "parameter -> lowest and highest value; the study's bounds otherwise", dict
    )


class Sensitivity(Options):
    """Asks what each parameter does to the motion."""

    sweep: Annotated[
        dict[str, tuple[float, ...] | None], PlainValidator(by_parameter(_line))
    ] = said(
        "name or wildcard -> first and last value, and how many if not as many as usual; all of "
        "the study's parameters otherwise", dict,
    )  # fmt: skip
    scale: Annotated[Literal["prior", "percent"], Choice()] = said(
        "local derivatives per standard deviation of a prior, or per per cent", "prior"
    )
    prior: Annotated[dict[str, float], PlainValidator(by_parameter(_spread))] = said(
        "standard deviation of a parameter or wildcard; usual ones otherwise", dict
    )
    indices: Annotated[Literal["sobol", "morris"], Choice()] | None = said(
        "global indices of the motion too (package SALib)", None
    )
    samples: Annotated[int, whole(0, 1_000_000)] | None = said(
        "points of Sobol's sequence, a power of two, or Morris trajectories; 256 or 64 otherwise",
        None,
    )
    range: Intervals = said(
        "of a parameter, for global indices; as wide as its prior otherwise", dict
    )
    seed: Seed = said("of the random numbers", 0)

    @model_validator(mode="after")
    def _check_used(self) -> Self:
        """What would have no effect is a misunderstanding."""
        if self.indices is None:
            for name in ("range", "samples"):
                if getattr(self, name) not in ({}, None):
                    expected = "global indices (--global sobol or morris)"
                    raise InputProblem("", f"{name}.indices", "none", expected)
            if self.prior and self.scale == "percent":
                expected = "--scale prior, or global indices"
                raise InputProblem("", "prior.scale", "percent", expected)
        return self
