"""The command line of the models: read, explained and completed by cyclopts."""

import inspect
import platform
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin

from cyclopts import App, CycloptsError, Parameter, exceptions
from cyclopts import Group as Heading
from pydantic.fields import FieldInfo

from kneejax import __version__
from kneejax.cli import _command
from kneejax.cli._command import Command, Group, Place, Written, is_given, marks, shown_name
from kneejax.cli._words import Split, choices_of, plain_type
from kneejax.files import InputProblem
from kneejax.quantities import nearest_name

#: Packages that the numbers depend on most.
_PACKAGES = ("jax", "numpy", "optimistix")
#: Heading -> its commands, in the order of the help.
Groups = Mapping[str, Sequence[type[Command]]]


class CommandLine:
    """Every command of a program.

    Attributes:
        commands: words -> model.
    """

    def __init__(self, groups: Groups, above: Mapping[str, str], example: str = ""):
        """Collect them: heading -> its commands, and first word of several -> what these do ("" ->
        the program)."""
        self.commands = {one.command: one for every in groups.values() for one in every}
        self._groups, self._above, self._example = groups, above, example

    def read(self, words: Sequence[str]) -> Command | None:
        """The command of the words after `kneejax`; None where help or the version were printed."""
        command = self._named(words)
        words = [_hyphens(word) for word in words]
        app = self.app(command)
        try:
            function, bound, _ = app.parse_args(words, exit_on_error=False, print_error=False)
        except CycloptsError as problem:
            raise self._refused(problem, command, words) from None
        model = getattr(function, "model", None)
        if model is None:
            function(*bound.args, **bound.kwargs)
            return None
        return model.read(bound.arguments)

    def _named(self, words: Sequence[str]) -> str:
        """The words that name a command, or those above it where help is asked for."""
        name = ""
        for word in words:
            below = self._below(name)
            if name in self.commands or not below or word.startswith("-"):
                break
            if word not in below:
                known = ["--help", "--version", *below] if not name else below
                expected = f"one of {', '.join(below)}"
                raise InputProblem(name or "command", "name", word, expected, known)
            name = f"{name} {word}".strip()
        below, options = self._below(name), [word for word in words if word.startswith("-")]
        if name and below and not options:
            raise InputProblem(name, "command", "missing", f"one of {', '.join(below)}")
        return name

    def _below(self, name: str) -> list[str]:
        start = f"{name} " if name else ""
        found = (one.removeprefix(start) for one in self.commands if one.startswith(start))
        return list(dict.fromkeys(one.split()[0] for one in found))

    def app(self, command: str = "", completing: bool = False) -> App:
        """The program as cyclopts knows it: with the options of one command, of the others the help
        is enough, or of all, with the names that a shell offers, for `completing`."""
        example = self._example
        top = _app("kneejax", "kneejax COMMAND ...", self._above[""], example, version=version_text)
        parents = {"": top}
        for number, (heading, models) in enumerate(self._groups.items()):
            group = Heading(heading, sort_key=number)
            for model in models:
                *above, word = model.command.split()
                for name in above:
                    if name not in parents:
                        usage, sentence = f"kneejax {name} COMMAND ...", self._above[name]
                        parents[name] = _app(name, usage, sentence, model.example, group=group)
                        top.command(parents[name])
                heading = () if above else group
                said = inspect.getdoc(model) or ""
                one = _app(word, _usage(model), said, model.example, group=heading)
                if completing or model.command == command:
                    one.default(_function(model, completing))
                parents[above[0] if above else ""].command(one)
        return top

    def _refused(self, problem: CycloptsError, command: str, words: Sequence[str]) -> InputProblem:
        """What cyclopts refuses, as file, field, value and what was expected."""
        place = command or "command"
        if command not in self.commands:
            option = next((word for word in words if word.startswith("-")), "")
            known = ["--help", *([] if command else ["--version"]), *self._below(command)]
            return InputProblem(place, "option", option, "a command or --help", known)
        word = None
        if isinstance(problem, exceptions.UnknownOptionError):
            word = problem.token.keyword or problem.token.value
        elif isinstance(problem, exceptions.UnusedCliTokensError):
            word = (problem.unused_tokens or [""])[0]
            if not word.startswith("-"):
                return InputProblem(place, "argument", word, "no further argument")
        if word is not None:
            expected, model = f"an option of kneejax {command} (see --help)", self.commands[command]
            return InputProblem(place, "option", word, expected, _nearest(model, word))
        argument = problem.argument
        option = argument.names[0] if argument is not None and argument.names else "option"
        if isinstance(problem, exceptions.MissingArgumentError) and argument is not None:
            count = argument.token_count()[0]
            expected = "a value" if count == 1 else f"{count} values"
            given = " ".join(problem.tokens_so_far) or "missing"
            return InputProblem(place, option, given, expected)
        if isinstance(problem, exceptions.RepeatArgumentError):
            option = problem.token.keyword or option
            return InputProblem(place, option, problem.token.value or "given", "this option once")
        if isinstance(problem, exceptions.CoercionError) and problem.token is not None:
            return InputProblem(place, option, problem.token.value, "this option without a value")
        return InputProblem(place, option, str(problem), "another value")


