"""A command as a typed model: each option, its limits, its help and its conditions stand once.
The model is the command line (`_line.py`), the settings.json of its results, what `rerun` reads,
and a call in Python: `Simulate(experiment="drawer", force_N=100)`."""

import importlib
import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple, Self

import pydantic
from pydantic.fields import FieldInfo

from kneejax.cli._words import choices_of, expected_of, read_value
from kneejax.files import InputProblem
from kneejax.files.reading import meaning, together

if TYPE_CHECKING:
    from kneejax.cli._results_folder import ResultsFolder


class Place(NamedTuple):
    """An argument without a name, given by its place."""

    name: str


class Form(NamedTuple):
    """How a value is written, where its type does not say so: `NAME=LOW:HIGH`."""

    form: str
    several: bool = False  # words at one mention; otherwise it is given once for each


class Group(NamedTuple):
    """The heading under which help shows an option."""

    title: str


class Only(NamedTuple):
    """An option that means something only where a condition holds; elsewhere it is refused."""

    where: Callable[[Any], bool]  # of the command
    expected: str  # what should be given with it, or in its place
    shown: str = ""  # the field whose value the error shows; the option's own if empty


class Bundled(NamedTuple):
    """A name of the package's data, or a file."""

    kind: str
    others: bool = False  # whether folders and patterns may stand in its place


class File(NamedTuple):
    """A file that must exist, and what it is."""

    kind: str


class Parameters:
    """Names of parameters of the command's knee, with what they are set to."""


class Angles:
    """Angles of flexion: first:last:step or a,b,c."""


#: Option, value, and what was expected in its place.
Problem = tuple[str, Any, str]


def option_name(field: str) -> str:
    """`force_N` -> `force-N`."""
    return field.replace("_", "-")


class Command(pydantic.BaseModel):
    """The options of a command, checked. A subclass states them as fields, and its name has the
    words after `kneejax`: `JointFit` is `kneejax joint fit`."""

    model_config = pydantic.ConfigDict(extra="forbid", defer_build=True,
                                       alias_generator=option_name, populate_by_name=True,
                                       ser_json_inf_nan="strings")  # fmt: skip
    command: ClassVar[str]
    example: ClassVar[str]  # a line that runs, for the end of its help
    body: ClassVar[str]  # module (that of the command's name if not stated), or module:function
    renamed: ClassVar[Mapping[str, str]] = {}  # name in a calculation -> field that gave it

    @classmethod
    def __pydantic_init_subclass__(cls, **_: Any) -> None:
        cls.command = re.sub("(?<=[a-z])(?=[A-Z])", " ", cls.__name__).lower()
        if "body" not in vars(cls):
            cls.body = f"kneejax.cli._{cls.command.replace(' ', '_')}"

    @classmethod
    def read(cls, given: Mapping[str, Any]) -> Self:
        """Check options, or fields, as words or as a file of settings holds them."""
        try:
            return cls.model_validate(dict(given))
        except pydantic.ValidationError as found:
            raise found.errors()[0].get("ctx", {})["error"] from None  # as `_checked` raised it

    @pydantic.field_validator("*", mode="before")
    @classmethod
    def _of_words(cls, value: Any, info: pydantic.ValidationInfo) -> Any:
        return read_value(cls.model_fields[info.field_name or ""], value)

    @pydantic.model_validator(mode="wrap")
    @classmethod
    def _checked(cls, given: Any, build: pydantic.ValidatorFunctionWrapHandler) -> Any:
        """Check every field, then what goes together."""
        try:
            made = build(cls.usual(dict(given)))
        except pydantic.ValidationError as found:
            problems = [*cls._in_words(found)]
        else:
            problems = [*made._only_with()]
            useless = {problem.field for problem in problems}
            problems += [InputProblem(cls.command, *one)
                         for one in made.problems() if one[0] not in useless]
        if problems:
            raise together(problems)
        return made  # pyright: ignore[reportPossiblyUnboundVariable]

    @classmethod
    def _in_words(cls, found: pydantic.ValidationError) -> Iterator[InputProblem]:
        """What pydantic found, as file, field, value and what was expected."""
        known = {field.alias or name: field for name, field in cls.model_fields.items()}
        fields = known | cls.model_fields
        for error in found.errors(include_url=False):
            place, value, near = str(error["loc"][0]), error["input"], None
            if (field := fields.get(place)) is None:
                expected, near = f"no such option of kneejax {cls.command}", known
                yield InputProblem(cls.command, place, value, expected, near)
                continue
            file, place, value = cls.command, shown_name(field), _shown(value)
            if isinstance(refused := error.get("ctx", {}).get("error"), InputProblem):
                value, expected = _shown(refused.value), refused.expected
                file, place = (place, refused.field) if refused.field else (file, place)
            elif error["type"] == "missing":
                value, expected = "missing", field.description or "a value"
            else:
                expected, near = expected_of(field, error), choices_of(field.annotation)
            yield InputProblem(file, place, value, expected, near)

    def _only_with(self) -> Iterator[InputProblem]:
        """Options that mean nothing here: none is silently ignored."""
        for name, field in type(self).model_fields.items():
            value = getattr(self, name)
            if not is_given(value) or value == field.get_default(call_default_factory=True):
                continue
            for rule in marks(field, Only):
                if not rule.where(self):
                    shown = getattr(self, rule.shown) if rule.shown else _shown(value)
                    yield InputProblem(self.command, shown_name(field), shown, rule.expected)
                    break

    @classmethod
    def usual(cls, values: dict[str, Any]) -> dict[str, Any]:
        """The values with defaults that depend on others."""
        return values

    def problems(self) -> Iterable[Problem]:
        """What is wrong with options that are good one by one; for a subclass to say."""
        return ()

    def options(self) -> dict[str, Any]:
        """Options and their values, defaults among them, as a result's own settings hold them."""
        values = self.model_dump(exclude={"out", "verbose"})
        return {k: str(x) if isinstance(x, Path) else x for k, x in values.items()}

    def settings(self) -> dict[str, Any]:
        """The command and its options as JSON holds them; where it writes is no part of them."""
        values = json.loads(self.model_dump_json(by_alias=True, exclude={"out", "verbose"}))
        return {"command": self.command, **values}

    def work(self) -> Callable[[Self], int]:
        """What does the work: the function, or `run` of a module, imported when it is needed."""
        module, _, function = self.body.partition(":")
        return getattr(importlib.import_module(module), function or "run")

    def run(self) -> int:
        """Do the work; the exit status. What a calculation refuses is said of its option."""
        try:
            return self.work()(self)
        except ValueError as problem:
            every = [*getattr(problem, "problems", (problem,))]
            if (said := [self.said(one) for one in every]) == every:
                raise
            raise together(said) from None

    def said(self, problem: ValueError) -> ValueError:
        """What a calculation refuses, said of the option that gave it; anything else as it is."""
        if isinstance(problem, InputProblem):
            return problem
        from kneejax.numerics import WrongValue

        if not isinstance(problem, WrongValue):
            return problem
        option = option_name(self.renamed.get(problem.field, problem.field))
        return InputProblem(self.in_errors, f"--{option}", problem.found, problem.expected)

    @property
    def in_errors(self) -> str:
        """The command in errors."""
        return self.command


