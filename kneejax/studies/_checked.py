"""Models of what a person gives: every mistake at once, each with its place and what was meant."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self, TypeVar, get_args

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    GetCoreSchemaHandler,
    PlainValidator,
    ValidationError,
    ValidationInfo,
)
from pydantic import Field as PydanticField
from pydantic_core import core_schema

from kneejax.files.reading import MOST, Field, InputProblem, InputProblems, nearest_name
from kneejax.quantities import RANGES, Range, range_of_parameter

if TYPE_CHECKING:
    from numpy import ndarray
else:
    # Options are read, and help is printed, without NumPy.
    ndarray = Any

_T = TypeVar("_T")
_PARAMETER = re.compile(r"[A-Za-z*?][\w*?+-]*(\.[\w*?]+)*")


class Part(BaseModel):
    """A mapping in a file; what is no field of it is a mistake."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, arbitrary_types_allowed=True, populate_by_name=True,
        defer_build=True)  # fmt: skip

    def given(self) -> dict[str, Any]:
        """What was given, by the names that a file has."""
        fields = type(self).model_fields
        return {fields[name].alias or name: getattr(self, name) for name in self.model_fields_set}

    def replace(self, **changes: Any) -> Self:
        """The same with other values, checked anew."""
        return type(self)(**self.given() | changes)


class Options(Part):
    """What a command is asked for, as one model for the command line and for Python.

    Raises:
        InputProblem: a field is not what it should be; `InputProblems` where several are. In the
            place of a file stands the name of the field.
    """

    def __init__(self, **fields: Any):
        """Check all fields."""
        if mistakes := found_in(self, plain(fields)):
            raise together([_of_option(one) for one in mistakes])


def _of_option(problem: ValueError) -> ValueError:
    if not isinstance(problem, InputProblem):
        return problem
    name, _, rest = problem.field.partition(".")
    name, _, number = name.partition("[")
    rest = rest or (f"[{number}" if number else name)
    return InputProblem(name, rest, problem.value, problem.expected, problem.nearest)


class Mistakes(list[ValueError]):
    """What is wrong so far.

    Attributes:
        file: where that stands; empty where only its reader knows.
    """

    def __init__(self, file: str = ""):
        """Begin without any."""
        super().__init__()
        self.file = file

    @contextlib.contextmanager
    def gathered(self, at: str = "") -> Iterator[None]:
        """Keep a mistake in what is read at this place, and go on."""
        try:
            yield
        except ValueError as problem:
            self.keep(problem, at)

    def keep(self, problem: ValueError, at: str = "") -> None:
        """Add a mistake, or the several that an exception stands for, found at a place.

        Raises:
            ValueError: it is no mistake of a person.
        """
        for one in getattr(problem, "problems", (problem,)):
            # What else may be wrong was found by JAX's modules, which are there then.
            said = _placed if isinstance(one, InputProblem) else _explained
            self.append(said(one, self.file, at))

    def check(self) -> None:
        """Raise what was found, if anything."""
        if self:
            raise together(self)


def together(problems: Sequence[ValueError]) -> ValueError:
    """One mistake as it is; several as one exception, a line each."""
    return problems[0] if len(problems) == 1 else InputProblems(problems)


def _placed(problem: InputProblem, file: str, at: str) -> InputProblem:
    """A mistake with its file and its whole place; one that names its file has both."""
    if problem.file:
        return problem
    place = _joined(at, "" if problem.field == "file" else problem.field)
    return InputProblem(file, place or "file", problem.value, problem.expected, problem.nearest)


def _explained(problem: ValueError, file: str, at: str) -> ValueError:
    """What a calculation refuses, said of the place that asked for it."""
    from kneejax.mechanics import Implausible
    from kneejax.numerics import MissingPackage, WrongValue
    from kneejax.parameters import UnknownParameter, UnsuitableData

    match problem:
        case WrongValue():
            place = _joined(at, problem.field)
            return InputProblem(file, place, problem.found, problem.expected)
        case Implausible():
            place = f"{problem.fibre}.{problem.quantity}"
            return InputProblem(file, place, problem.value, problem.expected)
        case UnknownParameter() | UnsuitableData():
            place = ": ".join(word for word in (file, at) if word)
            return type(problem)(f"{place}: {problem}") if place else problem
        case MissingPackage():
            return problem
    raise problem


def _joined(at: str, place: str) -> str:
    apart = at and place and place[0] not in ".["
    return f"{at}.{place}" if apart else (at + place).lstrip(".")


