"""What a recorded movement does to a knee, or to several, as an answer."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from kneejax.experiments import Activity, Cycle, Round, with_flips
from kneejax.geometry import (
    BODIES,
    COLUMNS,
    COORDINATES,
    FEMORAL,
    FREE_COORDINATES,
    convert_table,
    coordinate,
)
from kneejax.report import doubts as faults
from kneejax.report import pose_tables
from kneejax.report.activity_figures import activity_figure, graft_pulls, places_figure
from kneejax.report.look.page import Answer, Drawing, Section, Verdict
from kneejax.report.look.tables import NONE, Column, Table, listed, text_of
from kneejax.statics import Status

#: A knee whose residual is larger does not agree with the record, N m.
_LARGE_NM = 5.0
_DIRECTIONS = ("anterior", "superior", "lateral")
_MOMENTS = ("adduction", "internal_rotation", "extension")


def activity_answer(
    title: str, found: Mapping[str, Activity], cycle: Cycle, *, rounds: Sequence[Round] = (),
    convention: str = FEMORAL,
) -> Answer:
    """A movement of knees, each with or without a ligament or a graft.

    Args:
        title: the knee and how its record is counted.
        found: what a knee is called -> its activity; the intact one first.
        cycle: of the record.
        rounds: of OpenSim and the knee, in their order.
        convention: of the poses.

    Returns:
        The answer; its tables are activity, forces, contact, residual and, of several knees,
        places, and of rounds, rounds.
    """
    first = next(iter(found.values()))
    record = first.record
    status = {name: with_flips(x.motion.status, x.mechanics) for name, x in found.items()}
    words = {name: _words(one) for name, one in found.items()}
    doubts = [*record.doubts]
    for name, one in found.items():
        places = faults.named_places([f"{x:.4g}" for x in record.time_s], "s")
        own = [*faults.status_doubts(status[name], words[name], *places), *_second(one)]
        own += [*_unexplained(one)]
        doubts += [f"{name}: {x.lstrip()}" if len(found) > 1 else x for x in own]
    tables = {"activity": _activity_table(found, status, words, cycle, convention),
              "forces": _of_knees(found, _ligament_table),
              "contact": _of_knees(found, _contact_table),
              "residual": _of_knees(found, _residual_table)}  # fmt: skip
    several, alone = len(found) > 2, len(found) == 1
    ranges, compared = _ranges(found), place_table(found)
    drawings = {"activity": Drawing(activity_figure, dict([*found.items()][:2]), cycle, title)}
    if several:
        tables["places"] = compared
        drawings["places"] = Drawing(places_figure, found, cycle, title)
    peaks = []
    for name, one in [*found.items()][:2]:
        times = np.round(record.time_s, 3)
        forces = pose_tables.peak_table(one.motion.knee, one.mechanics, times, "at time, s")
        peaks.append(dataclasses.replace(forces, title=f"Largest forces, {name}"))
    sections = [Section("Range of each coordinate", tables=[ranges] if not alone else []),
                Section("Largest forces", tables=peaks),
                Section("All coordinates and forces", drawings=["activity"] if several else [])]
    sections = [part for part in sections if part.tables or part.drawings]
    if rounds:
        tables["rounds"] = round_table(rounds)
        sections.append(Section("Rounds with OpenSim", tables=["rounds"]))
    time = record.time_s
    spoken = [f"{len(time)} instants from {time[0]:g} to {time[-1]:g} s"]
    if record.mass_kg:
        spoken.append(f"Leg below the knee: {record.mass_kg:.2f} kg.")
    spoken += record.notes
    shown = [compared] if several else [*[compared] * (not alone), ranges, *peaks]
    shown += [tables["rounds"]] if rounds else []
    lost = any((x != Status.BALANCED).any() for x in status.values())
    second = any(np.isfinite(one.other).all(axis=1).any() for one in found.values())
    return Answer(
        title=title, asked=f"What the recorded loads and muscles do to the knee at {spoken[0]}.",
        verdict=Verdict.DOUBTFUL if (record.doubts or second) and not lost else
        pose_tables.verdict_of(np.concatenate([*status.values()])),
        sentence=_sentence(found), tables=tables, main=[ranges if alone else compared],
        drawings=drawings, picture="places" if several else "activity", doubts=doubts,
        sections=[*sections, Section("The record", spoken)],
        text="\n".join([*spoken, text_of(*shown), *doubts]),
        exit_status=int(bool(record.doubts) or lost or second),
    )


def _words(one: Activity) -> tuple[str, ...]:
    """What is wrong at each instant, or known of another balance there."""
    here = np.asarray(one.motion.to_table())
    others = [faults.second_balance(other, own) if np.isfinite(other).all() else ""
              for other, own in zip(one.other, here, strict=True)]  # fmt: skip
    also = zip(faults.search_words(one.motion), others, strict=True)
    said = ["; ".join(filter(None, pair)) for pair in also]
    return faults.pose_words(one.motion.knee, one.mechanics, said)


def _second(one: Activity) -> Iterator[str]:
    """When a second stable balance is known, and what is reported then; nothing without one."""
    rows = np.flatnonzero(np.isfinite(one.other).all(axis=1))
    if not len(rows):
        return
    # Runs of instants, one after the other.
    runs = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    time = one.record.time_s
    spans = [f"{time[r[0]]:g}" + (f" to {time[r[-1]]:g}" if len(r) > 1 else "") for r in runs]
    yield (
        f"{listed(spans, 8)} s ({len(rows)} of {len(time)} instants): a second stable balance "
        "exists, and the loads alone do not decide between them: reported is that to which the "
        "path from the unloaded intact knee leads, cut while they act if it is; what the other is "
        "stands in the column doubt"
    )


def _residual(one: Activity) -> tuple[float, float]:
    """Moment that holds flexion, N m: root of the mean square, and the largest."""
    if not one.holds.any():
        return np.nan, np.nan
    moment = np.asarray(one.residual_Nm)
    return float(np.sqrt(np.nanmean(moment**2))), float(np.nanmax(np.abs(moment)))


def _unexplained(one: Activity) -> Iterator[str]:
    rms, most = _residual(one)
    if rms > _LARGE_NM:
        yield (
            f"flexion is held by a moment of {rms:.1f} N m rms, at most {most:.1f}: so much is not "
            "explained by muscles, ligaments, contact and what acts on the leg together"
        )


def _peak(values: np.ndarray) -> float:
    """The largest number; NaN where there is none."""
    return float(np.nanmax(values)) if np.isfinite(values).any() else np.nan


def _ranges(found: Mapping[str, Activity]) -> Table:
    """Least and most of each coordinate, and how far it is from the record's."""
    rows = []
    for name, one in found.items():
        table = np.asarray(one.motion.to_table())
        for k, which in enumerate(COORDINATES if one.holds.any() else ()):
            away = table[:, k] - one.record.pose[:, k]
            rms = np.sqrt(np.nanmean(away**2)) if one.record.same_frames and k else np.nan
            ends = np.nanmin(table[:, k]), np.nanmax(table[:, k])
            rows.append([name, coordinate(which).axis_label, *ends, rms])
        if one.holds.any():
            moment = np.asarray(one.residual_Nm)
            ends = np.nanmin(moment), np.nanmax(moment)
            rows.append([name, "Moment that holds flexion, N m", *ends, _residual(one)[0]])
    same = any(one.record.same_frames for one in found.values())
    columns = [
        Column("knee", words=True), Column("coordinate", " ", words=True),
        Column("least", show=".2f"), Column("most", show=".2f"),
        Column("rms", "rms from record" if same else "rms", ".2f"),
    ]  # fmt: skip
    return Table(columns, rows, note="Of the moment: rms of itself; nothing known to act holds it.")