def version_text() -> str:
    """The package's version, and below it those that a report of a fault should name."""
    from importlib.metadata import version

    others = ", ".join(f"{name} {version(name)}" for name in _PACKAGES)
    return f"kneejax {__version__}\nPython {platform.python_version()}, {others}"


def _app(name: str, usage: str, sentence: str, example: str, **more: Any) -> App:
    return App(name=name, usage="", help=f"{sentence}\n\nusage: {usage}",
               help_epilogue=f"example:\n  {example}", help_format="plaintext",
               version_flags=["--version"] if "version" in more else [], help_on_error=False,
               group_commands=Heading("Commands"), group_parameters=Heading("Options", sort_key=50),
               **more)  # fmt: skip


def _usage(model: type[Command]) -> str:
    """The command with its places; in brackets what may be left out."""
    words = []
    for field in model.model_fields.values():
        for place in marks(field, Place):
            several = "..." if get_origin(plain_type(field.annotation)) is list else ""
            word = f"{place.name}{several}"
            words.append(word if field.is_required() else f"[{word}]")
    return " ".join(["kneejax", model.command, *words, "[OPTIONS]"])


def _hyphens(word: str) -> str:
    """`--force_N=5`, the older spelling, as `--force-N=5`."""
    option, equals, value = word.partition("=")
    return option.replace("_", "-") + equals + value if word.startswith("--") else word


def _nearest(model: type[Command], word: str) -> str | None:
    """The option, or the field of a study, most like a word that begins with a hyphen."""
    given = word.lstrip("-").partition("=")[0]
    named = (field for field in model.model_fields.values() if not marks(field, Place))
    options = [field.alias or "" for field in named]
    near = nearest_name(given, [*options, "help"])
    if near is None and "study" in model.model_fields:
        from kneejax.studies import STUDY_FIELDS

        near = nearest_name(given.replace("-", "_"), STUDY_FIELDS)
        return f"the field {near} of a study file" if near else None
    return f"--{near}" if near else None


def _function(model: type[Command], completing: bool) -> Callable[..., None]:
    """A function with the options of a model, for cyclopts to bind words to."""

    def call(*_: Any, **__: Any) -> None: ...

    parameters, headings = [], {}
    for name, field in model.model_fields.items():
        heading = None
        for one in marks(field, Group):
            order = 99 if one.title == "Results" else 51 + len(headings)
            heading = headings.setdefault(one.title, Heading(one.title, sort_key=order))
        hint, many = _hint(field, completing)
        # What stands for a value in help: its form, or its type.
        form = next((x.form for x in field.metadata if isinstance(x, _command.Form | Split)), "")
        known = {float: "NUMBER", int: "N", Path: "FILE"}.get(plain_type(field.annotation))
        other = "NxM" if marks(field, Split) else known or (field.alias or "").upper()
        # What a shell offers: choices, or names of the package's data.
        offered = choices_of(field.annotation) or None
        for mark in marks(field, _command.Bundled) if completing and not offered else ():
            from kneejax.files import bundled_files

            offered = tuple(bundled_files(mark.kind))
        option = Parameter(name=shown_name(field), help=_help(model, field), show_default=False,
                           metavar=re.sub(r",.*", "", form) or other, consume_multiple=many,
                           choices=offered if completing else None,
                           **({} if field.annotation == bool | None else {"negative": ()}),
                           **({} if heading is None else {"group": heading}))  # fmt: skip
        places = inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.KEYWORD_ONLY
        kind, hint = places[not marks(field, Place)], Annotated[hint | None, option]
        parameters.append(inspect.Parameter(name, kind, default=None, annotation=hint))
    parameters.sort(key=lambda one: one.kind)
    call.__signature__ = inspect.Signature(parameters)  # pyright: ignore[reportFunctionMemberAccess]
    call.__annotations__ = {one.name: one.annotation for one in parameters}
    call.model = model  # pyright: ignore[reportFunctionMemberAccess]
    return call


def _hint(field: FieldInfo, completing: bool) -> tuple[Any, Any]:
    """How many words an option takes, as a type; and whether one mention takes several."""
    kind = plain_type(field.annotation)
    origin, inner = get_origin(kind), get_args(kind)
    is_path = kind is Path or (inner and plain_type(inner[0]) is Path)
    is_path = is_path or marks(field, _command.Bundled)
    word = Path if completing and is_path else str
    if kind is bool:
        return bool, False
    if marks(field, Split) or origin not in (list, tuple, dict, Mapping):
        return word, False
    if origin is tuple:
        return tuple[tuple([str] * len(inner))], False  # pyright: ignore[reportReturnType]
    if origin is list and get_origin(inner[0]) is tuple:
        return list[_hint(FieldInfo(annotation=inner[0]), False)[0]], False
    return list[word], (1, None) if marks(field, _command.Several) else False


def _help(model: type[Command], field: FieldInfo) -> str:
    """What an option is, what may be chosen, and what it is without being given."""
    words, default = field.description or "", field.get_default(call_default_factory=True)
    choices = [one for one in choices_of(field.annotation) if one not in words]
    words += f" ({', '.join(choices)})" if choices else ""
    if field.alias == "out" and issubclass(model, Written):
        default = model.folder
    if field.is_required() or not is_given(default):
        return words
    shown = "x".join(map(str, default)) if isinstance(default, tuple) else default
    return f"{words} (default: {shown})"
