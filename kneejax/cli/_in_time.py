"""`kneejax simulate settle | drop`, and `--dynamic`: mass, damping, time; dampers of a record."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from kneejax import experiments
from kneejax.cli._deliver import deliver
from kneejax.cli._given import asked_knee, knee_words, read_loads
from kneejax.cli.options import Simulate
from kneejax.dynamics import MovingKnee, gravity_of
from kneejax.files import InputProblem, parse_flexion, read_loads_over_time
from kneejax.geometry import COLUMNS
from kneejax.inference.transients import Recorded, fit_transient
from kneejax.mechanics import Knee
from kneejax.report import raised_leg_answer, transient_answer
from kneejax.studies import stages_on_terminal

_FLEXION = {"settle": 20.0, "drop": 60.0, "lachman": 20.0}
_OTHER_FLEXION = 30.0
_MOST_TIMES = 20_000
#: Of a raised leg: flexions at which it is also held; its time, and between two rows of its tables.
_RAISED, _RAISED_S, _RAISED_EVERY_MS = "0:90:5", 20.0, 100.0
_LENGTH = "quadriceps_mm"
#: With which a search for dampers begins, where the options give none.
_FIRST = {"critical": 1.0, "damping_N_s_per_mm": 0.1, "dissipation_s_per_mm": 1e-3}


def run_in_time(arguments: Simulate) -> int:
    """Move a knee through time, with dampers from a record where one is given."""
    name, flexion = arguments.experiment, _FLEXION.get(arguments.experiment, _OTHER_FLEXION)
    if arguments.flexion is not None:
        angles = parse_flexion(arguments.flexion)
        if len(angles) != 1:
            raise InputProblem("--flexion", "flexion", arguments.flexion, "one angle through time")
        flexion = float(angles[0])
    load_s, sizes, led = _loads(arguments, flexion)
    begin_s, usual_s = 0.0, 2.0 if name == "settle" else 1.0
    if arguments.loads is not None:
        begin_s, usual_s = load_s[0], load_s[-1] - load_s[0]
    times = begin_s + _times(arguments, usual_s, 1.0)
    for column in arguments.offset:
        if column not in COLUMNS:
            raise InputProblem("--from", "name", column, COLUMNS)
    usual = {"anterior_mm": 3.0} if name == "settle" else {}
    motion = {
        "load_s": load_s, "sizes": sizes, "led": led, "offset": arguments.offset or usual,
        "flexion_is_free": name == "drop",
    }  # fmt: skip
    recorded, fit = None, None
    if arguments.recorded is not None:
        recorded = _recorded(arguments.recorded, times[0])
    moving, most_mm = _moving(arguments, asked_knee(arguments)), _most_mm(arguments)
    if recorded is not None:
        first = {name: getattr(arguments, name) or _FIRST[name] for name in arguments.free}
        what = f"{', '.join(first)} from {len(recorded.time_s)} times"
        with stages_on_terminal(moving.knee.name) as show:
            begin = experiments.beginning(moving, flexion, float(recorded.time_s[0]), **motion)
            fit = fit_transient(
                moving, begin.start, recorded, first, loads=begin.loads, held=begin.held,
                most_mm=most_mm, progress=lambda done: show(what, done, done + 1),
            )  # fmt: skip
        moving = fit.moving
    with _shown(moving, times) as progress:
        found = experiments.transient(
            moving, flexion, times, **motion, most_mm=most_mm, progress=progress
        )
    answer = transient_answer(
        knee_words(arguments, moving.knee), name, found, recorded=recorded, fit=fit,
        convention=arguments.convention,
    )  # fmt: skip
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
        asked = {k: getattr(arguments, k) for k in ("force_N", "moment_Nm")}
        asked = {k: v for k, v in asked.items() if v is not None}
        (test,) = experiments.lab_tests(name, [flexion], **asked, constant=constant)
        full = dict(test.full)
    ramp = 0.1 if arguments.ramp_s is None else arguments.ramp_s
    load_s = np.array([0.0, max(ramp, 1e-9)])
    sizes = {k: v * np.array([0.0, 1.0]) for k, v in full.items()}
    rest = {k: np.full(2, v) for k, v in constant.items() if k not in full}
    return load_s, {**sizes, **rest}, {}


def _times(arguments: Simulate, duration_s: float, every_ms: float) -> np.ndarray:
    """Rows of the tables, s, of what was asked for or else of these."""
    duration = duration_s if arguments.duration_s is None else arguments.duration_s
    every = every_ms if arguments.every_ms is None else arguments.every_ms
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


def _most_mm(arguments: Simulate) -> float:
    return arguments.error_mm or experiments.MOST_ERROR_MM


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
    part = 1.0 if arguments.critical is None else arguments.critical
    pressed = arguments.dissipation_s_per_mm
    contacts = {name: pressed for name in knee.contact_names} if pressed else {}
    leg = experiments.leg_of_person(**arguments.person)
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
    lengths, duration_s, file = None, _RAISED_S, arguments.loads
    if file is not None:  # of the quadriceps, over times that begin at 0
        read_s, loads, ways = read_loads_over_time(file, (_LENGTH,))
        if loads or _LENGTH not in ways:
            raise InputProblem(str(file), "header", ", ".join(loads), f"time_s, {_LENGTH}")
        lengths = read_s - read_s[0], ways[_LENGTH]
        duration_s = lengths[0][-1]
    times = _times(arguments, duration_s, _RAISED_EVERY_MS)
    moving = _moving(arguments, asked_knee(arguments, patella=True))
    with _shown(moving, times) as progress:
        found = experiments.raised_leg(
            moving, flexion, times, lengths=lengths, most_mm=_most_mm(arguments),
            progress=progress,
        )  # fmt: skip
    knee = knee_words(arguments, moving.knee)
    return deliver(raised_leg_answer(knee, found, arguments.convention), arguments)
