"""The extensor mechanism, as an answer with figures."""

from typing import Any

import numpy as np

from kneejax.experiments import TENDON, DrivenExtensor, Extensor, with_flips
from kneejax.geometry import BODIES, COLUMNS, FEMUR, FEMUR_AND_TIBIA, PATELLA
from kneejax.report import panels as draw
from kneejax.report import pose_tables
from kneejax.report.look.colours import BLUE, GREEN, GREY, VERMILLION, part_styles, shades
from kneejax.report.look.page import Answer, Drawing, Section, prose
from kneejax.report.look.style import Axes, Figure, styled, verbatim
from kneejax.report.look.tables import Table
from kneejax.statics import Status

_PULL = "Quadriceps force, N"
_MOST_LINES = 8
#: Moment up to which a leg counts as held by the quadriceps, N m.
_LEFT_NM = 1e-3


@styled
def extensor_figure(found: Extensor, status: np.ndarray, title: str) -> Figure:
    """Draw the pull, the ratios of forces, the moment arm, the patella, and the ligaments."""
    figure, panels = draw.panel_grid(3, 2, 7.8, title)
    flexion, pull, patella = (np.asarray(x) for x in
                              (found.flexion_deg, found.quadriceps_N, found.patella))  # fmt: skip
    angles, x, rows = np.unique(flexion), flexion, [np.arange(len(flexion))]
    if over_pull := len(angles) < len(flexion):
        x, rows = pull, [np.flatnonzero(flexion == angle) for angle in angles]

    def by_flexion(axes: Axes, values, label: str) -> None:
        """A line for each flexion where several pulls were tried, else one."""
        for angle, own, shade in zip(angles, rows, shades(len(rows)), strict=False):
            color = shade if len(rows) > 1 else BLUE
            axes.plot(x[own], np.asarray(values)[own], color=color, label=f"{angle:g}")
        axes.set_ylabel(label)

    def by_kind(axes: Axes, curves: dict[str, np.ndarray], label: str) -> None:
        for k, own in enumerate(rows):
            named = {name if k == 0 else f"_{name}": y[own] for name, y in curves.items()}
            draw.draw_named(axes, x[own], named, label, colors=(BLUE, VERMILLION, GREEN), columns=3)

    # A quadriceps that nothing asks for is left at rest: its ratios tell of the bands alone.
    extension = np.asarray(found.extension_Nm)
    asked = (np.asarray(found.weight_Nm) == 0.0) | (np.abs(extension) < _LEFT_NM)
    tendon, contact = (np.where(asked, np.asarray(force) / pull, np.nan)
                       for force in (found.tendon_N, found.contact_N))  # fmt: skip
    by_flexion(panels[0], *((extension, "Extension moment, N m") if over_pull else (pull, _PULL)))
    ratios = {"patellar tendon": tendon, "patellofemoral contact": contact}
    by_kind(panels[1], ratios, "Force by quadriceps force")
    panels[1].set_ylim(bottom=0.0)
    by_flexion(panels[2], found.arm_mm, "Moment arm of the quadriceps, mm")
    turns = {"flexion": patella[:, 0], "tilt": patella[:, 2], "rotation": patella[:, 1]}
    by_kind(panels[3], turns, "Patella, deg")
    knee = found.motion.knee
    draw.draw_ligaments(panels[4], x, knee, found.mechanics.tension, among=_tibiofemoral(found),
                        rows=rows)  # fmt: skip
    by_flexion(panels[5], np.asarray(found.motion.to_table())[:, 3], "Tibia, anterior, mm")
    for axes in panels:
        if over_pull:
            axes.set_xlabel(_PULL)
        else:
            draw.flexion_axis(axes, x)
        draw.mark_status(axes, x, status, height=0.02)
    if len(rows) > 1:
        panels[2].legend(title="Flexion, deg", title_fontsize=7.5, fontsize=7.5)
    return figure


@styled
def shear_figure(found: Extensor) -> Figure:
    """Draw what each part does to the tibia along its anterior axis: the parts sum to zero."""
    # Tendon, contact, muscles and weight, then ligaments, the fibres of a bundle together.
    knee, parts = found.motion.knee, dict(found.forces_on_tibia)
    grouped = {TENDON: parts.pop(TENDON)}
    if pressed := [parts.pop(name) for name in knee.contact_names if name in parts]:
        grouped["contact"] = sum(pressed)
    members = pose_tables.bundles(knee, _tibiofemoral(found))
    pulled = {name: sum(parts.pop(x) for x in own) for name, own in members.items()}
    forces = {name: force[:, 0] for name, force in {**grouped, **parts, **pulled}.items()}
    shown = sorted(forces, key=lambda name: -np.nanmax(np.abs(forces[name])))[:_MOST_LINES]
    figure, ((axes,),) = draw.grid(1, 1, 3.6, left=0.7, right=1.82)
    x = np.asarray(found.flexion_deg)
    for name, style in part_styles(shown).items():
        axes.plot(x, forces[name], label=verbatim(name), **style)
    if rest := [force for name, force in forces.items() if name not in shown]:
        axes.plot(x, sum(rest), color=GREY, label="all others")
    axes.plot(x, sum(forces.values()), color="black", linestyle=":", label="sum")
    axes.axhline(0.0, color=GREY, linewidth=0.5)
    axes.set(title="Force on the tibia, forwards along its own axis", ylabel="N")
    draw.flexion_axis(axes, x)
    draw.part_legend(axes, draw.labelled(axes), (1.02, 1.02))
    return figure


def _tibiofemoral(found: Extensor) -> list[str]:
    fibres = found.motion.knee.ligaments
    pairs = zip(fibres.names, fibres.bodies, strict=True)
    return [name for name, pair in pairs if pair == FEMUR_AND_TIBIA]


