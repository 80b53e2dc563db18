"""`kneejax activity`: what a recorded movement does to a knee."""

from __future__ import annotations

from kneejax.cli import options
from kneejax.cli._deliver import deliver
from kneejax.cli._outer_rounds import asked_of_opensim, movement_of
from kneejax.cli._progress import stages_on_terminal
from kneejax.experiments import Activity, Round, activity, cycle_of
from kneejax.files import (
    InputProblem,
    WholeBody,
    knee_with,
    load_knee_file,
    read_activity,
)
from kneejax.mechanics import Knee, LegRecord
from kneejax.parameters import cut
from kneejax.planning import AclPlan, intact_knee, operated_knees
from kneejax.report import activity_answer
from kneejax.studies import read_plan

INTACT = "intact"
#: The knee where none is named.
_USUAL = "lenhart2015_reduced"


def run(arguments: options.Activity) -> int:
    """Read what acted on the leg, and find the equilibria of each knee under it."""
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
    with stages_on_terminal(knee.name) as show:
        knees = knees if plan is None else operated_knees(plan)
        found: dict[str, Activity] = {}
        for name, one in knees.items():
            show(f"{knee.name}, {name}", 0, 0)
            found[name] = activity(one, record, near=found.get(INTACT))
    cycle = cycle_of(record)
    title = f"{knee.name}: {cycle.words}" + (", with patella" if arguments.patella else "")
    answer = activity_answer(title, found, cycle, rounds=rounds, convention=arguments.convention)
    return deliver(answer, arguments, ["opensim/"] if arguments.motion is not None else [])


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
