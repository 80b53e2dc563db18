"""`kneejax simulate EXPERIMENT`: flexion, tests under load, the quadriceps, motion in time."""

import contextlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np

from kneejax import experiments, files, mechanics
from kneejax.cli._command import option_name
from kneejax.cli._deliver import deliver
from kneejax.cli.options.simulate import EXTENSOR, SIZES, Simulate
from kneejax.dynamics import MovingKnee, gravity_of
from kneejax.files import InputProblem, parse_flexion, read_loads_over_time
from kneejax.geometry import COLUMNS, COORDINATES
from kneejax.inference.transients import Recorded, fit_transient
from kneejax.mechanics import LIMITS, NAMED_LOADS, RANGES, Knee, Range, load_of
from kneejax.numerics import WrongValue
from kneejax.parameters import cut
from kneejax.report.extensor import extensor_answer
from kneejax.report.flexion import flexion_answer
from kneejax.report.in_time import raised_leg_answer, transient_answer
from kneejax.report.laboratory import laboratory_answer
from kneejax.studies import stages_on_terminal

#: Farther than a limit a knee is dislocated.
_FARTHEST = {"displacement_mm": Range(0.0, LIMITS["anterior"], "mm"),
             "rotation_deg": Range(0.0, LIMITS["internal_rotation"], "deg")}
#: Of a leg that is raised by a motor: flexions at which it is also held.
_FLEXION = {"patellar-tracking": "0:120:5", "extension": "0:90:30", "leg-raise": "0:90:5"}
_PULL_N = {"patellar-tracking": 100.0, "extension": 1000.0}
_LONGER = Range(-20.0, 100.0, "mm")
#: Of a motion in time: flexion, duration and time between two rows; 30 degrees, 1 s and 1 ms else.
_BEGINS_DEG = {"settle": 20.0, "drop": 60.0, "lachman": 20.0}
_LASTS_S, _EVERY_MS = {"settle": 2.0, "leg-raise": 20.0}, {"leg-raise": 100.0}
_MOST_TIMES = 20_000
_LENGTH = "quadriceps_mm"
#: With which a search for dampers begins, where the options give none.
_FIRST = {"critical": 1.0, "damping_N_s_per_mm": 0.1, "dissipation_s_per_mm": 1e-3}


def run(arguments: Simulate) -> int:
    """Move a knee through flexion or time, load it, or let its quadriceps pull."""
    if arguments.in_time:
        raises = arguments.experiment == "leg-raise"
        return run_raised_leg(arguments) if raises else run_in_time(arguments)
    if arguments.experiment in EXTENSOR:
        return run_extensor(arguments)
    if arguments.experiment != "passive-flexion":
        return run_test(arguments)
    flexion = parse_flexion(arguments.flexion or "0:120:5")
    loads, (_, knee) = read_loads(arguments.load), asked_knees(arguments)
    acting = [load_of(**loads)] if loads else []
    with stages_on_terminal(knee.name):
        with experiments.evaluate_beside(knee):
            motion = experiments.passive_flexion(knee, flexion, acting)
        mechanics = experiments.evaluate(knee, motion.pose, motion.equilibrium.contact_points)
        answer = flexion_answer(
            knee_words(arguments, knee), motion, mechanics, flexion, loads=loads,
            unloaded=experiments.passive_flexion(knee, flexion) if loads else None,
            branches=experiments.branches(knee, flexion, acting) if arguments.branches else None,
            convention=arguments.convention)  # fmt: skip
    return deliver(answer, arguments)


def read_loads(given: Mapping[str, float]) -> dict[str, float]:
    """Loads on the tibia, as `kneejax.mechanics.NAMED_LOADS` has them: name -> size, zero where
    nothing was asked for, empty without any; refuses other names, and sizes out of range."""
    for name, size in given.items():
        if name not in NAMED_LOADS:
            known, meant = f"one of {', '.join(NAMED_LOADS)}", mechanics.load_opposite_to(name)
            near = f"{meant}={-size:g}" if meant else mechanics.load_called(name) or NAMED_LOADS
            raise InputProblem("--load", "name", name, known, near)
        _check_within("--load", name, size, RANGES[name])
    return {name: given.get(name, 0.0) for name in NAMED_LOADS} if given else {}


