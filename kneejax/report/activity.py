"""What a recorded movement does to a knee, or to several, as an answer.

Figures are in the layout of papers on gait; grafts in several places are as in paper 2, Figure 7.
"""

import re
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.lines import Line2D

from kneejax.experiments import Activity, Cycle, Round, with_flips
from kneejax.geometry import BODIES, COLUMNS, COORDINATES, FEMORAL, FREE_COORDINATES, coordinate
from kneejax.report import pose_tables
from kneejax.report.look.colours import BLACK, BLUE, GREY, LIGHT, VERMILLION, part_styles, shades
from kneejax.report.look.page import Answer, Drawing, Section, Verdict, prose
from kneejax.report.look.style import Axes, Figure, styled, verbatim
from kneejax.report.look.tables import NONE, Column, Table, listed, runs
from kneejax.report.panels import draw_named, figure_legend, labelled, mark_edge, panel_grid
from kneejax.statics import Status

_STYLES = ((BLUE, "-"), (VERMILLION, (0, (4, 1.5))))
_MOST_LIGAMENTS, _MOST_MUSCLES, _SMALL = 5, 4, 0.05
#: Columns of a table of poses.
_TURN, _FORWARD = 2, 3
_PLACES = {0: (BLACK, (0, (4, 1.5)), 1.6), 1: (VERMILLION, "-", 1.0), 2: (BLUE, "-", 1.2)}
#: A knee whose residual is larger does not agree with the record, N m.
_LARGE_NM = 5.0


def activity_answer(
    title: str, found: Mapping[str, Activity], cycle: Cycle, *, rounds: Sequence[Round] = (),
    convention: str = FEMORAL,
) -> Answer:
    """A recorded movement, in a cycle, of knees by what they are called, the intact one first."""
    record = next(iter(found.values())).record
    status = {name: with_flips(x.motion.status, x.mechanics) for name, x in found.items()}
    words, doubts, second, time = {}, [*record.doubts], False, record.time_s
    for name, one in found.items():
        here, rows = np.asarray(one.motion.to_table()), np.isfinite(one.other).all(axis=1)
        # What is wrong at each instant, or known of another balance there.
        also = pose_tables.with_second(pose_tables.search_words(one.motion), one.other, here)
        words[name] = pose_tables.pose_words(one.motion.knee, one.mechanics, also)
        places = pose_tables.named_places([f"{x:.4g}" for x in time], "s")
        said = [*pose_tables.status_doubts(status[name], words[name], *places)]
        if rows.any():
            rows, second = np.flatnonzero(rows), True
            spans = [f"{time[a]:g}" + f" to {time[b]:g}" * (a != b) for a, b in runs(rows)]
            said.append(prose("activity.second", spans=listed(spans, 8), count=len(rows),
                              all=len(time)))  # fmt: skip
        moment = np.asarray(one.residual_Nm)
        rms = np.sqrt(np.nanmean(moment**2)) if one.holds.any() else np.nan
        if rms > _LARGE_NM:
            said.append(prose("activity.unexplained", rms=rms, most=np.nanmax(abs(moment))))
        doubts += [f"{name}: {x.lstrip()}" if len(found) > 1 else x for x in said]
    tables = _tables(found, status, words, cycle, convention)
    ranges, compared = _ranges(found), place_table(found)
    several, alone, drawn = len(found) > 2, len(found) == 1, dict([*found.items()][:2])
    drawings = {"activity": Drawing(activity_figure, drawn, cycle, title)}
    if several:
        tables["places"] = compared
        drawings["places"] = Drawing(places_figure, found, cycle, title)
    times = np.round(record.time_s, 3)
    peaks = [pose_tables.peak_table(one.motion.knee, one.mechanics, times, "at time, s",
                                    f"Largest forces, {name}") for name, one in drawn.items()]
    if rounds:
        tables["rounds"] = round_table(rounds)
    instants = f"{len(time)} instants from {time[0]:g} to {time[-1]:g} s"
    mass = [f"Leg below the knee: {record.mass_kg:.2f} kg."] * bool(record.mass_kg)
    lost = any((x != Status.BALANCED).any() for x in status.values())
    return Answer(title=title,
                  asked=f"What the recorded loads and muscles do to the knee at {instants}.",
                  verdict=Verdict.DOUBTFUL if (record.doubts or second) and not lost else
                  pose_tables.verdict_of(np.concatenate([*status.values()])),
                  sentence=_sentence(found), tables=tables, main=[ranges if alone else compared],
                  drawings=drawings, picture="places" if several else "activity", doubts=doubts,
                  exit_status=int(bool(record.doubts) or lost or second), sections=[
        Section("Range of each coordinate", tables=[ranges] * (not alone), printed=not several),
        Section("Largest forces", tables=peaks, printed=not several),
        Section("All coordinates and forces", drawings=["activity"] * several),
        Section("Rounds with OpenSim", tables=["rounds"] * bool(rounds), printed=True),
        Section("The record", [f"{instants}.", *mass, *record.notes], printed=True),
    ])  # fmt: skip


