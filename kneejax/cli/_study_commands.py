"""Arguments of the commands that ask what data and parameters tell about each other."""

from __future__ import annotations

import argparse
from pathlib import Path

from kneejax.cli._parser import KNEE
from kneejax.studies import Identify, Map, Sensitivity


def add_map(parser: argparse.ArgumentParser) -> None:
    """Arguments of `kneejax map`."""
    add_study(parser)
    parser.add_argument(
        "--pair",
        nargs=2,
        action="append",
        default=[],
        metavar=("X", "Y"),
        help="two parameters, e.g. PCL.stiffness PCL.reference_strain; may be repeated",
    )
    parser.add_argument(
        "--all-pairs", action="store_true", help="every pair of the study's parameters"
    )
    parser.add_argument("--grid", default=f"{Map.grid[0]}", help="points a side, or as in 41x61")
    parser.add_argument(
        "--range",
        action="append",
        default=[],
        metavar="NAME=LOW:HIGH",
        dest="ranges",
        help="of a parameter; the study's bounds otherwise",
    )


def add_sensitivity(parser: argparse.ArgumentParser) -> None:
    """Arguments of `kneejax sensitivity`."""
    add_study(parser)
    parser.add_argument(
        "--sweep",
        action="append",
        default=[],
        metavar="NAME[=LOW:HIGH[:COUNT]]",
        help="a parameter, or as *.stiffness, one at a time; all of the study's otherwise",
    )
    parser.add_argument(
        "--scale",
        choices=["prior", "percent"],
        default=Sensitivity.scale,
        help="local derivatives per standard deviation of a prior, or per per cent",
    )
    parser.add_argument(
        "--prior",
        action="append",
        default=[],
        metavar="NAME=SD",
        help="standard deviation of a parameter, or as *.stiffness; usual ones otherwise",
    )
    parser.add_argument(
        "--global",
        choices=["sobol", "morris"],
        dest="indices",
        help="global indices of the motion too (package SALib)",
    )
    parser.add_argument(
        "--samples",
        type=int,
        help="points of Sobol's sequence, a power of two, or Morris trajectories (default: 256 or "
        "64)",
    )
    parser.add_argument(
        "--range",
        action="append",
        default=[],
        metavar="NAME=LOW:HIGH",
        dest="ranges",
        help="of a parameter, for global indices; as wide as its prior otherwise",
    )
    parser.add_argument(
        "--knees",
        nargs="+",
        metavar="KNEE",
        help="compare knees instead: varus and valgus moments, scores of paper 4; each a "
        f"{KNEE}",
    )
    parser.add_argument(
        "--seed", type=int, default=Sensitivity.seed, help="of the random numbers"
    )


def add_identify(parser: argparse.ArgumentParser) -> None:
    """Arguments of `kneejax identify`."""
    add_study(parser)
    parser.add_argument("--noise-mm", type=float, help="standard deviation of measured positions")
    parser.add_argument("--noise-deg", type=float, help="standard deviation of measured rotations")
    parser.add_argument(
        "--prior",
        action="append",
        default=[],
        metavar="NAME=MEAN:SD",
        help="normal prior of a parameter or wildcard, for the posterior",
    )
    parser.add_argument(
        "--posterior", action="store_true", help="sample it (packages BlackJAX and ArviZ)"
    )
    parser.add_argument(
        "--chains", type=int, default=Identify.chains, help="of the posterior's samples"
    )
    parser.add_argument(
        "--draws", type=int, default=Identify.draws, help="of each chain, after warm-up"
    )
    parser.add_argument("--seed", type=int, default=Identify.seed, help="of the random numbers")
    parser.add_argument(
        "--next-tests",
        type=int,
        default=Identify.next_tests,
        metavar="K",
        help="how many tests to choose",
    )
    parser.add_argument(
        "--criterion",
        choices=["D", "A"],
        default=Identify.criterion,
        help="what they make small: the volume of the confidence region (D), or the mean squared "
        "standard error (A)",
    )
    parser.add_argument(
        "--candidates", type=Path, help="CSV of tests to choose from; a usual set otherwise"
    )


def add_study(parser: argparse.ArgumentParser) -> None:
    """The study, of every command that has one."""
    parser.add_argument("study", nargs="?", default="paper1", help="study file or bundled study")
