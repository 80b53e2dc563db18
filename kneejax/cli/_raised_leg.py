"""`kneejax simulate leg-raise --dynamic`: a motor shortens the quadriceps."""

from __future__ import annotations

import argparse
import functools

import numpy as np

from kneejax.cli._given import read_pairs
from kneejax.cli._in_time import (
    check_in_time,
    doubtful_motion,
    moving_knee,
    times_of,
    told_in_time,
    write_motion,
)
from kneejax.cli._progress import stages_on_terminal
from kneejax.experiments import MOST_ERROR_MM, RaisedLeg, raised_leg
from kneejax.files import (
    InputProblem,
    knee_with,
    load_knee,
    parse_flexion,
    read_loads_over_time,
    write_rows,
)
from kneejax.parameters import cut

_FLEXION, _DURATION_S, _EVERY_MS = "0:90:5", 20.0, 100.0
_LENGTH = "quadriceps_mm"
_NOT_RAISED = ("load", "ramp_s", "offset", "force_N", "moment_Nm")


def run_raised_leg(arguments: argparse.Namespace) -> int:
    """Raise the leg, print how far it is from one that is held, write tables and a figure."""
    for option in _NOT_RAISED:
        if getattr(arguments, option) not in (None, []):
            word = {"offset": "from"}.get(option, option)
            raise InputProblem("simulate", f"--{word}", "leg-raise", "a test under load with it")
    check_in_time(arguments)
    flexion = np.sort(parse_flexion(arguments.flexion or _FLEXION))[::-1]
    if len(flexion) < 4:
        expected = "four angles at least, at which the leg is also held, as 0:90:5"
        raise InputProblem("--flexion", "flexion", arguments.flexion, expected)
    lengths = _lengths(arguments)
    duration = _DURATION_S if lengths is None else lengths[0][-1] - lengths[0][0]
    times = times_of(arguments, duration, _EVERY_MS)
    values = read_pairs("--set", arguments.values)
    knee = cut(knee_with(load_knee(arguments.knee, patella=True), values, "--set"), arguments.cut)
    moving = moving_knee(arguments, knee)
    with stages_on_terminal(knee.name) as show:
        told = functools.partial(told_in_time, show, times)
        most = arguments.error_mm or MOST_ERROR_MM
        try:
            found = raised_leg(
                moving, flexion, times, lengths=lengths, most_mm=most, progress=told
            )
        except ValueError as problem:
            raise InputProblem("simulate", "leg-raise", "--dynamic", str(problem)) from None
    _report(arguments, found)
    write_motion(arguments, found.transient)
    files = "motion.csv, forces.csv, energy.csv, extensor.csv, settings.json"
    print(f"written: {arguments.out}/{files}, figures/raised_leg.png")
    return doubtful_motion(found.transient)


def _lengths(arguments: argparse.Namespace) -> tuple[np.ndarray, np.ndarray] | None:
    """Times, from 0 on, and lengths of the quadriceps, of a file."""
    if arguments.loads is None:
        return None
    times, loads, ways = read_loads_over_time(arguments.loads, (_LENGTH,))
    if loads or _LENGTH not in ways:
        raise InputProblem(str(arguments.loads), "header", ", ".join(loads), f"time_s, {_LENGTH}")
    return times - times[0], ways[_LENGTH]


def _report(arguments: argparse.Namespace, found: RaisedLeg) -> None:
    from kneejax.report import (
        EXTENSOR_COLUMNS,
        extensor_rows,
        motor_raise_figure,
        motor_raise_lines,
        save_figure,
    )

    name = found.transient.trajectory.moving.knee.name
    without = f" without {', '.join(arguments.cut)}" if arguments.cut else ""
    title = f"{name}{without}: leg-raise in {found.transient.time_s[-1]:g} s"
    print(title)
    print("\n".join(motor_raise_lines(found)))
    status = np.asarray(found.held.motion.status)
    rows = extensor_rows(found.held, status)
    write_rows(arguments.out / "extensor.csv", list(EXTENSOR_COLUMNS), rows)
    folder = arguments.out / "figures"
    folder.mkdir(parents=True, exist_ok=True)
    save_figure(motor_raise_figure(found, title), folder, "raised_leg", svg=arguments.svg)
