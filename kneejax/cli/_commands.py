"""Every command and its arguments. What a command does is imported when it is called."""

from __future__ import annotations

import argparse
import functools
import importlib
from collections.abc import Callable
from pathlib import Path

from kneejax.cli._activity_command import add_activity
from kneejax.cli._cohort_commands import add_cohort, add_cohort_options
from kneejax.cli._dynamic_options import IN_TIME, add_dynamic_options
from kneejax.cli._parser import (
    KNEE,
    Parser,
    add_command,
    add_convention,
    add_kinds,
    add_out,
    add_svg,
)
from kneejax.cli._plan_commands import add_plan
from kneejax.cli._study_commands import add_identify, add_map, add_sensitivity
from kneejax.cli._test_options import EXTENSOR, TESTS, add_extensor_options, add_test_options
from kneejax.cli._version import ShowVersion
from kneejax.cli.joint import add_joint

#: Shells for which a completion can be printed.
SHELLS = ("bash", "zsh", "fish")
_SIDES = ("r", "l")


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
        _add_knees, _add_describe, _add_simulate, _add_activity, _add_evaluate, _add_calibrate,
        _add_map, _add_sensitivity, _add_identify, _add_reproduce, _add_view, _add_joint,
        _add_import, _add_export, _add_cohort, _add_plan, _add_rerun, _add_completion,
    ):  # fmt: skip
        add(commands)
    return parser


def _add_knees(commands) -> None:
    knees = add_command(
        commands, "knees", "List bundled knees, studies and measurements.", "kneejax knees"
    )
    knees.set_defaults(run=_lazily("_knees"))


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
    describe.set_defaults(run=_lazily("_describe"))


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
    simulate.add_argument("--knee", default="four_ligament", help=KNEE)
    simulate.add_argument(
        "--flexion",
        help="degrees: first:last:step or a,b,c (default: 0:120:5 in passive-flexion, 0:90:15 in "
        "tests, 20 in lachman)",
    )
    add_test_options(simulate)
    add_extensor_options(simulate)
    add_dynamic_options(simulate)
    simulate.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        dest="values",
        help="a parameter, as ACL.stiffness=300 (N) or *.reference_strain=0.02; once for each",
    )
    simulate.add_argument(
        "--cut",
        action="append",
        default=[],
        metavar="LIGAMENT",
        help="a ligament, or a group of them, that does not act; once for each",
    )
    simulate.add_argument(
        "--branches",
        action="store_true",
        help="look for other stable balances at the same angles and load as well: branches.csv",
    )
    simulate.add_argument(
        "--load",
        action="append",
        default=[],
        metavar="NAME=SIZE",
        help="on the tibia, along the axes of Grood and Suntay: lateral_N, anterior_N, "
        "compression_N (at the tibia's origin), varus_Nm, internal_Nm; e.g. anterior_N=134. In a "
        "test it acts throughout",
    )
    add_out(simulate, _NamesOut.folder)
    add_svg(simulate)
    add_convention(simulate, "of the poses that are printed and written")
    simulate.set_defaults(run=_lazily("_simulate"))


def _add_evaluate(commands) -> None:
    evaluate = add_command(
        commands,
        "evaluate",
        "Say how ligaments and contact are at given poses; nothing is solved.",
        "kneejax simulate passive-flexion && "
        "kneejax evaluate four_ligament kneejax-passive-flexion/poses.csv",
    )
    evaluate.add_argument("knee", help=KNEE)
    evaluate.add_argument("poses", type=Path, help="CSV of poses")
    add_out(evaluate, "kneejax-evaluate")
    add_convention(evaluate, "of the poses")
    evaluate.set_defaults(run=_lazily("_evaluate"))


def _add_calibrate(commands) -> None:
    calibrate = add_command(
        commands,
        "calibrate",
        "Identify the parameters of ligaments from measured motion.",
        "kneejax calibrate paper1",
    )
    calibrate.add_argument(
        "study",
        nargs="?",
        default="paper1",
        help="study file or bundled study; or a cohort: a folder of studies, a pattern in quotes, "
        "or a file that names its knees",
    )
    add_cohort_options(calibrate)
    add_out(calibrate, "kneejax-calibration")
    add_svg(calibrate)
    calibrate.set_defaults(run=_lazily("_calibrate"))


