"""`kneejax simulate settle | drop`, and tests with `--dynamic`: mass, damping and time."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from kneejax.cli._asked_knee import asked_knee, knee_words
from kneejax.cli._deliver import deliver
from kneejax.cli._given import read_loads, refused
from kneejax.cli._progress import stages_on_terminal
from kneejax.cli._recorded import fit_dampers, read_recorded
from kneejax.cli.options import Simulate
from kneejax.dynamics import MovingKnee, gravity_of
from kneejax.experiments import MOST_ERROR_MM, lab_tests, leg_of_person, transient
from kneejax.files import InputProblem, parse_flexion, read_loads_over_time
from kneejax.geometry import COLUMNS
from kneejax.mechanics import Knee
from kneejax.numerics import WrongValue
from kneejax.report import transient_answer

_FLEXION = {"settle": 20.0, "drop": 60.0, "lachman": 20.0}
_OTHER_FLEXION = 30.0
_MOST_TIMES = 20_000

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

    Raises:
        InputProblem: the motion cannot begin.
    """
    with stages_on_terminal(moving.knee.name) as show:

        def told(done: int) -> None:
            show(f"{times[-1] - times[0]:g} s of motion", done, max(done, len(times)))

        try:
            yield {"most_mm": arguments.error_mm or MOST_ERROR_MM, "progress": told}
        except WrongValue as problem:
            raise refused("simulate", problem) from None


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
        try:
            (test,) = lab_tests(name, [flexion], **asked, constant=constant)
        except WrongValue as problem:
            raise refused("simulate --dynamic", problem) from None
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
