"""`kneejax joint fit|compare|export`: their arguments; each runs in a file of its own."""

from __future__ import annotations

import argparse
import importlib
from pathlib import Path

_CONVENTIONS = ("femoral", "grood-suntay", "tibial", "femur-in-tibia")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `kneejax joint`."""
    kinds = parser.add_subparsers(dest="kind", required=True, parser_class=type(parser))
    _add_fit(kinds.add_parser("fit", help="moving axis and hinge from poses and a femur"))
    compare = kinds.add_parser("compare", help="joints and a knee against measured motion")
    _when_parsed(compare, "kneejax.cli._joint_compare")
    export = kinds.add_parser("export", help="an OpenSim CustomJoint and coupled coordinates")
    export.add_argument("joint", type=Path, help="joint file")
    export.add_argument("--out", type=Path, default=Path("kneejax-joint-export"))


def run(arguments: argparse.Namespace) -> int:
    """Run the command that was asked for."""
    return importlib.import_module(f"kneejax.cli._joint_{arguments.kind}").run(arguments)


def _add_fit(parser: argparse.ArgumentParser) -> None:
    point = {"type": float, "nargs": 3, "metavar": ("X", "Y", "Z")}
    parser.add_argument("poses", type=Path, help="CSV of two or more measured poses")
    parser.add_argument("--convention", choices=_CONVENTIONS, default="femoral")
    parser.add_argument(
        "--at",
        type=float,
        nargs="+",
        metavar="DEGREES",
        help="calibrate on the poses nearest to these flexions; on the first and last otherwise",
    )
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("--femur", type=Path, metavar="MESH", help="bone or cartilage")
    source.add_argument("--axes", type=Path, metavar="FILE", help="YAML of axis points instead")
    parser.add_argument("--unit", choices=["auto", "m", "mm", "cm"], default="auto")
    parser.add_argument("--side", choices=["right", "left"], default="right")
    parser.add_argument(
        "--landmarks", type=Path, metavar="FILE", help="YAML: femur's axes, in the mesh's frame"
    )
    parser.add_argument(
        "--extension-facet", type=float, nargs=2, metavar="DEGREES", default=(65.0, 110.0),
        help="from anterior through distal, about the transverse axis",
    )  # fmt: skip
    parser.add_argument(
        "--flexion-facet", type=float, nargs=2, metavar="DEGREES", default=(110.0, 190.0)
    )
    parser.add_argument("--medial-epicondyle", **point, help="mm, for the hinge")
    parser.add_argument("--lateral-epicondyle", **point)
    parser.add_argument(
        "--interpolation", choices=["linear", "monotone"], help="monotone from three poses on"
    )
    parser.add_argument("--flexion", default="0:120:5", help="of the tables: first:last:step")
    parser.add_argument("--out", type=Path, default=Path("kneejax-joint"))


def _when_parsed(parser: argparse.ArgumentParser, module: str) -> None:
    """Let a module add its arguments once they are needed: it may import much."""
    parse = parser.parse_known_args

    def complete_first(*arguments, **options):
        importlib.import_module(module).add_arguments(parser)
        parser.parse_known_args = parse
        return parse(*arguments, **options)

    parser.parse_known_args = complete_first