def _add_map(commands) -> None:
    command = add_command(
        commands,
        "map",
        "Compute the objective over pairs of parameters.",
        "kneejax map --pair PCL.stiffness PCL.reference_strain --grid 21",
    )
    add_map(command)
    add_out(command, "kneejax-map")
    add_svg(command)
    command.set_defaults(run=_lazily("_map"))


def _add_sensitivity(commands) -> None:
    command = add_command(
        commands,
        "sensitivity",
        "Say what each parameter does to the motion.",
        "kneejax sensitivity --sweep ACL.stiffness",
    )
    add_sensitivity(command)
    add_out(command, "kneejax-sensitivity")
    add_svg(command)
    command.set_defaults(run=_lazily("_sensitivity"))


def _add_identify(commands) -> None:
    command = add_command(
        commands,
        "identify",
        "Say what the data of a study can and cannot tell, and what to measure next.",
        "kneejax identify paper1 --next-tests 2",
    )
    add_identify(command)
    add_out(command, "kneejax-identify")
    add_svg(command)
    command.set_defaults(run=_lazily("_identify"))


def _add_reproduce(commands) -> None:
    command = add_command(
        commands,
        "reproduce",
        "Compute what a paper claims, and judge each claim.",
        "kneejax reproduce 1",
    )
    command.add_argument("paper", choices=["1", "2", "3", "4", "5"], help="number of the paper")
    command.add_argument("--knee", help=f"of paper 1, four_ligament_fitted by default: {KNEE}")
    add_out(command, "kneejax-reproduction")
    add_svg(command)
    command.set_defaults(run=_lazily("_reproduce"))


