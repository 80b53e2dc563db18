"""`kneejax joint fit|compare|export`: their arguments; each runs in a file of its own."""

from __future__ import annotations

import argparse
import importlib
import math
from collections.abc import Sequence
from pathlib import Path

from kneejax.files import InputProblem
from kneejax.geometry import COLUMNS, CONVENTIONS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `kneejax joint`."""
    kinds = parser.add_subparsers(dest="kind", required=True, parser_class=type(parser))
    fit = kinds.add_parser("fit", help="moving axis and hinge from poses or a contact knee")
    _when_parsed(fit, "kneejax.cli._joint_fit")
    compare = kinds.add_parser("compare", help="joints and a knee against measured motion")
    _when_parsed(compare, "kneejax.cli._joint_compare")
    export = kinds.add_parser("export", help="an OpenSim CustomJoint and coupled coordinates")
    export.add_argument("joint", type=Path, help="joint file")
    export.add_argument("--out", type=Path, default=Path("kneejax-joint-export"))


def run(arguments: argparse.Namespace) -> int:
    """Run the command that was asked for."""
    return importlib.import_module(f"kneejax.cli._joint_{arguments.kind}").run(arguments)


def degrees(text: str) -> float:
    """An angle, one of several that are given with blanks between them."""
    try:
        angle = float(text)
    except ValueError:
        angle = math.nan
    if not math.isfinite(angle):
        raise argparse.ArgumentTypeError(
            f"{text}: expected a number of degrees; several have blanks between them, as 0 90"
        )
    return angle


def add_table_arguments(parser: argparse.ArgumentParser) -> None:
    """What the columns of measured poses mean and how they are called."""
    parser.add_argument("--convention", choices=CONVENTIONS, help="of the poses; femoral")
    parser.add_argument(
        "--column",
        action="append",
        metavar="NAME=COLUMN",
        help="the table's column for one of the package's, as flexion_deg=knee_flex_deg; may be "
        "repeated",
    )


def renamed_columns(asked: Sequence[str] | None) -> dict[str, str]:
    """Column of the package -> column of the table.

    Args:
        asked: words `NAME=COLUMN`.

    Returns:
        The names, empty if nothing was asked.

    Raises:
        InputProblem: a word is something else, or a name is unknown or there twice.
    """
    names: dict[str, str] = {}
    for word in asked or ():
        name, _, column = word.partition("=")
        if name not in COLUMNS:
            raise InputProblem("--column", "name", name, f"one of {', '.join(COLUMNS)}", COLUMNS)
        if not column or name in names:
            raise InputProblem("--column", name, column, f"one {name}=COLUMN of the table")
        names[name] = column
    return names


def _when_parsed(parser: argparse.ArgumentParser, module: str) -> None:
    """Let a module add its arguments once they are needed: it may import much."""
    parse = parser.parse_known_args

    def complete_first(*arguments, **options):
        importlib.import_module(module).add_arguments(parser)
        parser.parse_known_args = parse
        return parse(*arguments, **options)

    parser.parse_known_args = complete_first