def _ranges(found: Mapping[str, Activity]) -> Table:
    """Least and most of each coordinate, and how far it is from the record's."""
    rows = []
    for name, one in found.items():
        if not one.holds.any():
            continue
        table, moment = np.asarray(one.motion.to_table()), np.asarray(one.residual_Nm)
        away = (table - one.record.pose) if one.record.same_frames else np.full_like(table, np.nan)
        away[:, 0] = np.nan
        labels = [coordinate(which).axis_label for which in COORDINATES]
        for label, values, off in (*zip(labels, table.T, away.T, strict=True),
                                   ("Moment that holds flexion, N m", moment, moment)):  # fmt: skip
            rms = np.sqrt(np.nanmean(off**2)) if np.isfinite(off).any() else np.nan
            rows.append([name, label, np.nanmin(values), np.nanmax(values), rms])
    same = any(one.record.same_frames for one in found.values())
    columns = ["knee", Column("coordinate", " "), Column("least", show=".2f"),
               Column("most", show=".2f"),
               Column("rms", "rms from record" if same else "rms", ".2f")]  # fmt: skip
    return Table(columns, rows, note="Of the moment: rms of itself; nothing known to act holds it.")


def _sentence(found: Mapping[str, Activity]) -> str:
    first = next(iter(found.values()))
    if not first.holds.any():
        return "The intact knee has no equilibrium at any instant."
    contact = pose_tables.contact_forces(first.mechanics).sum(axis=1)
    row = int(np.nanargmax(contact))
    words = (f"All contacts together carry up to {contact[row]:.0f} N, at "
             f"{first.record.time_s[row]:.2f} s, in the intact knee.")
    intact = np.asarray(first.motion.to_table())
    for name, one in [*found.items()][1:3]:
        away = np.abs(np.asarray(one.motion.to_table()) - intact)[:, [_FORWARD, _TURN]]
        if np.isfinite(away).any():
            far, turned = np.nanmax(away, axis=0)
            words += (
                f" {name[:1].upper()}{name[1:]}, the tibia is up to {far:.1f} mm (anterior) and "
                f"{turned:.1f} degrees (internal rotation) from it."
            )
    return words


