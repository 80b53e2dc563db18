"""Models of what a person gives: every mistake at once, each with its place and what was meant.

A model is a `Part`: its fields say what may stand in a mapping of a file. Readers of single values
refuse with an `InputProblem` without a file; each model adds the field where the value stands, and
`checked` the file.
"""

__all__ = [
    "Chosen", "Mistakes", "Part", "checked", "checks", "fill", "folder_of", "said_of", "together",
]

import contextlib
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Self, TypeVar

import pydantic
from pydantic import BaseModel, ConfigDict, ValidationError, ValidationInfo, model_validator
from pydantic_core import core_schema

from kneejax.files.reading._text import InputProblem, InputProblems, wrong
from kneejax.quantities import nearest_name

_P = TypeVar("_P", bound="Part")


class Part(BaseModel):
    """A mapping in a file; what is no field of it is a mistake."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, arbitrary_types_allowed=True, populate_by_name=True,
        defer_build=True)  # fmt: skip

    @model_validator(mode="wrap")
    @classmethod
    def _in_words(
        cls, value: Any, build: pydantic.ModelWrapValidatorHandler, info: ValidationInfo
    ) -> Any:
        """Check every field; what pydantic finds becomes mistakes with their places."""
        mistakes = Mistakes()
        if (info.context or {}).get("file") and isinstance(value, dict):
            own = {field.alias or name: field for name, field in cls.model_fields.items()}
            for name in [k for k, x in value.items() if x is None and k in own]:
                if not own[name].is_required():
                    mistakes.append(wrong(None, "a value (or omit the field)", at=name))
                    value = {k: x for k, x in value.items() if k != name}
        try:
            made = build(value)
        except ValidationError as error:
            _keep_all(mistakes, error, cls)
        mistakes.check()
        return made  # pyright: ignore[reportPossiblyUnboundVariable]

    def given(self) -> dict[str, Any]:
        """What was given, by the names that a file has."""
        fields = type(self).model_fields
        return {fields[name].alias or name: getattr(self, name) for name in self.model_fields_set}

    def replace(self, **changes: Any) -> Self:
        """The same with other values, checked anew."""
        return type(self)(**self.given() | changes)


def checked(
    model: type[_P], value: Any, file: str = "", folder: Path | None = None, *, nulls: bool = False
) -> _P:
    """What stands in a file, as a model of it, or all mistakes in it. Paths in it are relative to
    `folder`; fields may be null where `nulls` says so, as in a file that the package wrote."""
    try:
        context = {"folder": folder or Path(), "file": not nulls}
        return model.model_validate(value, context=context)
    except ValidationError as error:
        (mistakes := Mistakes(file)).keep(error)
    raise together(mistakes)


def fill(model: Part, fields: Any, context: Mapping[str, Any] | None = None) -> None:
    """Fill a model that was made empty; raises of a mistake in its fields, or of several."""
    validator = type(model).__pydantic_validator__
    try:
        validator.validate_python(fields, self_instance=model, context=dict(context or {}))
    except ValidationError as error:
        found = Mistakes()
        found.keep(error)
        raise together(found) from None


class Mistakes(list[ValueError]):
    """What is wrong so far in a file, whose name is empty where only its reader knows it."""

    def __init__(self, file: str = ""):
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
        """Add a mistake, or the several that an exception stands for, found at a place; raises what
        is no mistake of a person."""
        if isinstance(problem, ValidationError):  # a model's own, as `_in_words` raised it
            problem = problem.errors()[0].get("ctx", {})["error"]
        for one in getattr(problem, "problems", (problem,)):
            if not isinstance(one, InputProblem):
                # What else may be wrong was found by JAX's modules, which are there then.
                one = _explained(one, self.file, at)
            elif not one.file:  # one that names its file has its whole place
                place = _joined(at, one.field) or "file" * bool(self.file)
                one = InputProblem(self.file, place, one.value, one.expected, one.nearest)
            self.append(one)

    def check(self) -> None:
        """Raise what was found, if anything."""
        if self:
            raise together(self)


@contextlib.contextmanager
def said_of(place: str | os.PathLike[str]) -> Iterator[None]:
    """Let a name or a value that a knee refuses say where it stands: the file or the option.

    Raises:
        InputProblem: a value that no knee has, or one that leads to such a knee.
        UnknownParameter: the knee has no parameter of this name.

    Example:
        >>> from kneejax.files import load_knee
        >>> with said_of("--set"):
        ...     knee = load_knee("four_ligament").replace({"ACL.stiffness": 300.0})
        >>> float(knee.ligaments.stiffness[0])
        300.0
    """
    mistakes = Mistakes(os.fspath(place))
    with mistakes.gathered():
        yield
    mistakes.check()


def together(problems: Sequence[ValueError]) -> ValueError:
    """One mistake as it is; several as one exception, a line each."""
    return problems[0] if len(problems) == 1 else InputProblems(problems)


def _explained(problem: ValueError, file: str, at: str) -> ValueError:
    """What a calculation refuses, said of the place that asked for it."""
    from kneejax.mechanics import Implausible
    from kneejax.numerics import MissingPackage, WrongValue
    from kneejax.parameters import UnknownParameter, UnsuitableData

    match problem:
        case WrongValue():
            return InputProblem(file, _joined(at, problem.field), problem.found, problem.expected)
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


def _keep_all(mistakes: Mistakes, error: ValidationError, model: type[BaseModel]) -> None:
    """Keep what is wrong with the fields of a model; models in it have spoken for theirs."""
    every = error.errors(include_url=False)
    # A field that may only be absent is none that a person is told of.
    fields = {k: x for k, x in model.model_fields.items() if x.annotation is not type(None)}
    missing = [one["loc"][-1] for one in every if one["type"] == "missing"]
    known = [field.alias or name for name, field in fields.items()]
    near: dict[Any, str | None] = {}
    for one in every:
        if one["type"] == "extra_forbidden":
            name = str(one["loc"][-1])
            near[name] = nearest_name(name, missing) or nearest_name(name, known)
            expected = f"no such field, but one of {', '.join(known)}"
            mistakes.append(wrong(one["input"], expected, near[name], at=name))
    misnamed = [one["loc"][:-1] for one in every if one["loc"] and one["loc"][-1] == "[key]"]
    for one in every:
        path = one["loc"][:-1] if one["loc"][-1:] == ("[key]",) else one["loc"]
        if path is one["loc"] and path in misnamed:
            continue  # what stands under a wrong name may be meant for another
        place = "".join(f"[{x}]" if isinstance(x, int) else f".{x}" for x in path).lstrip(".")
        match one["type"]:
            case "value_error":
                mistakes.keep(one.get("ctx", {})["error"], place)
            case "missing" if one["loc"][-1] not in near.values():
                mistakes.append(wrong("missing", "this field", at=place))
            case "model_type":
                names = [k for k, x in zip(known, fields.values(), strict=True) if x.is_required()]
                several = "s" * (len(names or known) > 1)
                expected = f"a mapping with the field{several} {', '.join(names or known)}"
                mistakes.append(wrong(one["input"], expected, at=place))
            case kind if kind not in ("missing", "extra_forbidden"):
                mistakes.append(wrong(one["input"], "a value of another kind", at=place))


def checks(check: Callable[[Any, Mistakes], None]) -> Any:
    """A validator of a part as a whole: it adds what is wrong to the mistakes, or raises it."""
    def validated(part: Any) -> Any:
        mistakes = Mistakes()
        check(part, mistakes)
        mistakes.check()
        return part

    return model_validator(mode="after")(validated)


class Chosen:
    """A part whose model its content decides: `model` takes the value, and gives its model or
    refuses it."""

    def __init__(self, model: Callable[[Any], type[Part]]):
        self.model = model

    def __get_pydantic_core_schema__(self, source: Any, handler: pydantic.GetCoreSchemaHandler):
        def read(value: Any, info: ValidationInfo) -> Any:
            return self.model(value).model_validate(value, context=info.context)

        return core_schema.with_info_plain_validator_function(read)


def folder_of(info: ValidationInfo) -> Path:
    """To which paths in what is read are relative."""
    return (info.context or {}).get("folder", Path())
