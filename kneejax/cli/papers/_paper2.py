"""`kneejax reproduce 2`: Lachman tests and grafts on paper 2's ten bundles, against its claims."""

from __future__ import annotations

import importlib.util
from pathlib import Path

from kneejax.cli._progress import stages_on_terminal
from kneejax.cli.options import Reproduce
from kneejax.cli.papers._judged import say_claims, write_claims
from kneejax.files import load_knee, write_rows
from kneejax.inference import versions
from kneejax.reproduction import VERDICTS, Claim, Paper2Study, paper2_claims, paper2_study
from kneejax.reproduction.paper2 import LENGTH_CHANGES, PRESTRAINS, Octagon, octagon_study
from kneejax.statics import Status

_KNEE = "ten_bundle"
#: A knee without an ACL may give way or dislocate, and is judged by that.
_ANSWERS = (Status.BALANCED, Status.OVERSTRETCHED, Status.GIVES_WAY, Status.DISLOCATED)


def run(arguments: Reproduce) -> int:
    """Compute the study, judge the claims, print and write them."""
    knee, octagon = load_knee(_KNEE), None
    with stages_on_terminal("Lachman tests"):
        found = paper2_study(knee)
    if importlib.util.find_spec("dtaidistance"):
        with stages_on_terminal("grafts in eight places"):
            octagon = octagon_study(knee)
    claims, doubts = paper2_claims(found, octagon), _doubts(found)
    _write(found, claims, doubts, arguments.out, arguments.svg)
    files = ["lachman.csv"]
    if octagon is not None:
        _write_octagon(octagon, arguments.out / "octagon.csv")
        files.append("octagon.csv")
    return say_claims(claims, arguments.out, files, doubts)


def _write_octagon(found: Octagon, path: Path) -> None:
    """Its Table 4, of the bundle that was moved and of a graft under its tension."""
    ways = {"moved": found.moved, "hamstring": found.planned}
    own = [name for name in found.ligaments if name not in ("pACL", "graft")]
    columns = ["graft", "position", *(f"{x}_distance" for x in ("graft", "pACL", *own)), "total"]
    rows = []
    for way, outcome in ways.items():
        names = found.ligaments if way == "moved" else (*own, "graft")
        for k, distance in enumerate(outcome.distance):
            by = dict(zip(names, distance, strict=True))
            each = [by["graft"], by.get("pACL", float("nan")), *(by[name] for name in own)]
            rows.append([way, k + 1, *each, outcome.total[k]])
    write_rows(path, columns, rows)


def _doubts(found: Paper2Study) -> list[str]:
    kinds = {"Table 1": found.printed, "calibrated": found.calibrated}
    return [
        f"{kind}, {state}: {test.status.word} ({test.status.sentence})."
        for kind, tests in kinds.items()
        for state, test in tests.items()
        if test.status not in _ANSWERS
    ]


def _write(found: Paper2Study, claims: tuple[Claim, ...], doubts, out, svg: bool) -> None:
    from kneejax.report import lachman_figure, write_reproduction

    write_claims(claims, out)
    kinds = {"table_1": found.printed, "calibrated": found.calibrated}
    names = list(found.printed["two bundles"].tension)
    write_rows(
        out / "lachman.csv",
        ["strains", "acl", "anterior_N", "anterior_mm", *(f"{name}_N" for name in names)],
        [
            [kind, state, load, test.moved[k], *(test.tension[name][k] for name in names)]
            for kind, tests in kinds.items()
            for state, test in tests.items()
            for k, load in enumerate(found.load_N)
        ],
    )
    figures = {
        "lachman": (
            lachman_figure(found),
            "As Figures 3 and 4 of the paper, at rest: displacement over force. Squares are the "
            "numbers that it prints; a cross is the last load before the knee gives way.",
        )
    }
    about = [
        f"The knee {_KNEE}: bundles of the paper's Table 1 on one healthy person's articular "
        "surfaces (lenhart2015), attachments of its fibres, lengths as in the table. No muscles, "
        "no body, nothing that damps: the tibia is loaded at rest. The paper's patient, its "
        "attachments, curves and calibrated numbers were not published.",
        "Grafts are placed by what `kneejax plan acl` calls; activities are not part of this.",
        f"Verdicts: {', '.join(VERDICTS)}.",
    ]
    settings = {
        "knee": _KNEE, "added_to_collateral_strains": list(PRESTRAINS),
        "calibrated_at": found.prestrain, "changes_of_resting_length": list(LENGTH_CHANGES),
    }  # fmt: skip
    title = "Paper 2: the Lachman test, and eight places for a graft"
    write_reproduction(title, about, claims, figures, doubts, settings, versions(), out, svg=svg)