#: Columns of extensor.csv that people read, with heading and digits.
_SHOWN = {"flexion_deg": ("flexion, deg", ".1f"), "quadriceps_N": ("quadriceps, N", ".1f"),
          "tendon_by_quadriceps": ("tendon, / quadriceps", ".2f"), "arm_mm": ("arm, mm", ".1f"),
          "patellofemoral_by_quadriceps": ("contact, / quadriceps", ".2f"), "status": (),
          "patella_flexion_deg": ("patella: flexion, deg", ".1f"),
          "patella_tilt_deg": ("tilt, deg", ".1f")}  # fmt: skip


def extensor_answer(
    name: str, experiment: str, found: Extensor, *, loads, driven: DrivenExtensor | None = None
) -> Answer:
    """What a knee does while its quadriceps pulls, or is given lengths (`driven`), under loads."""
    knee, status = found.motion.knee, with_flips(found.motion.status, found.mechanics)
    flexion, pull = np.asarray(found.flexion_deg), np.asarray(found.quadriceps_N)
    search = pose_tables.search_words(found.motion, loads)
    words = pose_tables.pose_words(knee, found.mechanics, search)
    places = pose_tables.named_places([f"{x:g}" for x in flexion], "degrees")
    doubts = [*pose_tables.status_doubts(status, words, *places)]
    title, notes = f"{name}: {experiment}", []
    if found.continued.any():
        at = ", ".join(f"{x:g}" for x in flexion[found.continued])
        notes.append(prose("extensor.continued", places=at))
    if driven is not None:
        loose = zip(driven.longer_mm[driven.slack], flexion[driven.slack], strict=True)
        notes += [prose("extensor.slack", mm=f"{mm:g}", deg=f"{deg:g}") for mm, deg in loose]
    keys = {"flexion_deg": flexion, "quadriceps_N": pull}
    parts = found.forces_on_tibia
    on_tibia = {**{name: np.tile(x, len(parts)) for name, x in keys.items()},
                "part": np.repeat([*parts], len(flexion)),
                pose_tables.along("{}_N"): np.concatenate([*parts.values()])}  # fmt: skip
    tables = {"extensor": extensor_table(found, status, driven),
              "forces": pose_tables.force_table(knee, found.mechanics, keys),
              "tibia_forces": Table.of(on_tibia)}
    drawings = {"extensor": Drawing(extensor_figure, found, status, title)}
    sections = [pose_tables.peak_section(knee, found.mechanics, flexion, "at flexion, deg")]
    if experiment != "extension":
        drawings["shear"] = Drawing(shear_figure, found)
        sections.append(Section("What draws the tibia forwards", drawings=["shear"]))
    return Answer(title=title, asked=prose(experiment), verdict=pose_tables.verdict_of(status),
                  sentence=_sentence(experiment, found, status), tables=tables, main=["extensor"],
                  drawings=drawings, doubts=doubts,
                  sections=[*sections, Section("Notes", notes, printed=True)])  # fmt: skip


def extensor_table(
    found: Extensor, status: np.ndarray, driven: DrivenExtensor | None = None
) -> Table:
    """Forces, lengths, moments and both bones, a row a pose: extensor.csv."""
    motion, mechanics = found.motion, found.mechanics
    pull, tendon, contact = (np.asarray(x) for x in
                             (found.quadriceps_N, found.tendon_N, found.contact_N))  # fmt: skip
    here = [k for k, x in enumerate(motion.knee.contacts) if x.bodies == (FEMUR, PATELLA)]
    tibia, patella = np.asarray(motion.to_table()), np.asarray(found.patella)
    columns: dict[Any, Any] = {
        "flexion_deg": np.round(np.asarray(found.flexion_deg, float), 9), "quadriceps_N": pull,
        "quadriceps_mm": found.quadriceps_mm, "tendon_N": tendon, "patellofemoral_N": contact,
        "tendon_by_quadriceps": tendon / pull, "patellofemoral_by_quadriceps": contact / pull,
        "extension_Nm": found.extension_Nm, "weight_Nm": found.weight_Nm, "arm_mm": found.arm_mm,
        "patellofemoral_area_mm2": np.asarray(mechanics.area)[:, here].sum(axis=1),
        "patellofemoral_max_pressure_MPa": np.asarray(mechanics.max_pressure)[:, here].max(axis=1),
        COLUMNS[1:]: tibia[:, 1:], tuple(x.column for x in BODIES[PATELLA].values()): patella,
        "converged": motion.equilibrium.converged, "stable": motion.stable,
        "status": pose_tables.words_of(status),
    }  # fmt: skip
    if driven is not None:
        columns |= {"longer_mm": driven.longer_mm, "slack": driven.slack}
    return Table.of(columns, note=prose("arm"), show=_SHOWN)


def _sentence(experiment: str, found: Extensor, status: np.ndarray) -> str:
    known = np.flatnonzero(np.asarray(status) < Status.TOO_DEEP)
    if not len(known):
        return "No pose has an equilibrium."
    values, what, unit = {
        "extension": (found.extension_Nm, "The knee extends", "N m"),
        "patellar-tracking": (found.contact_N, "The patella is pressed", "N"),
    }.get(experiment, (found.quadriceps_N, "The quadriceps pulls", "N"))
    flexion, arm, values = (np.asarray(x)[known] for x in (found.flexion_deg, found.arm_mm, values))
    most = int(np.argmax(values))
    words = f"{what} with at most {values[most]:.0f} {unit}, at {flexion[most]:g} degrees"
    if np.isfinite(arm).any():
        arms = f"{np.nanmin(arm):.0f} to {np.nanmax(arm):.0f} mm"
        words += f"; the quadriceps has a moment arm of {arms}"
    return f"{words}."