def _check_within(option: str, name: str, value: float, allowed: Range | None) -> None:
    if allowed is not None and not allowed.holds(value):
        raise InputProblem(option, name, f"{value:g}", allowed.expected(value))


def asked_knees(arguments: Simulate, *, patella: bool = False) -> tuple[Knee, Knee]:
    """The knee with the parameters that were set; and that in which what was cut does not act."""
    knee = files.load_knee(arguments.knee, patella=patella)
    with files.said_of("--set"):
        knee = knee.replace(arguments.values)
    return knee, cut(knee, arguments.cut)


def knee_words(arguments: Simulate, knee: Knee) -> str:
    """What a knee is called, with what was cut."""
    return knee.name + (f" without {', '.join(arguments.cut)}" if arguments.cut else "")


def run_test(arguments: Simulate) -> int:
    """Load a knee, print its laxity, write curves, laxity, poses, forces and two figures."""
    # Everything wrong with the test is known before a knee is read.
    name, loads = arguments.experiment, read_loads(arguments.load)
    given = {load: size for load, size in loads.items() if size}
    steps = 20 if arguments.steps is None else arguments.steps
    angles = None if arguments.flexion is None else parse_flexion(arguments.flexion)
    sizes = {key: size for key in SIZES if (size := getattr(arguments, key)) is not None}
    for key, size in sizes.items():
        _check_within(f"--{option_name(key)}", key, size, _FARTHEST.get(key))
    if name != "load":
        tests = experiments.lab_tests(name, angles, **sizes, held=arguments.hold,
                                      both=arguments.both, steps=steps, constant=given)  # fmt: skip
    elif not given:
        raise InputProblem("simulate", "--load", "load", "the load that grows, as NAME=SIZE")
    else:  # what --load says grows, observed where its first part works
        first = next(name for name in NAMED_LOADS if name in given)
        observed = next(x for x in NAMED_LOADS[first].also_called if x in COORDINATES)
        at = tuple(map(float, range(0, 91, 15) if angles is None else angles))
        path, held = experiments.load_cycle(steps, arguments.both), tuple(arguments.hold)
        full = {first: given[first], **given}
        tests = (experiments.LabTest("load", full, observed, at, path, held=held),)
    whole, knee = asked_knees(arguments)
    with stages_on_terminal(knee.name):
        from_intact = arguments.counted_from == "intact"
        with experiments.evaluate_beside(knee):
            curves = experiments.load_curves(knee, tests, whole if from_intact else None)
        mechanics = experiments.mechanics_of(curves[0])
        looked_at = curves if arguments.cut else ()
        others = [experiments.second_balances(one, whole) for one in looked_at]
        meniscectomy = any(x.partition(":")[0] in whole.menisci for x in arguments.cut)
        before = None
        if name == "compression" and meniscectomy:
            beside = experiments.load_curves(whole, tests)
            before = whole, beside, experiments.mechanics_of(beside[0])
    answer = laboratory_answer(knee_words(arguments, knee), knee, curves, mechanics, second=others,
                               bands=files.bundled_bands(arguments.cut),
                               convention=arguments.convention, intact=before)  # fmt: skip
    return deliver(answer, arguments)


def run_extensor(arguments: Simulate) -> int:
    """Pull, print forces and the patella, write tables and two figures."""
    name = arguments.experiment
    flexion = parse_flexion(arguments.flexion or _FLEXION[name])
    lengths, driven = arguments.quadriceps_mm, None
    if lengths is not None:  # how much longer than at rest
        lengths = files.parse_range(lengths, "--quadriceps-mm", "lengths", _LONGER, "length")
    loads = read_loads(arguments.load)
    (_, knee), acting = asked_knees(arguments, patella=True), [load_of(**loads)] if loads else []
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
    answer = extensor_answer(knee_words(arguments, knee), name, found, loads=loads, driven=driven)
    return deliver(answer, arguments)


