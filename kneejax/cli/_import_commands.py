"""Arguments of `kneejax import osim|stl` and `kneejax export osim`."""

from __future__ import annotations

from pathlib import Path

from kneejax.cli._parser import (
    KNEE,
    Parser,
    add_command,
    add_convention,
    add_kinds,
    add_out,
    add_repeated,
    add_svg,
    lazily,
)

_SIDES = ("r", "l")


def add_import(commands) -> None:
    """`kneejax import osim` and `kneejax import stl`."""
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
    add_repeated(
        osim,
        "--without",
        metavar="FIBRE",
        help="leave out a fibre or force, or those that fit a pattern",
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
    add_repeated(
        osim,
        "--at",
        metavar="COORDINATE=VALUE",
        help="of hip or foot, degrees: where muscles and ligaments from the pelvis begin; the "
        "model's defaults otherwise",
    )
    add_out(osim, "kneejax-import")
    osim.set_defaults(run=lazily("_import_osim"))


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
    stl.set_defaults(run=lazily("_import_stl"))


def add_export(commands) -> None:
    """`kneejax export osim`."""
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
    osim.add_argument(
        "--replace",
        action="store_true",
        help="the model's fibres over the knee become the knee's: grafts are put in, what the knee "
        "has not is taken out",
    )
    osim.add_argument(
        "--coupled",
        type=Path,
        metavar="POSES.csv",
        help="the model's knee follows its flexion as these poses do, along splines: a CustomJoint "
        "of one coordinate",
    )
    add_convention(osim, "of these poses")
    osim.set_defaults(run=lazily("_export_osim"))
