"""Arguments of `kneejax joint fit|compare|export`."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from kneejax.cli._parser import (
    CONVENTIONS,
    Parser,
    add_command,
    add_kinds,
    add_out,
    add_repeated,
    add_svg,
)
from kneejax.files.reading import plain_number


def add_joint(joint: Parser) -> None:
    """Add the commands below `kneejax joint`."""
    kinds = add_kinds(joint)
    fit = "kneejax joint fit --knee four_ligament --flexion 0:90:10"
    _add_fit(
        add_command(kinds, "fit", "Fit a moving axis and a hinge to poses or a contact knee.", fit)
    )
    _add_compare(
        add_command(
            kinds,
            "compare",
            "Hold joints and contact knees against measured motion.",
            "kneejax simulate passive-flexion && "
            "kneejax joint compare kneejax-passive-flexion/poses.csv --knee four_ligament",
        )
    )
    _add_export(
        add_command(
            kinds,
            "export",
            "Write a joint as an OpenSim CustomJoint and as coupled coordinates.",
            "kneejax joint fit --knee four_ligament && "
            "kneejax joint export kneejax-joint/joint.yaml",
        )
    )


def _add_fit(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "poses", type=Path, nargs="?", help="CSV of two or more measured poses; or --knee"
    )
    _add_table(parser)
    parser.add_argument(
        "--knee",
        help="passive flexion of a contact knee instead of poses: bundled name, knee file, or the "
        "result.json of a calibration; without --femur and --axes its condyles give the axes",
    )
    parser.add_argument(
        "--at",
        type=_degrees,
        nargs="+",
        metavar="DEGREES",
        help="calibrate on the poses nearest to these flexions; on the first and last otherwise, "
        "of a knee at both ends of --flexion",
    )
    _add_anatomy(parser)
    parser.add_argument(
        "--interpolation",
        choices=["linear", "monotone"],
        help="between the poses (default: monotone from three poses on)",
    )
    parser.add_argument(
        "--flexion", default="0:120:5", help="of the tables: first:last:step or a,b,c"
    )
    add_out(parser, "kneejax-joint")
    add_svg(parser)


def _add_anatomy(parser: argparse.ArgumentParser) -> None:
    """Where the axes of the femur come from: meshes, or points that are given."""
    point = {"type": float, "nargs": 3, "metavar": ("X", "Y", "Z")}
    femur = parser.add_mutually_exclusive_group()
    femur.add_argument("--femur", type=Path, metavar="MESH", help="bone or cartilage")
    femur.add_argument("--axes", type=Path, metavar="FILE", help="YAML or CSV of axis points")
    parser.add_argument(
        "--tibia",
        type=Path,
        metavar="MESH",
        help="facets are where the femur meets it, at the first and at the last calibration pose",
    )
    parser.add_argument(
        "--touching-within", type=_millimetres, metavar="MM", help="how near that is (default: 4)"
    )
    parser.add_argument(
        "--unit", choices=["auto", "m", "mm", "cm"], help="of the meshes (default: auto)"
    )
    parser.add_argument(
        "--side", choices=["right", "left"], help="of the knee (default: right, or that of --knee)"
    )
    parser.add_argument(
        "--landmarks",
        type=Path,
        metavar="FILE",
        help="YAML: axes of femur and tibia, in the frames of their meshes",
    )
    parser.add_argument(
        "--extension-facet", type=float, nargs=2, metavar="DEGREES",
        help="from anterior through distal, about the transverse axis (default: 65 110)",
    )  # fmt: skip
    parser.add_argument(
        "--flexion-facet",
        type=float,
        nargs=2,
        metavar="DEGREES",
        help="likewise (default: 110 190)",
    )
    parser.add_argument("--medial-epicondyle", **point, help="mm, for the hinge")
    parser.add_argument("--lateral-epicondyle", **point, help="likewise")


def _add_compare(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "measured", type=Path, nargs="+", help="CSV of measured poses, one file a subject"
    )
    _add_table(parser)
    add_repeated(
        parser,
        "--joint",
        metavar="[NAME=]FILE[,FILE...]",
        help="joint file for all subjects, or one for each, in their order; may be repeated",
    )
    add_repeated(
        parser,
        "--knee",
        help="contact knee in passive flexion: bundled name, knee file, or the result.json of a "
        "calibration; may be repeated",
    )
    parser.add_argument(
        "--calibrate-at",
        type=_degrees,
        nargs="+",
        default=[],
        metavar="DEGREES",
        help="fit moving axis and hinge here, each subject's on its own poses at these flexions "
        "with the points of --axes; and leave those poses out of the comparison",
    )
    parser.add_argument(
        "--average-within",
        type=float,
        metavar="DEGREES",
        help="poses as near as this to a flexion of calibration are averaged for it (default: 0.5)",
    )
    add_repeated(
        parser,
        "--axes",
        metavar="FILE[,FILE...]",
        help="axis points, as for kneejax joint fit: one file for all subjects, or one for each, "
        "in their order",
    )
    parser.add_argument(
        "--side",
        choices=["right", "left"],
        help="of the knees whose points --axes gives, with Z to the person's right; poses go by "
        "clinical meaning on either side (default: right)",
    )
    parser.add_argument(
        "--spread",
        type=float,
        default=1.0,
        metavar="DEGREES",
        help="by how much subjects may be flexed differently at one condition",
    )
    parser.add_argument(
        "--anova",
        action=argparse.BooleanOptionalAction,
        help="test differences, by package pingouin (default: from three subjects on)",
    )
    parser.add_argument("--alpha", type=float, default=0.01, help="level of these tests")
    add_out(parser, "kneejax-joint-compare")
    add_svg(parser)


def _add_export(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("joint", type=Path, help="joint file")
    add_out(parser, "kneejax-joint-export")


def _add_table(parser: argparse.ArgumentParser) -> None:
    """What the columns of measured poses mean and how they are called."""
    parser.add_argument("--convention", choices=CONVENTIONS, help="of the poses (default: femoral)")
    parser.add_argument(
        "--column",
        action="append",
        metavar="NAME=COLUMN",
        help="the table's column for one of the package's, as flexion_deg=knee_flex_deg; may be "
        "repeated",
    )


def _degrees(text: str) -> float:
    """An angle, one of several that are given with blanks between them."""
    angle = plain_number(text)
    if angle is None or not math.isfinite(angle):
        raise argparse.ArgumentTypeError(
            f"{text}: expected a number of degrees; several have blanks between them, as 0 90"
        )
    return angle


def _millimetres(text: str) -> float:
    length = plain_number(text)
    if length is None or not 0.0 < length < math.inf:
        raise argparse.ArgumentTypeError(f"{text}: expected mm above 0")
    return length
