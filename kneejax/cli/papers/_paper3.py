"""`kneejax reproduce 3`: drawer and torsion on paper 3's twelve bundles, against its claims."""

from __future__ import annotations

import argparse

import numpy as np

from kneejax.cli._progress import stages_on_terminal
from kneejax.cli.papers._judged import say_claims, write_claims
from kneejax.files import bundled_measurements, load_knee, write_rows
from kneejax.files.tables import read_rows
from kneejax.inference import versions
from kneejax.reproduction import VERDICTS, Claim, Paper3Study, paper3_claims, paper3_study
from kneejax.statics import Status

_KNEE, _CONDITIONS = "twelve_bundle", "paper3_conditions"
#: A knee may give way under the torque, and is judged by that.
_ANSWERS = (Status.BALANCED, Status.OVERSTRETCHED, Status.GIVES_WAY)


def run(arguments: argparse.Namespace) -> int:
    """Compute the study, judge the claims, print and write them."""
    flexion, displacement_mm, torque_Nm = _conditions()
    with stages_on_terminal("drawer and torsion"):
        found = paper3_study(load_knee(_KNEE), flexion, displacement_mm, torque_Nm)
    claims, doubts = paper3_claims(found), _doubts(found)
    _write(found, claims, doubts, arguments.out, arguments.svg)
    return say_claims(claims, arguments.out, ["drawer.csv", "torsion.csv"], doubts)


def _conditions() -> tuple[np.ndarray, float, float]:
    """Flexions, size of the drawer and of the torque, as the bundled table has them."""
    names = ["flexion_deg", "drawer_mm", "internal_Nm"]
    header, rows = read_rows(str(bundled_measurements()[_CONDITIONS].path), names)
    table = np.array([[float(cells[header.index(name)]) for name in names] for _, cells in rows])
    return table[:, 0], float(table[0, 1]), float(table[0, 2])


def _doubts(found: Paper3Study) -> list[str]:
    return [
        f"{flexion:g} degrees: {status.word} ({status.sentence})."
        for flexion, status in sorted(found.status.items())
        if status not in _ANSWERS
    ]


def _write(found: Paper3Study, claims: tuple[Claim, ...], doubts, out, svg: bool) -> None:
    from kneejax.report import drawer_figure, torsion_figure, write_reproduction

    write_claims(claims, out)
    names = list(found.tension)
    write_rows(
        out / "drawer.csv",
        ["flexion_deg", "anterior_mm", "anterior_N", *(f"{name}_N" for name in names)],
        [
            [flexion, moved, found.force_N[i, k], *(found.tension[name][i, k] for name in names)]
            for i, flexion in enumerate(found.drawer_deg)
            for k, moved in enumerate(found.moved_mm)
        ],
    )
    columns = found.torsion_deg, found.internal_deg, found.external_deg, *found.held_Nm.T
    write_rows(
        out / "torsion.csv",
        ["flexion_deg", "internal_deg", "external_deg", "held_external_Nm", "held_internal_Nm"],
        zip(*columns, strict=True),
    )
    figures = {
        "drawer": (drawer_figure(found), "As Figure 10 of the paper: what holds the tibia there."),
        "torsion": (torsion_figure(found), "As Figure 11 of the paper."),
    }
    about = [
        f"The knee {_KNEE}: stiffness and reference strain of the paper's Table 1 on one healthy "
        "person's articular surfaces and attachments (lenhart2015), since the paper prints neither "
        "its attachments nor the polynomials of its condyles. Of its table, aPC's row stands under "
        "the name of pPC; pPC and pCM are taken from paper 2's table, and the reference strain of "
        "the capsule (LPC, MPC) is an ASSUMPTION. The knee's file lists every adaptation.",
        "A machine moves the tibia forwards and backwards from where it rests, all else free; the "
        "torque is applied likewise. The patellar tendon pulls with 2 kg, without which the knee "
        "would be loose in flexion.",
        f"Verdicts: {', '.join(VERDICTS)}.",
    ]
    settings = {"knee": _KNEE, "conditions": _CONDITIONS, "torque_Nm": found.torque_Nm}
    title = "Paper 3: anterior-posterior and torsional laxity"
    write_reproduction(title, about, claims, figures, doubts, settings, versions(), out, svg=svg)
