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
from kneejax.cli._command import Command, Form, Group, Place, Written, is_given, marks, shown_name
from kneejax.cli._words import Split, choices_of, plain_type
from kneejax.files import InputProblem
from kneejax.quantities import nearest_name

#: Packages that the numbers depend on most.
_PACKAGES = ("jax", "numpy", "optimistix")


class CommandLine:
    """Every command of a program: `groups` are heading -> its commands, in the order of the help;
    `above` is first word of several -> what these do ("" -> the program)."""

    def __init__(self, groups: Mapping[str, Sequence[type[Command]]], above: Mapping[str, str],
                 example: str = ""):  # fmt: skip
        self.commands = {one.command: one for every in groups.values() for one in every}
        self._groups, self._above, self._example = groups, above, example

    def app(self, completing: bool = False) -> App:
        """The program as cyclopts knows it; with names and files to offer, for `completing`."""
        top = _app("kneejax", "kneejax COMMAND ...", self._above[""], self._example,
                   version=version_text)  # fmt: skip
        parents = {"": top}
        for number, (title, models) in enumerate(self._groups.items()):
            heading = Heading(title, sort_key=number)
            for model in models:
                first, _, word = model.command.rpartition(" ")
                if first not in parents:
                    usage, sentence = f"kneejax {first} COMMAND ...", self._above[first]
                    parents[first] = _app(first, usage, sentence, model.example, group=heading)
                    top.command(parents[first])
                one = _app(word, _usage(model), inspect.getdoc(model) or "", model.example,
                           group=() if first else heading)  # fmt: skip
                one.default(_function(model, completing))
                parents[first].command(one)
        return top

    def read(self, words: Sequence[str]) -> Command | None:
        """The command of the words after `kneejax`; None where help or the version were printed."""
        app, words = self.app(), [_hyphens(word) for word in words]
        chain, apps, rest = app.parse_commands(words)
        named = [word for word in chain if not word.startswith("-")]
        name, options = " ".join(named), [word for word in words if word.startswith("-")]
        below = [word for word in apps[len(named)] if not word.startswith("-")]
        if below and rest and len(named) == len(chain) and not rest[0].startswith("-"):
            known, place = below if name else ["--help", "--version", *below], name or "command"
            raise InputProblem(place, "name", rest[0], f"one of {', '.join(below)}", known)
        if below and name and not options:
            raise InputProblem(name, "command", "missing", f"one of {', '.join(below)}")
        try:
            function, bound, _ = app.parse_args(words, exit_on_error=False, print_error=False)
        except CycloptsError as problem:
            if not below:
                raise _refused(problem, self.commands[name]) from None
            known = ["--help", *([] if name else ["--version"]), *below]
            expected = "a command or --help"
            raise InputProblem(name or "command", "option", options[0], expected, known) from None
        if (model := getattr(function, "model", None)) is not None:
            return model.read(bound.arguments)
        function(*bound.args, **bound.kwargs)
        return None


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


def _refused(problem: CycloptsError, model: type[Command]) -> InputProblem:
    """What cyclopts refuses, as file, field, value and what was expected."""
    command, argument, near = model.command, problem.argument, None
    place = argument.names[0] if argument is not None and argument.names else "option"
    value, expected = str(problem), "another value"
    if isinstance(problem, exceptions.UnknownOptionError | exceptions.UnusedCliTokensError):
        token = getattr(problem, "token", None)
        value = token.keyword or token.value if token else (problem.unused_tokens or [""])[0]
        place, expected = "argument", "no further argument"
        if token or value.startswith("-"):
            place, expected = "option", f"an option of kneejax {command} (see --help)"
            near = _nearest(model, value)
    elif isinstance(problem, exceptions.MissingArgumentError) and argument is not None:
        count = argument.token_count()[0]
        value = " ".join(problem.tokens_so_far) or "missing"
        expected = "a value" if count == 1 else f"{count} values"
    elif isinstance(problem, exceptions.RepeatArgumentError):
        place, value = problem.token.keyword or place, problem.token.value or "given"
        expected = "this option once"
    elif isinstance(problem, exceptions.CoercionError) and problem.token is not None:
        value, expected = problem.token.value, "this option without a value"
    return InputProblem(command, place, value, expected, near)


