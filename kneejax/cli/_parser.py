"""How the command line is read and explained: help, defaults, and mistakes in one line."""

from __future__ import annotations

import argparse
import functools
import importlib
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from kneejax.files import nearest_name
from kneejax.files.reading import plain_number
from kneejax.studies import STUDY_FIELDS

BAD_INPUT = 2
#: Characters of a mistake at most.
_LONGEST = 2000
#: As `kneejax.geometry.CONVENTIONS`, which would bring in JAX.
CONVENTIONS = ("femoral", "grood-suntay", "tibial", "femur-in-tibia")

#: What stands for a knee, wherever one is asked for.
KNEE = "bundled name, knee file, or the result.json of a calibration"


class Parser(argparse.ArgumentParser):
    """A command's own parser: help begins with what the command does and ends with an example."""

    def __init__(self, *arguments: Any, **options: Any):
        # In full: `--dissipation_s_per_m` would be read as the same number in s/mm.
        whole = {"formatter_class": _WithDefaults, "allow_abbrev": False}
        super().__init__(*arguments, **{**whole, **options})
        # Whatever a command does not know, its own parser reports: it knows the command's options.
        self.set_defaults(parser=self)
        self.register("type", float, _number)
        self.register("type", int, _whole_number)

    def format_help(self) -> str:
        """The sentence first, then how the command is called."""
        sentence, self.description = self.description, None
        try:
            return f"{sentence}\n\n{super().format_help()}"
        finally:
            self.description = sentence

    def error(self, message: str) -> NoReturn:
        """Say a mistake in one line."""
        words = " ".join(message.split())
        shown = words if len(words) <= _LONGEST else f"{words[:_LONGEST]}..."
        print(f"kneejax: {shown}", file=sys.stderr)
        raise SystemExit(BAD_INPUT)

    def refuse(self, words: Sequence[str]) -> NoReturn:
        """Say which words a command does not know, and what the first may be meant to be."""
        near = self._nearest_option(words[0]) if words[0].startswith("-") else None
        self.error(f"unrecognized arguments: {' '.join(words)}{_meant(near)}")

    def _nearest_option(self, word: str) -> str | None:
        """The option, or the field of a study, most like a word that begins with a hyphen."""
        given = word.lstrip("-").partition("=")[0]
        options = {name.lstrip("-"): name for name in self._option_string_actions}
        near = nearest_name(given, options)
        if near is None and any(action.dest == "study" for action in self._actions):
            field = nearest_name(given.replace("-", "_"), STUDY_FIELDS)
            return f"the field {field} of a study file" if field else None
        return options.get(near or "")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """As of the base class, with the nearest choice."""
        if action.choices is None or value in action.choices:
            return
        named = [str(name) for name in action.choices]
        known = ", ".join(map(repr, named))
        if isinstance(action, argparse._SubParsersAction):
            # `kneejax help` and `kneejax version` are options here.
            named += [name for name in self._option_string_actions if name.startswith("--")]
        near = _meant(nearest_name(str(value), named))
        words = f"invalid choice: {value!r} (choose from {known}){near}"
        raise argparse.ArgumentError(action, words)

    def _get_value(self, action: argparse.Action, arg_string: str) -> Any:
        """As of the base class; nothing between quotes is no value."""
        if not arg_string.strip() and action.nargs != argparse.PARSER:
            raise argparse.ArgumentError(action, "expected a value, not an empty text")
        return super()._get_value(action, arg_string)


def _meant(near: str | None) -> str:
    return f"; did you mean {near}?" if near else ""


def _number(text: str) -> float:
    found = plain_number(text)
    if found is None:
        raise argparse.ArgumentTypeError(f"invalid float value: {text!r}")
    return found


def _whole_number(text: str) -> int:
    if not re.fullmatch(r"[-+]?[0-9]{1,18}", text.strip()):
        raise argparse.ArgumentTypeError(f"invalid int value: {text!r}")
    return int(text)


class _WithDefaults(argparse.RawDescriptionHelpFormatter):
    """Every option says what it is without being given."""

    def _get_help_string(self, action: argparse.Action) -> str:
        words = action.help or ""
        told = action.default not in (None, argparse.SUPPRESS, []) and action.default is not False
        return f"{words} (default: %(default)s)" if told else words


def add_command(commands: Any, name: str, sentence: str, example: str) -> Parser:
    """Add a command.

    Args:
        commands: what `add_subparsers` of the parser above gave.
        name: of the command.
        sentence: what it does; for the list of commands and the beginning of its help.
        example: a line that runs, for the end of its help.

    Returns:
        Its parser.
    """
    return commands.add_parser(
        name, help=sentence, description=sentence, epilog=f"example:\n  {example}"
    )


def add_kinds(parser: Parser) -> Any:
    """Where the commands below a command are added, one of which must be given."""
    return parser.add_subparsers(dest="kind", metavar="KIND", required=True)


def add_out(parser: argparse.ArgumentParser, folder: str) -> None:
    """Where results are written: `--out`, by default this folder; and `--verbose`."""
    parser.add_argument("--out", type=Path, default=Path(folder), help="folder for the results")
    parser.add_argument(
        "--verbose", action="store_true", help="say what was compiled, and how long it took"
    )


def add_svg(parser: argparse.ArgumentParser) -> None:
    """Whether figures are written as SVG too: `--svg`."""
    parser.add_argument("--svg", action="store_true", help="write figures as SVG too")


def add_convention(parser: argparse.ArgumentParser, whose: str) -> None:
    """What the six numbers of a pose mean: `--convention`."""
    parser.add_argument("--convention", choices=CONVENTIONS, default="femoral", help=whose)


def add_repeated(parser: argparse.ArgumentParser, option: str, **words: Any) -> None:
    """An option that may be given several times: a list, empty without it."""
    parser.add_argument(option, action="append", default=[], **words)


def add_values(parser: argparse.ArgumentParser) -> None:
    """Parameters that are not those of the knee's file: `--set`."""
    add_repeated(
        parser,
        "--set",
        metavar="NAME=VALUE",
        dest="values",
        help="a parameter, as ACL.stiffness=3000 (N) or *.reference_strain=0.02; once for each. By "
        "the name of a structure drawn as several fibres (a group), stiffness is the sum over its "
        "fibres, any other number their mean",
    )


def lazily(module: str) -> Callable[[argparse.Namespace], int]:
    """A command, as the name of a file here, that is imported when it is called."""

    load = functools.partial(importlib.import_module, f"kneejax.cli.{module}")

    def run(arguments: argparse.Namespace) -> int:
        return load().run(arguments)

    run.load = load  # pyright: ignore[reportFunctionMemberAccess]
    return run
