"""`kneejax reproduce 3`: drawer, torsion and the raised leg on paper 3's twelve bundles."""

from __future__ import annotations

import numpy as np

from kneejax.cli._progress import stages_on_terminal
from kneejax.cli.options import Reproduce
from kneejax.cli.papers._judged import say_claims, write_claims
from kneejax.files import bundled_measurements, load_knee, write_rows
from kneejax.files.tables import read_rows
from kneejax.geometry import BODIES, COLUMNS, PATELLA
from kneejax.inference import versions
from kneejax.reproduction import (
    VERDICTS,
    Claim,
    Paper3Study,
    RaisedLeg,
    paper3_claims,
    paper3_study,
    raised_leg,
)
from kneejax.reproduction.paper3 import BODY_KG, HEIGHT_M
from kneejax.statics import Status

_KNEE, _CONDITIONS = "twelve_bundle", "paper3_conditions"
#: A knee may give way under the torque, and is judged by that.
_ANSWERS = (Status.BALANCED, Status.OVERSTRETCHED, Status.GIVES_WAY)


def run(arguments: Reproduce) -> int:
    """Compute the study, judge the claims, print and write them."""
    flexion, displacement_mm, torque_Nm = _conditions()
    with stages_on_terminal("drawer and torsion"):
        found = paper3_study(load_knee(_KNEE), flexion, displacement_mm, torque_Nm)
    with stages_on_terminal("leg raise"):
        raised = raised_leg(load_knee(_KNEE), load_knee(_KNEE, patella=True))
    claims, doubts = paper3_claims(found, raised), [*_doubts(found), *_doubts_of_leg(raised)]
    _write(found, raised, claims, doubts, arguments.out, arguments.svg)
    files = ["drawer.csv", "torsion.csv", "raised_leg.csv"]
    return say_claims(claims, arguments.out, files, doubts)


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


def _doubts_of_leg(raised: RaisedLeg) -> list[str]:
    """Where the leg has no balance, and where a facet would have to hold on to the groove."""
    leg, said = raised.leg, []
    lost = leg.flexion_deg[np.isnan(leg.quadriceps_N)]
    if lost.size:
        said.append(f"No held leg was found at {', '.join(f'{x:g}' for x in lost)} degrees.")
    loose = leg.flexion_deg[raised.held & (leg.contact_N < 0.0).any(axis=1)]
    if loose.size:
        places = ", ".join(f"{x:g}" for x in loose)
        said.append(f"The patella touches one facet only at {places} degrees.")
    return said


def _leg_rows(raised: RaisedLeg):
    """Column names, then a row a pose; empty where the quadriceps does not pull."""
    leg, table = raised.leg, np.asarray(raised.leg.tibia.to_table())
    forces = np.c_[leg.quadriceps_N, leg.tendon_N, leg.contact_N, leg.patellofemoral_N, leg.arm_mm]
    shear, pulls = (np.stack(list(x.values()), axis=1) for x in (raised.shear, raised.tension))
    names = [
        "flexion_deg", "quadriceps_N", "tendon_N", "medial_facet_N", "lateral_facet_N",
        "patellofemoral_N", "arm_mm", *COLUMNS[1:], *(x.column for x in BODIES[PATELLA].values()),
        *(f"{name}_N" for name in raised.tension), *(f"{name}_anterior_N" for name in raised.shear),
    ]  # fmt: skip
    return names, np.c_[leg.flexion_deg, forces, table[:, 1:], leg.patella, pulls, shear]


def _write(
    found: Paper3Study, raised: RaisedLeg, claims: tuple[Claim, ...], doubts, out, svg: bool
) -> None:
    from kneejax.report import (
        drawer_figure,
        raised_leg_figure,
        torsion_figure,
        write_reproduction,
    )

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
    columns, rows = _leg_rows(raised)
    write_rows(out / "raised_leg.csv", columns, rows)
    figures = {
        "drawer": (drawer_figure(found), "As Figure 10 of the paper: what holds the tibia there."),
        "torsion": (torsion_figure(found), "As Figure 11 of the paper."),
        "raised_leg": (raised_leg_figure(raised), "As Figures 12 to 19 of the paper."),
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
        "The raised leg has the paper's own patella: rigid, on two plane facets 130 degrees apart, "
        "which touch the two second-order polynomials of the groove in a point each, without "
        "friction; a tendon that does not stretch and one straight quadriceps. Surfaces are laid "
        "through the same person's groove and patella. The leg is that of a person of "
        f"{BODY_KG:g} kg and {HEIGHT_M:g} m (Winter 2009), the thigh level; the 2 kg are gone.",
        f"Verdicts: {', '.join(VERDICTS)}.",
    ]
    settings = {"knee": _KNEE, "conditions": _CONDITIONS, "torque_Nm": found.torque_Nm}
    title = "Paper 3: laxity, and the leg that is raised"
    write_reproduction(title, about, claims, figures, doubts, settings, versions(), out, svg=svg)
