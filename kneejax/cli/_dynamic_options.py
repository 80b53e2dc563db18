"""What `kneejax simulate` may be told of a motion through time."""

from __future__ import annotations

import argparse
from pathlib import Path

from kneejax.cli._parser import add_repeated

#: Experiments through time; tests under load are with `--dynamic`.
IN_TIME = ("settle", "drop")


def add_dynamic_options(simulate: argparse.ArgumentParser) -> None:
    """Time, loads over it, damping and how exact."""
    simulate.add_argument(
        "--dynamic",
        action="store_true",
        help="of a test by load, at one flexion: with mass, damping and time; the load grows in "
        "--ramp_s and stays; of leg-raise: a motor shortens the quadriceps. settle and drop are so "
        "anyway",
    )
    simulate.add_argument(
        "--loads",
        type=Path,
        metavar="FILE.csv",
        help="of `load --dynamic`: loads over time, a column time_s and columns like anterior_N; "
        "columns like flexion_deg lead a coordinate; of `leg-raise --dynamic`: a column "
        "quadriceps_mm, what a motor makes of its length",
    )
    simulate.add_argument(
        "--duration_s",
        type=float,
        help="of a motion through time (default: 1; settle 2; leg-raise 20; that of --loads)",
    )
    simulate.add_argument(
        "--every_ms", type=float, help="between two rows of its tables (default: 1; leg-raise 100)"
    )
    simulate.add_argument(
        "--ramp_s", type=float, help="in which the load of a test grows (default: 0.1)"
    )
    _add_damping(simulate)
    add_repeated(
        simulate,
        "--from",
        metavar="NAME=SIZE",
        dest="offset",
        help="how far from its balance the knee is let go, as anterior_mm=3 or adduction_deg=2; "
        "once for each (default of settle: anterior_mm=3)",
    )
    simulate.add_argument(
        "--error_mm",
        type=float,
        help="that the steps may leave in any pose (default: 0.01); they become as short as it "
        "takes",
    )


def _add_damping(simulate: argparse.ArgumentParser) -> None:
    """Dampers, and a record from which they are found."""
    simulate.add_argument(
        "--critical",
        type=float,
        help="damping of each fibre, as part of sqrt(4 k m) (default: 1; paper 2)",
    )
    simulate.add_argument(
        "--damping_N_s_per_mm",
        type=float,
        help="of every coordinate, rotations at 30 mm (default: 0; settle 1)",
    )
    simulate.add_argument(
        "--dissipation_s_per_mm",
        type=float,
        help="of every contact: its force grows by so much with each mm/s of its overlap "
        "(default: 0)",
    )
    simulate.add_argument(
        "--recorded",
        type=Path,
        metavar="FILE.csv",
        help="a recorded motion, columns time_s and some like anterior_mm, of which changes from "
        "the first row count: finds the damping that --free names",
    )
    add_repeated(
        simulate,
        "--free",
        metavar="NAME",
        help="what is found from --recorded: critical, damping_N_s_per_mm or dissipation_s_per_mm; "
        "once for each",
    )
