"""A knee in time: motions, energies, a leg that a motor raises."""

from collections.abc import Iterator

import numpy as np

from kneejax.experiments import RaisedLeg, Transient
from kneejax.geometry import COLUMNS, COORDINATES, FEMORAL, coordinate, table_units
from kneejax.inference.transients import FittedTransient, Recorded
from kneejax.mechanics import NAMED_LOADS, load_words
from kneejax.report import pose_tables
from kneejax.report.extensor import extensor_table
from kneejax.report.look.colours import BLACK, BLUE, GREEN, GREY, PURPLE, VERMILLION
from kneejax.report.look.page import Answer, Drawing, Section, prose
from kneejax.report.look.style import Figure, styled
from kneejax.report.look.tables import Column, Table
from kneejax.report.panels import draw_ligaments, draw_named, flexion_axis, panel_grid
from kneejax.statics import Status

_COLORS = (BLUE, VERMILLION, GREEN)
_ENERGIES = {"work": BLACK, "kinetic": BLUE, "potential": GREEN, "dissipated": PURPLE,
             "missing": GREY}  # fmt: skip


@styled
def transient_figure(found: Transient, title: str, recorded: Recorded | None = None) -> Figure:
    """Draw a motion through time."""
    figure, panels = panel_grid(3, 2, 7.0, title, shared=True)
    motion, time, names = found.trajectory, found.time_s, list(COORDINATES)
    table, knee = motion.to_table(), motion.moving.knee
    for axes, columns, label in ((panels[0], range(3, 6), "Change of translation, mm"),
                                 (panels[1], range(1, 3), "Change of rotation, deg")):
        changes = {names[k].replace("_rotation", ""): table[:, k] - table[0, k] for k in columns}
        draw_named(axes, time, changes, label, colors=_COLORS)
        for k, color in zip(columns, _COLORS, strict=False):
            if recorded is not None and names[k] in recorded.changes:
                dots = recorded.time_s, recorded.changes[names[k]]
                axes.plot(*dots, ".", color=color, markersize=2.5, alpha=0.6)
            if found.rest is not None:
                away = float(found.rest.to_table()[0, k]) - table[0, k]
                axes.axhline(away, color=color, linestyle="--", linewidth=0.8)
    acting = {NAMED_LOADS[name]: x for name, x in found.sizes.items() if np.any(x)}
    if acting:
        units = sorted({load.unit for load in acting})
        loads = {x.positive + f", {x.unit}" * (len(units) > 1): y for x, y in acting.items()}
        draw_named(panels[2], time, loads, f"Load, {' and '.join(units)}")
    else:
        draw_named(panels[2], time, {"_": table[:, 0]}, "Flexion, deg", colors=[BLACK])
    draw_ligaments(panels[3], time, knee, np.asarray(found.mechanics.tension) + found.damping_N)
    forces = pose_tables.contact_forces(found.mechanics).T
    contact = dict(zip(knee.contact_names, forces, strict=True))
    draw_named(panels[4], time, contact, "Contact force, N")
    energies = {kind: getattr(found.account, kind) for kind in _ENERGIES}
    steps = np.concatenate([[0.0], motion.grid.time_s]) + time[0]
    draw_named(panels[5], steps, energies, "Energy, N mm", colors=[*_ENERGIES.values()], columns=5,
               size=6.5)  # fmt: skip
    for axes in panels[4:]:
        axes.set_xlabel("Time, s")
    for axes in panels if motion.ended is not Status.BALANCED else ():
        axes.axvline(motion.ended_s, color=VERMILLION, linewidth=0.8, linestyle=":")
    return figure