def _nearest(model: type[Command], word: str) -> str | None:
    """The option, or the field of a study, most like a word that begins with a hyphen."""
    given = word.lstrip("-").partition("=")[0]
    named = (field for field in model.model_fields.values() if not marks(field, Place))
    if near := nearest_name(given, [*(field.alias or "" for field in named), "help"]):
        return f"--{near}"
    if "study" in model.model_fields:
        from kneejax.studies import STUDY_FIELDS

        if near := nearest_name(given.replace("-", "_"), STUDY_FIELDS):
            return f"the field {near} of a study file"
    return None


def _function(model: type[Command], completing: bool) -> Callable[..., None]:
    """A function with the options of a model, for cyclopts to bind words to."""

    def call(*_: Any, **__: Any) -> None: ...

    parameters, headings = [], {}
    for name, field in model.model_fields.items():
        more: dict[str, Any] = {}
        for one in marks(field, Group):
            order = 99 if one.title == "Results" else 51 + len(headings)
            more["group"] = headings.setdefault(one.title, Heading(one.title, sort_key=order))
        if field.annotation != bool | None:
            more["negative"] = ()
        kind, word = plain_type(field.annotation), str
        if completing:  # names of the package's data, choices or files are offered
            bundled = marks(field, _command.Bundled)
            word = Path if bundled or Path in (kind, *map(plain_type, get_args(kind)[:1])) else str
            more["choices"] = choices_of(kind) or None
            if bundled and not more["choices"]:
                from kneejax.files import bundled_files

                more["choices"] = tuple(bundled_files(bundled[-1].kind))
        # What stands for a value in help: its form, or its type.
        form = next((x.form for x in field.metadata if isinstance(x, Form | Split)), "")
        usual = {float: "NUMBER", int: "N", Path: "FILE"}.get(kind, (field.alias or "").upper())
        if any(one.several for one in marks(field, Form)):
            more["consume_multiple"] = (1, None)
        option = Parameter(name=shown_name(field), help=_help(model, field), show_default=False,
                           metavar=form.partition(",")[0] or usual, **more)  # fmt: skip
        hint = word if marks(field, Split) else _hint(kind, word)
        places = inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.KEYWORD_ONLY
        place, hint = places[not marks(field, Place)], Annotated[hint | None, option]
        parameters.append(inspect.Parameter(name, place, default=None, annotation=hint))
    parameters.sort(key=lambda one: one.kind)
    call.__signature__ = inspect.Signature(parameters)  # pyright: ignore[reportFunctionMemberAccess]
    call.__annotations__ = {one.name: one.annotation for one in parameters}
    call.model = model  # pyright: ignore[reportFunctionMemberAccess]
    return call


def _hint(kind: Any, word: type) -> Any:
    """How many words an option of some type takes, as a type."""
    origin, inner = get_origin(kind), get_args(kind)
    if origin is tuple:
        return tuple[tuple([str] * len(inner))]  # pyright: ignore[reportReturnType]
    if origin is list and get_origin(inner[0]) is tuple:
        return list[_hint(inner[0], word)]
    return bool if kind is bool else list[word] if origin in (list, dict, Mapping) else word


def _help(model: type[Command], field: FieldInfo) -> str:
    """What an option is, what may be chosen, and what it is without being given."""
    words, default = field.description or "", field.get_default(call_default_factory=True)
    choices, said = choices_of(field.annotation), {*re.findall(r"[\w'-]+", words)}
    words += f" ({', '.join(choices)})" if not said.issuperset(choices) else ""
    if field.alias == "out" and issubclass(model, Written):
        default = model.folder
    if field.is_required() or not is_given(default):
        return words
    shown = "x".join(map(str, default)) if isinstance(default, tuple) else default
    return f"{words} (default: {shown})"
