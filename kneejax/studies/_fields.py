"""Types of the fields of studies, plans and questions: parameters, angles, loads, objects; and what
may be asked of a study: one model a command, whose fields are the command's options.

An option has the name of its field, but for `indices`, which is `--global`. No JAX is imported.
"""

__all__ = ["Identify", "Map", "Sensitivity", "file_named", "misspelt"]

import dataclasses
import math
import os
import re
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import GetCoreSchemaHandler, PlainValidator, ValidationInfo
from pydantic_core import core_schema

from kneejax.files import reading
from kneejax.files.reading import Choice, InputProblem, Part, by_parameter, meaning, reads, wrong
from kneejax.quantities import FIBRE_QUANTITIES, RANGES, Range, nearest_name

if TYPE_CHECKING:
    from numpy import ndarray

    from kneejax.inference import Candidate
else:
    # Options are read, and help is printed, without NumPy.
    ndarray = Candidate = Any


class Options(Part):
    """What a command is asked for, as one model for the command line and for Python. In errors the
    name of a field stands in the place of a file."""

    def __init__(self, **fields: Any):
        """Check all fields."""
        try:
            reading.fill(self, reading.plain(fields))
        except ValueError as found:
            every = [*getattr(found, "problems", (found,))]
            for row, one in enumerate(every):
                if isinstance(one, InputProblem):
                    name = re.split(r"[.\[]", one.field)[0]
                    rest = one.field.removeprefix(name).removeprefix(".") or name
                    every[row] = InputProblem(name, rest, one.value, one.expected, one.nearest)
            raise reading.together(every) from None


def misspelt(knee: str, names: Iterable[str]) -> Iterator[InputProblem]:
    """Names of parameters that the knee's file shows to be wrong, before JAX is imported.

    Only names of ligaments and groups are looked at: what a fibre has with what it wraps around,
    and names of other parts, the knee itself knows.

    Args:
        knee: bundled name or file.
        names: of parameters.

    Returns:
        Each wrong one as an error without file and field, with the name that is meant.
    """
    if knee.endswith(".json"):
        return
    from kneejax.files import named_document

    document, _ = named_document("knees", knee)
    fibres = document.get("ligaments") if isinstance(document, dict) else None
    fibres = fibres if isinstance(fibres, dict) else {}
    straight = [name for name, one in fibres.items() if isinstance(one, dict) and "wrap" not in one]
    owners = {*straight, *(document.get("groups") or ())} if fibres else set()
    for name in names:
        owner, _, quantity = name.partition(".")
        known = any(f"{one}.".startswith(f"{quantity}.") for one in FIBRE_QUANTITIES)
        near = None if known else nearest_name(quantity, FIBRE_QUANTITIES)
        if owner in owners and near:
            yield wrong(name, f"a parameter of {knee}", f"{owner}.{near}")


def file_named(value: Any, info: ValidationInfo, kind: str, known: Any = ()) -> str:
    """The path of a file that is named by what is read; refuses one that does not exist, with the
    known names that might stand in its place."""
    path = reading.folder_of(info) / reading.text(value)
    if not os.path.isfile(path):
        raise wrong(value, f"{kind}; not at {path}", known)
    return os.fspath(path)


class OrObject:
    """A part of a file by its model, or an object of Python that has been made of one, which is
    kept as it is, unless `read` checks it."""

    def __init__(self, model: type[Part], read: Callable[[Any], Any] | None = None):
        self.model, self.read = model, read

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler):
        def made(value: Any, info: core_schema.ValidationInfo) -> Any:
            if isinstance(value, dict):
                return self.model.model_validate(value, context=info.context)
            if self.read is not None and not isinstance(value, self.model):
                return self.read(value)
            if isinstance(value, str | int | float | list | None):
                return self.model.model_validate(value)
            return value

        return core_schema.with_info_plain_validator_function(made)


def angles(value: Any) -> ndarray:
    """Angles of flexion, `(n,)`, degrees, as a list or as `0:120:5`."""
    from numpy import array

    from kneejax.files import parse_flexion

    if isinstance(value, str):
        return parse_flexion(value, "", "")
    return array(reading.numbers(reading.plain(value), None, RANGES["flexion_deg"]))


#: Free coordinate -> its unit, in the order of `kneejax.geometry.FREE_COORDINATES`.
UNITS = {"adduction": "deg", "internal_rotation": "deg", "anterior": "mm", "superior": "mm",
         "lateral": "mm"}  # fmt: skip
