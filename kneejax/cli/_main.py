"""Parsing, float64, the compilation cache, and errors in one line."""

from __future__ import annotations

import argparse
import os
import re
import sys
from pathlib import Path
from typing import NoReturn

from kneejax.cli import _joint
from kneejax.cli._study_commands import STUDY_COMMANDS
from kneejax.files import nearest_name

DONE, DOUBTFUL, BAD_INPUT = 0, 1, 2


class _Parser(argparse.ArgumentParser):
    def __init__(self, *arguments, **options):
        super().__init__(*arguments, **options)
        # Whatever a command does not know, its own parser reports: it knows the command's options.
        self.set_defaults(parser=self)

    def error(self, message: str) -> NoReturn:
        near = self._nearest(message)
        message += f"; did you mean {near}?" if near else ""
        print(f"kneejax: {' '.join(message.split())}", file=sys.stderr)
        raise SystemExit(BAD_INPUT)

    def _nearest(self, message: str) -> str | None:
        """The option or choice most like the one that the message complains of."""
        choice = re.search(r"argument ([^:]+): invalid choice: '([^']+)'", message)
        if choice:
            own = [
                a for a in self._actions if choice.group(1) in ("/".join(a.option_strings), a.dest)
            ]
            named = [name for action in own for name in action.choices or ()]
            return nearest_name(choice.group(2), named)
        option = re.search(r"unrecognized arguments: -+([^ =]+)", message)
        options = {name.lstrip("-"): name for name in self._option_string_actions}
        near = nearest_name(option.group(1), options) if option else None
        return options.get(near or "")


def main(arguments: list[str] | None = None) -> int:
    """Run the `kneejax` command.

    Args:
        arguments: words after `kneejax`; those of the process by default.

    Returns:
        Exit status: 0 done; 1 done, but something is doubtful (the results say what); 2 bad
        input, nothing written.
    """
    parser = _build_parser()
    chosen, unknown = parser.parse_known_args(arguments)
    if unknown:
        chosen.parser.error(f"unrecognized arguments: {' '.join(unknown)}")
    _prepare_jax()
    from kneejax.files import InputProblem
    from kneejax.inference import UnknownParameter, UnsuitableData
    from kneejax.mechanics import Implausible

    # Of a command that is cut short: files may be missing, a mere answer was read as far as wanted.
    status = DOUBTFUL if hasattr(chosen, "out") else DONE
    try:
        _check_out(getattr(chosen, "out", None), folder=chosen.command != "export")
        status = chosen.run(chosen)
        sys.stdout.flush()
        return status
    except (InputProblem, UnknownParameter, UnsuitableData, Implausible) as problem:
        print(f"kneejax: {' '.join(str(problem).split())}", file=sys.stderr)
        return BAD_INPUT
    except BrokenPipeError:
        # Whoever reads has seen enough (`kneejax describe ... | head`). Python flushes once more
        # when it ends, and would complain.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return status
    except OSError as problem:
        print(f"kneejax: {problem.filename}: {problem.strerror}", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        print("kneejax: stopped; files that were not complete were not written", file=sys.stderr)
        return 130


def _check_out(out: Path | None, folder: bool) -> None:
    """Whether results can be written there: better known before the work than after it."""
    from kneejax.files import InputProblem

    if out is None:
        return
    if folder and out.exists() and not out.is_dir():
        raise InputProblem("--out", "folder", str(out), "a folder; this is a file")
    if not folder and out.is_dir():
        raise InputProblem("--out", "file", str(out), "the name of the new file; this is a folder")
    above = next((place for place in (out, *out.parents) if place.exists()), None)
    if above is None or above == out and not folder:
        return
    if not above.is_dir():
        raise InputProblem("--out", "folder", str(out), f"a place in a folder; {above} is a file")
    if not os.access(above, os.W_OK):
        raise InputProblem("--out", "folder", str(out), f"a place to write; {above} is not yours")


def _build_parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="kneejax", description="A differentiable knee that identifies its ligaments."
    )
    commands = parser.add_subparsers(dest="command", required=True, parser_class=_Parser)

    knees = commands.add_parser("knees", help="list bundled knees, studies and measurements")
    knees.set_defaults(run=_lazily("_knees"))

    describe = commands.add_parser("describe", help="print a knee")
    describe.add_argument("knee", help="bundled name or knee file")
    describe.add_argument(
        "--fibres",
        action="store_true",
        help="a row for each fibre, with its strain at the reference pose",
    )
    describe.set_defaults(run=_lazily("_describe"))

    simulate = commands.add_parser("simulate", help="run an experiment")
    simulate.add_argument("experiment", choices=["passive-flexion"])
    simulate.add_argument("--knee", default="four_ligament")
    simulate.add_argument("--flexion", default="0:120:5", help="degrees: first:last:step or a,b,c")
    simulate.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", dest="values")
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
        "compression_N (at the tibia's origin), varus_Nm, internal_Nm; e.g. anterior_N=134",
    )
    simulate.add_argument("--out", type=Path, default=Path("kneejax-passive-flexion"))
    _add_convention(simulate)
    simulate.set_defaults(run=_lazily("_simulate"))

    evaluate = commands.add_parser("evaluate", help="ligaments and contact at given poses")
    evaluate.add_argument("knee")
    evaluate.add_argument("poses", type=Path, help="CSV of poses")
    evaluate.add_argument("--out", type=Path, default=Path("kneejax-evaluate"))
    _add_convention(evaluate)
    evaluate.set_defaults(run=_lazily("_evaluate"))

    calibrate = commands.add_parser("calibrate", help="identify ligaments from motion")
    calibrate.add_argument("study", nargs="?", default="paper1", help="study file or bundled study")
    calibrate.add_argument("--out", type=Path, default=Path("kneejax-calibration"))
    calibrate.set_defaults(run=_lazily("_calibrate"))

    for name, (help_line, add_arguments) in STUDY_COMMANDS.items():
        command = commands.add_parser(name, help=help_line)
        add_arguments(command)
        command.set_defaults(run=_lazily(f"_{name}"))

    view = commands.add_parser("view", help="draw a knee in space, at poses")
    view.add_argument("knee", help="bundled name or knee file")
    view.add_argument("poses", nargs="?", type=Path, help="CSV of poses; the reference pose else")
    for bone in ("femur", "tibia"):
        view.add_argument(
            f"--{bone}-bone",
            type=Path,
            metavar="FILE",
            help=f"mesh of the {bone} to show, in its frame, m or mm",
        )
    view.add_argument("--out", type=Path, default=Path("kneejax-view"))
    _add_convention(view)
    view.set_defaults(run=_lazily("_view"))

    joint = commands.add_parser("joint", help="simple joints: fit, compare and export them")
    _joint.add_arguments(joint)
    joint.set_defaults(run=_lazily("_joint"))

    _add_import(commands.add_parser("import", help="make a knee from a model or from meshes"))
    _add_export(commands.add_parser("export", help="write a knee's numbers into a model"))
    return parser