def found_in(model: BaseModel, fields: Any, context: Any = None) -> list[ValueError]:
    """Fill a model that was made empty; the mistakes in its fields, at their places."""
    try:
        model.__pydantic_validator__.validate_python(fields, self_instance=model, context=context)
    except ValidationError as error:
        return _mistakes(error, type(model))
    return []


def _mistakes(error: ValidationError, model: type[BaseModel]) -> list[ValueError]:
    found = Mistakes()
    every = error.errors(include_url=False)
    misspelt = set()
    for one in every:
        *above, name = one["loc"] or ("",)
        if one["type"] == "extra_forbidden":
            known = [field.alias or own for own, field in _at(model, above).model_fields.items()]
            missing = [e["loc"][-1] for e in every
                       if e["type"] == "missing" and [*e["loc"][:-1]] == above]  # fmt: skip
            near = nearest_name(str(name), missing) or nearest_name(str(name), known)
            misspelt.add((*above, near))
            expected = f"no such field, but one of {', '.join(known)}"
            found.append(InputProblem("", _path(one["loc"]), one["input"], expected, near))
    for one in every:
        place = _path(one["loc"])
        match one["type"]:
            case "extra_forbidden":
                continue
            case "value_error":
                found.keep(one.get("ctx", {})["error"], place)
            case "missing" if one["loc"] in misspelt:
                continue
            case "missing":
                found.append(InputProblem("", place, "missing", "this field"))
            case _:
                fields = _at(model, one["loc"]).model_fields
                required = [name for name, field in fields.items() if field.is_required()]
                expected = f"a mapping with the fields {', '.join(required or fields)}"
                found.append(InputProblem("", place or "file", one["input"], expected))
    return found


def _path(loc: Sequence[Any]) -> str:
    return "".join(f"[{x}]" if isinstance(x, int) else f".{x}" for x in loc).lstrip(".")


def _at(model: type[BaseModel], loc: Sequence[Any]) -> type[BaseModel]:
    """The model of what stands at a place."""
    for name in loc:
        if isinstance(name, str):
            (field,) = [f for own, f in model.model_fields.items() if name in (own, f.alias)]
            model = next(_models((field.annotation, *field.metadata)))
    return model


def _models(annotations: Sequence[Any]) -> Iterator[type[BaseModel]]:
    for one in annotations:
        if isinstance(one, type) and issubclass(one, BaseModel):
            yield one
        yield from _models([*get_args(one), *getattr(one, "models", ())])


def folder_of(info: ValidationInfo) -> Path:
    """To which paths in what is read are relative."""
    return (info.context or {}).get("folder", Path())


def plain(value: Any) -> Any:
    """Lists, dictionaries and numbers of Python, as a file would give them."""
    if isinstance(value, Mapping):
        return {name: plain(one) for name, one in value.items()}
    if hasattr(value, "dtype"):  # of NumPy and JAX
        return value.tolist()
    return [plain(one) for one in value] if isinstance(value, list | tuple) else value


def said(description: str, default: Any = ..., **more: Any) -> Any:
    """A field: what it means, and its default, or what makes it."""
    kind = "default_factory" if callable(default) else "default"
    return PydanticField(**{kind: default}, description=description, **more)


def reads(read: Callable[[Field], Any]) -> BeforeValidator:
    """A value that is read as one of a file is."""
    return BeforeValidator(lambda value: read(Field("", "", value)))


def within(name: str) -> BeforeValidator:
    """A finite number in the range of this name (`kneejax.mechanics.RANGES`)."""
    return reads(lambda field: field.number(RANGES[name]))


def whole(at_least: int, at_most: int = MOST) -> BeforeValidator:
    """A whole number between limits."""
    return reads(lambda field: field.integer(at_least, at_most))


