"""Types of the fields of studies, plans and questions: parameters, angles, loads, objects."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import GetCoreSchemaHandler, PlainValidator
from pydantic_core import core_schema

from kneejax.files import reading
from kneejax.files.reading import Choice, InputProblem, Part, by_parameter, interval, plain, reads
from kneejax.quantities import RANGES

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
        except ValueError as problem:
            every = getattr(problem, "problems", (problem,))
            raise reading.together([_of_option(one) for one in every]) from None


def _of_option(problem: ValueError) -> ValueError:
    if not isinstance(problem, InputProblem):
        return problem
    name, _, rest = problem.field.partition(".")
    name, _, number = name.partition("[")
    rest = rest or (f"[{number}" if number else name)
    return InputProblem(name, rest, problem.value, problem.expected, problem.nearest)


class OrObject:
    """A part of a file, or an object of Python that has been made of one.

    Attributes:
        model: the part's model.
        read: what an object is checked and kept by; it is kept as it is without.
    """

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
Intervals = Annotated[
    dict[str, tuple[float, float]], PlainValidator(by_parameter(interval))
]
Convention = Annotated[
    Literal["femoral", "grood-suntay", "tibial", "femur-in-tibia"], Choice()
]
LoadName = Literal["lateral_N", "anterior_N", "compression_N", "varus_Nm", "internal_Nm"]
