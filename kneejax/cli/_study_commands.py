"""Arguments of the commands that ask what data and parameters tell about each other."""

from __future__ import annotations

from pathlib import Path

from kneejax.cli._parser import KNEE, Parser, add_command, add_out, add_repeated, add_svg, lazily
from kneejax.studies import Identify, Map, Sensitivity


def add_map(commands) -> None:
    """`kneejax map`."""
    command = add_command(
        commands,
        "map",
        "Compute the objective over pairs of parameters.",
        "kneejax map --pair PCL.stiffness PCL.reference_strain --grid 21",
    )
    _add_study(command)
    add_repeated(
        command,
        "--pair",
        nargs=2,
        metavar=("X", "Y"),
        help="two parameters, e.g. PCL.stiffness PCL.reference_strain; may be repeated",
    )
    command.add_argument(
        "--all-pairs", action="store_true", help="every pair of the study's parameters"
    )
    command.add_argument("--grid", default=f"{Map().grid[0]}", help="points a side, or as in 41x61")
    add_repeated(
        command,
        "--range",
        metavar="NAME=LOW:HIGH",
        dest="ranges",
        help="of a parameter; the study's bounds otherwise",
    )
    add_out(command, "kneejax-map")
    add_svg(command)
    command.set_defaults(run=lazily("_map"))


def add_sensitivity(commands) -> None:
    """`kneejax sensitivity`."""
    command = add_command(
        commands,
        "sensitivity",
        "Say what each parameter does to the motion.",
        "kneejax sensitivity --sweep ACL.stiffness",
    )
    _add_study(command)
    add_repeated(
        command,
        "--sweep",
        metavar="NAME[=LOW:HIGH[:COUNT]]",
        help="a parameter, or as *.stiffness, one at a time; all of the study's otherwise",
    )
    command.add_argument(
        "--scale",
        choices=["prior", "percent"],
        default=Sensitivity().scale,
        help="local derivatives per standard deviation of a prior, or per per cent",
    )
    add_repeated(
        command,
        "--prior",
        metavar="NAME=SD",
        help="standard deviation of a parameter, or as *.stiffness; usual ones otherwise",
    )
    command.add_argument(
        "--global",
        choices=["sobol", "morris"],
        dest="indices",
        help="global indices of the motion too (package SALib)",
    )
    command.add_argument(
        "--samples",
        type=int,
        help="points of Sobol's sequence, a power of two, or Morris trajectories (default: 256 or "
        "64)",
    )
    add_repeated(
        command,
        "--range",
        metavar="NAME=LOW:HIGH",
        dest="ranges",
        help="of a parameter, for global indices; as wide as its prior otherwise",
    )
    command.add_argument(
        "--knees",
        nargs="+",
        metavar="KNEE",
        help="compare knees instead: varus and valgus moments, scores of paper 4; each a "
        f"{KNEE}",
    )
    command.add_argument(
        "--seed", type=int, default=Sensitivity().seed, help="of the random numbers"
    )
    add_out(command, "kneejax-sensitivity")
    add_svg(command)
    command.set_defaults(run=lazily("_sensitivity"))


def add_identify(commands) -> None:
    """`kneejax identify`."""
    command = add_command(
        commands,
        "identify",
        "Say what the data of a study can and cannot tell, and what to measure next.",
        "kneejax identify --next-tests 2",
    )
    _add_study(command)
    command.add_argument("--noise-mm", type=float, help="standard deviation of measured positions")
    command.add_argument("--noise-deg", type=float, help="standard deviation of measured rotations")
    add_repeated(
        command,
        "--prior",
        metavar="NAME=MEAN:SD",
        help="normal prior of a parameter or wildcard, for the posterior",
    )
    command.add_argument(
        "--posterior", action="store_true", help="sample it (packages BlackJAX and ArviZ)"
    )
    command.add_argument(
        "--chains", type=int, default=Identify().chains, help="of the posterior's samples"
    )
    command.add_argument(
        "--draws", type=int, default=Identify().draws, help="of each chain, after warm-up"
    )
    command.add_argument("--seed", type=int, default=Identify().seed, help="of the random numbers")
    command.add_argument(
        "--next-tests",
        type=int,
        default=Identify().next_tests,
        metavar="K",
        help="how many tests to choose",
    )
    command.add_argument(
        "--criterion",
        choices=["D", "A"],
        default=Identify().criterion,
        help="what they make small: the volume of the confidence region (D), or the mean squared "
        "standard error (A)",
    )
    command.add_argument(
        "--candidates", type=Path, help="CSV of tests to choose from; a usual set otherwise"
    )
    add_out(command, "kneejax-identify")
    add_svg(command)
    command.set_defaults(run=lazily("_identify"))


def _add_study(command: Parser) -> None:
    """The study, of every command that has one."""
    command.add_argument(
        "study", nargs="?", default="passive_flexion", help="study file or bundled study"
    )
