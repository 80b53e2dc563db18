"""What may be asked of a study: one model a command, whose fields are the command's options.

An option has the name of its field, but for `indices`, which is `--global`. No JAX is imported.
"""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import Field as described
from pydantic import model_validator

from kneejax._ranges import RANGES, Range
from kneejax.files import InputProblem
from kneejax.files.reading import Field
from kneejax.studies._checked import (
    Choice,
    Flag,
    Intervals,
    Options,
    Seed,
    Text,
    entries,
    of_parameters,
    reads,
    whole,
)

if TYPE_CHECKING:
    from kneejax.inference import Candidate
else:
    Candidate = Any


def _noise(name: str):
    # Nothing is measured without noise.
    return reads(lambda field: field.number(dataclasses.replace(RANGES[name], or_zero=False)))


def _normal(field: Field, allowed: Range | None) -> tuple[float, float]:
    """Mean and standard deviation, which may be infinite."""
    mean, width = (item.value for item in field.items("numbers", 2))
    place = Field(field.file, field.path, width)
    Field(field.file, field.path, mean).number(allowed)
    return mean, math.inf if width == math.inf else place.number(allowed and allowed.spread)


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

    noise_mm: Annotated[float, _noise("noise_mm")] | None = described(
        None, description="standard deviation of measured positions; the study's otherwise"
    )
    noise_deg: Annotated[float, _noise("noise_deg")] | None = described(
        None, description="standard deviation of measured rotations; the study's otherwise"
    )
    prior: Annotated[dict[str, tuple[float, float]], of_parameters(_normal)] = described(
        default_factory=dict,
        description="mean and standard deviation, which may be infinite, of a normal prior of a "
        "parameter or wildcard, for the posterior",
    )
    posterior: Flag = described(False, description="sample it (packages BlackJAX and ArviZ)")
    chains: Annotated[int, whole(1, 1000)] = described(4, description="of the posterior's samples")
    draws: Annotated[int, whole(1, 1_000_000)] = described(
        1000, description="of each chain, after warm-up"
    )
    seed: Seed = described(0, description="of the random numbers")
    next_tests: Annotated[int, whole(1, 1000)] = described(
        3, description="how many tests to choose"
    )
    criterion: Annotated[Literal["D", "A"], Choice()] = described(
        "D",
        description="what they make small: the volume of the confidence region (D), or the mean "
        "squared standard error (A)",
    )
    candidates: tuple[Candidate, ...] | None = described(
        None, description="tests to choose from; a usual set otherwise"
    )


class Map(Options):
    """Asks how the objective looks over pairs of parameters."""

    pair: Annotated[tuple[tuple[Text, Text], ...], entries("pairs", empty=True)] = described(
        (), description="two parameters, the first along x"
    )
    all_pairs: Flag = described(False, description="every pair of the study's parameters")
    grid: tuple[Annotated[int, whole(2, 2000)], Annotated[int, whole(2, 2000)]] = described(
        (41, 41), description="points along x and y"
    )
    range: Intervals = described(
        default_factory=dict,
        description="parameter -> lowest and highest value; the study's bounds otherwise",
    )


class Sensitivity(Options):
    """Asks what each parameter does to the motion."""

    sweep: Annotated[dict[str, tuple[float, ...] | None], of_parameters(_line)] = described(
        default_factory=dict,
        description="name or wildcard -> first and last value, and how many if not as many as "
        "usual; all of the study's parameters otherwise",
    )
    scale: Annotated[Literal["prior", "percent"], Choice()] = described(
        "prior",
        description="local derivatives per standard deviation of a prior, or per per cent",
    )
    prior: Annotated[
        dict[str, float], of_parameters(lambda field, own: field.number(own and own.spread))
    ] = described(
        default_factory=dict,
        description="standard deviation of a parameter or wildcard; usual ones otherwise",
    )
    indices: Annotated[Literal["sobol", "morris"], Choice()] | None = described(
        None, description="global indices of the motion too (package SALib)"
    )
    samples: Annotated[int, whole(0, 1_000_000)] | None = described(
        None,
        description="points of Sobol's sequence, a power of two, or Morris trajectories; 256 or 64 "
        "otherwise",
    )
    range: Intervals = described(
        default_factory=dict,
        description="of a parameter, for global indices; as wide as its prior otherwise",
    )
    seed: Seed = described(0, description="of the random numbers")

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
