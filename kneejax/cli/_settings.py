"""What a command was asked for, as settings.json holds it, and its words again."""

from __future__ import annotations

import argparse
import glob
import math
import os
import re
from collections.abc import Iterator, Mapping
from decimal import Decimal
from pathlib import Path
from typing import Any

from kneejax.cli._parser import Parser
from kneejax.files import InputProblem
from kneejax.files.reading import load_json, plain_number

#: The file in a folder of results.
FILE = "settings.json"
_COMMAND, _WORKED_IN, _VERSIONS = "command", "working_folder", "versions"
#: The field of `kneejax.parameters.MEANING`, whose import would be JAX's.
_MEANING = "stiffness_of"
#: File -> checksum, of all that a run wrote.
WRITTEN = "written"
#: Names that no option may have, since they stand beside the options.
ADDED = (_COMMAND, _WORKED_IN, _VERSIONS, _MEANING, WRITTEN)
#: What else parsed arguments hold.
_NO_OPTIONS = ("command", "kind", "run", "parser", "out", "verbose", "results", "imports_s")
_EXPECTED = "settings.json of a kneejax command"
#: What stands for a number by name, so that it can be recorded as one.
_NUMBERS = ("NAME=VALUE", "NAME=SIZE")
#: Arguments that are a name of the package's data, or a file.
NAME_OR_FILE = ("knee", "knees", "study", "plan")


def asked_for(chosen: argparse.Namespace) -> dict[str, Any]:
    """A command and its arguments as plain words and numbers, defaults among them.

    Args:
        chosen: what was parsed, before the command has seen it.
    """
    parser: Parser = chosen.parser
    return {
        _COMMAND: " ".join(parser.prog.split()[1:]),
        **{
            name: _plain(getattr(chosen, action.dest), action)
            for name, action in _arguments(parser)
        },
        _WORKED_IN: os.getcwd(),
    }


def options_of(chosen: argparse.Namespace) -> dict[str, Any]:
    """Options and their values, defaults among them, as a result's own settings hold them.

    Args:
        chosen: what was parsed.
    """
    return {
        name: str(value) if isinstance(value, Path) else value
        for name, value in vars(chosen).items()
        if name not in _NO_OPTIONS
    }


def with_versions(settings: Mapping[str, Any]) -> dict[str, Any]:
    """What a command was asked for, and which versions answered.

    Args:
        settings: from `asked_for`.
    """
    from kneejax.inference import versions
    from kneejax.parameters import MEANING

    return {**settings, **MEANING, _VERSIONS: versions()}


def read_settings(folder: Path) -> dict[str, Any]:
    """Read what a command was asked for.

    Args:
        folder: that it wrote.

    Raises:
        InputProblem: the folder has no settings, or they are no command's.
    """
    file = folder / FILE
    if not folder.is_dir():
        found = "a file" if folder.exists() else "missing"
        raise InputProblem(folder, "folder", found, "a folder that a kneejax command wrote")
    if not file.is_file():
        expected = "this file, which a kneejax command writes beside its results"
        raise InputProblem(file, "file", "missing", expected)
    settings = load_json(file, _EXPECTED)
    for name, kind in ((_COMMAND, str), (_WORKED_IN, str), (_VERSIONS, dict)):
        found = settings.get(name) if isinstance(settings, dict) else None
        if not isinstance(found, kind):
            shown = "missing" if found is None else found
            raise InputProblem(file, name, shown, f"as in {_EXPECTED}")
    return settings


def words_again(settings: Mapping[str, Any], top: Parser, file: Path) -> list[str]:
    """The words of a command line that asks for the same; without `--out`.

    Args:
        settings: from `read_settings`.
        top: the parser of all commands.
        file: where they stand, for errors.

    Raises:
        InputProblem: the command, or one of its options, is not known, or a file is gone.
    """
    command = settings[_COMMAND].split()
    parser = _parser_of(command, top, file)
    known = dict(_arguments(parser))
    places, options = [], []
    for name, value in settings.items():
        if name in ADDED:
            continue
        if name not in known:
            expected = f"no such option of kneejax {settings[_COMMAND]}"
            raise InputProblem(file, name, _word(value), expected, known)
        _check_there(name, value, known[name], Path(settings[_WORKED_IN]), file)
    for name, action in known.items():
        value = settings.get(name)
        if value is not None:
            (options if action.option_strings else places).extend(_words(value, action))
    return [*command, *places, *options]


