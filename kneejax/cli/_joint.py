"""`kneejax joint fit|compare|export`: their arguments; each runs in a file of its own."""

from __future__ import annotations

import argparse
import importlib
import math
from pathlib import Path

CONVENTIONS = ("femoral", "grood-suntay", "tibial", "femur-in-tibia")


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


def _when_parsed(parser: argparse.ArgumentParser, module: str) -> None:
    """Let a module add its arguments once they are needed: it may import much."""
    parse = parser.parse_known_args

    def complete_first(*arguments, **options):
        importlib.import_module(module).add_arguments(parser)
        parser.parse_known_args = parse
        return parse(*arguments, **options)

    parser.parse_known_args = complete_first