class Choice:
    """One of the texts of a `Literal`; a mistake names the nearest."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler):
        options = get_args(source)
        return core_schema.no_info_before_validator_function(
            lambda value: Field("", "", value).choice(options), handler(source)
        )


class OrObject:
    """A part of a file, or an object of Python that has been made of one.

    Attributes:
        models: the part's model.
        read: what an object is checked and kept by; it is kept as it is without.
    """

    def __init__(self, model: type[Part], read: Callable[[Field], Any] | None = None):
        self.models, self.read = (model,), read

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler):
        (model,) = self.models

        def made(value: Any, info: core_schema.ValidationInfo) -> Any:
            if isinstance(value, dict):
                return model.model_validate(value, context=info.context)
            if self.read is not None and not isinstance(value, model):
                return self.read(Field("", "", value))
            if isinstance(value, str | int | float | list | None):
                return model.model_validate(value)
            return value

        return core_schema.with_info_plain_validator_function(made)


def entries(kind: str, *, empty: bool = False) -> BeforeValidator:
    """A list with something in it; an empty one where `empty`."""

    def listed(field: Field) -> list:
        own = Field("", "", plain(field.value))
        return [] if own.value == [] and empty else [item.value for item in own.items(kind)]

    return reads(listed)


def _distinct(values: tuple[_T, ...]) -> tuple[_T, ...]:
    """Refuse a list with an entry twice."""
    twice = [i for i, value in enumerate(values) if value in values[:i]]
    if twice:
        again = [InputProblem("", f"[{i}]", values[i], "every name once") for i in twice]
        raise together(again)
    return values


def mapping_of(
    read: Callable[[Field, str], Any],
    kind: str,
    names: Sequence[str] | Callable[[Field, Any], str] | None = None,
) -> Callable[[Any], dict[str, Any]]:
    """A reader of a mapping whose values are read with the names under which they stand.

    Args:
        read: takes a value and its name.
        kind: what the mapping is, for the error.
        names: that there may be, or what takes a name and its value and refuses a wrong one.
    """

    def name_of(name: str, value: Any) -> str:
        if callable(names):
            return names(Field("", "", name), value)
        if names is not None:
            Field("", "", {name: value}).mapping((), names)
        return name

    def found(value: Any) -> dict[str, Any]:
        value = plain(value)
        if not isinstance(value, dict):
            raise Field("", "", value).problem(kind)
        mistakes, values = Mistakes(), {}
        for name, one in value.items():
            with mistakes.gathered():
                key = name_of(name, one)
                values[key] = read(Field("", key, one), key)
        mistakes.check()
        return values

    return found


def by_parameter(read: Callable[[Field, Range | None], Any]) -> Callable[[Any], dict[str, Any]]:
    """A reader of a mapping from names or wildcards of parameters to what is said of them."""
    return mapping_of(
        lambda field, name: read(field, range_of_parameter(name)),
        "a mapping from a parameter to its value",
        parameter_name,
    )


def parameter_name(field: Field, _: Any = None) -> str:
    """A name or a wildcard of parameters.

    Raises:
        InputProblem: it can be neither.
    """
    name = field.text()
    if not _PARAMETER.fullmatch(name):
        raise field.problem("a name such as ACL.stiffness, or a wildcard such as *.stiffness")
    return name


def deviation(field: Field, allowed: Range | None) -> float:
    """A standard deviation of what may be so large."""
    sd = field.number(allowed and allowed.spread)
    if not sd > 0:
        raise field.problem("a standard deviation above 0")
    return sd


def angles(field: Field) -> ndarray:
    """Angles of flexion, `(n,)`, degrees, as a list or as `0:120:5`."""
    from numpy import array

    from kneejax.files import parse_flexion

    if isinstance(field.value, str):
        return parse_flexion(field.value, field.file, field.path)
    return array(field.numbers(allowed=RANGES["flexion_deg"]))


#: Free coordinate -> its unit, in the order of `kneejax.geometry.FREE_COORDINATES`.
UNITS = {"adduction": "deg", "internal_rotation": "deg", "anterior": "mm", "superior": "mm",
         "lateral": "mm"}  # fmt: skip
#: Signs of a left knee in axes with Z to the person's right: adduction, internal rotation and
#: lateral shift change.
MIRROR = (1.0, -1.0, -1.0, 1.0, 1.0, -1.0)
Distinct = AfterValidator(_distinct)
Text = Annotated[str, reads(Field.text)]
Flag = Annotated[bool, reads(Field.boolean)]
Seed = Annotated[int, whole(0)]
Parameter = Annotated[str, reads(parameter_name)]
Angles = Annotated[ndarray, reads(lambda f: angles(Field("", "", plain(f.value))))]
Values = Annotated[dict[str, float], PlainValidator(by_parameter(Field.number))]
Interval = Annotated[tuple[float, float], reads(Field.interval)]
Intervals = Annotated[
    dict[str, tuple[float, float]], PlainValidator(by_parameter(Field.interval))
]
Convention = Annotated[
    Literal["femoral", "grood-suntay", "tibial", "femur-in-tibia"], Choice()
]
LoadName = Literal["lateral_N", "anterior_N", "compression_N", "varus_Nm", "internal_Nm"]