def _add_import(parser: argparse.ArgumentParser) -> None:
    kinds = parser.add_subparsers(dest="kind", required=True, parser_class=_Parser)
    sides = ["r", "l"]

    osim = kinds.add_parser("osim", help="an OpenSim model, schema 3 or 4")
    osim.add_argument("file", type=Path)
    osim.add_argument("--side", choices=sides, required=True)
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
    osim.add_argument("--out", type=Path, default=Path("kneejax-import"))
    osim.set_defaults(run=_lazily("_import_osim"))

    stl = kinds.add_parser("stl", help="cartilage (and bone) meshes")
    stl.add_argument("--femur-cartilage", type=Path, required=True)
    stl.add_argument("--tibia-cartilage", type=Path, required=True)
    stl.add_argument("--patella-cartilage", type=Path, help="fitted and kept for later")
    stl.add_argument("--femur-bone", type=Path, help="for the layer's thickness")
    stl.add_argument("--tibia-bone", type=Path, help="for the layer's thickness")
    stl.add_argument("--side", choices=sides, required=True)
    stl.add_argument("--knee", help="knee whose ligaments are kept; its contacts are replaced")
    stl.add_argument(
        "--layer-thickness", type=float, metavar="MM", help="both cartilages; measured otherwise"
    )
    stl.add_argument("--thickness", choices=["constant", "field"], default="constant")
    stl.add_argument("--modulus", type=float, default=10.0, metavar="MPA", help="Young's modulus")
    stl.add_argument("--poisson-ratio", type=float, default=0.45)
    stl.add_argument("--law", choices=["linear", "log", "ratio"], default="linear")
    stl.add_argument("--unit", choices=["auto", "m", "mm", "cm"], default="auto")
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
    stl.add_argument("--out", type=Path, default=Path("kneejax-import"))
    stl.set_defaults(run=_lazily("_import_stl"))


def _add_export(parser: argparse.ArgumentParser) -> None:
    kinds = parser.add_subparsers(dest="kind", required=True, parser_class=_Parser)
    osim = kinds.add_parser("osim", help="into the OpenSim model that the knee came from")
    osim.add_argument("knee", help="bundled name or knee file")
    osim.add_argument("model", type=Path, help="the original model; it is not changed")
    osim.add_argument("--out", type=Path, required=True, help="the new model")
    osim.set_defaults(run=_lazily("_export_osim"))


def _add_convention(parser: argparse.ArgumentParser) -> None:
    names = ["femoral", "grood-suntay", "tibial", "femur-in-tibia"]
    parser.add_argument("--convention", choices=names, default="femoral")


def _lazily(module: str):
    """A command is imported when it is called."""

    def run(arguments: argparse.Namespace) -> int:
        import importlib

        return importlib.import_module(f"kneejax.cli.{module}").run(arguments)

    return run


def _prepare_jax() -> None:
    import jax

    from kneejax.statics import share_memory_between_threads, use_shared_fusion

    share_memory_between_threads()
    use_shared_fusion()
    jax.config.update("jax_enable_x64", True)
    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
        jax.config.update("jax_compilation_cache_dir", str(Path(base) / "kneejax"))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
