"""`kneejax simulate TEST`: a knee under loads that grow."""

from __future__ import annotations

from kneejax.cli._asked_knee import knee_words, whole_knee
from kneejax.cli._command import option_name
from kneejax.cli._deliver import deliver
from kneejax.cli._given import check_within, read_loads, refused
from kneejax.cli._progress import stages_on_terminal
from kneejax.cli.options import Simulate
from kneejax.experiments import (
    LabTest,
    lab_tests,
    load_curves,
    load_cycle,
    mechanics_of,
    second_balances,
)
from kneejax.files import InputProblem, bundled_bands, parse_flexion
from kneejax.geometry import COORDINATES
from kneejax.mechanics import LIMITS, NAMED_LOADS, Range
from kneejax.numerics import WrongValue
from kneejax.parameters import cut
from kneejax.report import laboratory_answer

#: Sizes of a test. Farther than a limit a knee is dislocated.
_SIZES = ("force_N", "moment_Nm", "displacement_mm", "rotation_deg")
_FARTHEST = {
    "displacement_mm": Range(0.0, LIMITS["anterior"], "mm"),
    "rotation_deg": Range(0.0, LIMITS["internal_rotation"], "deg"),
}


def run_test(arguments: Simulate) -> int:
    """Load a knee, print its laxity, write curves, laxity, poses, forces and two figures."""
    tests = _tests(arguments)
    from_intact = arguments.counted_from == "intact"
    whole = whole_knee(arguments)
    knee = cut(whole, arguments.cut)
    with stages_on_terminal(knee.name):
        curves = load_curves(knee, tests, whole if from_intact else None)
        mechanics = mechanics_of(curves[0])
        others = [second_balances(one, whole) for one in curves] if arguments.cut else []
    answer = laboratory_answer(
        knee_words(arguments, knee), knee, curves, mechanics, second=others,
        bands=bundled_bands(arguments.cut), convention=arguments.convention,
    )  # fmt: skip
    return deliver(answer, arguments)


def _tests(arguments: Simulate) -> tuple[LabTest, ...]:
    """What is asked for; everything wrong with it is said before a knee is read."""
    name, loads = arguments.experiment, read_loads(arguments.load)
    given = {load: size for load, size in loads.items() if size}
    steps = 20 if arguments.steps is None else arguments.steps
    angles = None if arguments.flexion is None else parse_flexion(arguments.flexion)
    sizes = {key: getattr(arguments, key) for key in _SIZES}
    asked = {key: size for key, size in sizes.items() if size is not None}
    for key, size in asked.items():
        check_within(f"--{option_name(key)}", key, [size], _FARTHEST.get(key))
    if name == "load":
        path = load_cycle(steps, arguments.both)
        return (_wrench(given, angles, path, tuple(arguments.hold)),)
    try:
        return lab_tests(
            name, angles, **asked, held=arguments.hold, both=arguments.both, steps=steps,
            constant=given,
        )  # fmt: skip
    except WrongValue as problem:
        raise refused(f"simulate {name}", problem) from None


def _wrench(given, angles, path, held) -> LabTest:
    """The test `load`: what `--load` says grows, observed where its first part works."""
    if not given:
        raise InputProblem("simulate", "--load", "load", "the load that grows, as NAME=SIZE")
    first = next(name for name in NAMED_LOADS if name in given)
    observed = next(x for x in NAMED_LOADS[first].also_called if x in COORDINATES)
    flexion = range(0, 91, 15) if angles is None else angles
    ordered = {first: given[first], **given}
    try:
        angles = tuple(float(x) for x in flexion)
        return LabTest("load", ordered, observed, angles, path, held=held)
    except WrongValue as problem:
        raise refused("simulate load", problem) from None
