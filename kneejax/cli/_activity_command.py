"""Arguments of `kneejax activity`."""

from __future__ import annotations

from pathlib import Path

from kneejax.cli._parser import (
    KNEE,
    add_command,
    add_convention,
    add_out,
    add_repeated,
    add_svg,
    add_values,
    lazily,
)


def add_activity(commands) -> None:
    """`kneejax activity`."""
    activity = add_command(
        commands,
        "activity",
        "Balance a knee at each instant of a movement that OpenSim recorded.",
        "kneejax activity coordinates.sto muscle_forces.sto external_loads.xml "
        "--model MODEL.osim --side r",
    )
    activity.add_argument(
        "files",
        nargs="*",
        type=Path,
        metavar="FILE",
        help="OpenSim's tables (.sto, .mot) of coordinates, and of muscle forces with the external "
        "loads (.xml), if some act, or of joint reactions; each is known by its columns",
    )
    activity.add_argument("--model", type=Path, required=True, help="the model that moved (.osim)")
    _add_what_opensim_is_asked(activity)
    activity.add_argument("--side", choices=("r", "l"), default="r", help="right or left knee")
    activity.add_argument(
        "--femur", metavar="BODY", help="body of the model; found from its joints if not given"
    )
    activity.add_argument("--tibia", metavar="BODY", help="likewise; both or none")
    activity.add_argument("--knee", help=f"{KNEE} (default: lenhart2015_reduced)")
    activity.add_argument(
        "--plan",
        metavar="PLAN",
        help="plan file or bundled plan, in place of --knee: its knee intact, without the "
        "ligament, and with the graft where it is planned and in the corners of the octagon",
    )
    activity.add_argument(
        "--frames",
        choices=("auto", "same", "landmarks"),
        default="auto",
        help="whether the knee's frames are the model's; auto: where the knee was made of it",
    )
    activity.add_argument(
        "--patella", action="store_true", help="with the patella, on which the quadriceps pulls"
    )
    activity.add_argument(
        "--instants", type=int, help="so many, evenly spaced; the coarsest table's rows otherwise"
    )
    add_values(activity)
    add_repeated(
        activity,
        "--cut",
        metavar="LIGAMENT",
        help="compare with the knee in which a ligament, or a group of them, does not act; once "
        "for each",
    )
    add_out(activity, "kneejax-activity")
    add_svg(activity)
    add_convention(activity, "of the poses written")
    activity.set_defaults(run=lazily("_activity"))


def _add_what_opensim_is_asked(activity) -> None:
    """Options of a movement for which OpenSim itself finds the forces."""
    activity.add_argument(
        "--motion",
        type=Path,
        help="in place of FILES: coordinates (.sto, .mot) for which OpenSim itself finds the "
        "forces, by inverse dynamics and static optimisation; needs the extra opensim",
    )
    activity.add_argument(
        "--grf",
        type=Path,
        help="beside --motion: forces from the ground, external loads (.xml); without them the "
        "model's own contacts press its feet",
    )
    activity.add_argument(
        "--actuators",
        type=Path,
        help="beside --motion: reserves and residuals, a ForceSet (.xml); weak ones otherwise",
    )
    activity.add_argument(
        "--time_s", metavar="BEGIN:END", help="beside --motion: a part of it (default: all)"
    )
    activity.add_argument(
        "--rounds",
        type=int,
        default=0,
        help="beside --motion: how often the knee's secondary motion goes back into the model, as "
        "splines of flexion, for OpenSim to find the forces again",
    )
