"""`kneejax reproduce 2`: Lachman tests on paper 2's ten bundles, against its claims."""

from __future__ import annotations

import argparse

from kneejax.cli._progress import stages_on_terminal
from kneejax.cli.papers._judged import say_claims, write_claims
from kneejax.files import load_knee, write_rows
from kneejax.inference import versions
from kneejax.reproduction import VERDICTS, Claim, Paper2Study, paper2_claims, paper2_study
from kneejax.reproduction.paper2 import LENGTH_CHANGES, PRESTRAINS
from kneejax.statics import Status

_KNEE = "ten_bundle"
#: A knee without an ACL may give way or dislocate, and is judged by that.
_ANSWERS = (Status.BALANCED, Status.OVERSTRETCHED, Status.GIVES_WAY, Status.DISLOCATED)


def run(arguments: argparse.Namespace) -> int:
    """Compute the study, judge the claims, print and write them."""
    with stages_on_terminal("Lachman tests"):
        found = paper2_study(load_knee(_KNEE))
    claims, doubts = paper2_claims(found), _doubts(found)
    _write(found, claims, doubts, arguments.out, arguments.svg)
    return say_claims(claims, arguments.out, ["lachman.csv"], doubts)


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
        "Planning a graft (the octagon of insertions) and activities are not part of this.",
        f"Verdicts: {', '.join(VERDICTS)}.",
    ]
    settings = {
        "knee": _KNEE, "added_to_collateral_strains": list(PRESTRAINS),
        "calibrated_at": found.prestrain, "changes_of_resting_length": list(LENGTH_CHANGES),
    }  # fmt: skip
    title = "Paper 2: the Lachman test with and without an ACL"
    write_reproduction(title, about, claims, figures, doubts, settings, versions(), out, svg=svg)