class Written(Command):
    """A command that writes a folder of results."""

    folder: ClassVar[str]  # unless `--out` names another one; called as the command's first word
    _results: Any = pydantic.PrivateAttr(None)
    out: Annotated[Path, Group("Results")] = meaning("folder for the results", Path())
    verbose: Annotated[bool, Group("Results")] = meaning(
        "say what was compiled, and how long it took", False)

    @classmethod
    def __pydantic_init_subclass__(cls, **_: Any) -> None:
        super().__pydantic_init_subclass__()
        if "folder" not in vars(cls):
            cls.folder = f"kneejax-{cls.command.partition(' ')[0]}"

    @classmethod
    def usual(cls, values: dict[str, Any]) -> dict[str, Any]:
        """Name the folder, where nothing else is said."""
        folder = cls.folder.replace("EXPERIMENT", str(values.get("experiment")))
        return {"out": Path(folder), **values}

    def resumes(self) -> bool:
        """Whether a run goes on with what an earlier one has finished."""
        return False

    @property
    def results(self) -> "ResultsFolder":
        """The folder of results, while the command runs."""
        return self._results


class Drawn(Written):
    """A command that draws figures too."""

    svg: Annotated[bool, Group("Results")] = meaning("write figures as SVG too", False)


def marks(field: FieldInfo, kind: type) -> list[Any]:
    """Marks of a kind on a field."""
    return [one for one in field.metadata if isinstance(one, kind)]


def shown_name(field: FieldInfo) -> str:
    """What an option is called in errors: `--force-N`, or the name of its place."""
    places = marks(field, Place)
    return places[0].name if places else f"--{field.alias}"


def is_given(value: Any) -> bool:
    """Whether an option was given, be it as 0, which equals False."""
    return value is not None and value is not False and value not in ([], {}, ())


def _shown(value: Any) -> Any:
    """A value as a person wrote it."""
    if value is True:
        return "given"
    if isinstance(value, list | tuple):
        return " ".join(f"{x:g}" if isinstance(x, float) else str(x) for x in value)
    if isinstance(value, dict):
        return next(iter(value), "")
    return f"{value:g}" if isinstance(value, float) else str(value)
