"""`kneejax reproduce 4`: sensitivities over several knees, against the findings of paper 4."""

from __future__ import annotations

import dataclasses

from kneejax.cli._progress import balances_on_terminal
from kneejax.cli._sensitivity_knees import write_tables
from kneejax.cli.options import Reproduce
from kneejax.cli.papers._judged import say_claims, write_claims
from kneejax.files import load_knee
from kneejax.mechanics import Knee
from kneejax.reproduction import (
    VERDICTS,
    Claim,
    KneeComparison,
    compare_knees,
    made_up_knee,
    paper4_claims,
)

#: Bundled models, and the one around which synthetic knees are drawn, with their seeds.
KNEES = ("four_ligament", "lenhart2015_reduced", "lenhart2015")
DRAWN_AROUND, SEEDS = "lenhart2015_reduced", (1, 2)
_KINSHIP = (
    "All of these knees have one person's bones, and all but four_ligament nearly the same "
    "ligaments: they may be more alike than those of four persons."
)
_CURVES = ("MCL.prestretch", "LCL.prestretch", "MCL.youngs_modulus")


def run(arguments: Reproduce) -> int:
    """Compute the study, judge the claims, print and write them."""
    with balances_on_terminal("knees") as progress:
        found = compare_knees(_knees(), progress=progress)
    claims = paper4_claims(found, _KINSHIP)
    files = _write(found, claims, arguments.out, arguments.svg)
    return say_claims(claims, arguments.out, files, found.doubts)


def _knees() -> dict[str, Knee]:
    knees = {name: load_knee(name) for name in KNEES}
    drawn = {f"made_up_{seed}": made_up_knee(knees[DRAWN_AROUND], seed) for seed in SEEDS}
    return knees | drawn


def _write(found: KneeComparison, claims: tuple[Claim, ...], out, svg: bool) -> list[str]:
    from kneejax.report import ramp_figure, score_figure, write_reproduction

    write_claims(claims, out)
    figures = {
        "scores": (
            score_figure(found),
            "Scores by Table 5, means of varus and valgus, as in Figures 6 to 8 of the paper.",
        )
    }
    for name in _CURVES:
        figures[name.replace(".", "-")] = (
            ramp_figure(found, name),
            "Rotation over the moment, the moment that each value holds, and the peak pressures "
            "at the last moment that all compared values hold; as in Figures 4 and 5 of the paper.",
        )
    settings = dataclasses.asdict(found.settings) | {
        "knees": list(KNEES), "made_up_around": DRAWN_AROUND, "made_up_seeds": list(SEEDS)
    }  # fmt: skip
    write_reproduction(
        "Paper 4: sensitivity of several knees to their ligaments",
        _about(found),
        claims,
        figures,
        found.doubts,
        settings,
        found.versions,
        out,
        svg=svg,
    )
    return write_tables(found, out)


def _about(found: KneeComparison) -> list[str]:
    settings = found.settings
    return [
        f"Each knee carries {settings.body_weight_N / 2:.1f} N along the tibia at extension, then "
        f"up to {settings.full_Nm:g} N m of varus or valgus, with one ligament changed at a time: "
        "prestretch by up to 0.1, Young's modulus by up to 100 MPa (as a share of "
        f"{settings.reference_modulus_MPa:g} MPa), attachments halved.",
        "The paper has four finite element models of four persons. Here are three models of one "
        f"person's bones ({', '.join(KNEES)}) and {len(SEEDS)} synthetic knees, drawn around "
        f"{DRAWN_AROUND}: its attachments by 2 mm, reference strains by 0.02, stiffnesses and the "
        "cartilage's modulus by 20 per cent (standard deviations). None was calibrated to laxity, "
        "bones are rigid, and there are no menisci.",
        f"Verdicts: {', '.join(VERDICTS)}. Scores run from 0, none, over 1, small, and 2, medium, "
        "to 3, large.",
    ]
