"""What may be asked of a study: one model a command, whose fields are the command's options.

An option has the name of its field, but for `indices`, which is `--global`. No JAX is imported.
"""

import dataclasses
import math
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import PlainValidator, model_validator

from kneejax.files import reading
from kneejax.files.reading import Choice, Flag, InputProblem, Text, entries, meaning, reads, wrong
from kneejax.quantities import RANGES, Range
from kneejax.studies._fields import Intervals, Options, Seed

if TYPE_CHECKING:
    from kneejax.inference import Candidate
else:
    Candidate = Any


def _noise(name: str):
    # Nothing is measured without noise.
    return reads(reading.number, dataclasses.replace(RANGES[name], or_zero=False))


def _spread(value: Any, allowed: Range | None) -> float:
    return reading.number(value, allowed and allowed.spread)


def _normal(value: Any, allowed: Range | None) -> tuple[float, float]:
    """Mean and standard deviation, which may be infinite."""
    mean, width = reading.items(value, "numbers", 2)
    reading.number(mean, allowed)
    return mean, width if width == math.inf else _spread(width, allowed)


def _points(value: Any) -> list[int]:
    try:
        return [reading.whole(one, 2, 2000) for one in reading.items(value, "points", 2)]
    except InputProblem as problem:
        raise wrong(problem.value, problem.expected, at="points") from None


def _line(value: Any, allowed: Range | None) -> tuple[float, ...] | None:
    """A first and a last value, and how many; None for the usual ones."""
    if value is None:
        return None
    if not isinstance(value, list) or len(value) not in (2, 3):
        raise wrong(value, "a first and a last value, and how many if not as many as usual")
    count = tuple(reading.whole(one, 2, 1000) for one in value[2:])
    return reading.interval(value[:2], allowed) + count


class Identify(Options):
    """Asks what the data determine, what they do not, and what should be measured next.

    Example:
        >>> from kneejax import Identify
        >>> Identify(next_tests=2).next_tests
        2
    """

    noise_mm: Annotated[float, _noise("noise_mm")] | None = meaning(
        "standard deviation of measured positions; the study's otherwise", None
    )
    noise_deg: Annotated[float, _noise("noise_deg")] | None = meaning(
        "standard deviation of measured rotations; the study's otherwise", None
    )
    prior: Annotated[dict[str, tuple[float, float]],
                     PlainValidator(reading.by_parameter(_normal))] = meaning(
        "mean and standard deviation, which may be infinite, of a normal prior of a parameter or "
        "wildcard, for the posterior", dict,
    )  # fmt: skip
    posterior: Flag = meaning("sample it (packages BlackJAX and ArviZ)", False)
    chains: Annotated[int, reads(reading.whole, 1, 1000)] = meaning("of the posterior's samples", 4)
    draws: Annotated[int, reads(reading.whole, 1, 1_000_000)] = meaning(
        "of each chain, after warm-up", 1000
    )
    seed: Seed = meaning("of the random numbers", 0)
    next_tests: Annotated[int, reads(reading.whole, 1, 1000)] = meaning(
        "how many tests to choose", 3
    )
    criterion: Annotated[Literal["D", "A"], Choice()] = meaning(
        "what they make small: the volume of the confidence region (D), or the mean squared "
        "standard error (A)", "D",
    )  # fmt: skip
    candidates: tuple[Candidate, ...] | None = meaning(
        "tests to choose from; a usual set otherwise", None
    )


class Map(Options):
    """Asks how the objective looks over pairs of parameters.

    Example:
        >>> from kneejax import Map
        >>> Map(pair=[("ACL.stiffness", "PCL.stiffness")], grid=(21, 21)).grid
        (21, 21)
    """

    pair: Annotated[tuple[tuple[Text, Text], ...], entries("pairs", empty=True)] = meaning(
        "two parameters, the first along x", ()
    )
    all_pairs: Flag = meaning("every pair of the study's parameters", False)
    grid: Annotated[tuple[int, int], reads(_points)] = meaning("points along x and y", (41, 41))
    range: Intervals = meaning(
        "parameter -> lowest and highest value; the study's bounds otherwise", dict
    )


class Sensitivity(Options):
    """Asks what each parameter does to the motion.

    Example:
        >>> from kneejax import Sensitivity
        >>> Sensitivity(scale="percent").scale
        'percent'
    """

    sweep: Annotated[dict[str, tuple[float, ...] | None],
                     PlainValidator(reading.by_parameter(_line))] = meaning(
        "name or wildcard -> first and last value, and how many if not as many as usual; all of "
        "the study's parameters otherwise", dict,
    )  # fmt: skip
    scale: Annotated[Literal["prior", "percent"], Choice()] = meaning(
        "local derivatives per standard deviation of a prior, or per per cent", "prior"
    )
    prior: Annotated[dict[str, float], PlainValidator(reading.by_parameter(_spread))] = meaning(
        "standard deviation of a parameter or wildcard; usual ones otherwise", dict
    )
    indices: Annotated[Literal["sobol", "morris"], Choice()] | None = meaning(
        "global indices of the motion too (package SALib)", None
    )
    samples: Annotated[int, reads(reading.whole, 0, 1_000_000)] | None = meaning(
        "points of Sobol's sequence, a power of two, or Morris trajectories; 256 or 64 otherwise",
        None,
    )  # fmt: skip
    range: Intervals = meaning("of a parameter, for global indices; as wide as its prior otherwise",
                               dict)
    seed: Seed = meaning("of the random numbers", 0)

    @model_validator(mode="after")
    def _check_used(self) -> Self:
        """What would have no effect is a misunderstanding."""
        if self.indices is None:
            for name in ("range", "samples"):
                if getattr(self, name) not in ({}, None):
                    expected = "global indices (--global sobol or morris)"
                    raise wrong("none", expected, at=f"{name}.indices")
            if self.prior and self.scale == "percent":
                raise wrong("percent", "--scale prior, or global indices", at="prior.scale")
        return self
