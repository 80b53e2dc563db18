"""What `kneejax simulate` may be told of a test under load."""

from __future__ import annotations

import argparse

from kneejax.cli._parser import add_repeated

#: As `kneejax.experiments.READY`, which would bring in JAX, and two more.
TESTS = (
    "drawer", "lachman", "torsion", "varus-valgus", "compression", "distraction", "pivot",
    "envelope", "load",
)  # fmt: skip
#: Experiments in which the quadriceps pulls on a patella.
EXTENSOR = ("patellar-tracking", "extension", "leg-raise")
#: What paper 1's weight pulls on, its own form first.
PATELLAS = ("on-path", "balanced", "none")
_HELD = ("adduction", "internal_rotation")
#: Of `kneejax.experiments.COUNTED_FROM`, what a simulated test can be counted from.
_COUNTED_FROM = ("unloaded", "intact")


def add_test_options(simulate: argparse.ArgumentParser) -> None:
    """Sizes of a test, by force or by displacement, what is held, and its steps."""
    simulate.add_argument(
        "--force_N",
        type=float,
        help="full force of a test (default: 100; compression 500, distraction 50)",
    )
    simulate.add_argument(
        "--moment_Nm",
        type=float,
        help="full moment of a test (default: 10; torsion 5); pivot adds half of it in internal "
        "torque, torsion in an envelope is half of it",
    )
    simulate.add_argument(
        "--displacement_mm",
        type=float,
        help="of drawer and lachman: a machine moves the tibia so far, and its force is read",
    )
    simulate.add_argument(
        "--rotation_deg",
        type=float,
        help="of torsion and varus-valgus: a machine turns the tibia so far; its moment is read",
    )
    add_repeated(
        simulate,
        "--hold",
        choices=_HELD,
        metavar="ROTATION",
        help=f"a rotation that a machine holds where it is without the test's load: "
        f"{' or '.join(_HELD)}; once for each",
    )
    simulate.add_argument(
        "--counted_from",
        choices=_COUNTED_FROM,
        help="what displacements of a cut knee are counted from: its own unloaded pose (default), "
        "or that of the intact knee, from which a machine moves it too; as in a study",
    )
    simulate.add_argument(
        "--both", action="store_true", help="load a test in the opposite sense too"
    )
    simulate.add_argument(
        "--steps", type=int, help="of a test, from nothing to the full load (default: 20)"
    )


def add_extensor_options(simulate: argparse.ArgumentParser) -> None:
    """Pull of the quadriceps, and the leg that it holds."""
    simulate.add_argument(
        "--quadriceps_N",
        type=float,
        help="pull of the quadriceps: of patellar-tracking (default: 100), and the largest of "
        "extension (default: 1000), which --steps divides",
    )
    simulate.add_argument(
        "--quadriceps_mm",
        metavar="FROM:TO:STEP",
        help="of extension and leg-raise, instead of a pull: how much longer the quadriceps is "
        "than at rest, at the flexion that is held or in extension; as 0:-3:-0.5; its pull, and "
        "of leg-raise flexion, is a result",
    )
    simulate.add_argument(
        "--body_kg", type=float, help="of leg-raise: the person (default: 75); shank and foot are "
        "6.1 %% of it"
    )  # fmt: skip
    simulate.add_argument("--height_m", type=float, help="of leg-raise (default: 1.75)")
    simulate.add_argument(
        "--ankle_kg", type=float, help="of leg-raise: a weight at the ankle besides (default: 0)"
    )
    simulate.add_argument(
        "--femur_deg",
        type=float,
        help="of leg-raise: of the thigh from the horizontal, knee above hip positive (default: 0)",
    )
