"""An activity that was recorded or computed, and rounds between the knee and OpenSim."""

import dataclasses
from typing import Any

import numpy as np

from kneejax import files
from kneejax._whole_files import writing_place
from kneejax.cli._deliver import deliver
from kneejax.cli._words import SIDES
from kneejax.cli.options import knees as options
from kneejax.experiments import Activity, Round, activity, cycle_of, weights
from kneejax.geometry import TIBIA, Pose, State
from kneejax.mechanics import Knee, LegRecord
from kneejax.parameters import cut
from kneejax.planning import intact_knee, operated_knees
from kneejax.report.activity import activity_answer
from kneejax.studies import read_plan, stages_on_terminal

INTACT = "intact"
#: The knee where none is named.
_USUAL = "lenhart2015_reduced"


def asked_of_opensim(
    arguments: options.Activity, body: "files.WholeBody", knee: Knee, document: dict[str, Any], show
) -> tuple[LegRecord, list[Round]]:
    """What acts on the leg as OpenSim finds it, in the last of the rounds in which the knee's
    secondary motion goes back into the model; and these rounds, if any were asked for."""
    shifts = files.registered(body.model, body.side, knee, document, arguments.frames, body.bones)
    known = {"side": body.side, "knee": knee, "frames": shifts, "femur": body.bones[0],
             "tibia": body.bones[1]}  # fmt: skip
    rounds, model, motion = [], body.model, None  # the model's own motion, to begin with
    for number in range(arguments.rounds + 1):
        show(f"OpenSim, round {number}" if arguments.rounds else "OpenSim", 0, 0)
        own = f"round_{number}" if arguments.rounds else ""
        folder = writing_place(arguments.out / "opensim" / own)
        if motion is not None:
            model = folder / body.model.name
            data = files.couple_model(body.model, body.side, motion, shifts, body.bones)
            files.write_bytes(model, data)
        said = files.ask_opensim(body, folder, model)
        # Where no ground is given, the feet's own contacts are among the forces. The instants are
        # those of static optimisation, between which nothing is known.
        forces = [said.forces, *([] if body.loads is None else [body.loads])]
        record = files.read_activity(model, [body.motion, *forces], **known)
        if not arguments.rounds:
            break
        show(f"{knee.name}, round {number}", 0, 0)
        one = activity(knee, record)
        poses, file = np.asarray(one.motion.to_table())[one.holds], str(arguments.motion)
        if not len(poses):
            expected = "a movement under which the knee balances, for its motion to go back"
            raise files.InputProblem(file, "balances", f"none of {len(one.holds)}", expected)
        before = files.coupled_motion(record.pose) if motion is None else motion
        after = files.coupled_motion(poses, file, before.flexion_deg)
        off = float("nan")
        if body.loads is not None and not record.quadriceps_N.any():
            theirs = files.read_activity(model, [body.motion, said.reactions], **known)
            off = _reaction_off(record, theirs)
        moment = float(np.sqrt(np.nanmean(one.residual_Nm**2)))
        holds = int(one.holds.sum()), len(one.holds)
        secondary = before.secondary, after.secondary
        rounds.append(Round(number, after.flexion_deg, *secondary, after.rms, holds, moment, off))
        part = before.secondary + weights(rounds)[-1] * rounds[-1].change
        motion = dataclasses.replace(after, secondary=part)
    return record, rounds


def _reaction_off(record: LegRecord, theirs: LegRecord) -> float:
    """By how much OpenSim's joint reaction differs from the sum of what was read, rms, N."""
    state = State({TIBIA: Pose.from_table(record.pose)})
    pulls = np.asarray(record.muscles.on_tibia(state)).sum(axis=0).T
    ours = sum(record.acting.values(), pulls)[:, :3]
    there = theirs.acting["joint reaction"][:, :3]
    same = np.stack([np.interp(record.time_s, theirs.time_s, x) for x in there.T], axis=1)
    return float(np.sqrt(np.mean(np.sum((ours - same) ** 2, axis=1))))


def run(arguments: options.Activity) -> int:
    """Read what acted on the leg, and find the equilibria of each knee under it."""
    known = {"side": arguments.side, "instants": arguments.instants, "femur": arguments.femur,
             "tibia": arguments.tibia}  # fmt: skip
    body = None if arguments.motion is None else files.whole_body(
        arguments.model, arguments.motion, arguments.grf, actuators=arguments.actuators,
        time_s=arguments.time_s, **known)  # fmt: skip
    plan = None if arguments.plan is None else read_plan(arguments.plan, patella=arguments.patella)
    if plan is None:
        read = files.load_knee_file(arguments.knee or _USUAL)
        knee, document = read.with_patella() if arguments.patella else read.knee, read.document
        with files.said_of("--set"):
            knee = knee.replace(arguments.values)
    else:
        knee, document = intact_knee(plan), plan.document
    if document["side"] != SIDES[arguments.side]:
        expected = f"{document['side'][0]}, the side of the knee {knee.name}"
        raise files.InputProblem("--side", "side", arguments.side, expected)
    knees = {INTACT: knee}
    if arguments.cut:
        knees[f"without {', '.join(arguments.cut)}"] = cut(knee, arguments.cut)
    if body is None:
        record, rounds = files.read_activity(arguments.model, arguments.files, knee=knee,
                                             document=document, frames=arguments.frames,
                                             called=arguments.called, **known), []  # fmt: skip
    else:
        with stages_on_terminal("OpenSim") as show:
            record, rounds = asked_of_opensim(arguments, body, knee, document, show)
    if record.quadriceps_N.any() and not knee.other_bones and not knee.lines:
        expected = "a knee with a line for the patellar tendon, or --patella"
        raise files.InputProblem("--knee", "lines", f"none in {knee.name}", expected)
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
