"""`kneejax simulate EXPERIMENT`."""

from __future__ import annotations

import argparse

from kneejax.cli._asked_knee import asked_knee, knee_words
from kneejax.cli._deliver import deliver
from kneejax.cli._dynamic_options import IN_TIME
from kneejax.cli._given import given, read_loads
from kneejax.cli._progress import stages_on_terminal
from kneejax.cli._test_options import EXTENSOR
from kneejax.experiments import branches, evaluate, passive_flexion
from kneejax.files import InputProblem, parse_flexion
from kneejax.mechanics import load_of
from kneejax.report import flexion_answer

#: Options of a test under load.
_OF_TESTS = (
    "force_N", "moment_Nm", "displacement_mm", "rotation_deg", "hold", "both", "counted_from",
    "steps",
)  # fmt: skip
#: Options of experiments in which the quadriceps pulls.
_OF_EXTENSOR = (
    "quadriceps_N", "quadriceps_mm", "body_kg", "height_m", "ankle_kg", "femur_deg",
)  # fmt: skip
#: Options of motions through time.
_OF_TIME = (
    "loads", "duration_s", "every_ms", "ramp_s", "critical", "damping_N_s_per_mm",
    "dissipation_s_per_mm", "recorded", "free", "offset",
    "error_mm",
)  # fmt: skip


def run(arguments: argparse.Namespace) -> int:
    """Move a knee through flexion or time, load it, or let its quadriceps pull."""
    if arguments.experiment in IN_TIME or arguments.dynamic:
        _refuse(arguments, _OF_EXTENSOR[:1], f"{' or '.join(EXTENSOR[:2])} with it")
        _refuse(arguments, _OF_EXTENSOR[1:2], "one at rest; in time --loads gives lengths")
        if arguments.experiment == "leg-raise":
            from kneejax.cli._raised_leg import run_raised_leg

            return run_raised_leg(arguments)
        if arguments.experiment in EXTENSOR:
            expected = "leg-raise, or a test under load"
            raise InputProblem("simulate", "--dynamic", arguments.experiment, expected)
        from kneejax.cli._in_time import run_in_time

        return run_in_time(arguments)
    _refuse(arguments, _OF_TIME, f"--dynamic, or {' or '.join(IN_TIME)}, with it")
    if arguments.experiment in EXTENSOR:
        _refuse(arguments, _OF_TESTS[:-1], "a test under load with it")
        _refuse(arguments, ("branches",), "passive-flexion with it")
        from kneejax.cli._extensor import run_extensor

        return run_extensor(arguments)
    _refuse(arguments, _OF_EXTENSOR, f"{', '.join(EXTENSOR)} with it")
    if arguments.experiment == "passive-flexion":
        return _passive_flexion(arguments)
    from kneejax.cli._laboratory import run_test

    return run_test(arguments)


def _refuse(arguments: argparse.Namespace, options: tuple[str, ...], expected: str) -> None:
    for option in options:
        if given(arguments, option):
            word = {"offset": "from"}.get(option, option)
            raise InputProblem("simulate", f"--{word}", arguments.experiment, expected)


def _passive_flexion(arguments: argparse.Namespace) -> int:
    """Bend a knee, with loads and without them, and look for other balances if asked."""
    _refuse(arguments, _OF_TESTS, "a test under load with it; passive-flexion takes --load")
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