def _sentence(found: Mapping[str, Activity]) -> str:
    first = next(iter(found.values()))
    if not first.holds.any():
        return "The intact knee has no equilibrium at any instant."
    contact = pose_tables.contact_forces(first.mechanics).sum(axis=1)
    row = int(np.nanargmax(contact))
    words = (
        f"All contacts together carry up to {contact[row]:.0f} N, at "
        f"{first.record.time_s[row]:.2f} s, in the intact knee."
    )
    tables = {name: np.asarray(one.motion.to_table()) for name, one in found.items()}
    intact = next(iter(tables.values()))
    for name, table in [*tables.items()][1:3]:
        away = np.abs(table - intact)[:, [3, 2]]
        if np.isfinite(away).any():
            far, turned = np.nanmax(away, axis=0)
            words += (
                f" {name[:1].upper()}{name[1:]}, the tibia is up to {far:.1f} mm (anterior) and "
                f"{turned:.1f} degrees (internal rotation) from it."
            )
    return words


def place_table(found: Mapping[str, Activity]) -> Table:
    """Peaks and distances from the intact knee, one row a knee: places.csv."""
    pulls = graft_pulls(found)
    tables = {name: np.asarray(one.motion.to_table()) for name, one in found.items()}
    intact, rows = next(iter(tables.values())), []
    for name, one in found.items():
        away = (tables[name] - intact)[:, [3, 2]]
        away = away[np.isfinite(away).all(axis=1)]
        rms = np.sqrt(np.mean(away**2, axis=0)) if len(away) else [np.nan, np.nan]
        peaks = [_peak(x) for x in (*pulls[name], pose_tables.contact_forces(one.mechanics))]
        torn = np.asarray(one.motion.status) == Status.OVERSTRETCHED
        rows.append([name, int(one.holds.sum()), int(torn.sum()), *peaks, *rms])
    columns = [
        Column("knee", words=True), Column("in_balance", show=str),
        Column("overstretched", show=str),
        Column("graft_peak_N", "ligament or graft, N", ".0f"),
        Column("graft_peak_strain", "strain, %", lambda x: f"{100 * x:.1f}" if x == x else NONE),
        Column("contact_peak_N", "contact, N", ".0f"),
        Column("anterior_rms_from_intact_mm", "forwards, mm", ".2f"),
        Column("internal_rotation_rms_from_intact_deg", "inwards, deg", ".2f"),
    ]  # fmt: skip
    note = (
        f"Of {len(next(iter(found.values())).holds)} instants. Peaks; forwards and inwards: rms "
        "distance of the tibia from that of the intact knee."
    )
    return Table(columns, rows, note=note)