def _add_view(commands) -> None:
    view = add_command(
        commands,
        "view",
        "Draw a knee in space at poses: pictures, a film, and a page to turn it.",
        "kneejax simulate passive-flexion && "
        "kneejax view four_ligament kneejax-passive-flexion/poses.csv",
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
    view.set_defaults(run=_lazily("_view"))


def _add_joint(commands) -> None:
    joint = add_command(
        commands,
        "joint",
        "Fit, compare and export simple joints: moving axis and hinge.",
        "kneejax joint fit --knee four_ligament --flexion 0:90:10",
    )
    add_joint(joint)
    joint.set_defaults(run=_lazily("joint._command"))


def _add_import(commands) -> None:
    example = "kneejax import osim MODEL.osim --side r"
    above = add_command(commands, "import", "Make a knee from a model or from meshes.", example)
    kinds = add_kinds(above)
    sentence = "Make a knee from an OpenSim model, schema 3 or 4."
    _add_import_osim(add_command(kinds, "osim", sentence, example))
    example = (
        "kneejax import stl --femur-cartilage FEMUR.stl --tibia-cartilage TIBIA.stl --side r "
        "--knee four_ligament"
    )
    _add_import_stl(add_command(kinds, "stl", "Fit contacts to meshes of cartilage.", example))


def _add_import_osim(osim: Parser) -> None:
    osim.add_argument("file", type=Path, help="the model")
    osim.add_argument("--side", choices=_SIDES, required=True, help="right or left knee")
    osim.add_argument("--geometry", type=Path, help="folder of the model's cartilage meshes")
    osim.add_argument("--femur", metavar="BODY", help="found from the joints if not given")
    osim.add_argument("--tibia", metavar="BODY", help="likewise; both or none")
    osim.add_argument(
        "--without",
        action="append",
        default=[],
        metavar="FIBRE",
        help="leave out a fibre, or those that fit a pattern",
    )
    osim.add_argument(
        "--inside",
        choices=["refuse", "straight"],
        default="refuse",
        help="what to do where a fibre begins inside what it goes around; straight is what "
        "OpenSim does",
    )
    osim.add_argument(
        "--without-patella",
        action="store_true",
        help="leave out the patella, its ligaments and the muscles over the knee",
    )
    add_out(osim, "kneejax-import")
    osim.set_defaults(run=_lazily("_import_osim"))


def _add_import_stl(stl: Parser) -> None:
    stl.add_argument("--femur-cartilage", type=Path, required=True, help="mesh, in any unit")
    stl.add_argument("--tibia-cartilage", type=Path, required=True, help="mesh, likewise")
    stl.add_argument("--patella-cartilage", type=Path, help="fitted with the groove of the femur")
    stl.add_argument("--femur-bone", type=Path, help="for the layer's thickness")
    stl.add_argument("--tibia-bone", type=Path, help="for the layer's thickness")
    stl.add_argument("--side", choices=_SIDES, required=True, help="right or left knee")
    stl.add_argument("--knee", help=f"whose ligaments are kept, its contacts replaced: {KNEE}")
    stl.add_argument(
        "--layer-thickness", type=float, metavar="MM", help="both cartilages; measured otherwise"
    )
    stl.add_argument(
        "--thickness",
        choices=["constant", "field"],
        default="constant",
        help="one number for the layer, or as it varies over the surface",
    )
    stl.add_argument(
        "--modulus", type=float, default=10.0, metavar="MPA", help="Young's modulus, MPa"
    )
    stl.add_argument("--poisson-ratio", type=float, default=0.45, help="of the cartilage")
    stl.add_argument(
        "--law",
        choices=["linear", "log", "ratio"],
        default="linear",
        help="how pressure grows with the depth",
    )
    stl.add_argument(
        "--unit", choices=["auto", "m", "mm", "cm"], default="auto", help="of the meshes"
    )
    three = {"type": float, "nargs": 3}
    stl.add_argument("--axis-point", **three, help="of the femoral axis, mm; found otherwise")
    stl.add_argument("--axis-rotation", **three, help="of that axis about X, Y, Z, degrees")
    stl.add_argument("--notch", type=float, metavar="MM", help="along the axis; found otherwise")
    stl.add_argument(
        "--split", type=float, metavar="MM", help="between the tibial compartments, along Z"
    )
    stl.add_argument(
        "--angle", type=float, nargs=2, metavar="DEGREES", help="region of the condyles"
    )
    add_out(stl, "kneejax-import")
    add_svg(stl)
    stl.set_defaults(run=_lazily("_import_stl"))


def _add_export(commands) -> None:
    example = (
        "kneejax import osim MODEL.osim --side r && "
        "kneejax export osim kneejax-import/knee.yaml MODEL.osim --out NEW.osim"
    )
    above = add_command(commands, "export", "Write a knee's numbers into a model.", example)
    kinds = add_kinds(above)
    sentence = "Write a knee's numbers into the OpenSim model that it came from."
    osim = add_command(kinds, "osim", sentence, example)
    osim.add_argument("knee", help=KNEE)
    osim.add_argument("model", type=Path, help="the original model; it is not changed")
    osim.add_argument("--out", type=Path, required=True, help="the new model")
    osim.set_defaults(run=_lazily("_export_osim"))


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
    rerun.set_defaults(run=_lazily("_rerun"))


def _add_completion(commands) -> None:
    completion = add_command(
        commands,
        "completion",
        "Print a script that lets a shell complete commands, options and files.",
        'eval "$(kneejax completion bash)"',
    )
    completion.add_argument("shell", choices=SHELLS, help="whose script")
    completion.set_defaults(run=_lazily("_completion"))


def _lazily(module: str) -> Callable[[argparse.Namespace], int]:
    """A command is imported when it is called."""

    def run(arguments: argparse.Namespace) -> int:
        return importlib.import_module(f"kneejax.cli.{module}").run(arguments)

    return run


_add_activity, _add_cohort, _add_plan = (
    functools.partial(add, lazily=_lazily) for add in (add_activity, add_cohort, add_plan)
)
