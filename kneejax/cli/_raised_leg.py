"""`kneejax simulate leg-raise --dynamic`: a motor shortens the quadriceps."""

from __future__ import annotations

import numpy as np

from kneejax.cli._asked_knee import asked_knee, knee_words
from kneejax.cli._in_time import (
    doubtful_motion,
    moving_knee,
    moving_on_terminal,
    times_of,
    write_motion,
)
from kneejax.cli.options import Simulate
from kneejax.experiments import RaisedLeg, raised_leg
from kneejax.files import InputProblem, parse_flexion, read_loads_over_time, write_rows

_FLEXION, _DURATION_S, _EVERY_MS = "0:90:5", 20.0, 100.0
_LENGTH = "quadriceps_mm"


def run_raised_leg(arguments: Simulate) -> int:
    """Raise the leg, print how far it is from one that is held, write tables and a figure."""
    flexion = np.sort(parse_flexion(arguments.flexion or _FLEXION))[::-1]
    if len(flexion) < 4:
        expected = "four angles at least, at which the leg is also held, as 0:90:5"
        raise InputProblem("--flexion", "flexion", arguments.flexion, expected)
    lengths = _lengths(arguments)
    duration = _DURATION_S if lengths is None else lengths[0][-1] - lengths[0][0]
    times = times_of(arguments, duration, _EVERY_MS)
    moving = moving_knee(arguments, asked_knee(arguments, patella=True))
    with moving_on_terminal(arguments, moving, times) as options:
        found = raised_leg(moving, flexion, times, lengths=lengths, **options)
    _report(arguments, found)
    write_motion(arguments, found.transient)
    files = "motion.csv, forces.csv, energy.csv, extensor.csv, settings.json"
    print(f"written: {arguments.out}/{files}, figures/raised_leg.png")
    return doubtful_motion(found.transient)


def _lengths(arguments: Simulate) -> tuple[np.ndarray, np.ndarray] | None:
    """Times, from 0 on, and lengths of the quadriceps, of a file."""
    if arguments.loads is None:
        return None
    times, loads, ways = read_loads_over_time(arguments.loads, (_LENGTH,))
    if loads or _LENGTH not in ways:
        raise InputProblem(str(arguments.loads), "header", ", ".join(loads), f"time_s, {_LENGTH}")
    return times - times[0], ways[_LENGTH]


def _report(arguments: Simulate, found: RaisedLeg) -> None:
    from kneejax.report import (
        EXTENSOR_COLUMNS,
        extensor_rows,
        motor_raise_figure,
        motor_raise_lines,
        save_figure,
    )

    knee = knee_words(arguments, found.transient.trajectory.moving.knee)
    title = f"{knee}: leg-raise in {found.transient.time_s[-1]:g} s"
    print(title)
    print("\n".join(motor_raise_lines(found)))
    status = np.asarray(found.held.motion.status)
    rows = extensor_rows(found.held, status)
    write_rows(arguments.out / "extensor.csv", list(EXTENSOR_COLUMNS), rows)
    folder = arguments.out / "figures"
    folder.mkdir(parents=True, exist_ok=True)
    save_figure(motor_raise_figure(found, title), folder, "raised_leg", svg=arguments.svg)
