"""Types of the fields of studies, plans and questions: parameters, angles, loads, objects."""

import os
import re
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import GetCoreSchemaHandler, PlainValidator, ValidationInfo
from pydantic_core import core_schema

from kneejax.files import reading
from kneejax.files.reading import InputProblem, Part, by_parameter, interval, plain, reads, wrong
from kneejax.quantities import FIBRE_QUANTITIES, RANGES, nearest_name

if TYPE_CHECKING:
    from numpy import ndarray
else:
    # Options are read, and help is printed, without NumPy.
    ndarray = Any


class Options(Part):
    """What a command is asked for, as one model for the command line and for Python.

    Raises:
        InputProblem: a field is not what it should be; `InputProblems` where several are. In the
            place of a file stands the name of the field.
    """

    def __init__(self, **fields: Any):
        """Check all fields."""
        try:
            reading.fill(self, plain(fields))
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
    return array(reading.numbers(plain(value), None, RANGES["flexion_deg"]))


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
Interval = Annotated[tuple[float, float], reads(interval)]
Intervals = Annotated[dict[str, tuple[float, float]], PlainValidator(by_parameter(interval))]
Convention = Annotated[Literal["femoral", "grood-suntay", "tibial", "femur-in-tibia"],
                       reading.Choice()]
LoadName = Literal["lateral_N", "anterior_N", "compression_N", "varus_Nm", "internal_Nm"]