def run_in_time(arguments: Simulate) -> int:
    """Move a knee through time, with dampers from a record where one is given."""
    name, flexion = arguments.experiment, _BEGINS_DEG.get(arguments.experiment, 30.0)
    if arguments.flexion is not None:
        angles = parse_flexion(arguments.flexion)
        if len(angles) != 1:
            raise InputProblem("--flexion", "flexion", arguments.flexion, "one angle through time")
        flexion = float(angles[0])
    load_s, sizes, led = _loads(arguments, flexion)
    times = load_s[0] + _times(arguments, None if arguments.loads is None else np.ptp(load_s))
    for column in arguments.offset:
        if column not in COLUMNS:
            raise InputProblem("--from", "name", column, COLUMNS)
    usual = {"anterior_mm": 3.0} if name == "settle" else {}
    motion = {"load_s": load_s, "sizes": sizes, "led": led, "offset": arguments.offset or usual,
              "flexion_is_free": name == "drop"}  # fmt: skip
    fit, recorded = None, arguments.recorded and _recorded(arguments.recorded, times[0])
    moving = _moving(arguments, asked_knees(arguments)[1])
    most_mm = arguments.error_mm or experiments.MOST_ERROR_MM
    if recorded is not None:
        first = {name: getattr(arguments, name) or _FIRST[name] for name in arguments.free}
        what = f"{', '.join(first)} from {len(recorded.time_s)} times"
        with stages_on_terminal(moving.knee.name) as show:
            first_s = float(recorded.time_s[0])
            start, loads, held = experiments.beginning(moving, flexion, first_s, **motion)
            fit = fit_transient(moving, start, recorded, first, loads=loads, held=held,
                                most_mm=most_mm,
                                progress=lambda done: show(what, done, done + 1))  # fmt: skip
        moving = fit.moving
    with _shown(moving, times) as progress:
        found = experiments.transient(moving, flexion, times, **motion, most_mm=most_mm,
                                      progress=progress)
    answer = transient_answer(knee_words(arguments, moving.knee), name, found, recorded=recorded,
                              fit=fit, convention=arguments.convention)  # fmt: skip
    return deliver(answer, arguments)


def _loads(arguments: Simulate, flexion: float):
    """Times, sizes of loads at these, and coordinates that are led."""
    name = arguments.experiment
    constant = {k: v for k, v in read_loads(arguments.load).items() if v}
    if arguments.loads is not None:
        load_s, sizes, led = read_loads_over_time(arguments.loads)
        both = set(constant).intersection(sizes)
        if both:
            raise InputProblem("simulate", "--load", min(both), "a load in --load or in --loads")
        sizes = {**{k: np.full_like(load_s, v) for k, v in constant.items()}, **sizes}
        return load_s, sizes, {column: (load_s, way) for column, way in led.items()}
    if name in ("settle", "drop"):
        return np.zeros(1), {k: np.full(1, v) for k, v in constant.items()}, {}
    full = constant
    if name != "load":
        asked = {k: v for k in SIZES[:2] if (v := getattr(arguments, k)) is not None}
        (test,) = experiments.lab_tests(name, [flexion], **asked, constant=constant)
        full = dict(test.full)
    ramp = 0.1 if arguments.ramp_s is None else arguments.ramp_s
    load_s = np.array([0.0, max(ramp, 1e-9)])
    sizes = {k: v * np.array([0.0, 1.0]) for k, v in full.items()}
    rest = {k: np.full(2, v) for k, v in constant.items() if k not in full}
    return load_s, {**sizes, **rest}, {}