def place_table(found: Mapping[str, Activity]) -> Table:
    """Peaks and distances from the intact knee, one row a knee: places.csv."""
    pulls, rows = graft_pulls(found), []
    intact = np.asarray(next(iter(found.values())).motion.to_table())
    for name, one in found.items():
        away = (np.asarray(one.motion.to_table()) - intact)[:, [_FORWARD, _TURN]]
        away = away[np.isfinite(away).all(axis=1)]
        rms = np.sqrt(np.mean(away**2, axis=0)) if len(away) else [np.nan, np.nan]
        peaks = [pose_tables.largest(x)[0]
                 for x in (*pulls[name], pose_tables.contact_forces(one.mechanics).ravel())]
        torn = np.asarray(one.motion.status) == Status.OVERSTRETCHED
        rows.append([name, int(one.holds.sum()), int(torn.sum()), *peaks, *rms])
    columns = [
        "knee", "in_balance", "overstretched",
        Column("graft_peak_N", "ligament or graft, N", ".0f"),
        Column("graft_peak_strain", "strain, %", lambda x: f"{100 * x:.1f}" if x == x else NONE),
        Column("contact_peak_N", "contact, N", ".0f"),
        Column("anterior_rms_from_intact_mm", "forwards, mm", ".2f"),
        Column("internal_rotation_rms_from_intact_deg", "inwards, deg", ".2f"),
    ]  # fmt: skip
    return Table(columns, rows, note=prose("activity.places", count=len(intact)))


def round_table(rounds: Sequence[Round]) -> Table:
    """How far the knee's secondary motion is off the one that OpenSim's model had: rounds.csv."""
    rows = [
        [one.number, coordinate(name).column, rms, largest, left, *one.holds, one.moment_Nm,
         one.reaction_N]
        for one in rounds
        for name, rms, largest, left in zip(FREE_COORDINATES, *one.residual, one.left, strict=True)
    ]  # fmt: skip
    names = ("round", "coordinate", "residual_rms", "residual_largest", "left_by_splines_rms",
             "balanced_instants", "instants", "moment_Nm_rms", "reaction_N_rms")  # fmt: skip
    columns = [Column(name, show=".2f") for name in names]
    note = "Of the knee from the motion that OpenSim's model had, root of the mean square and most."
    return Table(columns, rows, "Rounds with OpenSim", note)


def _tables(found, status, words, cycle: Cycle, convention: str) -> dict[str, Table]:
    """Rows of each instant of each knee: poses, ligaments, contacts, and what acts on the tibia."""
    # A record of no gait has no part of a cycle.
    percent = cycle.percent if cycle.is_gait else np.full(len(cycle.percent), np.nan)
    axes = *pose_tables.along("{}_N"), *pose_tables.about("{}_Nmm")
    made: dict[str, Table] = {}
    for name, one in found.items():
        knee, record, told = one.motion.knee, one.record, one.mechanics
        states = one.motion.equilibrium.state.poses
        poses, extra = pose_tables.in_convention(one.motion.to_table(), convention)
        recorded, _ = pose_tables.in_convention(record.pose, convention)
        keys = {"knee": [name] * len(percent), "time_s": record.time_s}
        parts = {**one.acting, **one.held, "left over": one.left_over}
        own = {
            "activity": Table.of({
                **keys, "cycle_percent": percent, COLUMNS: poses,
                tuple(f"record_{x}" for x in COLUMNS): recorded,
                **{tuple(x.column for x in BODIES[body].values()): states[body].to_table()
                   for body in knee.other_bones},
                "quadriceps_N": record.quadriceps_N, "residual_flexion_Nm": one.residual_Nm,
                "status": pose_tables.words_of(status[name]), "doubt": words[name], **extra,
            }),
            "forces": pose_tables.part_table(keys, "ligament", knee.ligaments.names,
                                             {"force_N": told.tension, "strain": told.strain}),
            "contact": pose_tables.part_table(keys, "contact", knee.contact_names, {
                **pose_tables.contact_numbers(knee, told),
                pose_tables.along("center_{}_mm"): told.center,
            }),
            "residual": pose_tables.part_table(keys, "part", [*parts],
                                               {axes: np.stack([*parts.values()], axis=1)}),
        }  # fmt: skip
        for file, table in own.items():
            before = made[file].rows if file in made else []
            made[file] = Table(table.columns, [*before, *table.rows])
    return made


