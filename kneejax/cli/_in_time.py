"""`kneejax simulate settle | drop`, and `--dynamic`: mass, damping, time; dampers of a record."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from kneejax.cli._deliver import deliver
from kneejax.cli._given import asked_knee, knee_words, read_loads
from kneejax.cli.options import Simulate
from kneejax.dynamics import MovingKnee, gravity_of
from kneejax.experiments import (
    MOST_ERROR_MM,
    beginning,
    lab_tests,
    leg_of_person,
    raised_leg,
    transient,
)
from kneejax.files import InputProblem, parse_flexion, read_loads_over_time
from kneejax.geometry import COLUMNS
from kneejax.inference.transients import FittedTransient, Recorded, fit_transient
from kneejax.mechanics import Knee
from kneejax.report import raised_leg_answer, transient_answer
from kneejax.studies import stages_on_terminal

_FLEXION = {"settle": 20.0, "drop": 60.0, "lachman": 20.0}
_OTHER_FLEXION = 30.0
_MOST_TIMES = 20_000
#: Of a raised leg: flexions at which it is also held; its time, and between two rows of its tables.
_RAISED, _RAISED_S, _RAISED_EVERY_MS = "0:90:5", 20.0, 100.0
_LENGTH = "quadriceps_mm"


def read_recorded(arguments: Simulate, start_s: float) -> Recorded | None:
    """The record, which begins with the motion; None where none was asked for.

    Raises:
        InputProblem: a column that is no free coordinate, or another start.
    """
    if arguments.recorded is None:
        return None
    compared = COLUMNS[1:]
    time_s, loads, seen = read_loads_over_time(arguments.recorded, compared)
    if loads or not seen:
        expected = f"some of {', '.join(compared)}; loads stand in --loads"
        wrong = min(loads, default="time_s alone")
        raise InputProblem(str(arguments.recorded), "header", wrong, expected)
    if abs(time_s[0] - start_s) > 1e-9:
        expected = f"{start_s:g}, where the motion begins"
        raise InputProblem(str(arguments.recorded), "row 1, time_s", f"{time_s[0]:g}", expected)
    return Recorded.of_table(time_s, seen)


def fit_dampers(
    arguments: Simulate,
    moving: MovingKnee,
    recorded: Recorded,
    flexion_deg: float,
    motion: dict[str, Any],
) -> FittedTransient:
    """Find the dampers.

    Args:
        arguments: of the command; what is free begins at the options' sizes.
        moving: the knee, with these.
        recorded: the motion.
        flexion_deg: at which it begins.
        motion: options of `kneejax.experiments.beginning`.

    Raises:
        WrongValue: the motion cannot begin, or ends early with the first sizes.
    """
    usual = {"critical": 1.0, "damping_N_s_per_mm": 0.1, "dissipation_s_per_mm": 1e-3}
    first = {name: getattr(arguments, name) or usual[name] for name in arguments.free}
    with stages_on_terminal(moving.knee.name) as show:

        def report(done: int) -> None:
            show(f"{', '.join(first)} from {len(recorded.time_s)} times", done, done + 1)

        begin = beginning(moving, flexion_deg, float(recorded.time_s[0]), **motion)
        return fit_transient(
            moving, begin.start, recorded, first, loads=begin.loads, held=begin.held,
            most_mm=arguments.error_mm or MOST_ERROR_MM, progress=report,
        )  # fmt: skip


def run_in_time(arguments: Simulate) -> int:
    """Move a knee through time, with dampers from a record where one is given."""
    name = arguments.experiment
    flexion = _flexion(arguments)
    load_s, sizes, led = _loads(arguments, flexion)
    times = _times(arguments, load_s)
    motion = {
        "load_s": load_s, "sizes": sizes, "led": led, "offset": _offset(arguments),
        "flexion_is_free": name == "drop",
    }  # fmt: skip
    recorded = read_recorded(arguments, times[0])
    moving, fit = moving_knee(arguments, asked_knee(arguments)), None
    if recorded is not None:
        fit = fit_dampers(arguments, moving, recorded, flexion, motion)
        moving = fit.moving
    with moving_on_terminal(arguments, moving, times) as options:
        found = transient(moving, flexion, times, **motion, **options)
    answer = transient_answer(
        knee_words(arguments, moving.knee), name, found, recorded=recorded, fit=fit,
        convention=arguments.convention,
    )  # fmt: skip
    return deliver(answer, arguments)


@contextlib.contextmanager
def moving_on_terminal(
    arguments: Simulate, moving: MovingKnee, times: np.ndarray
) -> Iterator[dict[str, Any]]:
    """Options of a motion: how exact, and a line on the terminal, where steps stand for the time.
    """
    with stages_on_terminal(moving.knee.name) as show:

        def report(done: int) -> None:
            show(f"{times[-1] - times[0]:g} s of motion", done, max(done, len(times)))

        yield {"most_mm": arguments.error_mm or MOST_ERROR_MM, "progress": report}


def _flexion(arguments: Simulate) -> float:
    name = arguments.experiment
    if arguments.flexion is None:
        return _FLEXION.get(name, _OTHER_FLEXION)
    angles = parse_flexion(arguments.flexion)
    if len(angles) != 1:
        raise InputProblem("--flexion", "flexion", arguments.flexion, "one angle through time")
    return float(angles[0])


def _loads(arguments: Simulate, flexion: float):
    """Times, sizes of loads at these, and coordinates that are led."""
    name = arguments.experiment
    constant = {k: v for k, v in read_loads(arguments.load).items() if v}
    if arguments.loads is not None:
        load_s, sizes, led = read_loads_over_time(arguments.loads)
        both = set(constant).intersection(sizes)
        if both:
            expected = "a load in --load or in --loads"
            raise InputProblem("simulate", "--load", min(both), expected)
        sizes = {**{k: np.full_like(load_s, v) for k, v in constant.items()}, **sizes}
        return load_s, sizes, {column: (load_s, way) for column, way in led.items()}
    if name in ("settle", "drop"):
        return np.zeros(1), {k: np.full(1, v) for k, v in constant.items()}, {}
    full = constant
    if name != "load":
        asked = {k: getattr(arguments, k) for k in ("force_N", "moment_Nm")}
        asked = {k: v for k, v in asked.items() if v is not None}
        (test,) = lab_tests(name, [flexion], **asked, constant=constant)
        full = dict(test.full)
    ramp = 0.1 if arguments.ramp_s is None else arguments.ramp_s
    load_s = np.array([0.0, max(ramp, 1e-9)])
    sizes = {k: v * np.array([0.0, 1.0]) for k, v in full.items()}
    rest = {k: np.full(2, v) for k, v in constant.items() if k not in full}
    return load_s, {**sizes, **rest}, {}


def _times(arguments: Simulate, load_s: np.ndarray) -> np.ndarray:
    first = load_s[0] if arguments.loads is not None else 0.0
    usual = 2.0 if arguments.experiment == "settle" else 1.0
    usual = load_s[-1] - first if arguments.loads is not None else usual
    return first + times_of(arguments, usual, 1.0)


def times_of(arguments: Simulate, duration_s: float, every_ms: float) -> np.ndarray:
    """Rows of the tables, s, of what was asked for or else of these."""
    duration = duration_s if arguments.duration_s is None else arguments.duration_s
    every = every_ms if arguments.every_ms is None else arguments.every_ms
    count = round(duration / (1e-3 * every))
    if not 1 <= count <= _MOST_TIMES:
        expected = f"1 to {_MOST_TIMES} rows in {duration:g} s"
        raise InputProblem("--every-ms", "every_ms", f"{every:g}", expected)
    return np.linspace(0.0, duration, count + 1)


def _offset(arguments: Simulate) -> Mapping[str, float]:
    for column in arguments.offset:
        if column not in COLUMNS:
            expected = f"one of {', '.join(COLUMNS)}"
            raise InputProblem("--from", "name", column, expected, COLUMNS)
    usual = {"anterior_mm": 3.0} if arguments.experiment == "settle" else {}
    return arguments.offset or usual


def moving_knee(arguments: Simulate, knee: Knee) -> MovingKnee:
    """With the mass of a person's leg, gravity where a thigh has an attitude, and damping."""
    leg = leg_of_person(
        75.0 if arguments.body_kg is None else arguments.body_kg,
        1.75 if arguments.height_m is None else arguments.height_m,
        arguments.ankle_kg or 0.0,
    )
    attitude = arguments.femur_deg
    if attitude is None and arguments.experiment in ("drop", "leg-raise"):
        attitude = 0.0
    gravity = (0.0, 0.0, 0.0) if attitude is None else gravity_of(attitude)
    part = 1.0 if arguments.critical is None else arguments.critical
    pressed = arguments.dissipation_s_per_mm
    contacts = {name: pressed for name in knee.contact_names} if pressed else {}
    moving = MovingKnee.of(knee, leg, gravity_m_s2=gravity, contact_dissipation=contacts)
    moving = moving.critically_damped(part)
    usual = 1.0 if arguments.experiment == "settle" else 0.0
    everywhere = arguments.damping_N_s_per_mm
    return moving.damped_everywhere(usual if everywhere is None else everywhere)