def _times(arguments: Simulate, recorded_s: float | None) -> np.ndarray:
    """Rows of the tables, s: as asked for, or as long as a record, or as usual."""
    usual_s = _LASTS_S.get(arguments.experiment, 1.0) if recorded_s is None else recorded_s
    duration = arguments.duration_s or usual_s
    every = arguments.every_ms or _EVERY_MS.get(arguments.experiment, 1.0)
    count = round(duration / (1e-3 * every))
    if not 1 <= count <= _MOST_TIMES:
        expected = f"1 to {_MOST_TIMES} rows in {duration:g} s"
        raise InputProblem("--every-ms", "every_ms", f"{every:g}", expected)
    return np.linspace(0.0, duration, count + 1)


def _recorded(file: Path, start_s: float) -> Recorded:
    """A record that begins with the motion."""
    time_s, loads, seen = read_loads_over_time(file, COLUMNS[1:])
    if loads or not seen:
        expected = f"some of {', '.join(COLUMNS[1:])}; loads stand in --loads"
        raise InputProblem(file, "header", min(loads, default="time_s alone"), expected)
    if abs(time_s[0] - start_s) > 1e-9:
        expected = f"{start_s:g}, where the motion begins"
        raise InputProblem(file, "row 1, time_s", f"{time_s[0]:g}", expected)
    return Recorded.of_table(time_s, seen)


@contextlib.contextmanager
def _shown(moving: MovingKnee, times: np.ndarray) -> Iterator[Callable[[int], None]]:
    """A line on the terminal, where steps stand for the time."""
    what, count = f"{times[-1] - times[0]:g} s of motion", len(times)
    with stages_on_terminal(moving.knee.name) as show:
        yield lambda done: show(what, done, max(done, count))


def _moving(arguments: Simulate, knee: Knee) -> MovingKnee:
    """With the mass of a person's leg, gravity where a thigh has an attitude, and damping."""
    attitude = arguments.femur_deg
    if attitude is None and arguments.experiment in ("drop", "leg-raise"):
        attitude = 0.0
    gravity = (0.0, 0.0, 0.0) if attitude is None else gravity_of(attitude)
    part, everywhere = arguments.critical, arguments.damping_N_s_per_mm
    if everywhere is None:
        everywhere = 1.0 if arguments.experiment == "settle" else 0.0
    pressed = arguments.dissipation_s_per_mm
    contacts = dict.fromkeys(knee.contact_names, pressed) if pressed else {}
    leg = experiments.leg_of_person(**arguments.person)
    moving = MovingKnee.of(knee, leg, gravity_m_s2=gravity, contact_dissipation=contacts)
    return moving.critically_damped(1.0 if part is None else part).damped_everywhere(everywhere)


def run_raised_leg(arguments: Simulate) -> int:
    """Raise the leg, and compare it with one that is held at each flexion."""
    flexion = np.sort(parse_flexion(arguments.flexion or _FLEXION["leg-raise"]))[::-1]
    if len(flexion) < 4:
        expected = "four angles at least, at which the leg is also held, as 0:90:5"
        raise InputProblem("--flexion", "flexion", arguments.flexion, expected)
    lengths, file = None, arguments.loads
    if file is not None:  # of the quadriceps, over times that begin at 0
        read_s, loads, ways = read_loads_over_time(file, (_LENGTH,))
        if loads or _LENGTH not in ways:
            raise InputProblem(str(file), "header", ", ".join(loads), f"time_s, {_LENGTH}")
        lengths = read_s - read_s[0], ways[_LENGTH]
    times = _times(arguments, None if lengths is None else lengths[0][-1])
    moving = _moving(arguments, asked_knees(arguments, patella=True)[1])
    with _shown(moving, times) as progress:
        found = experiments.raised_leg(moving, flexion, times, lengths=lengths, progress=progress,
                                       most_mm=arguments.error_mm or experiments.MOST_ERROR_MM)
    knee = knee_words(arguments, moving.knee)
    return deliver(raised_leg_answer(knee, found, arguments.convention), arguments)
