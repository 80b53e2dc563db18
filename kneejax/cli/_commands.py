"""Every command and its arguments. What a command does is imported when it is called."""

from __future__ import annotations

import argparse
import functools
from pathlib import Path

from kneejax.cli._activity_command import add_activity
from kneejax.cli._cohort_commands import add_cohort, add_cohort_options
from kneejax.cli._dynamic_options import IN_TIME, add_dynamic_options
from kneejax.cli._import_commands import add_export, add_import
from kneejax.cli._parser import (
    KNEE,
    Parser,
    add_command,
    add_convention,
    add_out,
    add_repeated,
    add_svg,
    add_values,
    lazily,
)
from kneejax.cli._plan_commands import add_plan
from kneejax.cli._study_commands import add_identify, add_map, add_sensitivity
from kneejax.cli._test_options import (
    EXTENSOR,
    PATELLAS,
    TESTS,
    add_extensor_options,
    add_test_options,
)
from kneejax.cli._version import ShowVersion
from kneejax.cli.joint import add_joint

#: Shells for which a completion can be printed.
SHELLS = ("bash", "zsh", "fish")


class _NamesOut(argparse.Action):
    """The experiment; results go to a folder of its name unless `--out` says otherwise."""

    folder = "kneejax-EXPERIMENT"

    def __call__(self, parser, namespace, values, option_string=None):
        setattr(namespace, self.dest, values)
        if namespace.out == Path(self.folder):
            namespace.out = Path(f"kneejax-{values}")


def build_parser() -> Parser:
    """The parser of `kneejax`, complete."""
    parser = Parser(
        prog="kneejax",
        description="A differentiable knee that identifies its ligaments from measured motion.",
        epilog="kneejax COMMAND --help explains a command.\n\n"
        "example:\n  kneejax simulate passive-flexion --flexion 0:120:5",
    )
    parser.add_argument("--version", action=ShowVersion, help="show versions and exit")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND")
    for add in (
        _add_knees, _add_describe, _add_simulate, add_activity, _add_evaluate, _add_calibrate,
        add_map, add_sensitivity, add_identify, _add_reproduce, _add_view, _add_joint,
        add_import, add_export, add_cohort, functools.partial(add_plan, lazily=lazily),
        _add_rerun, _add_completion,
    ):  # fmt: skip
        add(commands)
    return parser


def _add_knees(commands) -> None:
    knees = add_command(
        commands, "knees", "List bundled knees, studies and measurements.", "kneejax knees"
    )
    knees.add_argument(
        "--copy", metavar="NAME", help="copy a bundled example or knee file into this folder"
    )
    knees.set_defaults(run=lazily("_knees"))


def _add_describe(commands) -> None:
    describe = add_command(
        commands,
        "describe",
        "Print a knee: ligaments, surfaces, contact, frames.",
        "kneejax describe four_ligament",
    )
    describe.add_argument("knee", help=KNEE)
    describe.add_argument(
        "--fibres",
        action="store_true",
        help="a row for each fibre, with its strain at the reference pose",
    )
    describe.set_defaults(run=lazily("_describe"))


def _add_simulate(commands) -> None:
    simulate = add_command(
        commands,
        "simulate",
        "Move a knee through flexion, or load it as a laboratory does.",
        "kneejax simulate drawer --knee lenhart2015_reduced --flexion 0:90:15 --force_N 100 --both",
    )
    simulate.add_argument(
        "experiment",
        choices=["passive-flexion", *TESTS, *EXTENSOR, *IN_TIME],
        action=_NamesOut,
        metavar="EXPERIMENT",
        help=f"passive-flexion, or a test under load: {', '.join(TESTS)}; `load` makes the load "
        "that --load says grow from nothing, `envelope` is drawer, varus-valgus and torsion; or "
        f"with the patella, {', '.join(EXTENSOR)}; or through time, {', '.join(IN_TIME)}, or a "
        "test with --dynamic",
    )
    simulate.add_argument("--knee", default="average_knee", help=KNEE)
    simulate.add_argument(
        "--flexion",
        help="degrees: first:last:step or a,b,c (default: 0:120:5 in passive-flexion, 0:90:15 in "
        "tests, 20 in lachman)",
    )
    add_test_options(simulate)
    add_extensor_options(simulate)
    add_dynamic_options(simulate)
    add_values(simulate)
    add_repeated(
        simulate,
        "--cut",
        metavar="LIGAMENT",
        help="a ligament, or a group of them, that does not act; once for each",
    )
    simulate.add_argument(
        "--branches",
        action="store_true",
        help="look for other stable balances at the same angles and load as well: branches.csv",
    )
    add_repeated(
        simulate,
        "--load",
        metavar="NAME=SIZE",
        help="on the tibia, along the axes of Grood and Suntay: lateral_N, anterior_N, "
        "compression_N (at the tibia's origin), varus_Nm, internal_Nm; e.g. anterior_N=134. In a "
        "test it acts throughout",
    )
    add_out(simulate, _NamesOut.folder)
    add_svg(simulate)
    add_convention(simulate, "of the poses that are printed and written")
    simulate.set_defaults(run=lazily("_simulate"))


