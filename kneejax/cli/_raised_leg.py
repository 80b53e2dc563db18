"""`kneejax simulate leg-raise --dynamic`: a motor shortens the quadriceps."""

from __future__ import annotations

import numpy as np

from kneejax.cli._asked_knee import asked_knee, knee_words
from kneejax.cli._deliver import deliver
from kneejax.cli._in_time import (
    moving_knee,
    moving_on_terminal,
    times_of,
)
from kneejax.cli.options import Simulate
from kneejax.experiments import raised_leg
from kneejax.files import InputProblem, parse_flexion, read_loads_over_time
from kneejax.report import raised_leg_answer

_FLEXION, _DURATION_S, _EVERY_MS = "0:90:5", 20.0, 100.0
_LENGTH = "quadriceps_mm"


def run_raised_leg(arguments: Simulate) -> int:
    """Raise the leg, and compare it with one that is held at each flexion."""
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