def round_table(rounds: Sequence[Round]) -> Table:
    """How far the knee's secondary motion is off the one that OpenSim's model had: rounds.csv."""
    names = ("round", "coordinate", "residual_rms", "residual_largest", "left_by_splines_rms",
             "balanced_instants", "instants", "moment_Nm_rms", "reaction_N_rms")  # fmt: skip
    whole = ("round", "coordinate", "balanced_instants", "instants")
    rows = []
    for one in rounds:
        rms, largest = one.residual
        for k, name in enumerate(FREE_COORDINATES):
            rows.append([one.number, coordinate(name).column, rms[k], largest[k], one.left[k],
                         *one.holds, one.moment_Nm, one.reaction_N])  # fmt: skip
    columns = [Column(x, show=str if x in whole else ".2f", words=x == "coordinate")
               for x in names]  # fmt: skip
    note = "Of the knee from the motion that OpenSim's model had, root of the mean square and most."
    return Table(columns, rows, "Rounds with OpenSim", note)


def _activity_table(found: Mapping[str, Activity], status, words, cycle: Cycle, convention: str):
    """Poses of the knee and of the record, at each instant of each knee: activity.csv."""
    knee = next(iter(found.values())).motion.knee
    others = [x.column for body in knee.other_bones for x in BODIES[body].values()]
    extra = [] if convention == FEMORAL else ["convention"]
    header = ["knee", "time_s", "cycle_percent", *COLUMNS, *(f"record_{name}" for name in COLUMNS),
              *others, "quadriceps_N", "residual_flexion_Nm", "status", "doubt", *extra]
    # A record of no gait has no part of a cycle.
    percent = cycle.percent if cycle.is_gait else np.full(len(cycle.percent), np.nan)
    rows = []
    for name, one in found.items():
        poses = np.asarray(one.motion.to_table()), one.record.pose
        states = one.motion.equilibrium.state.poses
        numbers = np.column_stack(
            [one.record.time_s, percent, *(convert_table(x, FEMORAL, convention) for x in poses),
             *(np.asarray(states[body].to_table()) for body in knee.other_bones),
             one.record.quadriceps_N, one.residual_Nm]
        )  # fmt: skip
        for row, word, doubt in zip(numbers.tolist(), status[name], words[name], strict=True):
            rows.append([name, *row, Status(int(word)).word, doubt, *[convention] * len(extra)])
    return Table([Column(x) for x in header], rows)


def _of_knees(found: Mapping[str, Activity], table: Callable[[dict, Activity], Table]) -> Table:
    """One table of all knees, the knee in the first column."""
    made = []
    for name, one in found.items():
        time = one.record.time_s
        made.append(table({"knee": [name] * len(time), "time_s": time}, one))
    return Table(made[0].columns, [row for each in made for row in each.rows])


def _ligament_table(keys: dict, one: Activity) -> Table:
    names, told = one.motion.knee.ligaments.names, one.mechanics
    numbers = {"force_N": told.tension, "strain": told.strain}
    return pose_tables.part_table(keys, "ligament", names, numbers)


def _contact_table(keys: dict, one: Activity) -> Table:
    told, names = one.mechanics, one.motion.knee.contact_names
    numbers = {"force_N": pose_tables.contact_forces(told), "max_pressure_MPa": told.max_pressure,
               "area_mm2": told.area, tuple(f"center_{way}_mm" for way in _DIRECTIONS): told.center}
    return pose_tables.part_table(keys, "contact", names, numbers)


def _residual_table(keys: dict, one: Activity) -> Table:
    """What each part does to the tibia, and what all together leave over."""
    parts = {**one.acting, **one.held, "left over": one.left_over}
    names = [f"{x}_N" for x in _DIRECTIONS] + [f"{x}_Nmm" for x in _MOMENTS]
    numbers = {tuple(names): np.stack([*parts.values()], axis=1)}
    return pose_tables.part_table(keys, "part", [*parts], numbers)