@styled
def activity_figure(found: Mapping[str, Activity], cycle: Cycle, title: str) -> Figure:
    """Draw a movement of one knee, or of two side by side."""
    figure, panels = panel_grid(4, 3, 8.6, title, shared=True)
    x, first = cycle.percent, next(iter(found.values()))
    record, legend = first.record, {"columns": 5, "size": 6.0}
    for k, (name, axes) in enumerate(zip(COORDINATES, panels[:6], strict=True)):
        if record.same_frames or k == 0:
            axes.plot(x, record.pose[:, k], color=GREY, linestyle=":", linewidth=1.4)
        for one, (color, dashes) in zip(found.values(), _STYLES, strict=False):
            if k or not record.same_frames:
                table = np.asarray(one.motion.to_table())
                axes.plot(x, table[:, k], color=color, linestyle=dashes)
        axes.set_ylabel(coordinate(name).axis_label)
    bundled = [pose_tables.bundle_forces(one.motion.knee, one.mechanics.tension)
               for one in found.values()]  # fmt: skip
    size = {name: max(np.nanmax(f[name], initial=0.0) for f in bundled) for name in bundled[0]}
    shown = sorted(size, key=lambda name: -size[name])[:_MOST_LIGAMENTS]
    shown = [name for name in shown if size[name] > _SMALL * size[shown[0]]]
    colors = [part_styles(bundled[0])[name]["color"] for name in shown] or [GREY]
    panels[9].axhline(0.0, color=GREY, linewidth=0.5)
    for k, (one, (color, dashes)) in enumerate(zip(found.values(), _STYLES, strict=False)):
        mark = "_" * k  # of the second knee nothing stands in the legends
        names = [mark + name for name in one.motion.knee.contact_names]
        for axes, values, label in (
            (panels[6], pose_tables.contact_forces(one.mechanics), "Contact force, N"),
            (panels[7], np.asarray(one.mechanics.max_pressure), "Peak pressure, MPa"),
        ):
            curves = dict(zip(names, values.T, strict=True))
            draw_named(axes, x, curves, label, linestyle=dashes, **legend)
        forces = {mark + name: bundled[k][name] for name in shown}
        draw_named(panels[8], x, forces, "Ligament force, N", colors=colors, linestyle=dashes,
                   **legend)  # fmt: skip
        panels[9].plot(x, one.residual_Nm, color=color, linestyle=dashes)
    panels[9].set_ylabel("Moment holding flexion, N m")
    for axes in panels[6:9]:
        axes.set_ylim(bottom=0.0)
    muscles = dict(zip(record.muscles.names, np.asarray(record.muscles.tension), strict=True))
    panels[10].set_visible(bool(muscles))
    if muscles and record.quadriceps_N.any():
        muscles["quadriceps"] = record.quadriceps_N
    most = sorted(muscles, key=lambda name: -float(muscles[name].max()))[:_MOST_MUSCLES]
    pulls = {re.sub(r"_[rl]$", "", name): muscles[name] for name in most}
    draw_named(panels[10], x, pulls, "Muscle force, N", **legend)
    force, ways, label = record.ground_N, ("X", "Y", "Z"), "Ground force, N"
    if (given := record.acting.get("joint reaction")) is not None:
        force, ways, label = given[:, :3], pose_tables.along("{}"), "Joint reaction, N"
    draw_named(panels[11], x, dict(zip(ways, force.T, strict=True)), label, **legend)
    for axes in panels:
        for one, (color, _) in zip(found.values(), _STYLES, strict=False):
            mark_edge(axes, x[~one.holds], "x", color, 0.02)
        axes.yaxis.labelpad = 1.5
    _over_cycle(panels, cycle, panels[9:])
    handles = [Line2D([], [], color=color, linestyle=dashes, label=verbatim(name))
               for name, (color, dashes) in zip(found, _STYLES, strict=False)]  # fmt: skip
    if record.same_frames:
        handles.append(Line2D([], [], color=GREY, linestyle=":", linewidth=1.4, label="record"))
    if np.isfinite(cycle.toe_off):
        handles.append(Line2D([], [], color=LIGHT, label="toe off"))
    if any(not one.holds.all() for one in found.values()):
        handles.append(Line2D([], [], color=GREY, marker="x", linestyle="", markersize=4,
                              label="no balance"))  # fmt: skip
    figure.legend(handles=handles, loc="upper left", bbox_to_anchor=(0.068, 0.965),
                  ncol=len(handles), fontsize=8, frameon=False)  # fmt: skip
    return figure


