"""Arguments of `kneejax plan`."""

from __future__ import annotations

from kneejax.cli._parser import add_command, add_kinds, add_out, add_svg


def add_plan(commands, lazily) -> None:
    """`kneejax plan acl`."""
    example = "kneejax plan acl ten_bundle --points 11"
    above = add_command(commands, "plan", "Plan an operation on a knee.", example)
    kinds = add_kinds(above)
    sentence = "Say where, and how tight, to place a graft for the anterior cruciate ligament."
    acl = add_command(kinds, "acl", sentence, example)
    acl.add_argument("plan", nargs="?", default="ten_bundle", help="plan file or bundled plan")
    acl.add_argument(
        "--points",
        type=int,
        metavar="N",
        help="of a map along each axis, 0 for no maps (default: what the plan says)",
    )
    acl.add_argument(
        "--front",
        action="store_true",
        help="also find the places that are best in some balance of laxity, force and strains",
    )
    add_out(acl, "kneejax-plan")
    add_svg(acl)
    acl.set_defaults(run=lazily("_plan"))
