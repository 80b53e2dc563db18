"""A knee under the pull of its quadriceps, as an answer."""

from __future__ import annotations

import functools

import numpy as np

from kneejax.experiments import DrivenExtensor, Extensor, with_flips
from kneejax.geometry import BODIES, COLUMNS, FEMUR, PATELLA
from kneejax.report.extensor._figures import extensor_figure, shear_figure
from kneejax.report.look import Answer, Column, Drawing, Section, Table
from kneejax.report.motion import (
    digits,
    force_table,
    named_places,
    peak_table,
    pose_words,
    search_words,
    status_doubts,
    text_of,
    verdict_of,
)
from kneejax.statics import Status

#: Columns of extensor.csv that people read, with heading and digits.
_SHOWN = {
    "flexion_deg": ("flexion, deg", 1), "quadriceps_N": ("quadriceps, N", 1),
    "tendon_by_quadriceps": ("tendon, / quadriceps", 2),
    "patellofemoral_by_quadriceps": ("contact, / quadriceps", 2), "arm_mm": ("arm, mm", 1),
    "patella_flexion_deg": ("patella: flexion, deg", 1), "patella_tilt_deg": ("tilt, deg", 1),
}  # fmt: skip
_ASKED = {
    "patellar-tracking": "Where the patella runs and what presses it, the quadriceps pulling with "
    "the same force at each flexion.",
    "extension": "How hard the knee would extend, its flexion prescribed, as the quadriceps pulls.",
    "leg-raise": "How hard the quadriceps must pull to hold the shank against its weight.",
}
_ARM = (
    "Arm: moment arm of the quadriceps by virtual work. Tendon and contact (between patella and "
    "femur): their forces by the quadriceps'."
)
_BY_LENGTH = (
    "slack: {:g} mm longer than at rest, at {:g} deg: the cable hangs loose, and the heads pull "
    "as at rest"
)


def extensor_answer(
    name: str, experiment: str, found: Extensor, *, loads, driven: DrivenExtensor | None = None
) -> Answer:
    """What a knee does while its quadriceps pulls.

    Args:
        name: of the knee, with what was cut.
        experiment: patellar-tracking, extension or leg-raise.
        found: of the experiment.
        loads: that acted throughout, by name.
        driven: where the quadriceps was given lengths.

    Returns:
        The answer; its tables are extensor, forces and tibia_forces.
    """
    knee, status = found.motion.knee, with_flips(found.motion.status, found.mechanics)
    flexion, pull = np.asarray(found.flexion_deg), np.asarray(found.quadriceps_N)
    words = pose_words(knee, found.mechanics, search_words(found.motion, loads))
    doubts = [*status_doubts(status, words, *named_places([f"{x:g}" for x in flexion], "degrees"))]
    title, notes = f"{name}: {experiment}", []
    if found.walked.any():
        places = ", ".join(f"{x:g}" for x in flexion[found.walked])
        notes.append(
            f"Found by a continuation of its own, since the equilibrium lay farther than 1 mm from "
            f"where it was expected: {places} deg."
        )
    if driven is not None:
        slack = zip(driven.longer_mm[driven.slack], flexion[driven.slack], strict=True)
        notes += [_BY_LENGTH.format(*one) for one in slack]
    keys = {"flexion_deg": flexion, "quadriceps_N": pull}
    axes = [f"{way}_N" for way in ("anterior", "superior", "lateral")]
    on_tibia = [
        [*place, part, *force]
        for part, forces in found.forces_on_tibia.items()
        for *place, force in zip(flexion, pull, forces, strict=True)
    ]
    tables = {
        "extensor": extensor_table(found, status, driven),
        "forces": force_table(knee, found.mechanics, keys),
        "tibia_forces": Table([Column(x) for x in (*keys, "part", *axes)], on_tibia),
    }
    peaks = peak_table(knee, found.mechanics, flexion, "at flexion, deg")
    drawings = {
        "extensor": Drawing(
            functools.partial(extensor_figure, found, status, title),
            "Pull, ratios of forces, moment arm, patella, ligaments and tibia.",
        )
    }
    sections = [Section("Largest forces", tables=[peaks])]
    if experiment != "extension":
        drawings["shear"] = Drawing(
            functools.partial(shear_figure, found), "The forces on the tibia sum to zero."
        )
        sections.append(Section("What draws the tibia forwards", drawings=["shear"]))
    return Answer(
        title=title,
        asked=_ASKED[experiment],
        verdict=verdict_of(status),
        sentence=_sentence(experiment, found, status),
        tables=tables,
        main=["extensor"],
        drawings=drawings,
        picture="extensor",
        doubts=doubts,
        sections=[*sections, *([Section("Notes", notes)] if notes else [])],
        text="\n".join([title, text_of(tables["extensor"]), *notes, *doubts]),
        exit_status=int((np.asarray(status) != Status.BALANCED).any()),
    )


