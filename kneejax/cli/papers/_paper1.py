"""`kneejax reproduce 1`: sweeps, maps and procedures of paper 1, against its claims."""

from __future__ import annotations

import dataclasses

import numpy as np

from kneejax.cli._progress import balances_on_terminal
from kneejax.cli.options import Reproduce
from kneejax.cli.papers._judged import say_claims, write_claims
from kneejax.experiments import on_path
from kneejax.files import InputProblem, load_knee
from kneejax.inference import in_convention, sensitivity_maps, sweep, versions
from kneejax.mechanics import Knee
from kneejax.reproduction import VERDICTS, Claim, Paper1Study, paper1_claims
from kneejax.reproduction.paper1 import CONVENTION, LIGAMENTS, as_paper1_sees
from kneejax.studies import Study, read_study
from kneejax.studies import run as run_study

#: The paper's protocol, and a knee of four lines that moves as measured knees do.
_STUDY, _KNEE = "paper1", "four_ligament_fitted"
_GRID, _VALUES = (61, 61), 37
_QUANTITIES = ("stiffness", "reference_strain")
#: Of `PATELLAS`: on what the weight pulls, in words.
_PULLS = {
    "balanced": "The 2 kg pull on a patella that is in balance in its groove, as a third bone.",
    "on-path": "The 2 kg pull on a patella that rides on its path, as in the paper.",
    "none": "A line of constant tension stands for the patella on which 2 kg pull.",
}


def run(arguments: Reproduce) -> int:
    """Compute the study, judge the claims, print and write them."""
    patella = arguments.patella or "on-path"
    knee = _four_lines(arguments.knee or _KNEE, patella)
    names = [f"{name}.{quantity}" for quantity in _QUANTITIES for name in LIGAMENTS]
    study = dataclasses.replace(read_study(_STUDY), knee=knee, parameters=names)
    found = _computed(study)
    claims, doubts = paper1_claims(found), _doubts(found)
    _write(study, found, claims, doubts, patella, arguments.out, arguments.svg)
    return say_claims(claims, arguments.out, doubts=doubts)


def _four_lines(name: str, patella: str) -> Knee:
    """The knee with its two kilograms on the quadriceps."""
    knee = load_knee(name)
    if set(knee.ligaments.names) != set(LIGAMENTS):
        found = f"{name} with {len(knee.ligaments.names)} ligaments"
        raise InputProblem("--knee", "knee", found, f"those of paper 1: {', '.join(LIGAMENTS)}")
    if patella == "none":
        return knee
    whole = load_knee(name, patella=True)
    return whole if patella == "balanced" else on_path(knee, whole)


def _computed(study: Study) -> Paper1Study:
    calibration = run_study(study)
    knee, measured, weights = study.knee_at_start, calibration.measured, study.weight_vector
    with balances_on_terminal("sweeps") as progress:
        sweeps = sweep(knee, study.parameters, measured[:, 0], count=_VALUES, progress=progress)
    pairs = [(f"{name}.stiffness", f"{name}.reference_strain") for name in LIGAMENTS]
    with balances_on_terminal("maps") as progress:
        maps = sensitivity_maps(
            knee,
            measured,
            [*pairs, ("ACL.stiffness", "PCL.stiffness")],
            grid=_GRID,
            bounds=study.bounds,
            weights=weights,
            convention=CONVENTION,
            progress=progress,
        )
    own = dict(zip(LIGAMENTS, maps[:4], strict=True))
    flexion = measured[:, 0]
    seen = np.column_stack([flexion, in_convention(measured[:, 1:], flexion, CONVENTION)])
    return Paper1Study(as_paper1_sees(sweeps), seen, weights, maps[4], own, calibration)


def _doubts(found: Paper1Study) -> list[str]:
    from kneejax.report import message

    doubts = []
    if (found.sweeps.status > 0).any():
        doubts.append("The knee's own motion is not balanced, stable and on fitted surfaces.")
    for fit in found.calibration.fits:
        if not fit.success:
            doubts.append(f"Procedure {fit.procedure}: {message(fit)}.")
    return doubts


def _write(
    study: Study, found: Paper1Study, claims: tuple[Claim, ...], doubts, patella: str, out, svg
) -> None:
    from kneejax.report import map_figure, sweep_figure, write_reproduction

    write_claims(claims, out)
    figures = {}
    for number, one in enumerate(found.sweeps.sweeps, 3):
        figures[one.name.replace(".", "-")] = (
            sweep_figure(found.sweeps, one.name, found.measured),
            f"As Figure {number} of the paper: {one.name} over its range, the others by Table 1.",
        )
    mapped = [("PCL", "11"), ("LCL", "12")]
    for name, number in mapped:
        figures[f"map-{name}"] = (
            map_figure(found.own[name]),
            f"As Figure {number} of the paper: objective over stiffness and reference strain of "
            f"the {name}.",
        )
    figures["map-ACL-PCL"] = (
        map_figure(found.cruciates),
        "As Figure 13 of the paper: objective over the stiffnesses of ACL and PCL.",
    )
    noise = study.synthetic.noise_mm if study.synthetic else 0.0
    about = [
        "The paper's four ligaments with the values of its Table 1, on the articular surfaces of "
        f"one knee ({study.knee.name}) instead of its cadaver's. {_PULLS[patella]} The paper's "
        "measured motion was not published: here it is made by the same knee with the parameters "
        f"of its Table 3, with {noise:g} mm and degrees of noise. Coordinates are the paper's, the "
        "femur in the tibia. What the paper reads off its figures is turned into criteria, stated "
        "with each claim.",
        f"Verdicts: {', '.join(VERDICTS)}.",
    ]
    settings = {
        "study": _STUDY, "knee": study.knee.name, "patella": patella, "grid": list(_GRID),
        "values_of_a_sweep": _VALUES,
    }  # fmt: skip
    title = "Paper 1: influence of ligament parameters on motion, and their identification"
    write_reproduction(title, about, claims, figures, doubts, settings, versions(), out, svg=svg)