def check_meaning(words: list[str], settings: Mapping[str, Any], file: Path) -> None:
    """Refuse older settings that give a structure's stiffness as the mean of its fibres.

    Args:
        words: from `words_again`.
        settings: from `read_settings`.
        file: where they stand, for errors.

    Raises:
        InputProblem: a number means something else today.
    """
    given = dict(re.findall(r"(\w+\.(?:stiffness|damping))=(\S+)", " ".join(words)))
    if _MEANING in settings or not given:
        return
    from kneejax.files import load_knee
    from kneejax.parameters import fibres_summed
    from kneejax.studies import read_study

    def place(name: str) -> str:
        path = worked_in(settings) / name
        return os.fspath(path) if path.is_file() else name

    knees = [load_knee(place(settings["knee"]))] if settings.get("knee") else []
    knees += [read_study(place(settings["study"])).knee] if settings.get("study") else []
    for name, value in given.items():
        count = max((fibres_summed(knee, name) for knee in knees), default=1)
        if count > 1:
            raise InputProblem(
                file, name, value, f"the sum over the structure's {count} fibres; these settings "
                "are older and have their mean: run the command itself, with the sum",
            )  # fmt: skip


def changed_versions(settings: Mapping[str, Any]) -> list[str]:
    """In words, what answered then and would not now; empty where all is the same.

    Args:
        settings: from `read_settings`.
    """
    from kneejax.inference import versions

    then, now = settings[_VERSIONS], versions()
    return [
        f"{name} {then.get(name, 'unknown')} then, {now.get(name, 'unknown')} now"
        for name in {**now, **then}
        if then.get(name) != now.get(name)
    ]


def worked_in(settings: Mapping[str, Any]) -> Path:
    """The folder from which the command's paths lead."""
    return Path(settings[_WORKED_IN])


def _arguments(parser: argparse.ArgumentParser) -> Iterator[tuple[str, argparse.Action]]:
    """What a command is asked for, by the names that a person knows."""
    for action in parser._actions:
        if action.dest not in ("help", "out", "verbose"):
            flag = next(iter(action.option_strings), action.dest)
            yield flag.lstrip("-"), action


def _parser_of(command: list[str], top: Parser, file: Path) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = top
    for word in command:
        below = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
        choices = below[0].choices if below else {}
        if word not in choices:
            expected = "a command of kneejax"
            raise InputProblem(file, _COMMAND, " ".join(command), expected, choices)
        parser = choices[word]
    return parser


def _plain(value: Any, action: argparse.Action) -> Any:
    """As JSON can hold it; numbers by name as a mapping."""
    if isinstance(value, list | tuple):
        if action.metavar in _NUMBERS:
            pairs = [_pair(word) for word in value]
            # What is no number, or comes twice, is for the command to refuse.
            if all(pairs) and len(dict(filter(None, pairs))) == len(pairs):
                return dict(filter(None, pairs))
        return [_plain(one, action) for one in value]
    return os.fspath(value) if isinstance(value, Path) else value


def _pair(word: str) -> tuple[str, float] | None:
    name, _, number = word.partition("=")
    value = plain_number(number)
    return None if value is None or not math.isfinite(value) else (name, value)


def _words(value: Any, action: argparse.Action) -> list[str]:
    """The words that give an argument its value."""
    if not action.option_strings:
        return [_word(one) for one in (value if isinstance(value, list) else [value])]
    flag = action.option_strings[0]
    if isinstance(action, argparse.BooleanOptionalAction):
        return [flag if value else action.option_strings[1]]
    if action.nargs == 0:
        return [flag] if value else []
    if isinstance(value, dict):
        return [f"{flag}={name}={_word(number)}" for name, number in value.items()]
    if not isinstance(value, list):
        return [f"{flag}={_word(value)}"]
    if isinstance(action, argparse._AppendAction):
        return [
            word
            for one in value
            for word in ([flag, *map(_word, one)] if isinstance(one, list) else [f"{flag}={one}"])
        ]
    return [flag, *map(_word, value)] if value else []


def _word(value: Any) -> str:
    # A number without an exponent: argparse takes -1e-05 for an option.
    return f"{Decimal(repr(value)):f}" if isinstance(value, float) else str(value)


def _check_there(name: str, value: Any, action: argparse.Action, folder: Path, file: Path) -> None:
    """Whether the files of an argument are there; of a name without an ending its command says."""
    for one in value if isinstance(value, list) else [value]:
        if not isinstance(one, str):
            continue
        is_file = action.type is Path
        if action.dest in NAME_OR_FILE:
            is_file = bool(Path(one).suffix) or len(Path(one).parts) > 1
        # A pattern names what is there when it is read.
        if is_file and not glob.has_magic(one) and not os.path.exists(folder / one):
            expected = f"a file that is still there; {folder / one} is gone"
            raise InputProblem(file, name, one, expected)