def _add_evaluate(commands) -> None:
    evaluate = add_command(
        commands,
        "evaluate",
        "Say how ligaments and contact are at given poses; nothing is solved.",
        "kneejax simulate passive-flexion && "
        "kneejax evaluate average_knee kneejax-passive-flexion/poses.csv",
    )
    evaluate.add_argument("knee", help=KNEE)
    evaluate.add_argument("poses", type=Path, help="CSV of poses")
    add_out(evaluate, "kneejax-evaluate")
    add_convention(evaluate, "of the poses")
    evaluate.set_defaults(run=lazily("_evaluate"))


def _add_calibrate(commands) -> None:
    calibrate = add_command(
        commands,
        "calibrate",
        "Identify the parameters of ligaments from measured motion.",
        "kneejax calibrate passive_flexion",
    )
    calibrate.add_argument(
        "study",
        nargs="?",
        default="passive_flexion",
        help="study file or bundled study; or a cohort: a folder of studies, a pattern in quotes, "
        "or a file that names its knees",
    )
    add_cohort_options(calibrate)
    add_out(calibrate, "kneejax-calibration")
    add_svg(calibrate)
    calibrate.set_defaults(run=lazily("_calibrate"))


def _add_reproduce(commands) -> None:
    command = add_command(
        commands,
        "reproduce",
        "Compute what a paper claims, and judge each claim.",
        "kneejax reproduce 1",
    )
    command.add_argument("paper", choices=["1", "2", "3", "4", "5"], help="number of the paper")
    command.add_argument("--knee", help=f"of paper 1, four_ligament_fitted by default: {KNEE}")
    command.add_argument(
        "--patella",
        choices=PATELLAS,
        help="of paper 1, on which its 2 kg pull: on-path, with one degree of freedom as in the "
        "paper (default); balanced, a third bone; none, a line of constant tension instead",
    )
    add_out(command, "kneejax-reproduction")
    add_svg(command)
    command.set_defaults(run=lazily("_reproduce"))


def _add_view(commands) -> None:
    view = add_command(
        commands,
        "view",
        "Draw a knee in space at poses: pictures, a film, and a page to turn it.",
        "kneejax simulate passive-flexion && "
        "kneejax view average_knee kneejax-passive-flexion/poses.csv",
    )
    view.add_argument("knee", help=KNEE)
    view.add_argument("poses", nargs="?", type=Path, help="CSV of poses; the reference pose else")
    view.add_argument(
        "--patella",
        action="store_true",
        help="with the patella and the quadriceps, as where a table has the patella's columns",
    )
    for bone in ("femur", "tibia", "patella"):
        view.add_argument(
            f"--{bone}-bone",
            type=Path,
            metavar="FILE",
            help=f"mesh of the {bone} to show, in its frame, m or mm",
        )
    add_out(view, "kneejax-view")
    add_svg(view)
    add_convention(view, "of the poses")
    view.set_defaults(run=lazily("_view"))


def _add_joint(commands) -> None:
    joint = add_command(
        commands,
        "joint",
        "Fit, compare and export simple joints: moving axis and hinge.",
        "kneejax joint fit --knee four_ligament --flexion 0:90:10",
    )
    add_joint(joint)
    joint.set_defaults(run=lazily("joint._command"))


def _add_rerun(commands) -> None:
    rerun = add_command(
        commands,
        "rerun",
        "Run the command that wrote a folder once more.",
        "kneejax simulate passive-flexion && "
        "kneejax rerun kneejax-passive-flexion --out again",
    )
    rerun.add_argument("folder", type=Path, help="with the settings.json of a command")
    rerun.add_argument("--out", type=Path, help="folder for the results; the same one otherwise")
    rerun.set_defaults(run=lazily("_rerun"))


def _add_completion(commands) -> None:
    completion = add_command(
        commands,
        "completion",
        "Print a script that lets a shell complete commands, options and files.",
        'eval "$(kneejax completion bash)"',
    )
    completion.add_argument("shell", choices=SHELLS, help="whose script")
    completion.set_defaults(run=lazily("_completion"))