@styled
def motor_raise_figure(found: RaisedLeg, title: str) -> Figure:
    """Draw a leg that is raised over its flexion, and by points one that is held there."""
    figure, panels = panel_grid(3, 2, 7.8, title)
    one, motion, at = found.transient, found.transient.trajectory, found.held.flexion_deg
    table, names = motion.to_table(), motion.names
    flexion = table[:, 0]
    panels[0].plot(one.time_s, flexion, color=BLUE)
    panels[0].set(xlabel="Time, s", ylabel="Flexion, deg")
    dots = {"linestyle": "none", "marker": ".", "markersize": 3.5}
    draw_named(panels[1], at, {"held": found.held.quadriceps_N}, "", colors=[BLACK], **dots)
    pull = {"raised": one.quadriceps["quadriceps_N"]}
    draw_named(panels[1], flexion, pull, "Quadriceps force, N")
    state = found.held.motion.equilibrium.state.at(names)
    held = np.asarray(state).T * table_units(names)
    for axes, shown, label in (
        (panels[2], ("patella_flexion", "patella_tilt", "patella_rotation"), "Patella, deg"),
        (panels[3], ("internal_rotation", "adduction", "anterior"), "Tibia, change, deg or mm"),
    ):
        curves = {}
        for name, color in zip(shown, _COLORS, strict=True):
            k = names.index(name)
            zero = table[0, k] if axes is panels[3] else 0.0
            curves[name.replace("patella_", "").replace("_", " ")] = table[:, k] - zero
            axes.plot(at, held[:, k] - zero, color=color, **dots)
        draw_named(axes, flexion, curves, label, colors=_COLORS, columns=3)
    tension = np.asarray(one.mechanics.tension) + one.damping_N
    draw_ligaments(panels[4], flexion, motion.moving.knee, tension)
    away = {f"{bone}, {unit}": np.zeros(len(found.from_held))
            for bone in ("tibia", "patella") for unit in ("deg", "mm")}  # fmt: skip
    for name, values in zip(names, np.abs(found.from_held).T, strict=True):
        bone = "patella" if name.startswith("patella") else "tibia"
        key = f"{bone}, {coordinate(name).unit}"
        away[key] = np.maximum(away[key], values)
    colors = (BLUE, GREEN, VERMILLION, PURPLE)
    draw_named(panels[5], at, away, "From the leg that is held", colors=colors, columns=2)
    panels[5].set_ylim(bottom=0.0)
    for axes in panels[1:]:
        flexion_axis(axes, flexion)
    return figure


#: A coordinate that moves less than this from the unloaded pose is left out, mm or degrees.
_SMALL = 0.05
#: Correlation from which a record does not separate two dampers.
_ALIKE = 0.95
#: Rows of a leg that is raised, for people.
_ROWS = 9


