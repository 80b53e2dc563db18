"""`kneejax activity`: what a recorded movement does to a knee."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from kneejax.cli import options
from kneejax.cli._outer_rounds import asked_of_opensim, movement_of
from kneejax.cli._progress import stages_on_terminal
from kneejax.cli._say_status import say_status
from kneejax.experiments import Activity, Cycle, Round, activity, cycle_of, with_flips
from kneejax.files import (
    InputProblem,
    WholeBody,
    knee_with,
    load_knee_file,
    read_activity,
    write_rows,
)
from kneejax.geometry import BODIES, COLUMNS, FEMORAL, convert_table
from kneejax.mechanics import Knee, LegRecord
from kneejax.parameters import cut
from kneejax.planning import AclPlan, intact_knee, operated_knees
from kneejax.report import pose_words, search_words, second_lines, second_words
from kneejax.statics import Status
from kneejax.studies import read_plan

INTACT = "intact"
#: The knee where none is named.
_USUAL = "lenhart2015_reduced"


def run(arguments: options.Activity) -> int:
    """Read, balance, print; write tables and a figure."""
    body = movement_of(arguments)
    plan = _plan(arguments)
    if plan is None:
        read = load_knee_file(arguments.knee or _USUAL)
        document = read.document
        whole = read.with_patella() if arguments.patella else read.knee
        knee = knee_with(whole, arguments.values, "--set")
    else:
        knee, document = intact_knee(plan), plan.document
    if document["side"] != {"r": "right", "l": "left"}[arguments.side]:
        expected = f"{document['side'][0]}, the side of the knee {knee.name}"
        raise InputProblem("--side", "side", arguments.side, expected)
    knees = {INTACT: knee}
    if arguments.cut:
        knees[f"without {', '.join(arguments.cut)}"] = cut(knee, arguments.cut)
    record, rounds = _record(arguments, body, knee, document)
    _check_pulls(knee, record)
    _say_record(record)
    with stages_on_terminal(knee.name) as show:
        knees = knees if plan is None else operated_knees(plan)
        found: dict[str, Activity] = {}
        for name, one in knees.items():
            show(f"{knee.name}, {name}", 0, 0)
            found[name] = activity(one, record, near=found.get(INTACT))
    return _report(arguments, found, cycle_of(record), rounds)


def _record(
    arguments: options.Activity, body: WholeBody | None, knee: Knee, document
) -> tuple[LegRecord, list[Round]]:
    """What acted on the leg: as it was recorded, or as OpenSim finds it."""
    if body is not None:
        with stages_on_terminal("OpenSim") as show:
            return asked_of_opensim(arguments, body, knee, document, show)
    record = read_activity(
        arguments.model, arguments.files, side=arguments.side, knee=knee, document=document,
        frames=arguments.frames, instants=arguments.instants, femur=arguments.femur,
        tibia=arguments.tibia,
    )  # fmt: skip
    return record, []


def _plan(arguments: options.Activity) -> AclPlan | None:
    """The plan that is asked for, if one is."""
    if arguments.plan is None:
        return None
    return read_plan(arguments.plan, patella=arguments.patella)


def _check_pulls(knee: Knee, record: LegRecord) -> None:
    if record.quadriceps_N.any() and not knee.other_bones and not knee.lines:
        expected = "a knee with a line for the patellar tendon, or --patella"
        raise InputProblem("--knee", "lines", f"none in {knee.name}", expected)


def _say_record(record: LegRecord) -> None:
    time = record.time_s
    print(f"{len(time)} instants from {time[0]:g} to {time[-1]:g} s")
    if record.mass_kg:
        print(f"Leg below the knee: {record.mass_kg:.2f} kg.")
    print("\n".join([*record.notes, *(f"doubtful: {doubt}" for doubt in record.doubts)]))


def _report(
    arguments: options.Activity, found: Mapping[str, Activity], cycle: Cycle, rounds: list[Round]
) -> int:
    from kneejax.report import (
        PLACE_COLUMNS,
        ROUND_COLUMNS,
        activity_figure,
        activity_lines,
        place_lines,
        place_rows,
        places_figure,
        round_lines,
        round_rows,
        save_figure,
    )

    out, first = arguments.out, found[INTACT]
    knee = first.motion.knee
    told = {name: _told(one) for name, one in found.items()}
    several = len(found) > 2
    print("\n".join(place_lines(found) if several else activity_lines(found)))
    doubtful = bool(first.record.doubts)
    for name, (status, said) in told.items():
        if len(found) > 1:
            print(f"{name}:")
        places = [f"{x:g}" for x in first.record.time_s]
        doubtful |= say_status(status, places, "s", said, given=False)
        for line in second_lines(found[name]):
            print(line)
            doubtful = True
    _write_motion(arguments, found, told, cycle)
    names = [f"{way}_N" for way in ("anterior", "superior", "lateral")]
    names += [f"{way}_Nmm" for way in ("adduction", "internal_rotation", "extension")]
    write_rows(out / "forces.csv", ["knee", "time_s", "ligament", "force_N", "strain"],
               _ligaments(found))  # fmt: skip
    columns = ["contact", "force_N", "max_pressure_MPa", "area_mm2"]
    columns += [f"center_{way}_mm" for way in ("anterior", "superior", "lateral")]
    write_rows(out / "contact.csv", ["knee", "time_s", *columns], _contacts(found))
    write_rows(out / "residual.csv", ["knee", "time_s", "part", *names], _balance(found))
    words = f"{knee.name}: {cycle.words}" + (", with patella" if arguments.patella else "")
    folder = out / "figures"
    folder.mkdir(parents=True, exist_ok=True)
    figure = activity_figure(dict([*found.items()][:2]), cycle, words)
    save_figure(figure, folder, "activity", svg=arguments.svg)
    more = ""
    if several:
        write_rows(out / "places.csv", PLACE_COLUMNS, place_rows(found))
        save_figure(places_figure(found, cycle, words), folder, "places", svg=arguments.svg)
        more = ", places.csv, figures/places.png"
    if rounds:
        print("\n".join(round_lines(rounds)))
        write_rows(out / "rounds.csv", ROUND_COLUMNS, round_rows(rounds))
        more += ", rounds.csv"
    more += ", opensim/" if arguments.motion is not None else ""
    files = "activity.csv, forces.csv, contact.csv, residual.csv, settings.json"
    print(f"written: {out}/{files}, figures/activity.png{more}")
    return int(doubtful)


def _told(one: Activity) -> tuple[np.ndarray, tuple[str, ...]]:
    status = with_flips(one.motion.status, one.mechanics)
    also = zip(search_words(one.motion), second_words(one), strict=True)
    said = ["; ".join(filter(None, pair)) for pair in also]
    return status, pose_words(one.motion.knee, one.mechanics, said)


def _write_motion(arguments, found: Mapping[str, Activity], told, cycle: Cycle) -> None:
    header = ["knee", "time_s", "cycle_percent", *COLUMNS]
    header += [f"record_{name}" for name in COLUMNS]
    knee = found[INTACT].motion.knee
    others = [x for body in knee.other_bones for x in BODIES[body].values()]
    header += [one.column for one in others]
    header += ["quadriceps_N", "residual_flexion_Nm", "status", "doubt"]
    other = arguments.convention != FEMORAL
    # A record of no gait has no part of a cycle.
    percent = cycle.percent if cycle.is_gait else np.full(len(cycle.percent), np.nan)
    rows = []
    for name, one in found.items():
        status, said = told[name]
        pose = np.asarray(one.motion.to_table())
        tables = [convert_table(x, FEMORAL, arguments.convention) for x in (pose, one.record.pose)]
        states = one.motion.equilibrium.state.poses
        tables += [np.asarray(states[body].to_table()) for body in knee.other_bones]
        numbers = np.column_stack(
            [one.record.time_s, percent, *tables, one.record.quadriceps_N, one.residual_Nm]
        )  # fmt: skip
        for row, word, doubt in zip(numbers.tolist(), status, said, strict=True):
            more = [arguments.convention] if other else []
            rows.append([name, *row, Status(int(word)).word, doubt, *more])
    write_rows(arguments.out / "activity.csv", header + ["convention"] * other, rows)


def _ligaments(found: Mapping[str, Activity]) -> Iterator[list]:
    for name, one in found.items():
        force, strain = (np.asarray(x) for x in (one.mechanics.tension, one.mechanics.strain))
        for i, time in enumerate(one.record.time_s):
            for j, ligament in enumerate(one.motion.knee.ligaments.names):
                yield [name, time, ligament, force[i, j], strain[i, j]]


def _contacts(found: Mapping[str, Activity]) -> Iterator[list]:
    for name, one in found.items():
        force = np.linalg.norm(np.asarray(one.mechanics.contact_force), axis=-1)
        peak, area = (np.asarray(x) for x in (one.mechanics.max_pressure, one.mechanics.area))
        center = np.asarray(one.mechanics.center)
        for i, time in enumerate(one.record.time_s):
            for j, contact in enumerate(one.motion.knee.contact_names):
                sizes = force[i, j], peak[i, j], area[i, j]
                yield [name, time, contact, *sizes, *center[i, j]]


def _balance(found: Mapping[str, Activity]) -> Iterator[list]:
    for name, one in found.items():
        parts = {**one.acting, **one.held, "left over": one.left_over}
        for i, time in enumerate(one.record.time_s):
            for part, wrench in parts.items():
                yield [name, time, part, *wrench[i]]
