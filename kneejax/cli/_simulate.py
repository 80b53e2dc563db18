"""`kneejax simulate EXPERIMENT`: passive flexion, tests under load, and the quadriceps' pull."""

from __future__ import annotations

import numpy as np

from kneejax import experiments
from kneejax.cli._command import option_name
from kneejax.cli._deliver import deliver
from kneejax.cli._given import asked_knee, check_within, knee_words, read_loads, whole_knee
from kneejax.cli.options import EXTENSOR, Simulate
from kneejax.files import InputProblem, bundled_bands, parse_flexion, parse_range
from kneejax.geometry import COORDINATES
from kneejax.mechanics import LIMITS, NAMED_LOADS, Range, load_of
from kneejax.numerics import WrongValue
from kneejax.parameters import cut
from kneejax.report import extensor_answer, flexion_answer, laboratory_answer
from kneejax.studies import stages_on_terminal

#: Sizes of a test. Farther than a limit a knee is dislocated.
_SIZES = ("force_N", "moment_Nm", "displacement_mm", "rotation_deg")
_FARTHEST = {
    "displacement_mm": Range(0.0, LIMITS["anterior"], "mm"),
    "rotation_deg": Range(0.0, LIMITS["internal_rotation"], "deg"),
}
_FLEXION = {"patellar-tracking": "0:120:5", "extension": "0:90:30", "leg-raise": "0:90:5"}
_PULL_N = {"patellar-tracking": 100.0, "extension": 1000.0}
_LONGER = Range(-20.0, 100.0, "mm")


def run(arguments: Simulate) -> int:
    """Move a knee through flexion or time, load it, or let its quadriceps pull."""
    if arguments.in_time:
        from kneejax.cli._in_time import run_in_time, run_raised_leg

        raises = arguments.experiment == "leg-raise"
        return run_raised_leg(arguments) if raises else run_in_time(arguments)
    if arguments.experiment in EXTENSOR:
        return run_extensor(arguments)
    if arguments.experiment != "passive-flexion":
        return run_test(arguments)
    flexion = parse_flexion(arguments.flexion or "0:120:5")
    loads, knee = read_loads(arguments.load), asked_knee(arguments)
    acting = [load_of(**loads)] if loads else []
    with stages_on_terminal(knee.name):
        motion = experiments.passive_flexion(knee, flexion, acting)
        mechanics = experiments.evaluate(knee, motion.pose, motion.equilibrium.contact_points)
        answer = flexion_answer(
            knee_words(arguments, knee), motion, mechanics, flexion, loads=loads,
            unloaded=experiments.passive_flexion(knee, flexion) if loads else None,
            branches=experiments.branches(knee, flexion, acting) if arguments.branches else None,
            convention=arguments.convention,
        )  # fmt: skip
    return deliver(answer, arguments)


def run_test(arguments: Simulate) -> int:
    """Load a knee, print its laxity, write curves, laxity, poses, forces and two figures."""
    # Everything wrong with the test is known before a knee is read.
    name, loads = arguments.experiment, read_loads(arguments.load)
    given = {load: size for load, size in loads.items() if size}
    steps = 20 if arguments.steps is None else arguments.steps
    angles = None if arguments.flexion is None else parse_flexion(arguments.flexion)
    sizes = {key: size for key in _SIZES if (size := getattr(arguments, key)) is not None}
    for key, size in sizes.items():
        check_within(f"--{option_name(key)}", key, size, _FARTHEST.get(key))
    if name != "load":
        tests = experiments.lab_tests(
            name, angles, **sizes, held=arguments.hold, both=arguments.both, steps=steps,
            constant=given,
        )  # fmt: skip
    elif not given:
        raise InputProblem("simulate", "--load", "load", "the load that grows, as NAME=SIZE")
    else:  # what --load says grows, observed where its first part works
        first = next(name for name in NAMED_LOADS if name in given)
        observed = next(x for x in NAMED_LOADS[first].also_called if x in COORDINATES)
        at = tuple(map(float, range(0, 91, 15) if angles is None else angles))
        path, held = experiments.load_cycle(steps, arguments.both), tuple(arguments.hold)
        full = {first: given[first], **given}
        tests = (experiments.LabTest("load", full, observed, at, path, held=held),)
    whole = whole_knee(arguments)
    knee = cut(whole, arguments.cut)
    with stages_on_terminal(knee.name):
        from_intact = arguments.counted_from == "intact"
        curves = experiments.load_curves(knee, tests, whole if from_intact else None)
        mechanics = experiments.mechanics_of(curves[0])
        looked_at = curves if arguments.cut else ()
        others = [experiments.second_balances(one, whole) for one in looked_at]
        meniscectomy = any(x.partition(":")[0] in whole.menisci for x in arguments.cut)
        before = None
        if name == "compression" and meniscectomy:
            beside = experiments.load_curves(whole, tests)
            before = whole, beside, experiments.mechanics_of(beside[0])
    answer = laboratory_answer(
        knee_words(arguments, knee), knee, curves, mechanics, second=others,
        bands=bundled_bands(arguments.cut), convention=arguments.convention, intact=before,
    )  # fmt: skip
    return deliver(answer, arguments)


def run_extensor(arguments: Simulate) -> int:
    """Pull, print forces and the patella, write tables and two figures."""
    name = arguments.experiment
    flexion = parse_flexion(arguments.flexion or _FLEXION[name])
    lengths, driven = arguments.quadriceps_mm, None
    if lengths is not None:  # how much longer than at rest
        lengths = parse_range(lengths, "--quadriceps-mm", "lengths", _LONGER, "length")
    loads = read_loads(arguments.load)
    knee, acting = asked_knee(arguments, patella=True), [load_of(**loads)] if loads else []
    shank = experiments.Shank.of_person(**arguments.person, femur_deg=arguments.femur_deg or 0.0)
    pull, steps = arguments.quadriceps_N or _PULL_N.get(name, 0.0), arguments.steps or 20
    with stages_on_terminal(knee.name):
        if lengths is not None and name == "extension":
            driven = experiments.extension_by_length(knee, flexion, lengths, acting)
        elif lengths is not None:
            try:
                driven = experiments.leg_raise_by_length(knee, lengths, shank)
            except WrongValue as wrong:
                place = ("--quadriceps-mm", "lengths")
                raise InputProblem(*place, wrong.found, wrong.expected) from None
        if driven is not None:
            found = driven.found
        elif name == "leg-raise":
            found = experiments.leg_raise(knee, flexion, shank)
        elif name == "patellar-tracking":
            found = experiments.patellar_tracking(knee, flexion, pull, acting)
        else:
            pulls = pull * np.arange(1, steps + 1) / steps
            found = experiments.isometric_extension(knee, flexion, pulls, acting)
    words = knee_words(arguments, knee)
    return deliver(extensor_answer(words, name, found, loads=loads, driven=driven), arguments)