def transient_answer(
    name: str, experiment: str, found: Transient, *, recorded: Recorded | None = None,
    fit: FittedTransient | None = None, convention: str = FEMORAL,
) -> Answer:
    """A motion through time, beside its record, with the dampers that were found from it."""
    last = {load: size[-1] for load, size in found.sizes.items()}
    under = f", {load_words(last)}" if any(last.values()) else ""
    title = f"{name}: {experiment} at {found.trajectory.to_table()[0, 0]:.3g} degrees{under}"
    moved, notes, doubts = _moved(found), [], [*_wrong(found)]
    for load, values in ((NAMED_LOADS[x], size) for x, size in found.sizes.items()):
        word = load.positive if values[np.argmax(np.abs(values))] >= 0 else load.negative
        notes.append(f"{word}: {np.abs(values).max():g} {load.unit} at most")
    if found.rest is not None:
        notes.append(f"from the balance under the last loads: {found.from_rest_mm:.2g} mm")
    tables, main, sentence = _motion_tables(found, convention), [moved], ""
    if fit is not None:
        known = [*zip(fit.names, fit.values, fit.lower, fit.upper, strict=True)]
        # Six digits; nothing for limits that are not known.
        sizes = [[f"{x:.6g}" if np.isfinite(x) else "" for x in row] for _, *row in known]
        heads = Column("value"), Column("lower_95", "95 % from"), Column("upper_95", "to")
        left = "; ".join(f"{coordinate(k).axis_label} {x:.2g}" for k, x in fit.rms.items())
        tables["damping"] = Table.of({Column("name", "damper"): fit.names, heads: sizes}, "Dampers",
                                     f"Left of the record, root of the mean square: {left}.")
        main.insert(0, "damping")
        said = []
        for name, value, low, high in known:
            limits = f"95 % {low:.3g} to {high:.3g}" if np.isfinite(low) else "at its bound"
            said.append(f"{name} is {value:.3g} ({limits})")
            if low < 0.0:
                doubts.append(f"{name}: the limits include zero; the record does not determine it")
        sentence = f"{'; '.join(said)}."
        together = np.nan_to_num(fit.uncertainty.correlation)
        doubts += [prose("dampers", one=fit.names[j], other=first, correlation=together[i, j])
                   for i, first in enumerate(fit.names) for j in range(i)
                   if abs(together[i, j]) > _ALIKE]  # fmt: skip
        if not fit.converged:
            doubts.append(f"the search was given up after {fit.evaluations} evaluations")
    return Answer(
        title=title, asked=prose("transient", seconds=found.time_s[-1] - found.time_s[0]),
        sentence=sentence or _sentence(moved, found), tables=tables, main=main,
        drawings={"motion": Drawing(transient_figure, found, title, recorded)}, doubts=doubts,
        sections=[pose_tables.peak_section(found.trajectory.moving.knee, found.mechanics,
                                           found.time_s, "at time, s"),
                  Section("Loads, time steps and energy", [*notes, *_how_exact(found)],
                          printed=True)],
        exit_status=int(any(_wrong(found)) or (fit is not None and not fit.converged)),
    )  # fmt: skip


def raised_leg_answer(name: str, found: RaisedLeg, convention: str = FEMORAL) -> Answer:
    """A leg that a motor raises, compared with the leg that is held at each flexion."""
    one, motion = found.transient, found.transient.trajectory
    title = f"{name}: leg-raise in {one.time_s[-1]:g} s"
    table, patella = motion.to_table(), motion.names.index("patella_flexion")
    picked = np.unique(np.linspace(0, len(found.rows) - 1, _ROWS).round().astype(int))
    row = np.asarray(found.rows)[picked]
    raised = Table.of({
        Column("time_s", show=".2f"): one.time_s[row],
        Column("flexion_deg", show=".2f"): table[row, 0],
        Column("quadriceps_N", show=".1f"): one.quadriceps["quadriceps_N"][row],
        Column("held_N", show=".1f"): np.asarray(found.held.quadriceps_N)[picked],
        Column("patella_flexion_deg", "patella, deg", ".2f"): table[row, patella],
    }, note="Held: the quadriceps force that holds the leg there.")  # fmt: skip
    sentence = "The leg was nowhere at a flexion at which it was held."
    if np.isfinite(found.from_held).any():
        k, column = np.unravel_index(np.nanargmax(np.abs(found.from_held)), found.from_held.shape)
        sentence = prose("raised_leg.far", far=found.farthest, at=table[found.rows[k], 0],
                         coordinate=coordinate(motion.names[column]))  # fmt: skip
    held = extensor_table(found.held, np.asarray(found.held.motion.status))
    return Answer(
        title=title, asked=prose("raised_leg", seconds=one.time_s[-1]),
        sentence=sentence, main=[raised],
        tables=_motion_tables(one, convention) | {"extensor": held},
        drawings={"raised_leg": Drawing(motor_raise_figure, found, title)}, doubts=[*_wrong(one)],
        sections=[Section("The leg that is held", tables=["extensor"]),
                  pose_tables.peak_section(motion.moving.knee, one.mechanics, one.time_s,
                                           "at time, s"),
                  Section("Time steps and energy", [*_how_exact(one)], printed=True)],
    )  # fmt: skip


