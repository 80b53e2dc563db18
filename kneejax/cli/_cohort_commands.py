"""Arguments of what concerns many knees: `kneejax cohort`, and calibrate's for a cohort."""

from __future__ import annotations

import argparse

from kneejax.cli._parser import KNEE, add_command, add_kinds, add_out, lazily
from kneejax.files import InputProblem

_OF_COHORTS = ("bootstrap", "blocks", "jobs", "scheduler", "shard")


def add_cohort(commands) -> None:
    """`kneejax cohort synthesise`."""
    example = "kneejax cohort synthesise --knees 100 --out made-up && kneejax calibrate made-up"
    above = add_command(commands, "cohort", "Make up a cohort of knees.", example)
    kinds = add_kinds(above)
    sentence = "Make up knees and their measurements; the truth is kept aside."
    made = add_command(kinds, "synthesise", sentence, example)
    made.add_argument("--knees", type=int, default=100, help="how many")
    made.add_argument("--seed", type=int, default=0, help="of the random numbers")
    made.add_argument("--knee", default="four_ligament", help=f"that is varied: {KNEE}")
    made.add_argument(
        "--noise-mm", type=float, default=0.2, help="standard deviation of measured positions"
    )
    made.add_argument(
        "--noise-deg", type=float, default=0.2, help="standard deviation of measured rotations"
    )
    add_out(made, "kneejax-cohort")
    made.set_defaults(run=lazily("_cohort_synthesise"))


def add_cohort_options(calibrate: argparse.ArgumentParser) -> None:
    """What may be asked where a cohort is calibrated."""
    calibrate.add_argument(
        "--bootstrap",
        type=int,
        metavar="N",
        help="of a cohort: for each knee N fits of data that its answer would give, with noise",
    )
    calibrate.add_argument(
        "--blocks",
        action="store_const",
        const=True,
        help="with --bootstrap: of curves drawn among those that were measured, each the passive "
        "motion or a test at one flexion",
    )
    calibrate.add_argument(
        "--jobs",
        type=int,
        metavar="N",
        help="of a cohort: workers on this machine, a core each (package dask; default: this "
        "process alone)",
    )
    calibrate.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="of a cohort: the workers of a Dask cluster, e.g. tcp://10.0.0.1:8786",
    )
    calibrate.add_argument(
        "--shard",
        metavar="I/N",
        help="of a cohort: only the I-th of N parts, for job arrays; whoever is last writes the "
        "report",
    )


def check_single(arguments: argparse.Namespace) -> None:
    """Refuse what only a cohort can be asked.

    Raises:
        InputProblem: such an option, and a single study.
    """
    for name in _OF_COHORTS:
        if getattr(arguments, name) is not None:
            value, study = getattr(arguments, name), arguments.study
            expected = (
                "this option with a cohort alone (a folder, a pattern in quotes or a cohort file), "
                f"not {study}"
            )
            given = "given" if value is True else str(value)
            raise InputProblem(f"--{name}", "option", given, expected)
