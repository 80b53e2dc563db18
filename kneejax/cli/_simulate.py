"""`kneejax simulate EXPERIMENT`."""

from __future__ import annotations

from kneejax.cli._asked_knee import asked_knee, knee_words
from kneejax.cli._deliver import deliver
from kneejax.cli._given import read_loads
from kneejax.cli._progress import stages_on_terminal
from kneejax.cli.options import EXTENSOR, Simulate
from kneejax.experiments import branches, evaluate, passive_flexion
from kneejax.files import parse_flexion
from kneejax.mechanics import load_of
from kneejax.report import flexion_answer


def run(arguments: Simulate) -> int:
    """Move a knee through flexion or time, load it, or let its quadriceps pull."""
    if arguments.in_time and arguments.experiment == "leg-raise":
        from kneejax.cli._raised_leg import run_raised_leg

        return run_raised_leg(arguments)
    if arguments.in_time:
        from kneejax.cli._in_time import run_in_time

        return run_in_time(arguments)
    if arguments.experiment in EXTENSOR:
        from kneejax.cli._extensor import run_extensor

        return run_extensor(arguments)
    if arguments.experiment == "passive-flexion":
        return _passive_flexion(arguments)
    from kneejax.cli._laboratory import run_test

    return run_test(arguments)


def _passive_flexion(arguments: Simulate) -> int:
    """Bend a knee, with loads and without them, and look for other balances if asked."""
    flexion = parse_flexion(arguments.flexion or "0:120:5")
    loads, knee = read_loads(arguments.load), asked_knee(arguments)
    acting = [load_of(**loads)] if loads else []
    with stages_on_terminal(knee.name):
        motion = passive_flexion(knee, flexion, acting)
        mechanics = evaluate(knee, motion.pose, motion.equilibrium.contact_points)
        answer = flexion_answer(
            knee_words(arguments, knee), motion, mechanics, flexion, loads=loads,
            unloaded=passive_flexion(knee, flexion) if loads else None,
            branches=branches(knee, flexion, acting) if arguments.branches else None,
            convention=arguments.convention,
        )  # fmt: skip
    return deliver(answer, arguments)