def _over_cycle(panels: Sequence[Axes], cycle: Cycle, lowest: Sequence[Axes]) -> None:
    for axes in panels:
        axes.set_xlim(cycle.percent[0], cycle.percent[-1])
        if np.isfinite(cycle.toe_off):
            axes.axvline(cycle.toe_off, color=LIGHT, linewidth=1.0, zorder=0)
    for axes in lowest:
        axes.set_xlabel(cycle.axis_label)


def graft_pulls(found: Mapping[str, Activity]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Force, N, and largest strain of the ligament where it acts, and of the graft elsewhere."""
    acts = np.stack([np.asarray(one.motion.knee.ligaments.stiffness) for one in found.values()])
    changing, answer = np.ptp(acts, axis=0) > 0, {}
    for (name, one), stiffness in zip(found.items(), acts, strict=True):
        rows = np.flatnonzero(changing & (stiffness > 0))
        force, strain = (np.asarray(x)[:, rows]
                         for x in (one.mechanics.tension, one.mechanics.strain))  # fmt: skip
        nothing = np.full(len(force), np.nan)
        answer[name] = (force.sum(axis=1), strain.max(axis=1)) if len(rows) else (nothing,) * 2
    return answer


@styled
def places_figure(found: Mapping[str, Activity], cycle: Cycle, title: str) -> Figure:
    """Draw what places of a graft do over a record."""
    figure, panels = panel_grid(2, 2, 5.4, title, shared=True)
    figure.subplots_adjust(bottom=0.2, hspace=0.12)
    tables = {name: np.asarray(one.motion.to_table()) for name, one in found.items()}
    intact = next(iter(tables.values()))
    words = ("Strain of ligament or graft, %", "Force of ligament or graft, N",
             "Forwards of the intact tibia, mm", "Turned inwards of it, deg")  # fmt: skip
    for axes, label in zip(panels, words, strict=True):
        axes.set_ylabel(label)
    for axes in panels[2:]:
        axes.axhline(0.0, color=GREY, linewidth=0.5)
    colours = shades(8, 0.95)
    for k, (name, (force, strain)) in enumerate(graft_pulls(found).items()):
        color, dashes, width = _PLACES.get(k, (colours[(k - 3) % 8], "-", 0.7))
        away = tables[name] - intact
        values = 100 * strain, force, away[:, _FORWARD], away[:, _TURN]
        # Of the intact knee there is no way to itself.
        for axes, curve in zip(panels[: 4 if k else 2], values, strict=False):
            axes.plot(cycle.percent, curve, color=color, linestyle=dashes, linewidth=width,
                      label=verbatim(name))  # fmt: skip
    _over_cycle(panels, cycle, panels[2:])
    # At how many instants a knee balances is said where that is not all of them; four such names
    # are as wide as the figure.
    lost = {verbatim(name): "" if one.holds.all() else f" ({one.holds.sum()} of {len(one.holds)})"
            for name, one in found.items()}  # fmt: skip
    drawn = labelled(*figure.axes)
    figure_legend(figure, {name + more: drawn[name] for name, more in lost.items()},
                  ncols=4 if any(lost.values()) else 6, fontsize=7.5, handlelength=1.6,
                  columnspacing=1.2)  # fmt: skip
    return figure