def extensor_table(
    found: Extensor, status: np.ndarray, driven: DrivenExtensor | None = None
) -> Table:
    """Forces, lengths, moments and both bones, a row a pose: extensor.csv.

    Args:
        found: of any of the experiments.
        status: `Status` values, one a pose.
        driven: where the quadriceps was given lengths.
    """
    motion, mechanics = found.motion, found.mechanics
    pull, tendon, contact = (np.asarray(x) for x in
                             (found.quadriceps_N, found.tendon_N, found.contact_N))  # fmt: skip
    here = [k for k, x in enumerate(motion.knee.contacts) if x.bodies == (FEMUR, PATELLA)]
    tibia, patella = np.asarray(motion.to_table()), np.asarray(found.patella)
    columns = {
        "flexion_deg": np.round(np.asarray(found.flexion_deg, float), 9),
        "quadriceps_N": pull, "quadriceps_mm": found.quadriceps_mm, "tendon_N": tendon,
        "patellofemoral_N": contact, "tendon_by_quadriceps": tendon / pull,
        "patellofemoral_by_quadriceps": contact / pull, "extension_Nm": found.extension_Nm,
        "weight_Nm": found.weight_Nm, "arm_mm": found.arm_mm,
        "patellofemoral_area_mm2": np.asarray(mechanics.area)[:, here].sum(axis=1),
        "patellofemoral_max_pressure_MPa": np.asarray(mechanics.max_pressure)[:, here].max(axis=1),
        **dict(zip(COLUMNS[1:], tibia[:, 1:].T, strict=True)),
        **dict(zip((x.column for x in BODIES[PATELLA].values()), patella.T, strict=True)),
        "converged": motion.equilibrium.converged, "stable": motion.stable,
        "status": [Status(int(x)).word for x in status],
    }  # fmt: skip
    if driven is not None:
        columns |= {"longer_mm": driven.longer_mm, "slack": driven.slack}
    shown = {
        name: Column(name, head, digits(count)) for name, (head, count) in _SHOWN.items()
    } | {"status": Column("status", words=True)}
    made = [shown.get(name) or Column(name, shown=False) for name in columns]
    cells = zip(*(np.asarray(x).tolist() for x in columns.values()), strict=True)
    return Table(made, [list(row) for row in cells], note=_ARM)


def _sentence(experiment: str, found: Extensor, status: np.ndarray) -> str:
    known = np.flatnonzero(np.asarray(status) < Status.TOO_DEEP)
    if not len(known):
        return "No pose has an equilibrium."
    flexion, arm = np.asarray(found.flexion_deg)[known], np.asarray(found.arm_mm)[known]
    values, what, unit = np.asarray(found.quadriceps_N)[known], "The quadriceps pulls", "N"
    if experiment == "extension":
        values, what, unit = np.asarray(found.extension_Nm)[known], "The knee extends", "N m"
    elif experiment == "patellar-tracking":
        values, what = np.asarray(found.contact_N)[known], "The patella is pressed"
    most = int(np.argmax(values))
    words = f"{what} with at most {values[most]:.0f} {unit}, at {flexion[most]:g} degrees"
    if np.isfinite(arm).any():
        arms = f"{np.nanmin(arm):.0f} to {np.nanmax(arm):.0f} mm"
        words += f"; the quadriceps has a moment arm of {arms}"
    return f"{words}."