def run_raised_leg(arguments: Simulate) -> int:
    """Raise the leg, and compare it with one that is held at each flexion."""
    flexion = np.sort(parse_flexion(arguments.flexion or _RAISED))[::-1]
    if len(flexion) < 4:
        expected = "four angles at least, at which the leg is also held, as 0:90:5"
        raise InputProblem("--flexion", "flexion", arguments.flexion, expected)
    lengths = _lengths(arguments)
    duration = _RAISED_S if lengths is None else lengths[0][-1] - lengths[0][0]
    times = times_of(arguments, duration, _RAISED_EVERY_MS)
    moving = moving_knee(arguments, asked_knee(arguments, patella=True))
    with moving_on_terminal(arguments, moving, times) as options:
        found = raised_leg(moving, flexion, times, lengths=lengths, **options)
    knee = knee_words(arguments, moving.knee)
    return deliver(raised_leg_answer(knee, found, arguments.convention), arguments)


def _lengths(arguments: Simulate) -> tuple[np.ndarray, np.ndarray] | None:
    """Times, from 0 on, and lengths of the quadriceps, of a file."""
    if arguments.loads is None:
        return None
    times, loads, ways = read_loads_over_time(arguments.loads, (_LENGTH,))
    if loads or _LENGTH not in ways:
        raise InputProblem(str(arguments.loads), "header", ", ".join(loads), f"time_s, {_LENGTH}")
    return times - times[0], ways[_LENGTH]