def _motion_tables(found: Transient, convention: str) -> dict[str, Table]:
    """Poses, rates and loads; forces; energies: motion.csv, forces.csv and energy.csv."""
    motion, time_s = found.trajectory, found.time_s
    table, knee = motion.to_table(), motion.moving.knee
    poses, extra = pose_tables.in_convention(table[:, :6], convention)
    rates = tuple(f"{coordinate(name).column}_per_s" for name in motion.names)
    damping = np.zeros((len(poses), len(knee.ligaments.names) + len(knee.contact_names)))
    damping[:, : len(knee.ligaments.names)] = found.damping_N
    energies = {f"{kind}_Nmm": np.asarray(getattr(found.account, kind))[motion.rows]
                for kind in _ENERGIES}  # fmt: skip
    return {
        "motion": Table.of({"time_s": time_s, COLUMNS: poses, motion.columns[6:]: table[:, 6:],
                            rates: motion.rates_to_table(), **found.sizes, **found.quadriceps,
                            "status": pose_tables.words_of(motion.status), **extra}),
        "forces": pose_tables.force_table(knee, found.mechanics, {"time_s": time_s},
                                          damping_N=damping),
        "energy": Table.of({"time_s": time_s, **energies}),
    }  # fmt: skip


def _moved(found: Transient) -> Table:
    """Where each coordinate began, how far it went, and where it ended."""
    motion, table = found.trajectory, found.trajectory.to_table()
    rest = None if found.rest is None else np.asarray(found.rest.to_table())[0]
    columns = [Column("coordinate", " "), Column("start", show=".2f"), Column("peak", show=".2f"),
               Column("peak_s", "at, s", ".3f"), Column("end", show=".2f")]  # fmt: skip
    if rest is not None:
        columns += [Column("rest", "at rest", ".2f"), Column("overshoot", show=".2f")]
    rows = []
    for k, name in enumerate(motion.names[:6]):
        values, away = table[:, k], np.abs(table[:, k] - table[0, k])
        if not np.nanmax(away) > _SMALL:
            continue
        peak = int(np.nanargmax(away))
        row = [coordinate(name).axis_label, values[0], values[peak], found.time_s[peak],
               values[np.isfinite(values)][-1]]  # fmt: skip
        rows.append(row if rest is None else [*row, rest[k], found.overshoot[name]])
    note = "" if rest is None else "At rest: the balance under the last loads."
    return Table(columns, rows, note=note)


def _sentence(moved: Table, found: Transient) -> str:
    if not moved.rows:
        return "The knee does not move."
    label, start, peak, at, *_ = max(moved.rows, key=lambda row: abs(row[2] - row[1]))
    what, _, unit = label.rpartition(",")
    words = f"{what} changes most: from {start:.1f} to {peak:.1f}{unit} at {at:.2g} s"
    if found.rest is not None:
        words += f"; at the end the knee is {found.from_rest_mm:.2g} mm from its balance"
    return f"{words}."


def _how_exact(found: Transient) -> Iterator[str]:
    """Time steps and their error; energies and what is missing of them."""
    motion, account = found.trajectory, found.account
    yield prose("time_steps", count=len(motion.grid.time_s), most=int(motion.grid.within().max()),
                error=motion.error_mm)  # fmt: skip
    ends = []
    for kind in [*_ENERGIES][:-1]:
        values = np.asarray(getattr(account, kind))
        known = values[np.isfinite(values)]
        ends.append(f"{kind} {known[-1]:.4g}" if len(known) else f"{kind} -")
    yield prose("energy", ends=", ".join(ends), missing=float(account.part_missing))


def _wrong(found: Transient) -> Iterator[str]:
    if not found.account.closes:
        yield "the account of energy does not close: ask for a smaller --error-mm"
    motion = found.trajectory
    if motion.ended is not Status.BALANCED:
        yield f"the motion ends at {motion.ended_s:.4g} s: {motion.ended.sentence}"