#: Signs of a left knee in axes with Z to the person's right: adduction, internal rotation and
#: lateral shift change.
MIRROR = (1.0, -1.0, -1.0, 1.0, 1.0, -1.0)
Seed = Annotated[int, reads(reading.whole, 0)]
Parameter = Annotated[str, reads(reading.parameter_name)]
Angles = Annotated[ndarray, reads(angles)]
Values = Annotated[dict[str, float], PlainValidator(by_parameter(reading.number))]
Interval = Annotated[tuple[float, float], reads(reading.interval)]
Intervals = Annotated[
    dict[str, tuple[float, float]], PlainValidator(by_parameter(reading.interval))]
Convention = Annotated[Literal["femoral", "grood-suntay", "tibial", "femur-in-tibia"], Choice()]
#: As `kneejax.mechanics.NAMED_LOADS`.
LOAD_NAMES = ("lateral_N", "anterior_N", "compression_N", "varus_Nm", "internal_Nm")


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
        "standard deviation of measured positions; the study's otherwise", None)
    noise_deg: Annotated[float, _noise("noise_deg")] | None = meaning(
        "standard deviation of measured rotations; the study's otherwise", None)
    prior: Annotated[
        dict[str, tuple[float, float]], PlainValidator(by_parameter(_normal))] = meaning(
        "mean and standard deviation, which may be infinite, of a normal prior of a parameter or "
        "wildcard, for the posterior and the tests to make next; the study's otherwise", dict)
    posterior: reading.Flag = meaning("sample it (packages BlackJAX and ArviZ)", False)
    chains: Annotated[int, reads(reading.whole, 1, 1000)] = meaning("of the posterior's samples", 4)
    draws: Annotated[int, reads(reading.whole, 1, 1_000_000)] = meaning(
        "of each chain, after warm-up", 1000)
    seed: Seed = meaning("of the random numbers", 0)
    next_tests: Annotated[int, reads(reading.whole, 1, 1000)] = meaning(
        "how many tests to choose", 3)
    criterion: Annotated[Literal["D", "A"], Choice()] = meaning(
        "what they make small: the volume of the confidence region (D), or the mean squared "
        "standard error (A)", "D")
    candidates: tuple[Candidate, ...] | None = meaning(
        "tests to choose from; a usual set otherwise", None)


class Map(Options):
    """Asks how the objective looks over pairs of parameters.

    Example:
        >>> from kneejax import Map
        >>> Map(pair=[("ACL.stiffness", "PCL.stiffness")], grid=(21, 21)).grid
        (21, 21)
    """

    pair: Annotated[
        tuple[tuple[reading.Text, reading.Text], ...], reading.entries("pairs", empty=True)
    ] = meaning("two parameters, the first along x", ())
    all_pairs: reading.Flag = meaning("every pair of the study's parameters", False)
    grid: Annotated[tuple[int, int], reads(_points)] = meaning("points along x and y", (41, 41))
    range: Intervals = meaning(
        "parameter -> lowest and highest value; the study's bounds otherwise", dict)


class Sensitivity(Options):
    """Asks what each parameter does to the motion.

    Example:
        >>> from kneejax import Sensitivity
        >>> Sensitivity(scale="percent").scale
        'percent'
    """

    sweep: Annotated[
        dict[str, tuple[float, ...] | None], PlainValidator(by_parameter(_line))] = meaning(
        "name or wildcard -> first and last value, and how many if not as many as usual; all of "
        "the study's parameters otherwise", dict)
    scale: Annotated[Literal["prior", "percent"], Choice()] = meaning(
        "local derivatives per standard deviation of a prior, or per per cent", "prior")
    prior: Annotated[dict[str, float], PlainValidator(by_parameter(_spread))] = meaning(
        "standard deviation of a parameter or wildcard; the study's or usual ones otherwise", dict)
    indices: Annotated[Literal["sobol", "morris"], Choice()] | None = meaning(
        "global indices of the motion too (package SALib)", None)
    samples: Annotated[int, reads(reading.whole, 0, 1_000_000)] | None = meaning(
        "points of Sobol's sequence, a power of two, or Morris trajectories; 256 or 64 otherwise",
        None)
    range: Intervals = meaning("of a parameter, for global indices; as wide as its prior otherwise",
                               dict)
    seed: Seed = meaning("of the random numbers", 0)

    @reading.checks
    def _check_used(self, _: reading.Mistakes) -> None:
        """What would have no effect is a misunderstanding."""
        if self.indices is None:
            for name in ("range", "samples"):
                if getattr(self, name) not in ({}, None):
                    expected = "global indices (--global sobol or morris)"
                    raise wrong("none", expected, at=f"{name}.indices")
            if self.prior and self.scale == "percent":
                raise wrong("percent", "--scale prior, or global indices", at="prior.scale")
